"""Where the base, the sliders and the cranks hold the joints and reflectors that they carry.

All arrays have poses last: q (n,), places (3, n). Signs are those of docs/reference/machine.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.rotation import skew
from calibration.machine.description import FIXED, DriveKind, Geometry, Machine


@dataclass(frozen=True)
class Carrier:
    """One drive (or the base) at n drive coordinates.

    travel (n,): scaled coordinate Q, thermal growth of a slider's scale included, in m (rad for a crank).
    base, grown (n,): thermal factors of the base and of what moves with the drive.
    """

    kind: DriveKind | None
    axis: Array
    pivot_m: Array
    travel: Array
    base: Array
    thermal_factor: Array

    @classmethod
    def from_geometry(
        cls, machine: Machine, geometry: Geometry, drive: int, coordinate: Array, base: Array, grown: Array
    ) -> Carrier:
        """The carrier of a drive's joints; FIXED for the base itself."""
        if drive == FIXED:
            return cls(None, np.zeros(3), np.zeros(3), np.zeros_like(base), base, grown)
        kind = machine.drive_kinds[drive]
        travel = coordinate * geometry.scale[drive]
        if kind != "crank":
            travel = travel * grown
        return cls(kind, geometry.axis[drive], geometry.pivot_m[drive], travel, base, grown)

    def position(self, point_m: Array) -> Array:
        """Place (3, n) of a point (3,) that is carried."""
        return self.positions(point_m[None])[:, 0]

    def positions(self, points_m: Array) -> Array:
        """Places (3, j, n) of points (j, 3) that are carried."""
        if self.kind == "crank":
            return (self.pivot_m[:, None] * self.base)[:, None] + self._rotate_arms(points_m) * self.thermal_factor
        places = points_m.T[:, :, None] * self.base
        if self.kind == "slider":
            for axis in np.flatnonzero(self.axis):
                places[axis] += self.axis[axis] * self.travel
        return places

    def d_point(self) -> Array:
        """Derivative (3, 3, n) of a place with the point."""
        if self.kind == "crank":
            return self._rotate_arms(np.eye(3)) * self.thermal_factor
        return np.eye(3)[:, :, None] * self.base

    def d_travel(self, point_m: Array) -> Array:
        """Derivative (3, n) of a place with the travel Q; zero for the base and for a leg."""
        if self.kind == "crank":
            return self._rotate_arms(np.cross(self.axis, point_m)[None])[:, 0] * self.thermal_factor
        axis = self.axis if self.kind == "slider" else np.zeros(3)
        return np.repeat(axis[:, None], self.travel.size, axis=1)

    def d_tilt(self, point_m: Array, about: Array) -> Array:
        """Derivative (3, n) of a place with a turn of the axis about a direction (3,)."""
        turned = skew(about) @ self.axis  # np.cross takes a tenth of a millisecond
        if self.kind == "slider":
            return turned[:, None] * self.travel
        if self.kind == "crank":
            along = self.axis @ point_m
            lift = turned * along + self.axis * (turned @ point_m)
            shift = np.outer(np.cross(turned, point_m), np.sin(self.travel)) + np.outer(lift, 1.0 - np.cos(self.travel))
            return shift * self.thermal_factor
        return np.zeros((3, self.travel.size))

    def d_pivot(self) -> Array:
        """Derivative (3, 3, n) of a place with the pivot."""
        return np.eye(3)[:, :, None] * (self.base if self.kind == "crank" else 0.0 * self.base)

    def d_growth(self, point_m: Array, part: str) -> Array:
        """Derivative (3, n) of a place with the thermal factor of the base ('base') or of the drive ('drives')."""
        if self.kind == "crank":
            return (
                np.outer(self.pivot_m, np.ones_like(self.base))
                if part == "base"
                else self._rotate_arms(point_m[None])[:, 0]
            )
        if part == "base":
            return np.outer(point_m, np.ones_like(self.base))
        return self.d_travel(point_m) * self.travel / self.thermal_factor

    def _rotate_arms(self, arms_m: Array) -> Array:
        """Arms (j, 3) turned about the axis by the travel, Rodrigues' formula: (3, j, n)."""
        along = np.outer(arms_m @ self.axis, self.axis)
        turned = np.multiply.outer((arms_m - along).T, np.cos(self.travel))
        turned += np.multiply.outer(np.cross(self.axis, arms_m).T, np.sin(self.travel))
        turned += along.T[:, :, None]
        return turned


def on_branch(carrier: Carrier, branch: float, base_end: Array, direction: Array) -> NDArray[np.bool_]:
    """Whether (n,) a drive's strut is the assembled one, from its base end and the direction in which it leaves it.

    Both (a, n), a axes: three, or x and y alone. Lengths do not matter, so the signs of docs/reference/machine.md are
    those of a slider's -u . n and a crank's u . ((s - c) x n).
    """
    side = np.zeros(direction.shape[1])
    for axis in np.flatnonzero(carrier.axis):
        if carrier.kind == "slider":
            side -= carrier.axis[axis] * direction[axis]
        else:
            i, j = (axis + 1) % 3, (axis + 2) % 3
            arm_i, arm_j = (base_end[k] - carrier.pivot_m[k] * carrier.base for k in (i, j))
            side += carrier.axis[axis] * (arm_i * direction[j] - arm_j * direction[i])
    return np.asarray(branch * side > 0.0)
