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


def station_frame(
    position_m: tuple[float, float, float], heading_rad: float, gravity_m_per_s2: Array | None = None
) -> Frame:
    """Machine to station frame for a levelled station, whose vertical is against gravity (3,) of the machine's frame.

    Where gravity is along -y (the default) heading zero looks along -z of the machine, with x to the right; for any
    other direction of gravity that view is turned as gravity is, the shortest way: where it is along -z, heading zero
    looks along y.
    """
    forward = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    turn = rotation_matrix(np.array([0.0, 0.0, heading_rad])) @ forward
    if gravity_m_per_s2 is not None:
        turn = turn @ _upright(np.asarray(gravity_m_per_s2, dtype=np.float64))
    return Frame(turn, -turn @ np.asarray(position_m))


def _upright(gravity: Array) -> Array:
    """The shortest turn (3, 3) that brings the direction against gravity to y; without gravity none."""
    size = float(np.linalg.norm(gravity))
    if size == 0.0:
        return np.eye(3)
    up = -gravity / size
    if up[1] < -1.0 + 1e-12:
        return np.diag([-1.0, -1.0, 1.0])
    half = up + np.array([0.0, 1.0, 0.0])  # half a turn about it brings one to the other, and another one keeps hands
    about = 2.0 * np.outer(half, half) / (half @ half) - np.eye(3)
    return np.asarray(about @ (2.0 * np.outer(up, up) - np.eye(3)))
