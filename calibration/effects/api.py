"""What a catalogue effect is: a name, a place, a size with its range, and the forms that its physics may take.

A form is a set of columns: functions of the readings' moments that act on the machine through channels
(docs/reference/effects.md). Its unknown coefficients are normal with standard deviations relative to the size, which
itself is unknown over its plausible range. The first column carries the size: one unit of it is one unit of the size.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.basis_functions import centred
from calibration.effects.context import Moments
from calibration.machine.description import Machine
from calibration.recording.header import DisturbanceLevels

Place = Literal["drive", "strut", "smr", "rig"]
Measured = Literal["norm", "sum", "rms", "range"]
Acts = tuple[tuple[str, Array], ...]
OnCurve = tuple[int, tuple[float, ...]]  # number of a curve, parameters

ABOVE_DECLARED = 2.0
FLEXIBLE = 0.3  # standard deviation of what a real part adds to the textbook's form, relative to the size


@dataclass(frozen=True)
class Parameter:
    """A number of an effect, its plausible range and its SI unit ('1' for a ratio)."""

    name: str
    low: float
    high: float
    unit: str
    meaning: str


@dataclass(frozen=True)
class Form:
    """One way in which an effect may act: numbers of its columns, standard deviations relative to the size.

    parameters: values of the effect's other parameters in this form. curve: which of the effect's curves it belongs to,
    and where on it, if it was found by fitting again; size: weights with which the first coefficients then add up to
    the size.
    """

    columns: tuple[int, ...]
    relative: tuple[float, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)
    weight: float = 1.0
    curve: OnCurve | None = None
    size: tuple[float, ...] = ()


class Forms:
    """The columns and forms of an effect at one place."""

    def __init__(self) -> None:
        self.acts: list[Acts] = []
        self.forms: list[Form] = []

    def add(self, *acts: tuple[str, Array]) -> list[int]:
        """Columns through one or several channels at once, (n,) or (n, k) each; their numbers."""
        wide = [(channel, shape[:, None] if shape.ndim == 1 else shape) for channel, shape in acts]
        first = len(self.acts)
        for k in range(wide[0][1].shape[1]):
            self.acts.append(tuple((channel, shape[:, k]) for channel, shape in wide))
        return list(range(first, len(self.acts)))

    def form(
        self,
        main: Sequence[int],
        flexible: Sequence[int] = (),
        *,
        share: float = FLEXIBLE,
        weight: float = 1.0,
        **parameters: float,
    ) -> None:
        """A form of main columns, and the same with flexible ones of a smaller size."""
        self.forms.append(Form(tuple(main), (1.0,) * len(main), parameters, weight))
        if flexible:
            relative = (1.0,) * len(main) + (share,) * len(flexible)
            self.forms.append(Form((*main, *flexible), relative, parameters, weight))


@dataclass(frozen=True)
class Tangent:
    """A curve near one of its points: columns, the first what it does there and then one by each parameter (p).

    relative (1 + p,): standard deviations, relative to the size, for which the tangent is good; units (p,): of the
    parameters by which their coefficients over the size count. size: weights with which the first coefficients add up
    to the size. step: by how much coefficients (1 + p,) move the point (p,).
    """

    acts: tuple[Acts, ...]
    relative: tuple[float, ...]
    units: tuple[float, ...]
    size: tuple[float, ...]
    step: Callable[[Array], Array]


@dataclass(frozen=True)
class Curve:
    """Forms that are not linear in their parameters (p): fitted again and again, from several starts (m, p).

    The first parameter carries the size. low, high (p,): limits; spread (p,): standard deviations about zero, infinite
    where limits are all that is known.
    """

    starts: Array
    low: Array
    high: Array
    spread: Array
    tangent: Callable[[Array], Tangent]


@dataclass(frozen=True)
class Setting:
    """What an effect may know: the machine, the moments of the readings, and forces of the fitted model.

    tension_n (n, s): of the struts; answer_n_per_m (n, s, s): change of each one's with the length of each; pull_n
    (n, d, 3), moment_nm (n, d): of the struts on each slider, about the middle of its joints; sight_m (n, 3): the
    measured points in the station's frame. periods: spatial periods within limits in m that stand out at a drive, each
    with its prior probability among all that the data could tell apart; onsets: the same of moments, in s since the
    beginning, from which on something stays changed at some channels.
    """

    machine: Machine
    moments: Moments
    tension_n: Array
    answer_n_per_m: Array
    pull_n: Array
    moment_nm: Array
    sight_m: Array
    channels: tuple[str, ...]
    periods: Callable[[int, float, float], Sequence[tuple[float, float]]]
    onsets: Callable[[Sequence[str]], Sequence[tuple[float, float]]]

    def drive(self, index: int) -> str:
        """Name of a drive."""
        return self.machine.drive_names[index]

    def partners(self, index: int) -> tuple[int, ...]:
        """The other drives."""
        return tuple(i for i in range(len(self.machine.drive_names)) if i != index)

    def of_drive(self, kind: str, index: int) -> tuple[str, ...]:
        """Channels of a kind ('sideways', 'turn') at a drive."""
        return tuple(c for c in self.channels if c.startswith(f"{kind}.{self.drive(index)}."))

    def middle_m(self, index: int) -> tuple[float, float]:
        """Middle and half width of the part of a drive's travel that was used."""
        q = self.moments.drives[:, index]
        low, high = float(q.min()), float(q.max())
        return 0.5 * (low + high), max(0.5 * (high - low), 1e-9)

    def along(self, index: int) -> Array:
        """A drive's coordinate (n,) on [-1, 1]."""
        return centred(self.moments.drives[:, index])

    def height_m(self, index: int) -> Array:
        """Height (n,) of a slider along its axis over the floor nests, or over the lowest place it may reach."""
        axis = self.machine.nominal.axis[index]
        struts = np.flatnonzero(self.machine.strut_drive == index)
        joint = self.machine.nominal.base_joint_m[struts].mean(axis=0) @ axis
        floor = [s.position_m @ axis for s in self.machine.smrs if s.on == "floor"]
        lowest = min(floor) if floor else joint + self.machine.travel[index, 0] - 1.0
        return np.asarray(self.moments.drives[:, index] + joint - lowest)

    @cached_property
    def load(self) -> Array:
        """Payload (n,) over the largest one."""
        most = float(self.moments.payload_kg.max())
        return self.moments.payload_kg / most if most > 0.0 else np.zeros(len(self.moments))


