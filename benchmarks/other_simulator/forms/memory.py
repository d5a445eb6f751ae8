"""What holds on to a former state: friction that keeps, relays, what counts from the last change."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.machine import Indices
from benchmarks.other_simulator.rows import Rows

Array = NDArray[np.float64]

SUBSTEP_S = 20.0


def dragged(x: Array, half_width: float) -> Array:
    """What follows x (r,) only when that is further away than half a width, and then stays so far behind."""
    out = np.array(x, float)
    for k in range(1, len(x)):
        out[k] = np.clip(out[k - 1], x[k] - half_width, x[k] + half_width)
    return out


def in_jerks(x: Array, needed: float) -> Array:
    """What stays where it is until x (r,) is so far away from it, and then comes to x at once."""
    out = np.array(x, float)
    for k in range(1, len(x)):
        out[k] = x[k] if abs(x[k] - out[k - 1]) > needed else out[k - 1]
    return out


def switched_over(x: Array, low: float, high: float) -> Array:
    """1 from when x (r,) is above `high` until it is below `low`, else -1; it begins with -1."""
    out, state = np.empty(len(x)), -1.0
    for k, value in enumerate(x):
        if value > high or value < low:
            state = 1.0 if value > high else -1.0
        out[k] = state
    return out


def cooled_by_thermostat(t_s: Array, heat: Array, tau_s: float, on_above: float, off_below: float) -> Array:
    """Warmth (r,) of what heat (r,) warms, and a cooler that runs from one warmth down to another; it begins warm."""
    out, warmth, cooling = np.empty(len(t_s)), (on_above + off_below) / 2, False
    out[0] = warmth
    for k in range(1, len(t_s)):
        passed_s = t_s[k] - t_s[k - 1]
        steps = max(int(np.ceil(passed_s / SUBSTEP_S)), 1)
        for _ in range(steps):
            cooling = warmth > on_above or (cooling and warmth > off_below)
            warmth += (1 - np.exp(-passed_s / steps / tau_s)) * (heat[k] - cooling - warmth)
        out[k] = warmth
    return out


def since_change_s(rows: Rows, stretch: Indices) -> Array:
    """Time since the first reading of the stretch of readings that each is in (r,); stretches are numbered rising."""
    numbers, which = np.unique(stretch, return_inverse=True)
    begins_s = np.array([rows.t_s[stretch == one].min() for one in numbers])
    return np.asarray(rows.t_s - begins_s[which])
