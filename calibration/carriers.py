"""Where the base, the sliders and the cranks hold the joints and reflectors that they carry.

All arrays have poses last: q (n,), places (3, n). Signs are those of docs/machine.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.machine import FIXED, Array, DriveKind, Geometry, Machine


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
    grown: Array

    @classmethod
    def of(
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

    def place(self, point_m: Array) -> Array:
        """Place (3, n) of a point (3,) that is carried."""
        if self.kind == "crank":
            return self.pivot_m[:, None] * self.base + self._turned(point_m) * self.grown
        place = point_m[:, None] * self.base
        return place + self.axis[:, None] * self.travel if self.kind == "slider" else place

    def d_point(self) -> Array:
        """Derivative (3, 3, n) of a place with the point."""
        if self.kind == "crank":
            columns = [self._turned(e) * self.grown for e in np.eye(3)]
            return np.stack(columns, axis=1)
        return np.eye(3)[:, :, None] * self.base

    def d_travel(self, point_m: Array) -> Array:
        """Derivative (3, n) of a place with the travel Q; zero for the base and for a leg."""
        if self.kind == "crank":
            return np.cross(self.axis, self._turned(point_m).T).T * self.grown
        axis = self.axis if self.kind == "slider" else np.zeros(3)
        return np.repeat(axis[:, None], self.travel.size, axis=1)

    def d_tilt(self, point_m: Array, about: Array) -> Array:
        """Derivative (3, n) of a place with a turn of the axis about a direction (3,)."""
        turned = np.cross(about, self.axis)
        if self.kind == "slider":
            return turned[:, None] * self.travel
        if self.kind == "crank":
            along = self.axis @ point_m
            lift = turned * along + self.axis * (turned @ point_m)
            shift = np.outer(np.cross(turned, point_m), np.sin(self.travel)) + np.outer(lift, 1.0 - np.cos(self.travel))
            return shift * self.grown
        return np.zeros((3, self.travel.size))

    def d_pivot(self) -> Array:
        """Derivative (3, 3, n) of a place with the pivot."""
        return np.eye(3)[:, :, None] * (self.base if self.kind == "crank" else 0.0 * self.base)

    def d_growth(self, point_m: Array, part: str) -> Array:
        """Derivative (3, n) of a place with the thermal factor of the base ('base') or of the drive ('drives')."""
        if self.kind == "crank":
            return np.outer(self.pivot_m, np.ones_like(self.base)) if part == "base" else self._turned(point_m)
        if part == "base":
            return np.outer(point_m, np.ones_like(self.base))
        return self.d_travel(point_m) * self.travel / self.grown

    def _turned(self, arm_m: Array) -> Array:
        """An arm (3,) turned about the axis by the travel, Rodrigues' formula: (3, n)."""
        along = self.axis * (self.axis @ arm_m)
        cos, sin = np.cos(self.travel), np.sin(self.travel)
        return np.outer(arm_m - along, cos) + np.outer(np.cross(self.axis, arm_m), sin) + along[:, None]


def on_branch(machine: Machine, geometry: Geometry, drive: int, carrier: Carrier, base_end: Array, end: Array) -> Array:
    """Whether (n,) a drive's strut from base_end (3, n) to the platform joint end (3, n) is the assembled one."""
    if carrier.kind == "slider":
        side = geometry.axis[drive] @ (base_end - end)
    elif carrier.kind == "crank":
        pivot = geometry.pivot_m[drive][:, None] * carrier.base
        side = geometry.axis[drive] @ np.cross((base_end - pivot).T, (end - pivot).T).T
    else:
        side = np.ones(end.shape[1])
    return np.asarray(machine.branch[drive] * side > 0.0)
