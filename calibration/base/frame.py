"""Rigid motions between the machine's frame and an instrument's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix


@dataclass(frozen=True)
class Frame:
    """A rigid motion from the machine's to the station's frame: x_station = rotation x + translation_m."""

    rotation: Array
    translation_m: Array

    def with_increment(self, increment: Array) -> Frame:
        """The frame after an increment (6,): rotation vector, applied on the left, and translation."""
        turn = rotation_matrix(increment[:3])
        return Frame(turn @ self.rotation, self.translation_m + increment[3:])

    def to_station(self, points_m: Array) -> Array:
        """Points (n, 3) of the machine's frame in the station's."""
        outside: Array = points_m @ self.rotation.T + self.translation_m
        return outside


def station_frame(position_m: tuple[float, float, float], heading_rad: float) -> Frame:
    """Machine to station frame for a levelled station; heading zero looks along -z of the machine."""
    forward = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    turn = rotation_matrix(np.array([0.0, 0.0, heading_rad])) @ forward
    return Frame(turn, -turn @ np.asarray(position_m))
