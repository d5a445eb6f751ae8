"""What may have changed on a machine between two campaigns: structures, their places, and the columns of each.

A *move* is one number that a change may have: an unknown of the model, or a function of the drives acting through a
channel. A *way* is a set of moves that go together; a candidate is a structure at a place, with its ways.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from calibration.base.arrays import Array
from calibration.comparison.two_campaigns import curve_of_drive, reflector_shifts_m
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.machine.description import FIXED, Machine, across
from calibration.model.parameters import ParameterSet

DRIVE_OFFSET, DRIVE_SCALE, COLUMN, STRUT = "drive_offset", "drive_scale", "column", "strut"
SCREW_CURVE, GUIDE, NEST = "screw_curve", "guide", "nest"
STRUCTURES = (DRIVE_OFFSET, DRIVE_SCALE, COLUMN, STRUT, SCREW_CURVE, GUIDE, NEST)
ALL_PLATFORM, ALL_FLOOR = "platform reflectors", "floor nests"

CURVE_TERMS = 8
TURN_LEVER_M = 0.3  # at which a turn of a carriage or of the platform counts as much as a shift
LENGTHS_M, RATIOS = (0.5e-6, 3.0e-3), (5.0e-3, 1.0)  # plausible sizes: of shifts, of logarithms of stiffness


@dataclass(frozen=True)
class Move:
    """One number of a change: its name and unit, its size relative to the change's, and what it acts on.

    unknown: an unknown of the linear model, else channel, with power or term of the drive's coordinate.
    """

    name: str
    unit: str
    relative: float
    unknown: str = ""
    channel: str = ""
    function: str = "one"
    term: int = 0
    smr: int = -1
    axis: int = -1

    @property
    def is_length(self) -> bool:
        """Whether its size relative to the change's makes it a length; what a stiffness does is none."""
        return not self.unknown.startswith("ln_stiffness")


@dataclass(frozen=True)
class Way:
    """Moves that go together, and the limits of their common size."""

    moves: tuple[Move, ...]
    limits: tuple[float, float] = LENGTHS_M


@dataclass(frozen=True)
class Candidate:
    """A structure at a place with the ways in which it may have changed."""

    structure: str
    place: str
    ways: tuple[Way, ...]

    @property
    def of_machine(self) -> bool:
        """Whether it is a change of the machine: reflectors and nests are what it is measured by."""
        return self.structure != NEST


def candidates(machine: Machine, seen: Sequence[int], shared: frozenset[str]) -> list[Candidate]:
    """All candidates; seen: reflectors that the campaign after has, shared: names of those that may be compared."""
    out = [*_of_drives(machine), *_of_struts(machine), *_of_guides(machine)]
    return [*out, *_of_reflectors(machine, [i for i in seen if machine.smrs[i].name in shared])]


def _axes(machine: Machine) -> str:
    return "xy" if machine.planar else "xyz"


def _of_drives(machine: Machine) -> Iterator[Candidate]:
    for a, (drive, kind) in enumerate(zip(machine.drive_names, machine.drive_kinds, strict=True)):
        unit, per_m = "rad" if kind == "crank" else "m", 1.0 / float(machine.arms_m[a])
        span = float(np.max(np.abs(machine.travel[a])))
        channel = f"travel.{drive}"
        offset = Move("offset", unit, per_m, channel=channel)
        scale = Move("scale", "1", per_m / span, channel=channel, function="travel")
        curve = tuple(
            Move(f"curve_{k + 1}", unit, per_m, channel=channel, function="curve", term=k) for k in range(CURVE_TERMS)
        )
        yield Candidate(DRIVE_OFFSET, drive, (Way((offset,)),))
        yield Candidate(DRIVE_SCALE, drive, (Way((scale,)),))
        yield Candidate(SCREW_CURVE, drive, (Way(curve),))
        if column := _column_ways(machine, a):
            yield Candidate(COLUMN, drive, column)


