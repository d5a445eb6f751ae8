"""What every unmodelled effect is made of: named parameters, a place, a variant, and what it acts on.

An effect sees moments (when the drives stood where, how they came there, how warm everything was) and changes a
departure: what differs from the machine without it. It draws from its own seed only and keeps its own history.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from mock_devices.machine_file import MachineFile, Vector3

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Place = Literal["drive", "strut", "smr", "rig"]
Kind = Literal["catalogue", "geometry", "outside", "nuisance"]
Law = Callable[[Array, Array], tuple[Array, Array]]

GRAVITY_M_PER_S2 = 9.80665


@dataclass(frozen=True)
class Parameter:
    """A number of an effect: its unit is the end of its name; `typical` is what holds if nothing is said."""

    name: str
    low: float
    typical: float
    high: float
    meaning: str

    @property
    def middle(self) -> float:
        """The middle of the range on a logarithmic scale."""
        return float(np.sqrt(self.low * self.high)) if self.low > 0.0 else 0.5 * (self.low + self.high)


@dataclass(frozen=True)
class EffectSpec:
    """One entry of the catalogue. The first parameter is the size: zero means no effect.

    `final` names the variant that only a final scoring uses.
    """

    name: str
    kind: Kind
    place: Place
    size: Parameter
    variants: tuple[str, ...]
    final: str
    reveals: str
    make: Callable[[Made], Effect]
    others: tuple[Parameter, ...] = ()

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters, the size first."""
        return (self.size, *self.others)


@dataclass(frozen=True)
class EffectChoice:
    """An effect as chosen: plain data. What is left out takes its typical value, its first place and variant."""

    name: str
    size: float
    place: str = ""
    variant: str = ""
    parameters: tuple[tuple[str, float], ...] = ()
    seed: int = 0


@dataclass(frozen=True)
class Site:
    """What an effect may know of the rig: the nominal machine, the station's place, when the campaign begins."""

    machine: MachineFile
    station_m: Vector3
    start_s: float = 0.0

    def drive_range_m(self, drive: int) -> tuple[float, float]:
        """Middle and half width of a drive's travel."""
        low, high = self.machine.sliders[drive].travel_m
        return 0.5 * (low + high), 0.5 * (high - low)


@dataclass(frozen=True)
class Made:
    """What an effect is made from: a choice with all its numbers, its place as an index, its own generator."""

    site: Site
    place: int
    variant: str
    values: dict[str, float]
    rng: np.random.Generator


@dataclass
class Leg:
    """One motion of one drive and the rest after it, until the next begins. `direction` is kept at rest."""

    start_s: float
    end_s: float
    from_m: float
    to_m: float
    speed_m_per_s: float
    direction: float
    until_s: float = float("inf")


class Temperatures(Protocol):
    """Past temperatures, for parts that lag behind them."""

    def part_series_c(self, name: str, t_s: Array) -> Array:
        """True temperature of a part at several times."""
        ...

    def air_series_c(self, t_s: Array) -> Array:
        """True temperature of the air."""
        ...


@dataclass(frozen=True)
class Moments:
    """When something is looked at, n times: everything (n,) or (n, drives); `leg` counts each drive's legs."""

    t_s: Array
    q_m: Array
    leg: NDArray[np.intp]
    from_m: Array
    leg_start_s: Array
    leg_end_s: Array
    speed_m_per_s: Array
    velocity_m_per_s: Array
    direction: Array
    payload_kg: Array
    exchanges: Array
    parts_c: dict[str, Array]
    thermal: Temperatures

    @property
    def since_s(self) -> Array:
        """Time since each drive came to rest (n, d), zero while it moves."""
        return np.maximum(self.t_s[:, None] - self.leg_end_s, 0.0)

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass
class Departure:
    """What differs from the machine without effects, for n moments.

    travel, sideways: of a slider along its axis and across it (axis turned by +90 degrees); yaw about the middle of its
    joints. length, ln_stiffness: (n, struts). platform_joint, base_joint: complex (n, struts). frame_shift,
    frame_turn_rad: of the whole machine against the floor. loads: forces at points of the platform. carriage_*:
    compliance (n, d, 3: along, across, yaw) and cubic hardening. smr: (n, smrs, 3) in the SMR's own frame. force_n:
    what the drives' torque shows besides the weight.
    """

    travel_m: Array
    sideways_m: Array
    yaw_rad: Array
    length_m: Array
    ln_stiffness: Array
    platform_joint_m: Complex
    base_joint_m: Complex
    smr_m: Array
    frame_shift_m: Complex
    frame_turn_rad: Array
    payload_shift_m: Complex
    moment_nm: Array
    force_n: Array
    carriage_compliance: Array
    carriage_hardening: Array
    loads: list[tuple[Complex, Complex]] = field(default_factory=list)
    laws: dict[int, list[Law]] = field(default_factory=dict)

    @classmethod
    def none(cls, n: int, machine: MachineFile) -> Departure:
        """No departure."""
        d, s, m = len(machine.sliders), len(machine.struts), len(machine.smrs)

        def zero(*shape: int) -> Array:
            return np.zeros((n, *shape))

        def none(*shape: int) -> Complex:
            return np.zeros((n, *shape), dtype=np.complex128)

        return cls(
            zero(d), zero(d), zero(d), zero(s), zero(s), none(s), none(s), zero(m, 3), none(), zero(), none(), zero(),
            zero(d), zero(d, 3), zero(d, 3),
        )  # fmt: skip


@dataclass
class Sight:
    """What the station sees of all SMRs, free of noise: (n, smrs); effects of the instrument change it in place.

    points_m: (n, smrs, 3) in the frame of the station.
    """

    points_m: Array
    hz_rad: Array
    v_rad: Array
    distance_m: Array


class Effect:
    """One effect at one place. The defaults do nothing."""

    def __init__(self, made: Made) -> None:
        self.site, self.place, self.variant = made.site, made.place, made.variant
        self.values, self.rng = made.values, made.rng
        self.size = next(iter(made.values.values()))
        self.setup()

    def setup(self) -> None:
        """Draw what is fixed from now on."""

    def follow(self, drive: int, leg: Leg) -> None:
        """A leg of a drive and the rest after it are over."""

    def early_s(self, m: Moments) -> Array | float:
        """By how much the drives are seen at a later time than the station's."""
        return 0.0

    def act(self, m: Moments, d: Departure) -> None:
        """Change the machine."""

    def sight(self, m: Moments, s: Sight) -> None:
        """Change what the station sees."""

    def elapsed_s(self, m: Moments) -> Array:
        """Time since the campaign began."""
        return np.maximum(m.t_s - self.site.start_s, 0.0)


class Remembering(Effect):
    """An effect whose drives remember how they were moved: one number a drive, kept as it was before each leg."""

    def __init__(self, made: Made) -> None:
        self._before: list[list[float]] = [[0.0] for _ in made.site.machine.sliders]
        super().__init__(made)

    def after(self, drive: int, before: float, leg: Leg) -> float:
        """What is remembered when the rest after a leg ends."""
        raise NotImplementedError

    def follow(self, drive: int, leg: Leg) -> None:
        """Keep what holds before the next leg."""
        kept = self._before[drive]
        kept.append(self.after(drive, kept[-1], leg))

    def before(self, m: Moments, drive: int) -> Array:
        """What was remembered before the leg of each moment (n,)."""
        kept = self._before[drive]
        if len(m) < len(kept):
            return np.array([kept[k] for k in m.leg[:, drive]])
        return np.array(kept)[m.leg[:, drive]]


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