@dataclass(frozen=True)
class Effect:
    """An entry of the catalogue.

    size: its first parameter; others follow. reveals: what in a campaign shows it. confounded: names of effects that
    look alike. forms: builds the forms at a place (index among drives, struts or platform reflectors; 0 for the rig).
    untested: why a campaign cannot show it, or None. declared: what of it a recording may declare as ordinary, in the
    size's unit: only what exceeds that twice is the effect. curves: forms that take longer, looked at where those of
    `forms` say something. measured: what the size of several main columns together
    is: the norm of their coefficients, their sum, or RMS or range over the readings of what they do at their channel.
    """

    name: str
    place: Place
    size: Parameter
    reveals: str
    confounded: tuple[str, ...]
    forms: Callable[[Setting, int], Forms]
    others: tuple[Parameter, ...] = ()
    untested: Callable[[Setting], str | None] = lambda setting: None
    declared: Callable[[DisturbanceLevels], float] = lambda nuisance: 0.0
    measured: Measured = "norm"
    curves: Callable[[Setting, int], Sequence[Curve]] = lambda setting, place: ()

    def acts(self, setting: Setting, place: int, curve: OnCurve | None = None) -> tuple[Acts, ...]:
        """The columns of its forms in a setting, or those of a curve's tangent."""
        if curve is None:
            return tuple(self.forms(setting, place).acts)
        number, at = curve
        chosen = self.curves(setting, place)[number]
        if len(at) != len(chosen.low):
            raise ValueError(f"'{self.name}' has {len(chosen.low)} parameters on its curve {number}, not {len(at)}")
        return chosen.tangent(np.clip(at, chosen.low, chosen.high)).acts

    def smallest(self, nuisance: DisturbanceLevels) -> float:
        """The smallest size that is this effect and not the declared wander of its rig."""
        return min(max(self.size.low, ABOVE_DECLARED * self.declared(nuisance)), 0.5 * self.size.high)

    def places(self, machine: Machine) -> tuple[str, ...]:
        """Names of the places where it may be."""
        if self.place == "drive":
            return machine.drive_names
        if self.place == "strut":
            return machine.strut_names
        if self.place == "smr":
            return tuple(s.name for s in machine.smrs if s.on == "platform")
        return ("",)


def ladder(low: float, high: float, count: int) -> list[float]:
    """Values at equal ratios."""
    return [float(x) for x in np.geomspace(low, high, count)]


def varied(x: Array, least: float) -> bool:
    """Whether a coordinate takes values at least so far apart."""
    return bool(np.ptp(x) >= least)


def strongest_onset(onsets: Sequence[tuple[float, float]]) -> dict[str, float]:
    """The parameter `onset_s` of a form that tells of no single moment: when most of it happened."""
    return {"onset_s": onsets[0][0]} if onsets else {}
