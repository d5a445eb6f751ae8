"""Channels: the places and directions in which an effect can act on the machine, and the response of every reading.

A channel is a place with a direction: a drive's travel, a strut's length, the pose of the platform, one reflector, the
station; or a stated value that may be wrong: the growth of a part, the payload, a drive's scale, a table that is on.
Its response is the shift of each measured reflector per unit of the channel (m, rad; 1/m for angles of light; kg; 1).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.diagnosis.observed_model import ObservedModel
from calibration.effects.departures import STIFFENED
from calibration.machine.description import COORDINATES, PARTS, across
from calibration.model.model import PAYLOAD

AXES = "xyz"
STATED = ("growth", "payload", "scale", "table")  # kinds of channels of stated values


def alike_but_for_zero(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Channels one by one, but those along, and those about, the station's x and y together: where these point is where
    its circle has its zero, so that one scale must hold for both."""
    groups: dict[str, list[str]] = {}
    for name in names:
        on_level = name.startswith("station.") and name.endswith(("x", "y"))
        groups.setdefault(name[:-1] if on_level else name, []).append(name)
    return [tuple(group) for group in groups.values()]


class Channels:
    """Responses of the readings of an observed model to one unit of each channel, by name, computed on first use."""

    def __init__(self, observed: ObservedModel) -> None:
        self.observed = observed
        self.machine = observed.machine
        self._shift_m: dict[str, Array] = {}
        self._flat = (0, 1) if self.machine.planar else (0, 1, 2)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """All channels of the machine, such as 'travel.left', 'sideways.left.x', 'length.left_upper', 'pose.rz'."""
        return tuple(self._names())

    def shift_m(self, name: str) -> Array:
        """Shift (n, 3) of each reading's reflector for one unit of a channel, machine's frame."""
        if name not in self._shift_m:
            kind, _, rest = name.partition(".")
            if kind in ("light", "station"):
                moved = self._refraction_response(rest) if kind == "light" else self._station_response(rest)
                self._shift_m[name] = moved @ self.observed.frame.rotation
            elif kind in STATED:
                self._shift_m[name] = self._stated_response(kind, rest)
            elif kind == STIFFENED:
                self._shift_m[name] = self._stiffened_response(rest)
            else:
                self._shift_m[name] = self._machine_response(name)
        return self._shift_m[name]

    def sideways_channels(self, drive: int) -> tuple[str, ...]:
        """Channels across a slider's guide."""
        return tuple(f"sideways.{self.machine.drive_names[drive]}.{c}" for c in self._across(drive))

    def rotation_channels(self, drive: int) -> tuple[str, ...]:
        """Channels of a slider's rotation."""
        if self.machine.drive_kinds[drive] != "slider":
            return ()
        axes = ("z",) if self.machine.planar else tuple(AXES)
        return tuple(f"turn.{self.machine.drive_names[drive]}.{c}" for c in axes)

    def pose_channels(self) -> tuple[str, ...]:
        """Channels of the platform's free coordinates."""
        return tuple(f"pose.{COORDINATES[i]}" for i in self.machine.dof)

    def force_channels(self) -> tuple[str, ...]:
        """Channels of a force on the platform, at its origin, and of moments: along and about its free coordinates."""
        return tuple(f"force.{COORDINATES[i]}" for i in self.machine.dof)

    def station_channels(self) -> tuple[str, ...]:
        """Channels of the station's frame."""
        return tuple(f"station.{c}" for c in ("rx", "ry", "rz", "x", "y", "z"))

    def floor_channels(self) -> tuple[str, ...]:
        """Channels of the whole machine against its floor."""
        return tuple(f"floor.{c}" for c in (("x", "y", "rz") if self.machine.planar else COORDINATES))

    @property
    def axes_of_motion(self) -> tuple[int, ...]:
        """Axes along which the platform can move: those of its plane where it moves in one."""
        return self._flat

    def reflector_channels(self, smr: int, axes: Sequence[int] = (0, 1, 2)) -> tuple[str, ...]:
        """Channels of a reflector on its part, along some axes; it may also lie off the plane of a planar machine."""
        return tuple(f"smr.{self.machine.smrs[smr].name}.{AXES[k]}" for k in axes)

    def _across(self, drive: int) -> tuple[str, ...]:
        if self.machine.drive_kinds[drive] != "slider":
            return ()
        directions = across(self.machine.nominal.axis[drive])
        names = tuple(AXES[int(np.argmax(np.abs(d)))] for d in directions)
        return tuple(c for c in names if AXES.index(c) in self._flat)

    def _names(self) -> Iterator[str]:
        machine, observed = self.machine, self.observed
        for a, drive in enumerate(machine.drive_names):
            yield f"travel.{drive}"
            yield from self.sideways_channels(a)
            yield from self.rotation_channels(a)
        yield from (f"length.{strut}" for strut in machine.strut_names)
        yield from (f"weight.{strut}" for strut in machine.strut_names)
        yield from (f"growth.{part}" for part in PARTS)
        yield "payload.mass"
        yield from (f"payload.{AXES[k]}" for k in self._flat)
        yield from (f"scale.{drive}" for drive in machine.drive_names)
        yield from (f"table.{generation}" for generation in observed.context.table_generations)
        yield from self.pose_channels()
        yield from self.force_channels()
        if not observed.by_station:
            return
        for i, smr in enumerate(machine.smrs):
            if smr.on == "platform":
                yield from self.reflector_channels(i)
        yield from self.station_channels()
        yield from self.floor_channels()
        yield from ("light.v", "light.hz", "light.range")

    def _machine_response(self, name: str) -> Array:
        kind, place, direction = (*name.split("."), "")[:3]
        machine, observed = self.machine, self.observed
        if kind == "smr":
            out = np.zeros((len(observed.smr), 3))
            smr = [s.name for s in machine.smrs].index(place)
            rows = np.flatnonzero(observed.smr == smr)
            rotation = observed.poses.equilibrium.rotation[observed.visit[rows]]
            out[rows] = rotation[:, :, AXES.index(direction)]
            return out
        if kind == "floor":
            return self._floor_response(place)
        if kind == "pose":
            return observed.platform_shift(_unit_pose(len(observed.poses.visits), COORDINATES.index(place)))
        if kind in ("force", "length", "weight"):
            return self._platform_shift(self._column_of_platform(kind, place))
        drive = machine.drive_names.index(place)
        return self._drive_response(kind, drive, direction)

    def _column_of_platform(self, kind: str, of: str) -> Array:
        """dG (f, v) of what moves the platform alone: a force along a free coordinate of it or a moment about it; a
        strut's length or weight."""
        if kind != "force":
            strut = self.machine.strut_names.index(of)
            return self.observed.poses.sensitivity.length(strut) if kind == "length" else self._weight_column(strut)
        column = np.zeros((len(self.machine.dof), len(self.observed.poses.visits)))
        column[list(self.machine.dof).index(COORDINATES.index(of))] = -1.0
        return column

    def _weight_column(self, strut: int) -> Array:
        """dG (f, v) per additional kilogram at a strut's platform joint, where part of its own weight acts."""
        visits = len(self.observed.poses.visits)
        joint = self.observed.poses.geometry.platform_joint_m[strut]
        gravity = np.repeat(self.machine.gravity_m_per_s2[:, None], visits, axis=1)
        return self.observed.poses.sensitivity.force(gravity, np.repeat(joint[:, None], visits, axis=1))

    def _stated_response(self, kind: str, of: str) -> Array:
        """What a stated value moves that is wrong by one unit."""
        if kind == "growth":
            return self._growth_response(of)
        if kind == "payload":
            return self._platform_shift(self.payload_column(f"payload.{of}"))
        return self._by_travels(kind, of)

    def _by_travels(self, kind: str, of: str, before: str = "") -> Array:
        """What a scale or a table moves, by the travels of the drives; before: that of stiffened ones begins so."""
        observed, machine = self.observed, self.machine
        drives = observed.poses.visits.drives
        if kind == "scale":
            drive = machine.drive_names.index(of)
            from_middle = drives[:, drive] - machine.travel[drive].mean()
            return self.shift_m(f"{before}travel.{of}") * from_middle[observed.visit, None]
        corrections = observed.context.table_corrections_m(int(of), machine.drive_names, drives)[observed.visit]
        travels = [self.shift_m(f"{before}travel.{name}") for name in machine.drive_names]
        return np.asarray(sum(travel * corrections[:, a, None] for a, travel in enumerate(travels)))

    def _stiffened_response(self, of: str) -> Array:
        """How the response to a channel changes with the logarithm of a strut's or a guide's stiffness.

        The derivative of -K^-1 dG: what the channel pulls less at a softer part moves the platform as that part's
        stiffness does by itself, dG = force times wrench, with the change of its force per unit of the channel.
        """
        name, _, channel = of.partition(".")
        kind, _, rest = channel.partition(".")
        if kind in ("scale", "table"):
            return self._by_travels(kind, rest, f"{STIFFENED}.{name}.")
        state = self.observed.poses.sensitivity.state
        constraint = (*self.machine.strut_names, *self.machine.guide_names).index(name)
        column, elongation = self._pull(channel)
        moved = self._pose_change(column)[:, self.machine.dof].T
        wrench = state.wrench[:, constraint]
        force = state.stiffness[constraint] * (np.sum(wrench * moved, axis=0) + elongation[constraint])
        return self._platform_shift(force * wrench)

    def _pull(self, channel: str) -> tuple[Array, Array]:
        """dG (f, v) of one unit of a channel; by how much struts and guides (c, v) become longer between their ends."""
        kind, place, direction = (*channel.split("."), "")[:3]
        machine, sensitivity = self.machine, self.observed.poses.sensitivity
        longer = np.zeros((sensitivity.state.wrench.shape[1], len(self.observed.poses.visits)))
        if kind == "payload":
            return self.payload_column(channel), longer
        if kind in ("force", "length", "weight"):
            if kind == "length":
                longer[machine.strut_names.index(place)] = -sensitivity.conditions.factors["struts"]
            return self._column_of_platform(kind, place), longer
        drive = machine.drive_names.index(place)
        if machine.drive_kinds[drive] == "leg":
            longer[machine.strut_drive == drive] = -1.0
            return sensitivity.travel(drive), longer
        column = np.zeros((len(machine.dof), longer.shape[1]))
        for strut, shift in self._base_shifts(kind, drive, direction):
            longer[strut] = -np.sum(sensitivity.state.direction[:, strut] * shift, axis=0)
            column += sensitivity.base_end(strut, shift)
        return column, longer

    def _base_shifts(self, kind: str, drive: int, direction: str) -> Iterator[tuple[int, Array]]:
        """By how much the base ends (3, v) of a drive's struts move with one unit of a channel of it."""
        joints, carrier = self.observed.poses.geometry.base_joint_m, self.observed.poses.sensitivity.carriers[drive]
        moved = None if kind == "travel" else self._of_slider(kind, drive, direction)
        for strut in np.flatnonzero(self.machine.strut_drive == drive).tolist():
            yield strut, carrier.d_travel(joints[strut]) if moved is None else moved(joints[strut])

    def payload_column(self, name: str) -> Array:
        """dG (f, v) per unit of a channel of the payload: a kilogram, or a metre of its centre along an axis."""
        sensitivity, axis = self.observed.poses.sensitivity, AXES.find(name.removeprefix("payload."))
        return sensitivity.mass(PAYLOAD) if axis < 0 else sensitivity.centre_of_mass(PAYLOAD, axis)

    def _growth_response(self, part: str) -> Array:
        """All dimensions of a part become longer by one, relatively; what it carries goes with it."""
        observed = self.observed
        sensitivity = observed.poses.sensitivity
        out = observed.platform_growth() if part == "platform" else np.zeros((len(observed.smr), 3))
        out += self._platform_shift(sensitivity.growth(part))
        if part in ("base", "drives"):
            for drive in range(len(self.machine.drive_names)):
                for i, rows, visit in self._reflectors_on_drive(drive):
                    out[rows] += sensitivity.carriers[drive].d_growth(observed.mounted_m[i], part)[:, visit].T
        return out

    def _drive_response(self, kind: str, drive: int, direction: str) -> Array:
        observed, sensitivity = self.observed, self.observed.poses.sensitivity
        if kind == "travel":
            out = self._platform_shift(sensitivity.travel(drive))
            for i, rows, visit in self._reflectors_on_drive(drive):
                out[rows] += sensitivity.carriers[drive].d_travel(observed.mounted_m[i])[:, visit].T
            return out
        column = np.zeros((len(self.machine.dof), len(observed.poses.visits)))
        for strut, shift in self._base_shifts(kind, drive, direction):
            column += sensitivity.base_end(strut, shift)
        out, moved = self._platform_shift(column), self._of_slider(kind, drive, direction)
        for i, rows, visit in self._reflectors_on_drive(drive):
            out[rows] += moved(observed.mounted_m[i])[:, visit].T
        return out

    def _of_slider(self, kind: str, drive: int, direction: str) -> Callable[[Array], Array]:
        """By how much a point of a slider moves (3, v) sideways, or where the slider turns."""
        axis, ones = np.eye(3)[AXES.index(direction)], np.ones(len(self.observed.poses.visits))
        joints = self.observed.poses.geometry.base_joint_m[self.machine.strut_drive == drive]
        middle = joints.mean(axis=0)  # about which it turns
        return lambda point: np.outer(axis if kind == "sideways" else np.cross(axis, point - middle), ones)

    def _reflectors_on_drive(self, drive: int) -> Iterator[tuple[int, NDArray[np.intp], NDArray[np.intp]]]:
        observed = self.observed
        for i, smr in enumerate(self.machine.smrs):
            if smr.on == "slider" and smr.drive == drive:
                rows = np.flatnonzero(observed.smr == i)
                yield i, rows, observed.visit[rows]

    def _pose_change(self, column: Array) -> Array:
        """Change of the pose (v, 6) from a column dG (f, v)."""
        out = np.zeros((column.shape[1], 6))
        out[:, self.machine.dof] = self.observed.poses.sensitivity.pose_derivatives([column])[:, :, 0]
        return out

    def _platform_shift(self, column: Array) -> Array:
        """Shifts (n, 3) of what is read of the platform, from a column dG (f, v)."""
        return self.observed.platform_shift(self._pose_change(column))

    def _floor_response(self, direction: str) -> Array:
        """The machine and everything it carries moves as a rigid body; the floor nests stay."""
        observed = self.observed
        places_m = (observed.position_m - observed.frame.translation_m) @ observed.frame.rotation
        column = COORDINATES.index(direction)
        out = (
            np.cross(np.eye(3)[column - 3], places_m)
            if column > 2
            else np.repeat(np.eye(3)[column][None], len(places_m), 0)
        )
        out[observed.visit < 0] = 0.0
        return np.asarray(out)

    def _station_response(self, direction: str) -> Array:
        observed = self.observed
        axis = np.eye(3)["xyz".index(direction[-1])]
        if direction.startswith("r"):
            return np.cross(axis, observed.sight_m)
        return np.repeat(axis[None], len(observed.position_m), axis=0)

    def _refraction_response(self, angle: str) -> Array:
        """An angle error of one radian per metre of distance; a range that is one metre too long per metre."""
        p = self.observed.sight_m
        if angle == "range":
            return p
        distance = np.linalg.norm(p, axis=1)[:, None]
        level = np.hypot(p[:, 0], p[:, 1])[:, None]
        if angle == "hz":
            return np.stack([p[:, 1], -p[:, 0], np.zeros(len(p))], axis=1) * distance
        return np.concatenate([p[:, :2] * p[:, 2:] / level, -level], axis=1) * distance


def unit_of_channel(name: str) -> str:
    """The SI unit of a channel's amount."""
    kind, last = name.partition(".")[0], name.rpartition(".")[2]
    if kind == STIFFENED:
        return unit_of_channel(name.split(".", 2)[2])
    if name == "payload.mass" or kind == "weight":
        return "kg"
    if kind == "force":
        return "N m" if last.startswith("r") else "N"
    if kind == "turn" or (kind in ("pose", "station", "floor") and last.startswith("r")):
        return "rad"
    if kind in ("growth", "scale", "table", "unknown") or name == "light.range":
        return "1"
    return "1/m" if kind == "light" else "m"


def _unit_pose(visits: int, column: int) -> Array:
    out = np.zeros((visits, 6))
    out[:, column] = 1.0
    return out
