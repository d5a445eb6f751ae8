"""The statistics of the scores."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Z95 = 1.959963984540054
BINS = 10
SIMULATIONS = 1000


def wilson(hits: int, trials: int) -> tuple[float, float]:
    """95 % interval of a proportion (Wilson's); from 0 to 1 without trials."""
    if trials == 0:
        return 0.0, 1.0
    z2, share = Z95**2, hits / trials
    middle = (share + z2 / (2.0 * trials)) / (1.0 + z2 / trials)
    half = Z95 / (1.0 + z2 / trials) * math.sqrt(share * (1.0 - share) / trials + z2 / (4.0 * trials**2))
    low = 0.0 if hits == 0 else max(middle - half, 0.0)
    high = 1.0 if hits == trials else min(middle + half, 1.0)
    return low, high


def reliability(stated: Array, right: Array, bins: int = BINS) -> list[tuple[float, float, int]]:
    """Mean stated probability, share of right answers and count of every bin of equal width that is not empty."""
    index = np.minimum((stated * bins).astype(int), bins - 1)
    return [
        (float(stated[index == b].mean()), float(right[index == b].mean()), int(np.sum(index == b)))
        for b in range(bins)
        if np.any(index == b)
    ]


def calibration_error(stated: Array, right: Array, bins: int = BINS) -> float:
    """Expected calibration error: mean distance of the share of right answers from the stated probability."""
    parts = reliability(stated, right, bins)
    total = sum(count for _, _, count in parts)
    return sum(count * abs(share - mean) for mean, share, count in parts) / total if total else 0.0


def excess_calibration_error(
    stated: Array, right: Array, *, seed: int = 0, simulations: int = SIMULATIONS
) -> tuple[float, float, float]:
    """Calibration error beyond what outcomes drawn from the stated probabilities show; 95 % interval by bootstrap."""
    if len(stated) == 0:
        return 0.0, 0.0, 1.0
    rng = np.random.default_rng(seed)
    simulated = rng.random((simulations, len(stated))) < stated
    by_chance = float(np.mean([calibration_error(stated, row.astype(np.float64)) for row in simulated]))
    resampled = rng.integers(0, len(stated), (simulations // 2, len(stated)))
    spread = [calibration_error(stated[k], right[k]) for k in resampled]
    observed = calibration_error(stated, right)
    # Resampling adds chance once more: centre the bootstrap on what was found.
    shifted = np.array(spread) - float(np.mean(spread)) + observed - by_chance
    return observed - by_chance, float(np.quantile(shifted, 0.025)), float(np.quantile(shifted, 0.975))


def paired_difference(first: Sequence[bool], second: Sequence[bool]) -> tuple[float, float, float]:
    """Difference of two proportions on the same cases with its 95 % interval."""
    n = len(first)
    if n == 0:
        return 0.0, -1.0, 1.0
    only_first = sum(a and not b for a, b in zip(first, second, strict=True))
    only_second = sum(b and not a for a, b in zip(first, second, strict=True))
    observed = (only_first - only_second) / n
    spread = math.sqrt(max(only_first + only_second - n * observed**2, 0.0)) / n
    return observed, observed - Z95 * spread, observed + Z95 * spread
