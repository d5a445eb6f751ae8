"""Where something can act on a machine, and what it does to every reading: the channels.

A channel is a place with a direction: a drive's travel, a strut's length, the pose of the platform, one reflector, the
station. Its response is what one unit of it (m, rad; 1/m for light) moves each measured reflector by.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.rotation import skew
from calibration.machine.description import COORDINATES, across

if TYPE_CHECKING:
    from calibration.diagnosis.linear_model import Seen

AXES = "xyz"


class Channels:
    """What one unit of each channel does to the readings of `seen`, by name, computed when asked for."""

    def __init__(self, seen: Seen) -> None:
        self.seen = seen
        self.machine = seen.machine
        self._known: dict[str, Array] = {}
        self._flat = (0, 1) if self.machine.planar else (0, 1, 2)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """All channels of the machine, such as 'travel.left', 'sideways.left.x', 'length.left_upper', 'pose.rz'."""
        return tuple(self._names())

    def shift_m(self, name: str) -> Array:
        """Shift (n, 3) of each reading's reflector for one unit of a channel, machine's frame."""
        if name not in self._known:
            kind, _, rest = name.partition(".")
            if kind in ("light", "station"):
                moved = self._light(rest) if kind == "light" else self._station(rest)
                self._known[name] = moved @ self.seen.frame.rotation
            else:
                self._known[name] = self._of_machine(name)
        return self._known[name]

    def sideways(self, drive: int) -> tuple[str, ...]:
        """Channels across a slider's guide."""
        return tuple(f"sideways.{self.machine.drive_names[drive]}.{c}" for c in self._across(drive))

    def turns(self, drive: int) -> tuple[str, ...]:
        """Channels of a slider's rotation."""
        if self.machine.drive_kinds[drive] != "slider":
            return ()
        axes = ("z",) if self.machine.planar else tuple(AXES)
        return tuple(f"turn.{self.machine.drive_names[drive]}.{c}" for c in axes)

    def poses(self) -> tuple[str, ...]:
        """Channels of the platform's free coordinates."""
        return tuple(f"pose.{COORDINATES[i]}" for i in self.machine.dof)

    def stations(self) -> tuple[str, ...]:
        """Channels of the station's frame."""
        return tuple(f"station.{c}" for c in ("rx", "ry", "rz", "x", "y", "z"))

    def floors(self) -> tuple[str, ...]:
        """Channels of the whole machine against its floor."""
        return tuple(f"floor.{c}" for c in (("x", "y", "rz") if self.machine.planar else COORDINATES))

    def smrs(self, smr: int) -> tuple[str, ...]:
        """Channels of a reflector on its part."""
        return tuple(f"smr.{self.machine.smrs[smr].name}.{AXES[k]}" for k in self._flat)

    def _across(self, drive: int) -> tuple[str, ...]:
        if self.machine.drive_kinds[drive] != "slider":
            return ()
        directions = across(self.machine.nominal.axis[drive])
        names = tuple(AXES[int(np.argmax(np.abs(d)))] for d in directions)
        return tuple(c for c in names if AXES.index(c) in self._flat)

    def _names(self) -> Iterator[str]:
        machine = self.machine
        for a, drive in enumerate(machine.drive_names):
            yield f"travel.{drive}"
            yield from self.sideways(a)
            yield from self.turns(a)
        yield from (f"length.{strut}" for strut in machine.strut_names)
        yield from (f"weight.{strut}" for strut in machine.strut_names)
        yield from self.poses()
        for i, smr in enumerate(machine.smrs):
            if smr.on == "platform":
                yield from self.smrs(i)
        yield from self.stations()
        yield from self.floors()
        yield from ("light.v", "light.hz")

    def _of_machine(self, name: str) -> Array:
        kind, place, direction = (*name.split("."), "")[:3]
        machine, known = self.machine, self.seen
        out = np.zeros((len(known.smr), 3))
        if kind == "smr":
            smr = [s.name for s in machine.smrs].index(place)
            rows = np.flatnonzero(known.smr == smr)
            rotation = known.poses.equilibrium.rotation[known.visit[rows]]
            out[rows] = rotation[:, :, AXES.index(direction)]
            return out
        if kind == "floor":
            return self._floor(place)
        if kind == "pose":
            return self._of_pose(_unit_pose(len(known.poses.visits), COORDINATES.index(place)), out)
        if kind == "length":
            column = known.poses.sensitivity.length(machine.strut_names.index(place))
            return self._of_pose(self._pose_of(column), out)
        if kind == "weight":
            return self._of_pose(self._pose_of(self._weight(machine.strut_names.index(place))), out)
        drive = machine.drive_names.index(place)
        return self._of_drive(kind, drive, direction, out)

    def _weight(self, strut: int) -> Array:
        """dG of one kilogram more at a strut's platform joint: its own weight hangs there, in part."""
        visits = len(self.seen.poses.visits)
        joint = self.seen.poses.geometry.platform_joint_m[strut]
        gravity = np.repeat(self.machine.gravity_m_per_s2[:, None], visits, axis=1)
        return self.seen.poses.sensitivity.force(gravity, np.repeat(joint[:, None], visits, axis=1))

    def _of_drive(self, kind: str, drive: int, direction: str, out: Array) -> Array:
        known, at = self.seen, self.seen.poses.sensitivity
        if kind == "travel":
            out = self._of_pose(self._pose_of(at.travel(drive)), out)
            for i, rows, visit in self._carried(drive):
                out[rows] += at.carriers[drive].d_travel(known.mounted_m[i])[:, visit].T
            return out
        axis = np.eye(3)[AXES.index(direction)]
        joints = known.poses.geometry.base_joint_m
        struts = np.flatnonzero(self.machine.strut_drive == drive)
        # A slider turns about the middle of its joints.
        middle = joints[struts].mean(axis=0)
        column = np.zeros((len(self.machine.dof), len(known.poses.visits)))
        ones = np.ones(len(known.poses.visits))

        def shift(point: Array) -> Array:
            return np.outer(axis if kind == "sideways" else np.cross(axis, point - middle), ones)

        for strut in struts.tolist():
            column += at.base_end(strut, shift(joints[strut]))
        out = self._of_pose(self._pose_of(column), out)
        for i, rows, visit in self._carried(drive):
            out[rows] += shift(known.mounted_m[i])[:, visit].T
        return out

    def _carried(self, drive: int) -> Iterator[tuple[int, NDArray[np.intp], NDArray[np.intp]]]:
        known = self.seen
        for i, smr in enumerate(self.machine.smrs):
            if smr.on == "slider" and smr.drive == drive:
                rows = np.flatnonzero(known.smr == i)
                yield i, rows, known.visit[rows]

    def _pose_of(self, column: Array) -> Array:
        """Change of the pose (v, 6) from a column dG (f, v)."""
        at = self.seen.poses.sensitivity
        out = np.zeros((column.shape[1], 6))
        out[:, self.machine.dof] = at.pose_derivatives([column])[:, :, 0]
        return out

    def _of_pose(self, change: Array, out: Array) -> Array:
        """Shifts (n, 3) of the platform's reflectors for a change of the pose (v, 6)."""
        known = self.seen
        rows = np.flatnonzero(known.on_platform)
        visit = known.visit[rows]
        lever = np.einsum("nij,nj->ni", known.poses.equilibrium.rotation[visit], known.mounted_m[known.smr[rows]])
        moved = change[visit]
        out[rows] += moved[:, :3] - np.einsum("nij,nj->ni", skew(lever), moved[:, 3:])
        return out

    def _floor(self, direction: str) -> Array:
        """The machine and all it carries moves as one; the nests do not."""
        known = self.seen
        places = (known.position_m - known.frame.translation_m) @ known.frame.rotation
        column = COORDINATES.index(direction)
        out = (
            np.cross(np.eye(3)[column - 3], places)
            if column > 2
            else np.repeat(np.eye(3)[column][None], len(places), 0)
        )
        out[known.visit < 0] = 0.0
        return np.asarray(out)

    def _station(self, direction: str) -> Array:
        known = self.seen
        axis = np.eye(3)["xyz".index(direction[-1])]
        if direction.startswith("r"):
            return np.cross(axis, known.position_m)
        return np.repeat(axis[None], len(known.position_m), axis=0)

    def _light(self, angle: str) -> Array:
        """An angle that is wrong by one radian a metre of distance."""
        p = self.seen.position_m
        distance = np.linalg.norm(p, axis=1)[:, None]
        level = np.hypot(p[:, 0], p[:, 1])[:, None]
        if angle == "hz":
            return np.stack([p[:, 1], -p[:, 0], np.zeros(len(p))], axis=1) * distance
        return np.concatenate([p[:, :2] * p[:, 2:] / level, -level], axis=1) * distance


def _unit_pose(visits: int, column: int) -> Array:
    out = np.zeros((visits, 6))
    out[:, column] = 1.0
    return out