def _column_ways(machine: Machine, drive: int) -> tuple[Way, ...]:
    """Where a slider's column or a crank's bearing stands, and which way it points."""
    name, kind = machine.drive_names[drive], machine.drive_kinds[drive]
    if kind == "leg":
        return ()
    reach = float(np.max(np.abs(machine.travel[drive]))) if kind == "slider" else TURN_LEVER_M
    tilts = tuple(
        Move(f"tilt_{label}", "rad", 1.0 / reach, unknown=f"axis_tilt.{name}.{label}")
        for label in _tilt_labels(machine, drive)
    )
    if kind == "crank":
        shifts = tuple(Move(f"shift_{c}", "m", 1.0, unknown=f"pivot.{name}.{c}") for c in _axes(machine))
        return tuple(Way(moves) for moves in (shifts, tilts, (*shifts, *tilts)) if moves)
    shifts = tuple(Move(f"shift_{c}", "m", 1.0, channel=f"sideways.{name}.{c}") for c in _sideways(machine, drive))
    turns = tuple(
        Move(f"turn_{c}", "rad", 1.0 / TURN_LEVER_M, channel=f"turn.{name}.{c}")
        for c in (("z",) if machine.planar else "xyz")
    )
    ways = (shifts, tilts, turns, (*shifts, *tilts), (*shifts, *tilts, *turns))
    return tuple(Way(moves) for moves in ways if moves)


def _sideways(machine: Machine, drive: int) -> list[str]:
    names = ["xyz"[int(np.argmax(np.abs(d)))] for d in across(machine.nominal.axis[drive])]
    return [c for c in names if c in _axes(machine)]


def _tilt_labels(machine: Machine, drive: int) -> list[str]:
    kinds = ParameterSet.of(machine, ("axis_tilt",)).parameters
    return [p.name.rpartition(".")[2] for p in kinds if p.part == drive]


def _of_struts(machine: Machine) -> Iterator[Candidate]:
    for strut in machine.strut_names:
        length = Move("length", "m", 1.0, unknown=f"strut_length.{strut}")
        soft = Move("ln_stiffness", "1", 1.0, unknown=f"ln_stiffness.{strut}")
        joints = [
            tuple(Move(f"{end}_joint_{c}", "m", 1.0, unknown=f"{end}_joint.{strut}.{c}") for c in _axes(machine))
            for end in ("platform", "base")
        ]
        alone = [Way((length,)), Way((soft,), RATIOS), *(Way(moves) for moves in joints)]
        # A new strut has another length and another stiffness: a tenth of it goes with 0.1 mm.
        both = Way((length, Move("ln_stiffness", "1", 1.0e3, unknown=soft.unknown)))
        yield Candidate(STRUT, strut, (*alone, both))


def _of_guides(machine: Machine) -> Iterator[Candidate]:
    for g, guide in enumerate(machine.guide_names):
        place = Move("position", "m", 1.0, unknown=f"guide_position.{guide}")
        soft = Move("ln_stiffness", "1", 1.0, unknown=f"ln_stiffness.{guide}")
        joint = int(machine.guide_joint[g])
        lever = max(float(np.linalg.norm(machine.nominal.platform_joint_m[joint])), TURN_LEVER_M)
        tilts = tuple(
            Move(f"tilt_{label}", "rad", 1.0 / lever, unknown=f"guide_tilt.{guide}.{label}")
            for label in _guide_tilts(machine, g)
        )
        ways = [(place,), tilts, (place, *tilts)] if tilts else [(place,)]
        yield Candidate(GUIDE, guide, (*(Way(moves) for moves in ways), Way((soft,), RATIOS)))


def _guide_tilts(machine: Machine, guide: int) -> list[str]:
    kinds = ParameterSet.of(machine, ("guide_tilt",)).parameters
    return [p.name.rpartition(".")[2] for p in kinds if p.part == guide]


