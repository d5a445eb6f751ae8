"""What rounding leaves of positions: that of floating-point numbers, of an encoder's counts, of decimals in a file."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array

ALIKE = 1.5  # differences of neighbouring values below this many times the least one are one step each
OFF_GRID = 0.1  # of a step, RMS, beyond which values are on no grid
LEAST_STEPS = 10  # differences of one step that make a grid


def rounding_step(x: Array) -> float:
    """Step to which values (n,) are rounded: that of their grid, at least the distance of floating-point numbers.

    A grid is told by neighbouring values that are one step apart; one so fine that few are is not seen.
    """
    floating = float(np.spacing(np.max(np.abs(x))))
    values = np.unique(x)
    differences = np.diff(values)
    differences = differences[differences > 4.0 * floating]  # the same value, after another calculation
    if not len(differences):
        return floating
    single = differences[differences < ALIKE * differences.min()]
    if len(single) < LEAST_STEPS:
        return floating
    step = float(single.mean())
    count = np.cumsum(np.round(differences / step))
    at = np.cumsum(differences)
    step = float(count @ at) / float(count @ count)
    off_grid = float(np.sqrt(np.mean((at - step * count) ** 2)))
    return step if off_grid < OFF_GRID * step else floating


def rounding_deviation(*positions: Array) -> float:
    """Standard deviation that the rounding of several positions (n,) leaves in their sum or difference."""
    return float(np.sqrt(sum(rounding_step(x) ** 2 for x in positions) / 12.0))
