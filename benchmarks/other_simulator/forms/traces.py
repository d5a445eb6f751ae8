"""What motions, rests, loads and people leave behind until something else takes it away."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.forms.history import UNCHANGED, new_visit, of_former_visit
from benchmarks.other_simulator.forms.shapes import draw_instant, draw_two_instants
from benchmarks.other_simulator.machine import Indices
from benchmarks.other_simulator.rows import Rows

Array = NDArray[np.float64]

BREAK_S = 240.0  # a gap between two readings in which people do something else


def gaps_s(rows: Rows) -> Array:
    """Time since the reading before (r,); 0 at the first one."""
    return np.diff(rows.t_s, prepend=rows.t_s[0])


def draw_breaks(rows: Rows, rng: np.random.Generator) -> tuple[Indices, float]:
    """How many breaks there were before each reading (r,), and when the first one ended.

    Where nobody ever took one, they are drawn: short ones, that the times of the readings do not show.
    """
    ends_s = rows.t_s[gaps_s(rows) > BREAK_S] - 1.0
    if not len(ends_s):
        ends_s = np.sort([draw_instant(rows, rng, 0.15, 0.85) for _ in range(UNCHANGED)])
    return np.searchsorted(ends_s, rows.t_s, "right"), float(ends_s[0])


def draw_after_break(rows: Rows, rng: np.random.Generator) -> tuple[NDArray[np.bool_], float, float]:
    """Whether a reading is after one of the breaks (r,), when the first of those was, and the moment before it."""
    breaks, _ = draw_breaks(rows, rng)
    after = breaks >= rng.integers(1, int(breaks[-1]) + 1)
    first = int(np.argmax(after))
    return after, float(rows.t_s[first]), float(rows.t_s[first - 1] + rows.t_s[first]) / 2


def draw_stretches(rows: Rows, count: tuple[int, int], share: tuple[float, float], rng: np.random.Generator) -> Array:
    """1 within some stretches of the campaign, each of such a share of it, else 0 (r,)."""
    on = np.zeros(len(rows))
    for _ in range(int(rng.integers(*count))):
        begin = rng.uniform(-0.05, 0.95)
        on[(rows.elapsed > begin) & (rows.elapsed < begin + rng.uniform(*share))] = 1.0
    return on


def gathered_until(rows: Rows, amount: Array, taken_away: NDArray[np.intp]) -> Array:
    """Sum of an amount (r,) since the last time that something took it away, by the number of such times (r,)."""
    total = np.cumsum(amount)
    out = total.copy()
    for one in np.unique(taken_away):
        out[taken_away == one] -= total[taken_away == one][0]
    return out


def wound_up(rows: Rows, drive: int, length_m: float) -> Array:
    """How far a drive is wound up against its motion (r,), -1 to 1: each way adds to what the ways before have left.

    A visit is a way to where the last approach begins, and that approach.
    """
    place_m = rows.commanded_m[:, drive]
    approach_m = rows.side[:, drive] * rows.approach_m[:, drive]
    to_begin_m = place_m - approach_m - of_former_visit(rows, place_m)
    out, state, first = np.zeros(len(rows)), 0.0, new_visit(rows)
    for k in range(len(rows)):
        if first[k]:
            for way_m in (to_begin_m[k], approach_m[k]):
                state = np.sign(way_m) + (state - np.sign(way_m)) * np.exp(-abs(way_m) / length_m)
        out[k] = state
    return out


def reversals(rows: Rows, drive: int) -> Array:
    """How often the side that a drive comes from has changed (r,)."""
    side = rows.side[:, drive]
    return np.cumsum(np.diff(side, prepend=side[0]) != 0).astype(float)


def following(t_s: Array, x: Array, tau_s: Array) -> Array:
    """What follows x (r,) with a time constant that is another at each time (r,); it begins where x does."""
    out = np.array(x, float)
    for k in range(1, len(x)):
        out[k] = out[k - 1] + (1 - np.exp(-(t_s[k] - t_s[k - 1]) / tau_s[k])) * (x[k] - out[k - 1])
    return out


def last_told(rows: Rows, x: Array, every_min: float, first: float) -> Array:
    """Values (r,) at the last time that somebody looked, which is done every so many minutes."""
    turn = np.floor(rows.hours * 60 / every_min + first).astype(int)
    begins = np.flatnonzero(np.diff(turn, prepend=turn[0] - 1) != 0)
    return np.asarray(x[begins[np.searchsorted(begins, np.arange(len(x)), "right") - 1]])


def draw_there_for_a_while(rows: Rows, rng: np.random.Generator) -> tuple[Array, float]:
    """1 from a moment to another, else 0 (r,), and the first of them."""
    first_s, second_s = draw_two_instants(rows, rng, (0.1, 0.4), (0.55, 0.9))
    return ((rows.t_s > first_s) & (rows.t_s < second_s)).astype(float), first_s
