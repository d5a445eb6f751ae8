"""The interface of a catalogue effect: its name, place, size with range, and the basis sets that its physics may take.

A basis set is a list of columns: functions of the readings' context that act on the machine through channels
(docs/reference/effects.md). Its unknown coefficients are normally distributed with standard deviations relative to the
size, which itself is unknown within its plausible range. The first column carries the size: a coefficient of one is a
size of one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, Protocol, TypeVar

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.basis_functions import scale_to_symmetric
from calibration.effects.basis_sets import BasisSet, BasisSets, Curve, CurvePoint, Departure, Tangent, Tangents
from calibration.effects.columns import Contributions
from calibration.effects.context import ReadingContext
from calibration.effects.former_names import former_name
from calibration.machine.description import Machine
from calibration.model.payload import PayloadEntry
from calibration.recording.header import DisturbanceLevels

__all__ = [
    "PERIOD",
    "BasisSet",
    "BasisSets",
    "Coordinate",
    "Curve",
    "CurvePoint",
    "Departure",
    "Effect",
    "EffectInputs",
    "EffectParameter",
    "Periods",
    "Tangent",
    "Tangents",
    "Textbook",
    "geometric_series",
    "strongest_onset",
    "varies",
]

Place = Literal["drive", "strut", "smr", "rig"]
Coordinate = Literal[
    "own travel", "other travel", "side", "approach", "payload", "rest", "speed", "time", "course", "way", "warmth",
    "temperature", "phase",
]  # fmt: skip
T = TypeVar("T")
SizeMeasure = Literal["norm", "norm of channels", "sum", "rms", "range"]

PERIOD = "period_m"  # name of the parameter in which a phase is one
MIN_RATIO_TO_DECLARED = 2.0
MIN_RATIO_TO_STATED_U = 3.0  # of a stated value: less is within its uncertainty, and calibrated


@dataclass(frozen=True)
class EffectParameter:
    """A parameter of an effect with its plausible range and its SI unit ('1' for a ratio)."""

    name: str
    low: float
    high: float
    unit: str
    meaning: str
    aliased: bool = False
    """Whether values that are far apart may look alike, so that others than the likeliest are listed."""


@dataclass(frozen=True)
class Textbook:
    """The form of an effect that textbooks give, and where it stands."""

    form: str
    source: str


class Periods(Protocol):
    """The question that `EffectInputs.periods` answers."""

    def __call__(
        self, drive: int, shortest_m: float, longest_m: float, over: tuple[float, ...] = (), /
    ) -> Sequence[tuple[float, float]]:
        """Periods in m with the prior of each; over (d,): weights of the drives' coordinates, none for its own."""


