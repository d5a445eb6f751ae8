"""A rail of a guide that its bolts press down."""

from __future__ import annotations

import math

import numpy as np

from mock_devices.effects.base import Array

PITCH_M = (0.08, 0.12)  # from bolt to bolt
WIDE = 0.25  # half width of a dip, over the pitch
TIGHT = (0.4, 1.6)  # depth of a dip by its bolt's torque
POINTS = 4001


class BoltedRail:
    """A line with a dip at every bolt, each as deep as its bolt is tight."""

    def __init__(self, low_m: float, high_m: float, rng: np.random.Generator) -> None:
        self.pitch_m = float(rng.uniform(*PITCH_M))
        first_m = low_m - self.pitch_m * float(rng.uniform(0.0, 1.0))
        self.at_m = first_m + self.pitch_m * np.arange(math.ceil((high_m - low_m) / self.pitch_m) + 2)
        self.depth = rng.uniform(*TIGHT, len(self.at_m))
        travel_m = np.linspace(low_m, high_m, POINTS)
        dips = self._dips(travel_m)
        self._level = np.polyfit(travel_m, dips, 1)  # from which a guide's errors count
        self._rms = float(np.std(dips - np.polyval(self._level, travel_m)))

    def _dips(self, q_m: Array) -> Array:
        away = (q_m[:, None] - self.at_m) / (WIDE * self.pitch_m)
        return np.asarray(-np.exp(-(away**2)) @ self.depth)

    def line(self, q_m: Array) -> Array:
        """The rail at places (n,) from its straight line, over the RMS along the travel."""
        return np.asarray((self._dips(q_m) - np.polyval(self._level, q_m)) / self._rms)
