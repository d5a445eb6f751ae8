"""The result of the diagnosis of one axis. Terms: docs/reference/definitions.md and axis-effects.md; SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from calibration.axis.model import AxisModel
from calibration.base.arrays import Array
from calibration.diagnosis.result import Quantity
from calibration.recording.axis_wrong_samples import WrongSamples


@dataclass(frozen=True)
class AxisEffectFound:
    """An effect that is considered present.

    contribution: by how much the RMS of what remains grows without it, quadratically: sqrt(without^2 - with^2).
    """

    effect: str
    size: Quantity
    probability: float
    contribution: float
    others: tuple[Quantity, ...]


@dataclass(frozen=True)
class AxisGap:
    """RMS of the gap on withheld stretches of time, noise floor removed, without and with the effects; the shrink."""

    before: float
    after: float
    noise_floor: float
    shrink: float
    shrink_interval: tuple[float, float]
    withheld: str


@dataclass(frozen=True)
class AxisDiagnosis:
    """The whole result. verdict: name of an effect, NONE or UNKNOWN.

    unit: of positions, rad or m, in which matters, contributions, gap and hidden are. equivalent: other effects that
    the data cannot distinguish from the verdict; matters: largest RMS difference of their predictions. effects: the
    main one first. ranking: probability by name of being the main cause. following_delay: by how much the motor is
    later than the command, where that was recorded. clues: share by coordinate of an unknown effect. frequency_hz,
    noise: density of the noise left, unit per root Hz. model: predicts the gap of other recordings of the drive.
    left_out: wrong samples, in the order of time.
    """

    recording: str
    simulated: bool
    unit: str
    verdict: str
    equivalent: tuple[str, ...]
    matters: float
    effects: tuple[AxisEffectFound, ...]
    ranking: Mapping[str, float]
    gap: AxisGap
    not_tested: Mapping[str, str]
    hidden: float
    clues: Mapping[str, float]
    following_delay: Quantity | None
    frequency_hz: Array
    noise: Array
    remaining: Array
    model: AxisModel
    remarks: tuple[str, ...] = ()
    left_out: tuple[WrongSamples, ...] = ()
