"""What the forms of the seventh archive are put together of: heat where a part runs, and lines without a formula."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from benchmarks.other_simulator.forms.history import new_visit
from benchmarks.other_simulator.forms.shapes import normalised
from benchmarks.other_simulator.rows import Rows

Array = NDArray[np.float64]

ZONES = 16  # of a travel


def heat_below_carriage(rows: Rows, drive: int, tau_min: float) -> Array:
    """Heat (r,) in the part of a screw below its carriage, left where the nut ran; 1 at most.

    Motion in the pauses leaves its heat everywhere alike.
    """
    place, way_m, middles = rows.raised[:, drive], rows.way_m[:, drive], (np.arange(ZONES) + 0.5) / ZONES
    length_m = np.ptp(rows.commanded_m[:, drive])
    out, heat = np.zeros(len(rows)), np.zeros(ZONES)
    for k in range(1, len(rows)):
        heat *= np.exp(-(rows.t_s[k] - rows.t_s[k - 1]) / (tau_min * 60))
        low, high = sorted((place[k - 1], place[k]))
        passed = (middles > low) & (middles < high)
        moved_m = way_m[k] - way_m[k - 1]
        straight_m = min((high - low) * length_m, moved_m) if passed.any() else 0.0
        heat += (moved_m - straight_m) / ZONES + passed * straight_m / max(passed.sum(), 1)
        out[k] = np.interp(place[k] * ZONES, np.arange(ZONES + 1), np.r_[0, np.cumsum(heat)])
    return normalised(out)


def uneven_line(x_m: Array, spacing_m: float, rng: np.random.Generator) -> Array:
    """A smooth line over a coordinate (r,) through random heights at even distances, without slope; 1 at most."""
    nodes_m = np.arange(x_m.min() - spacing_m, x_m.max() + 2 * spacing_m, spacing_m)
    heights = CubicSpline(nodes_m, rng.normal(size=len(nodes_m)))(x_m)
    return normalised(heights - np.polyval(np.polyfit(x_m, heights, 1), x_m))


def walked_line(x_m: Array, spacing_m: float, rng: np.random.Generator) -> Array:
    """A line over a coordinate (r,) whose slope is another from stretch to stretch, on average none; 1 at most."""
    nodes_m = np.arange(x_m.min(), x_m.max() + spacing_m, spacing_m)
    heights = np.interp(x_m, nodes_m, np.cumsum(rng.normal(size=len(nodes_m))))
    return normalised(heights - np.polyval(np.polyfit(x_m, heights, 1), x_m))


def of_each(numbers: NDArray[np.intp], values: Array) -> Array:
    """Values (r, ...) of the numbers (r,), with those of the first number taken as nothing."""
    return np.asarray((values - values[0])[numbers])


def way_since(rows: Rows, step_s: float) -> Array:
    """What all drives together have moved since a moment, as a share of what they move until the end (r,)."""
    moved_m = rows.way_m.sum(1)
    before_m = float(np.interp(step_s, rows.t_s, moved_m))
    return np.asarray(np.maximum(moved_m - before_m, 0) / max(moved_m[-1] - before_m, 1e-9))


def phases_of_visits(rows: Rows, rng: np.random.Generator) -> Array:
    """A phase in rad (r,) that is drawn anew for each visit."""
    visits = np.cumsum(new_visit(rows))
    return np.asarray(rng.uniform(0, 2 * np.pi, visits[-1] + 1)[visits])
