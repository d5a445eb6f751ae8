"""Rigid motions between the machine's frame and an instrument's."""

from __future__ import annotations

from dataclasses import dataclass

from calibration.machine import Array
from calibration.rotation import rotation_matrix


@dataclass(frozen=True)
class Frame:
    """A rigid motion from the machine's to the station's frame: x_station = rotation x + translation_m."""

    rotation: Array
    translation_m: Array

    def moved(self, increment: Array) -> Frame:
        """The frame after an increment (6,): rotation vector, applied on the left, and translation."""
        turn = rotation_matrix(increment[:3])
        return Frame(turn @ self.rotation, self.translation_m + increment[3:])

    def to_station(self, points_m: Array) -> Array:
        """Points (n, 3) of the machine's frame in the station's."""
        outside: Array = points_m @ self.rotation.T + self.translation_m
        return outside
