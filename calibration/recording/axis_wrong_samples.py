"""Wrong samples of an axis: a few in a row at which the gap leaves what its neighbours say, and returns.

Judged before any fit, since a single one far off is more than all effects together. The edge of a play or a slip
does not return, and a fast wave has neighbours like itself: both stay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, median_filter

from calibration.base.arrays import Array
from calibration.base.rounded_values import rounding_step

MOST_IN_A_ROW = 3
NEIGHBOURS, LEAST_ON_A_SIDE = 12, 4  # samples on each side
AT_ENDS = 2.0  # times the range of the gap
WINDOW = 4 * MOST_IN_A_ROW + 1  # of the running median: two spikes are less than half of it
SUSPECT = 8.0  # standard deviations from the running median, by a quantile: where a gap only rises, most are at it
OF_LARGEST = 0.2  # of the departures nearby: a large one moves the median beside it by a little
BEYOND = 5.0  # times what any neighbour is off a line through them
STEPS = 4.0  # of the positions' rounding, by which a gap may flicker
LEAST_KEPT = 0.75  # of the neighbours that are not suspect themselves
MOST_SHARE = 0.01  # of all samples: what is more often is no error of single ones
BULK, NORMAL = 0.9, 1.645  # that quantile of absolute values, and how many standard deviations it is


@dataclass(frozen=True)
class WrongSamples:
    """`count` samples in a row from number `first` on, at a time from the first of all.

    off: by how much the position is off, the most of them, in rad or m. of_motor: whether it is the motor's.
    """

    first: int
    count: int
    time_s: float
    off: float
    of_motor: bool


def without_wrong_samples(time_s: Array, motor: Array, second: Array) -> tuple[Array, Array, tuple[WrongSamples, ...]]:
    """Both positions (n,) with what the neighbours say in place of wrong samples, and these in the order of time."""
    gap = second - motor
    mended, of_gap, found = motor.copy(), gap.copy(), []
    for first, count in _runs(gap, STEPS * max(rounding_step(motor), rounding_step(second))):
        run, around = np.arange(first, first + count), _around(len(gap), first, count)
        of_gap[run] = np.interp(run, around, gap[around])
        off = gap[run] - of_gap[run]
        by_motor, by_second = (_own_departure(x, run, around) for x in (motor, second))
        of_motor = by_motor > by_second
        if of_motor:
            mended[run] += off
        most = float(off[np.argmax(np.abs(off))])
        found.append(
            WrongSamples(first, count, float(time_s[first] - time_s[0]), -most if of_motor else most, of_motor)
        )
    if not found:
        return motor, second, ()
    return mended, mended + of_gap, tuple(found)


def _runs(gap: Array, least: float) -> list[tuple[int, int]]:
    """First sample and number of samples of each wrong run of a gap (n,); what is off by less than `least` is none."""
    departure = np.abs(gap - median_filter(gap, WINDOW, mode="mirror"))
    level = max(SUSPECT * float(np.quantile(departure, BULK)) / NORMAL, least)
    suspect = (departure > level) & (departure > OF_LARGEST * maximum_filter(departure, WINDOW))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], suspect, [False]]).astype(np.int8)))
    out = []
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if end - first <= MOST_IN_A_ROW and _is_wrong(gap, suspect, first, end - first, level):
            out.append((first, end - first))
    return out if sum(count for _, count in out) <= MOST_SHARE * len(gap) else []


def _is_wrong(gap: Array, suspect: NDArray[np.bool_], first: int, count: int, level: float) -> bool:
    """Whether a run is far off a line through its neighbours, compared with how far these are.

    At either end nothing tells whether it returns: there it has to be off by more than the gap ever varies.
    """
    around = _around(len(gap), first, count)
    kept = around[~suspect[around]]
    if len(kept) < LEAST_KEPT * len(around):
        return False
    line = np.polynomial.Polynomial.fit(kept, gap[kept], 1)
    spread = float(np.max(np.abs(gap[kept] - line(kept))))
    run = np.arange(first, first + count)
    if min(first, len(gap) - first - count) < LEAST_ON_A_SIDE:
        level = max(level, AT_ENDS * float(np.ptp(gap[~suspect])))
    return float(np.min(np.abs(gap[run] - line(run)))) > max(BEYOND * spread, level)


def _own_departure(position: Array, run: NDArray[np.intp], around: NDArray[np.intp]) -> float:
    """How far a position (n,) is off a cubic through its neighbours: which of two is wrong."""
    cubic = np.polynomial.Polynomial.fit(around, position[around], 3)
    return float(np.max(np.abs(position[run] - cubic(run))))


def _around(total: int, first: int, count: int) -> NDArray[np.intp]:
    """Numbers of the neighbours of a run on both sides."""
    before = np.arange(max(first - NEIGHBOURS, 0), first)
    return np.concatenate([before, np.arange(first + count, min(first + count + NEIGHBOURS, total))])
