"""A plant whose drives stand where a test puts them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from mock_devices.plant.plant import Plant, SetPoint

HOME_M = math.sqrt(1.5**2 - 1.0)


@dataclass
class StandingDrive:
    """A drive that stands where it is put."""

    position_m: float = HOME_M
    count: int = 0
    moving: bool = False

    def put(self, position_m):
        self.position_m = position_m
        self.count += 1

    def encoder_m(self, _t_s):
        return self.position_m

    def set_point(self, _t_s):
        return SetPoint(self.count, round(self.position_m * 1e8))

    def is_moving(self, _t_s):
        return self.moving


@dataclass
class StandingPlant:
    plant: Plant
    drives: tuple[StandingDrive, StandingDrive] = field(default_factory=lambda: (StandingDrive(), StandingDrive()))

    def __post_init__(self):
        self.plant.attach(self.drives)
