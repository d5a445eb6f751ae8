"""Limits of a mock drive's axis, as the master may set them."""

from __future__ import annotations

from dataclasses import dataclass

from mock_devices.drives.axis_motion import Dynamics


@dataclass
class AxisLimits:
    """What the master may set, in increments and seconds."""

    low_inc: int
    high_inc: int
    speed: int = 20_000_000
    acceleration: int = 100_000_000
    deceleration: int = 100_000_000
    quick_stop_deceleration: int = 500_000_000
    following_error_window_inc: int = 100_000
    position_window_inc: int = 100
    max_torque_permille: int = 10_000

    def dynamics(self) -> Dynamics:
        """Speed, acceleration and deceleration of the next motion; zero counts as one."""
        return Dynamics(float(max(self.speed, 1)), float(max(self.acceleration, 1)), float(max(self.deceleration, 1)))