@dataclass(frozen=True)
class EffectInputs:
    """Everything that an effect may use: the machine, the context of the readings, forces of the fitted model.

    tension_n (n, s): of the struts; tension_response_n_per_m (n, s, s): change of each strut's tension with the length
    of each; payload_elongation_m (n, s) by channel of the payload: of each strut by one unit of it;
    pull_n (n, d, 3), moment_nm (n, d): of the struts on each slider, about the middle of its joints; sight_m
    (n, 3): the measured points in the station's frame. periods: of what errs along a drive, between a shortest and a
    longest in m, the most prominent spatial periods over its coordinate, or over all drives' coordinates each times its
    weight (d,), with the prior probability of each; onsets: of some channels, the most likely times,
    in s since the campaign's start, of a lasting change, also with prior probabilities; strength_onsets: the same of a
    lasting change of a column's strength, by a name of the column that no other has.
    """

    machine: Machine
    context: ReadingContext
    tension_n: Array
    tension_response_n_per_m: Array
    pull_n: Array
    moment_nm: Array
    sight_m: Array
    channels: tuple[str, ...]
    periods: Periods
    onsets: Callable[[Sequence[str]], Sequence[tuple[float, float]]]
    payload_elongation_m: Mapping[str, Array] = field(default_factory=dict)
    strength_onsets: Callable[[str, Contributions], Sequence[tuple[float, float]]] = lambda name, column: ()

    def drive(self, index: int) -> str:
        """Name of a drive."""
        return self.machine.drive_names[index]

    def other_drives(self, index: int) -> tuple[int, ...]:
        """Indices of all drives but one."""
        return tuple(i for i in range(len(self.machine.drive_names)) if i != index)

    def pull_along_n(self, index: int) -> Array:
        """What the struts pull on a drive along its axis (n,)."""
        return np.asarray(self.pull_n[:, index] @ self.machine.nominal.axis[index])

    def channels_of_drive(self, kind: str, index: int) -> tuple[str, ...]:
        """Channels of a kind ('sideways', 'turn') at a drive."""
        return tuple(c for c in self.channels if c.startswith(f"{kind}.{self.drive(index)}."))

    def leaning(self, index: int) -> tuple[tuple[str, str, float], ...]:
        """Pairs of channels by which a column leans: sideways, the rotation that goes with it, and the sign of that
        rotation (right-hand rule, ISO 230-1), for guides along an axis of the machine.

        A rotation about w moves what is ahead along the guide's axis a towards w x a, which is across the guide.
        """
        axis = self.machine.nominal.axis[index]
        turns = {channel[-1]: channel for channel in self.channels_of_drive("turn", index)}
        out = []
        for side in self.channels_of_drive("sideways", index):
            about = np.cross(axis, np.eye(3)["xyz".index(side[-1])])
            letter = "xyz"[int(np.argmax(np.abs(about)))]
            if letter in turns:
                out.append((side, turns[letter], float(np.sign(about["xyz".index(letter)]))))
        return tuple(out)

    def travel_range_m(self, index: int) -> tuple[float, float]:
        """Middle and half width of the part of a drive's travel that was used."""
        q = self.context.drives[:, index]
        low, high = float(q.min()), float(q.max())
        return 0.5 * (low + high), max(0.5 * (high - low), 1e-9)

    def normalised_travel(self, index: int) -> Array:
        """A drive's coordinate (n,) scaled to [-1, 1]."""
        return scale_to_symmetric(self.context.drives[:, index])

    def height_m(self, index: int) -> Array:
        """Height (n,) of a slider along its axis above the floor nests, or above the lowest point of its travel."""
        axis = self.machine.nominal.axis[index]
        struts = np.flatnonzero(self.machine.strut_drive == index)
        joint = self.machine.nominal.base_joint_m[struts].mean(axis=0) @ axis
        floor = [smr.position_m @ axis for smr in self.machine.smrs if smr.on == "floor"]
        lowest = min(floor) if floor else joint + self.machine.travel[index, 0] - 1.0
        return np.asarray(self.context.drives[:, index] + joint - lowest)

    def once(self, key: Hashable, make: Callable[[], T]) -> T:
        """What `make` returns, which depends on these inputs and the key only: computed at the first call."""
        if key not in self._computed:
            self._computed[key] = make()
        value: T = self._computed[key]
        return value

    @cached_property
    def _computed(self) -> dict[Hashable, Any]:
        return {}

    @cached_property
    def payload_ratio(self) -> Array:
        """Payload (n,) over the largest one of the campaign; zeros without payload."""
        largest = float(self.context.payload_kg.max())
        return self.context.payload_kg / largest if largest > 0.0 else np.zeros(len(self.context))

    moments = former_name("context")
    load = former_name("payload_ratio")
    answer_n_per_m = former_name("tension_response_n_per_m")
    along = former_name("normalised_travel")
    middle_m = former_name("travel_range_m")
    partners = former_name("other_drives")
    of_drive = former_name("channels_of_drive")


