"""Air and parts of the machine during a campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import HOUR_S, lagging, wandering

Array = NDArray[np.float64]

LAG_MIN = {"struts": (10, 30), "drives": (50, 110), "base": (120, 240), "platform": (25, 60)}
STEP_S, BEFORE_H = 20.0, 10  # of the air's course, which begins so long before the campaign
DOOR_S = 1200.0  # until the cold of an open door has gone


@dataclass(frozen=True)
class Weather:
    """At r readings: the air, and the true temperatures of parts by group; the air's course also on its own times."""

    t_s: Array  # (r,)
    air_c: Array  # (r,)
    part_c: Mapping[str, Array]  # (r,), by group
    pressure_hpa: Array  # (r,)
    humidity_percent: Array  # (r,)
    course_t_s: Array
    course_c: Array

    def lagging_air_c(self, tau_min: float) -> Array:
        """What follows the air with a time constant, at the readings (r,)."""
        return np.interp(self.t_s, self.course_t_s, lagging(self.course_t_s, self.course_c, tau_min * 60))


def draw_weather(t_s: Array, rng: np.random.Generator) -> Weather:
    """A wave of the air's temperature, noise and up to two doors; parts follow it."""
    end = t_s[-1]
    course_t = np.arange(-BEFORE_H * HOUR_S, end + 40, STEP_S)
    amplitude, period = rng.uniform(0.5, 1.5), rng.uniform(2.5, 7) * HOUR_S
    course = (
        rng.uniform(19, 22.5)
        + amplitude * np.sin(2 * np.pi * course_t / period + rng.uniform(0, 6.3))
        + 0.15 * wandering(course_t, 900, rng)
    )
    for _ in range(int(rng.integers(0, 3))):
        opened = rng.uniform(0, end)
        cold = -rng.uniform(0.3, 1.0)
        course += cold * np.where(course_t > opened, np.exp(-np.maximum(course_t - opened, 0) / DOOR_S), 0)
    lags_min = {group: rng.uniform(*bounds) for group, bounds in LAG_MIN.items()}
    part = {group: np.interp(t_s, course_t, lagging(course_t, course, lag * 60)) for group, lag in lags_min.items()}
    air = np.interp(t_s, course_t, course)
    hours = t_s / HOUR_S
    pressure = 1000 + rng.normal() * 10 + rng.normal() * 1.2 * hours + 0.1 * wandering(t_s, 3600, rng)
    humidity = 45 + rng.normal() * 8 + 3 * wandering(t_s, 5400, rng) - 2 * (air - air.mean())
    rng.uniform(-1, 1)  # decides nothing; without it all that is drawn later would be another
    return Weather(t_s, air, part, pressure, np.clip(humidity, 15, 85), course_t, course)
