"""What rounding leaves of positions: that of floating-point numbers, of an encoder's counts, of decimals in a file."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array

ALIKE = 1.5  # differences of neighbouring values below this many times the least one are one step each
OFF_GRID = 0.1  # of a step, RMS, beyond which values are on no grid
LEAST_STEPS = 10  # differences of one step, and values that return, that make a grid
NORMAL = 1.4826  # standard deviation over the median of absolute values
UNSMOOTHED = 1.25  # over what smoothing takes off: a cubic over seven samples takes off two thirds of a variance


def rounding_step(x: Array, least_steps: int = LEAST_STEPS) -> float:
    """Step to which values (n,) are rounded: that of their grid, at least the distance of floating-point numbers.

    A grid is told by neighbouring values that are one step apart, and by values that return, at least so many of each;
    one so fine that few do is not seen.
    """
    floating = float(np.spacing(np.max(np.abs(x))))
    values = np.unique(x)
    differences = np.diff(values)
    differences = differences[differences > 4.0 * floating]  # the same value, after another calculation
    single = differences[differences < ALIKE * differences.min(initial=np.inf)]
    if min(len(single), len(x) - len(values)) < least_steps:
        return floating
    step = float(single.mean())
    count, at = np.cumsum(np.round(differences / step)), np.cumsum(differences)
    step = float(count @ at) / float(count @ count)
    off_grid = float(np.sqrt(np.mean((at - step * count) ** 2)))
    return floating if off_grid > OFF_GRID * step else step


def rounding_deviation(x: Array, smooth: Array) -> float:
    """Standard deviation of the rounding of values (n,), given the same smoothed.

    The samples of a steady motion are on a grid too, but smooth.
    """
    floating = float(np.spacing(np.max(np.abs(x))))
    seen = UNSMOOTHED * NORMAL * float(np.median(np.abs(x - smooth)))  # corners are no rounding
    return float(max(floating, min(rounding_step(x), np.sqrt(12.0) * seen)) / np.sqrt(12.0))