@dataclass(frozen=True)
class Effect:
    """An entry of the catalogue.

    size: its first parameter; others follow. reveals: what in a campaign shows it. confounded: names of effects that
    look alike. forms: builds the basis sets at a place (index among drives, struts or platform reflectors; 0 for the
    rig). untested: why a campaign cannot show it, or None. declared: how much of it levels of disturbances make
    ordinary, in the size's unit: only more than twice as much is the effect. stated_u: standard uncertainty that the
    machine file and the payloads state of what is wrong, in the size's unit: only more than three times as much is the
    effect. curves: families of columns that are not linear in their parameters; fitted only where the basis sets have
    evidence. measured: how the size follows from several main columns: the norm of their coefficients, or of their RMS
    at each channel, their sum, or RMS or range over the readings of what they contribute at their channel.
    differs_by_visit: whether what one stop leaves of it the next one may not; of a drive's, where that comes with the
    side of the approach. anew_by_visit: name of the form of which
    each visit may leave anything, in the direction of each of its columns, rather than a share; empty if none.
    varies_with: coordinates on which its strength may depend wholly; on any other it may depend a little.
    functions_vary_with: coordinates with which its general functions may change, as the line of a guide does with
    the way that its cage has crept. textbook: the form that is never left out (`without_forms`); None for an effect
    that is general functions only. order: position in the shipped catalogue and in its lists; a user's effect comes
    after all shipped ones.
    """

    name: str
    place: Place
    size: EffectParameter
    reveals: str
    confounded: tuple[str, ...]
    forms: Callable[[EffectInputs, int], BasisSets]
    others: tuple[EffectParameter, ...] = ()
    untested: Callable[[EffectInputs], str | None] = lambda inputs: None
    declared: Callable[[DisturbanceLevels], float] = lambda nuisance: 0.0
    measured: SizeMeasure = "norm"
    curves: Callable[[EffectInputs, int], Sequence[Curve]] = lambda inputs, place: ()
    textbook: Textbook | None = None
    differs_by_visit: bool = False
    anew_by_visit: str = ""
    varies_with: tuple[Coordinate, ...] = ()
    functions_vary_with: tuple[Coordinate, ...] = ()
    order: float = math.inf
    stated_u: Callable[[Machine, Sequence[PayloadEntry]], float] = field(
        default=lambda machine, payloads: 0.0, kw_only=True
    )

    def __post_init__(self) -> None:
        """Raise ValueError for a phase that would be ignored."""
        if "phase" in self.functions_vary_with:
            raise ValueError(f"'{self.name}': general functions have no phase; name it in varies_with")
        repeats = self.place == "drive" and any(p.name == PERIOD for p in (self.size, *self.others))
        if "phase" in self.varies_with and not repeats:
            raise ValueError(f"'{self.name}': a phase needs the place drive and a parameter {PERIOD}")

    def contributions(
        self, inputs: EffectInputs, place: int, curve: CurvePoint | None = None
    ) -> tuple[Contributions, ...]:
        """The columns of its basis sets at a place, or those of the tangent at a point of one of its curves."""
        if curve is None:
            return tuple(self.forms(inputs, place).contributions)
        number, parameters = curve
        chosen = self.curves(inputs, place)[number]
        if len(parameters) != len(chosen.low):
            raise ValueError(
                f"'{self.name}' has {len(chosen.low)} parameters on its curve {number}, not {len(parameters)}"
            )
        return chosen.at_readings(chosen.tangent(np.clip(parameters, chosen.low, chosen.high)))

    def basis_sets(self, inputs: EffectInputs, place: int) -> BasisSets:
        """Its basis sets at a place, built once for the inputs."""
        _, built = inputs.once(
            (id(self), place), lambda: (self, self.forms(inputs, place))
        )  # self: so that the id lasts
        return built

    def curves_at(self, inputs: EffectInputs, place: int) -> Sequence[Curve]:
        """Its curves at a place, built once for the inputs."""
        _, built = inputs.once(("curves", id(self), place), lambda: (self, self.curves(inputs, place)))
        return built

    def without_forms(self, names: Collection[str]) -> Effect:
        """The effect without some of its forms; general functions and the textbook's form stay."""
        left_out = set(names) - ({self.textbook.form} if self.textbook else set()) - {""}
        if not left_out:
            return self
        forms, curves = self.forms, self.curves
        return replace(
            self,
            forms=lambda inputs, place: forms(inputs, place).without_forms(left_out),
            curves=lambda inputs, place: tuple(c for c in curves(inputs, place) if c.form not in left_out),
        )

    def smallest_size(self, nuisance: DisturbanceLevels, stated_u: float = 0.0) -> float:
        """The smallest size that counts as this effect and not as a disturbance that the recording declares, nor as
        the stated uncertainty of a value."""
        ordinary = max(MIN_RATIO_TO_DECLARED * self.declared(nuisance), MIN_RATIO_TO_STATED_U * stated_u)
        return min(max(self.size.low, ordinary), 0.5 * self.size.high)

    def places(self, machine: Machine) -> tuple[str, ...]:
        """Names of the places where it may be."""
        if self.place == "drive":
            return machine.drive_names
        if self.place == "strut":
            return machine.strut_names
        if self.place == "smr":
            return tuple(smr.name for smr in machine.smrs if smr.on == "platform")
        return ("",)


def geometric_series(low: float, high: float, count: int) -> list[float]:
    """Values at equal ratios."""
    return [float(x) for x in np.geomspace(low, high, count)]


def varies(x: Array, least: float) -> bool:
    """Whether the values of a coordinate span at least so much."""
    return bool(np.ptp(x) >= least)


def strongest_onset(onsets: Sequence[tuple[float, float]]) -> dict[str, float]:
    """The parameter `onset_s` of a basis set without a single onset of its own: the time of the largest change."""
    return {"onset_s": onsets[0][0]} if onsets else {}
