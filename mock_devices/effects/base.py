"""The parts of every effect: named parameters, a place, a variant, and what it acts on.

An effect receives states of motion (when the drives stood where, how they came there, how warm everything was) and
changes a deviation: what differs from the machine without it. It draws from its own seed only and keeps its own
history.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mock_devices.effects.state import Array, Complex, Deviation, Law, Leg, MotionState, StationSight
from mock_devices.known_tables import KnownTable
from mock_devices.machine_file import MachineFile, Vector3

Place = Literal["drive", "strut", "smr", "rig"]
Kind = Literal["catalogue", "geometry", "outside", "nuisance"]

GRAVITY_M_PER_S2 = 9.80665


@dataclass(frozen=True)
class EffectParameter:
    """A number of an effect: its unit is the end of its name; `typical` is the default."""

    name: str
    low: float
    typical: float
    high: float
    meaning: str

    @property
    def middle(self) -> float:
        """The middle of the range on a logarithmic scale."""
        return float(np.sqrt(self.low * self.high)) if self.low > 0.0 else 0.5 * (self.low + self.high)


ONSET = EffectParameter("onset_s", 0.0, 2400.0, 7200.0, "after the campaign's begin")


@dataclass(frozen=True)
class EffectSpec:
    """One entry of the catalogue. The first parameter is the size: zero means no effect.

    `final` names the variant that only a final scoring uses; `final_only`: it uses the whole effect alone.
    """

    name: str
    kind: Kind
    place: Place
    size: EffectParameter
    variants: tuple[str, ...]
    final: str
    reveals: str
    make: Callable[[EffectArguments], Effect]
    others: tuple[EffectParameter, ...] = ()
    final_only: bool = False

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        """All parameters, the size first."""
        return (self.size, *self.others)


@dataclass(frozen=True)
class EffectChoice:
    """An effect as chosen: plain data. Omitted parts take the typical value, the first place and the first variant."""

    name: str
    size: float
    place: str = ""
    variant: str = ""
    parameters: tuple[tuple[str, float], ...] = ()
    seed: int = 0


@dataclass(frozen=True)
class Site:
    """What an effect may know of the rig: the nominal machine, the station's place, when the campaign begins, and
    the compensation tables that are on record."""

    machine: MachineFile
    station_m: Vector3
    start_s: float = 0.0
    known_tables: tuple[KnownTable, ...] = ()

    def drive_range_m(self, drive: int) -> tuple[float, float]:
        """Middle and half width of a drive's travel."""
        low, high = self.machine.sliders[drive].travel_m
        return 0.5 * (low + high), 0.5 * (high - low)


@dataclass(frozen=True)
class EffectArguments:
    """What an effect is made from: a choice with all its numbers, its place as an index, its own generator."""

    site: Site
    place: int
    variant: str
    values: dict[str, float]
    rng: np.random.Generator


class Effect:
    """One effect at one place. The defaults do nothing."""

    def __init__(self, arguments: EffectArguments) -> None:
        self.site, self.place, self.variant = arguments.site, arguments.place, arguments.variant
        self.values, self.rng = arguments.values, arguments.rng
        self.size = next(iter(arguments.values.values()))
        self.setup()

    def setup(self) -> None:
        """Draw what is fixed from now on."""

    def record_leg(self, drive: int, leg: Leg) -> None:
        """A leg of a drive and the dwell after it have ended."""

    def early_s(self, state: MotionState) -> Array | float:
        """By how much the drives are observed later than the station."""
        return 0.0

    def act(self, state: MotionState, deviation: Deviation) -> None:
        """Change the machine."""

    def apply_to_sight(self, state: MotionState, sight: StationSight) -> None:
        """Change what the station sees."""

    def elapsed_s(self, state: MotionState) -> Array:
        """Time since the campaign began."""
        return np.maximum(state.t_s - self.site.start_s, 0.0)


class StatefulEffect(Effect):
    """An effect whose drives remember how they were moved: one number a drive, kept as it was before each leg."""

    def __init__(self, arguments: EffectArguments) -> None:
        self._before: list[list[float]] = [[0.0] for _ in arguments.site.machine.sliders]
        super().__init__(arguments)

    def state_after(self, drive: int, before: float, leg: Leg) -> float:
        """The new state when the dwell after a leg ends."""
        raise NotImplementedError

    def record_leg(self, drive: int, leg: Leg) -> None:
        """Append the state before the next leg."""
        states = self._before[drive]
        states.append(self.state_after(drive, states[-1], leg))

    def state_before(self, state: MotionState, drive: int) -> Array:
        """The state before the leg of each of the n observations (n,)."""
        states = self._before[drive]
        if len(state) < len(states):
            return np.array([states[k] for k in state.leg[:, drive]])
        return np.array(states)[state.leg[:, drive]]


def smooth_curve(rng: np.random.Generator, terms: int = 4) -> Callable[[Array], Array]:
    """A seeded curve on [-1, 1] without mean and slope, RMS 0.7 where drives mostly are: Legendre terms from two on."""
    weights = rng.standard_normal(terms) / np.arange(1, terms + 1)
    coefficients = np.concatenate([[0.0, 0.0], weights])
    x = np.linspace(-0.85, 0.85, 201)
    coefficients *= 0.7 / float(np.std(np.polynomial.legendre.legval(x, coefficients)))
    return lambda u: np.asarray(np.polynomial.legendre.legval(np.clip(u, -1.0, 1.0), coefficients))


def names_of(machine: MachineFile, place: Place) -> Sequence[str]:
    """The names of places of a kind, in the order of the file."""
    if place == "drive":
        return [slider.name for slider in machine.sliders]
    if place == "strut":
        return [strut.name for strut in machine.struts]
    if place == "smr":
        return [smr.name for smr in machine.smrs if smr.on == "platform"]
    return ["rig"]


__all__ = [
    "GRAVITY_M_PER_S2",
    "ONSET",
    "Array",
    "Complex",
    "Deviation",
    "Effect",
    "EffectArguments",
    "EffectChoice",
    "EffectParameter",
    "EffectSpec",
    "Kind",
    "Law",
    "Leg",
    "MotionState",
    "Place",
    "Site",
    "StatefulEffect",
    "StationSight",
]
