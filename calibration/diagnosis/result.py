"""The result of a diagnosis. Terms are those of docs/reference/definitions.md; units are in the names."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.reduction.left_out import LeftOutReading

NONE, UNKNOWN = "none", "unknown"
FEW_COORDINATES = 3  # with which a strength differs: a departure is with one of them, or a little with all
KINDS = (
    "drive", "strut", "smr", "pose", "region", "direction", "load", "speed", "dwell", "time", "temperature", "period",
)  # fmt: skip


@dataclass(frozen=True)
class Quantity:
    """A parameter of a found effect with its standard uncertainty and SI unit."""

    name: str
    value: float
    u: float
    unit: str


@dataclass(frozen=True)
class FoundPlace:
    """One of the places at which an effect is considered present.

    place: name of a drive, strut or reflector, '' for the whole rig. probability: of the place, given the effect.
    raw_sigma, visible_sigma, others, differs_with, aliases: as those of `FoundEffect`, of what it does from here.
    at_channels: by name of the channel the RMS, over the readings that respond to it, of what the effect does there.
    """

    place: str
    size: Quantity
    probability: float
    raw_sigma: float
    visible_sigma: float
    others: tuple[Quantity, ...] = ()
    differs_with: tuple[str, ...] = ()
    aliases: tuple[float, ...] = ()
    at_channels: tuple[Quantity, ...] = ()


@dataclass(frozen=True)
class FoundEffect:
    """An effect that is considered present, at one of its places or at several.

    probability: that it is present, at any place. places: where, the strongest first; place, size, place_probability,
    others, differs_with and aliases are those of the first. raw_sigma, visible_sigma: RMS shift of the platform
    reflectors' coordinates from all places together, in units of sigma, before and after frame, reflectors and geometry
    are refitted. differs_with: coordinates with which its strength departs from the form or its general functions
    change, 'visit' from visit to visit.
    aliases: other periods in m that the readings do not exclude, the likeliest first.
    """

    effect: str
    place: str
    size: Quantity
    probability: float
    place_probability: float
    raw_sigma: float
    visible_sigma: float
    others: tuple[Quantity, ...] = ()
    differs_with: tuple[str, ...] = ()
    aliases: tuple[float, ...] = ()
    places: tuple[FoundPlace, ...] = ()


@dataclass(frozen=True)
class Share:
    """Share of the gap's variance that a non-parametric function of one coordinate predicts on withheld blocks.

    kind: one of KINDS; name: of the coordinate ('left', 'x', 'tool'); low, high: 95 % interval.
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

    @property
    def grows(self) -> bool:
        """Whether withheld readings are predicted worse with the effects than without."""
        return self.shrink < 0.0 or self.shrink_interval[1] < 0.0

    def without_effect(self) -> GapFigures:
        """The figures if no effect is added: after equals before, and nothing shrinks; of no gap that is undefined."""
        shrink = 0.0 if self.before_m > 0.0 else math.nan
        return replace(self, after_m=self.before_m, shrink=shrink, shrink_interval=(shrink, shrink))


@dataclass(frozen=True)
class Withheld:
    """Predictions (k, 3), station's frame, of withheld readings: rows (k,) of the recording as it was passed in.

    Every platform reflector's reading is predicted once, without its block.
    """

    rows: NDArray[np.intp]
    before_m: Array
    after_m: Array


@dataclass(frozen=True)
class VisitGaps:
    """For pictures, one row per visit: tool (v, 3), gaps of the platform before and after (v, 3), machine frame, m.

    times_known: whether t_rig_s is more than a count.
    """

    tool_m: Array
    before_m: Array
    after_m: Array
    t_rig_s: Array
    drives: Array
    direction: Array
    payload_kg: Array
    dwell_s: Array
    times_known: bool = True


@dataclass(frozen=True)
class Spectrum:
    """Power of the gap along a drive over that of noise, by spatial period, the longest first."""

    drive: str
    period_m: Array
    power: Array


@dataclass(frozen=True)
class ProposedVisit:
    """A visit to be measured: tool pose (6,) as x, y, z and rotation vector, and the approach to it."""

    target_m: tuple[float, ...]
    direction: tuple[int, ...]
    payload: int
    speed_m_per_s: float
    dwell_s: float


@dataclass(frozen=True)
class CampaignAddition:
    """A proposed addition to the campaign; visits may be empty, for instance if reflectors are to be added.

    adds: the addition in words; settles: names of effects that it would distinguish; gain_bit: expected information on
    the cause.
    """

    name: str
    adds: str
    settles: tuple[str, ...]
    minutes: float
    gain_bit: float
    visits: tuple[ProposedVisit, ...]

    @property
    def gain_bit_per_min(self) -> float:
        """Expected information per minute; additions are ranked by it."""
        return self.gain_bit / self.minutes


@dataclass(frozen=True)
class Clue:
    """Where an unknown effect acts and on what it depends: a channel of the machine, a coordinate, its share."""

    channel: str
    coordinate: str
    share: float


@dataclass(frozen=True)
class KeptEvidence:
    """What the probabilities of a verdict are computed from (`verdict.verdict_probabilities`).

    log_evidence: of each effect alone; explained: of the causes together; excess: what non-parametric alternatives have
    more; none_elsewhere: of `none` at other levels of the disturbances; departure_gain: of `explained`, what smooth
    departures of the causes from their forms add.
    """

    log_evidence: Mapping[str, float]
    explained: float
    excess: float
    none_elsewhere: float
    departure_gain: float = 0.0


@dataclass(frozen=True)
class Diagnosis:
    """The whole result. verdict: name of an effect, NONE or UNKNOWN.

    equivalent: other effects that the data cannot distinguish from the verdict; matters_m: largest RMS difference of
    their predictions. effects: those considered present, the strongest first, at most three (empty for NONE and
    UNKNOWN). ranking: probability by name, NONE and UNKNOWN included; they add up to one. not_tested: reason by name.
    hidden_m: detection limit, the RMS that an undetected effect could still have (95 %). inside_geometry: RMS in m by
    name of what the geometry has absorbed. where: empty for NONE, whose gap is noise. clues: of an unknown effect.
    evidence: what the ranking follows from. left_out: readings that were wrong by what all others say.
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
    next_measurement: tuple[CampaignAddition, ...]
    withheld: Withheld
    visits: VisitGaps
    spectra: tuple[Spectrum, ...]
    remarks: tuple[str, ...] = ()
    evidence: KeptEvidence | None = None
    left_out: tuple[LeftOutReading, ...] = ()
