"""What forms may know of the campaign before a reading: the former visit, pauses, changes of payload, cycles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.forms.shapes import draw_instant, draw_phase, normalised
from benchmarks.other_simulator.machine import Indices
from benchmarks.other_simulator.rows import Rows

Array = NDArray[np.float64]

UNCHANGED = 3  # cuts of a campaign whose payload is never changed


def of_former_visit(rows: Rows, values: Array) -> Array:
    """Values (r, ...) at the last reading of the visit before; in the first visit those of the first reading."""
    begins = np.diff(rows.visit, prepend=rows.visit[0] - 1) != 0
    last_before = np.maximum(np.flatnonzero(begins) - 1, 0)
    return np.asarray(values[last_before[np.cumsum(begins) - 1]])


def pause_before_s(rows: Rows) -> Array:
    """Time from the last reading of the visit before until the place was reached (r,)."""
    return np.maximum(rows.t_s - rows.dwell_s - of_former_visit(rows, rows.t_s), 0)


def new_visit(rows: Rows) -> NDArray[np.bool_]:
    """Whether a reading is the first of its visit, but for the very first (r,)."""
    return np.asarray(np.diff(rows.visit, prepend=rows.visit[0]) != 0)


def draw_mountings(rows: Rows, rng: np.random.Generator) -> tuple[Indices, float]:
    """Number of the mounting of the payload at each reading (r,), and when the second one was.

    Where the payload is never changed, it is taken off and put back at some moments.
    """
    drawn = sorted(draw_instant(rows, rng, 0.2, 0.8) for _ in range(UNCHANGED))
    changes_s = rows.reseats_s or drawn
    return np.searchsorted(changes_s, rows.t_s, "right"), float(changes_s[0])


def draw_cycles(
    rows: Rows, period_min: tuple[float, float], tau_min: tuple[float, float], rng: np.random.Generator
) -> Array:
    """Warmth (r,) about its mean of what is switched on and off in turn, as a thermostat does; 1 at its largest."""
    turn = rows.hours * 60 / rng.uniform(*period_min) + draw_phase(rng)
    on = (turn % 1 < rng.uniform(0.35, 0.65)).astype(float)
    warmth = lagging(rows.t_s, on, rng.uniform(*tau_min) * 60)
    return normalised(warmth - warmth.mean())