def _of_reflectors(machine: Machine, seen: Sequence[int]) -> Iterator[Candidate]:
    for i in seen:
        shifts = tuple(Move(f"shift_{c}", "m", 1.0, smr=i, axis=k) for k, c in enumerate("xyz"))
        yield Candidate(NEST, machine.smrs[i].name, (Way(shifts),))
    for on, place in (("platform", ALL_PLATFORM), ("floor", ALL_FLOOR)):
        group = [i for i in seen if machine.smrs[i].on == on]
        if len(group) > 1:
            each = tuple(
                Move(f"{machine.smrs[i].name}_{c}", "m", 1.0, smr=i, axis=k) for i in group for k, c in enumerate("xyz")
            )
            yield Candidate(NEST, place, (Way(_together(on)), Way(each)))


def _together(on: str) -> tuple[Move, ...]:
    """All reflectors of a part as one body."""
    shifts = [Move(f"shift_{c}", "m", 1.0, channel=f"{on}.{c}") for c in "xyz"]
    turns = [Move(f"turn_{c}", "rad", 1.0 / TURN_LEVER_M, channel=f"{on}.r{c}") for c in "xyz"]
    return (*shifts, *turns)


@dataclass
class MoveColumns:
    """Whitened columns (n, 3) of a campaign's readings by one unit of each move, computed when first asked for."""

    linear: LinearisedReadings
    channels: Channels = field(init=False)
    _kept: dict[tuple[str, ...], Array] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.channels = Channels(self.linear)

    def __call__(self, move: Move) -> Array:
        """The column (n, 3) of one unit of a move."""
        key = (move.unknown, move.channel, move.function, str(move.term), str(move.smr), str(move.axis))
        if key not in self._kept:
            self._kept[key] = self._column(move)
        return self._kept[key]

    def _column(self, move: Move) -> Array:
        linear = self.linear
        if move.unknown:
            column = linear.names.index(move.unknown)
            return np.asarray(linear.columns[:, :, column] / linear.sigma[column])
        if move.smr >= 0:
            return linear.whiten_shift(reflector_shifts_m(linear, move.smr)[move.axis])
        kind, _, of = move.channel.partition(".")
        if kind in ("platform", "floor"):
            return linear.whiten_shift(self._body_shift_m(kind, of))
        shift = linear.whiten_shift(self.channels.shift_m(move.channel))
        if move.function == "one":
            return shift
        drive = linear.machine.drive_names.index(of)
        at = linear.context.drives[:, drive]
        return np.asarray(shift * drive_function(linear.machine, drive, at, move)[:, None])

    def _body_shift_m(self, on: str, direction: str) -> Array:
        """Shift (n, 3) of all reflectors on the platform, or of all floor nests, as a body."""
        linear = self.linear
        rows = linear.on_platform if on == "platform" else linear.on_floor
        mounted = linear.mounted_m[linear.smr]
        axis = np.eye(3)["xyz".index(direction[-1])]
        moved = np.cross(axis, mounted) if direction.startswith("r") else np.broadcast_to(axis, mounted.shape)
        if on == "platform":
            rotation = linear.poses.equilibrium.rotation[np.maximum(linear.visit, 0)]
            moved = np.einsum("nij,nj->ni", rotation, moved)
        return np.where(rows[:, None], moved, 0.0)


def drive_function(machine: Machine, drive: int, at: Array, move: Move) -> Array:
    """The function (n,) of a drive's coordinate (n,) by which a move acts on its travel."""
    if move.function == "travel":
        return at
    if move.function == "curve":
        return curve_of_drive(machine.travel[drive], at, CURVE_TERMS)[:, move.term]
    return np.ones_like(at)


def parameters_of(machine: Machine, move: Move, value: float) -> dict[str, float]:
    """Values (SI) of the machine's parameters that a move of some size is, as far as it is one of these."""
    if move.unknown:
        return {move.unknown: value}
    kind, _, of = move.channel.partition(".")
    if kind != "sideways":
        return {}
    drive, _, axis = of.rpartition(".")
    struts = np.flatnonzero(machine.strut_drive == machine.drive_names.index(drive))
    return {f"base_joint.{machine.strut_names[i]}.{axis}": value for i in struts if machine.strut_drive[i] != FIXED}
