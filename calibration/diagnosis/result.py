"""What a diagnosis says. Terms are those of docs/reference/definitions.md; units are in the names."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array

NONE, UNKNOWN = "none", "unknown"
KINDS = (
    "drive",
    "strut",
    "smr",
    "pose",
    "region",
    "direction",
    "load",
    "speed",
    "dwell",
    "time",
    "temperature",
    "period",
)


@dataclass(frozen=True)
class Quantity:
    """A parameter of a found effect with its standard uncertainty and SI unit."""

    name: str
    value: float
    u: float
    unit: str


@dataclass(frozen=True)
class FoundEffect:
    """An effect that is taken to be there: the first quantity is its size.

    place: name of a drive, strut or reflector, '' for the whole rig. probability: that this effect, at whatever
    place, is there. raw_sigma, visible_sigma: RMS over the platform reflectors' coordinates, in units of sigma, of what
    it does before and after frame, reflectors and geometry are fitted again.
    """

    effect: str
    place: str
    size: Quantity
    probability: float
    place_probability: float
    raw_sigma: float
    visible_sigma: float
    others: tuple[Quantity, ...] = ()


@dataclass(frozen=True)
class Share:
    """Part of the gap's variance that a form-free function of one coordinate predicts on withheld blocks.

    kind: one of KINDS; name: which one of them ('left', 'x', 'tool'); low, high: 95 % interval.
    """

    kind: str
    name: str
    share: float
    low: float
    high: float


@dataclass(frozen=True)
class GapFigures:
    """RMS over the platform reflectors' coordinates of the model's error on withheld blocks, noise floor removed."""

    before_m: float
    after_m: float
    noise_floor_m: float
    shrink: float
    shrink_interval: tuple[float, float]
    withheld: str


@dataclass(frozen=True)
class Withheld:
    """Predictions (k, 3), station's frame, of readings that were not used: rows (k,) of the recording as it was given.

    Every platform reflector's reading is predicted once, its block left out.
    """

    rows: NDArray[np.intp]
    before_m: Array
    after_m: Array


@dataclass(frozen=True)
class VisitGaps:
    """For pictures, one row a visit: tool (v, 3), gaps of the platform before and after (v, 3), machine frame, in m."""

    tool_m: Array
    before_m: Array
    after_m: Array
    t_rig_s: Array
    drives: Array
    direction: Array
    payload_kg: Array
    dwell_s: Array


@dataclass(frozen=True)
class Spectrum:
    """Power of the gap along a drive by spatial period, largest first period first; over the power of noise."""

    drive: str
    period_m: Array
    power: Array


@dataclass(frozen=True)
class PlannedVisit:
    """A visit to measure: tool pose (6,) as x, y, z and rotation vector, and how to come there."""

    target_m: tuple[float, ...]
    direction: tuple[int, ...]
    payload: int
    speed_m_per_s: float
    dwell_s: float


@dataclass(frozen=True)
class Candidate:
    """An addition to the campaign and what it would tell. visits may be empty where a reflector is to be added.

    adds: what is new in words; settles: the names it would tell apart; gain_bit: expected information on the cause.
    """

    name: str
    adds: str
    settles: tuple[str, ...]
    minutes: float
    gain_bit: float
    visits: tuple[PlannedVisit, ...]

    @property
    def gain_bit_per_min(self) -> float:
        """By which candidates are ranked."""
        return self.gain_bit / self.minutes


@dataclass(frozen=True)
class Clue:
    """Where an unknown effect lives and on what it depends: a channel of the machine, a coordinate, its share."""

    channel: str
    coordinate: str
    share: float


@dataclass(frozen=True)
class Diagnosis:
    """All of it. verdict: name of an effect, NONE or UNKNOWN.

    equivalent: other names that the data cannot tell from the verdict; matters_m: how far apart their predictions are
    at most, RMS. effects: those taken to be there, strongest first, at most three (empty for NONE and UNKNOWN).
    ranking: probability by name, NONE and UNKNOWN included, adding up to one. not_tested: name to reason. hidden_m:
    RMS that an effect could have and still hide (95 %). inside_geometry: RMS in m by name of what is taken into the
    geometry. where: empty for NONE, whose gap is noise. clues: of an unknown effect.
    """

    campaign: str
    verdict: str
    equivalent: tuple[str, ...]
    matters_m: float
    effects: tuple[FoundEffect, ...]
    ranking: Mapping[str, float]
    where: tuple[Share, ...]
    gap: GapFigures
    not_tested: Mapping[str, str]
    hidden_m: float
    inside_geometry: Mapping[str, float]
    clues: tuple[Clue, ...]
    next_measurement: tuple[Candidate, ...]
    withheld: Withheld
    visits: VisitGaps
    spectra: tuple[Spectrum, ...]
    remarks: tuple[str, ...] = ()
