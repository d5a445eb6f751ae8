"""Which readings are wrong: those beyond six of their own standard deviations (docs/explanation/wrong-readings.md).

The own standard deviation of a reading is the stated one of its deviation, times the scale of its kind in this
recording. The scale is taken from the bulk of the readings, so that neither a few wrong ones widen it nor something
that the model lacks, and that every reading shows, is taken for wrong readings.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi

from calibration.base.arrays import Array

GATE_SIGMAS = 6.0
ELSEWHERE_TIMES, ELSEWHERE_M, MOST_ELSEWHERE = 8.0, 0.05, 0.1  # no machine is so far off what it is commanded
BULK = (0.5, 0.9)  # quantiles of the deviations that must agree with the stated deviations, else these are too small


def scale_of(distance: Array, width: int) -> float:
    """Own over stated standard deviations of readings of one kind, 1 at least.

    distance (n,): root of the square form of a deviation of `width` numbers by its stated covariance, so the largest
    number of standard deviations in any direction; its quantiles are compared with those of the chi distribution.
    """
    return max(1.0, float(np.max(np.quantile(distance, BULK, method="lower") / chi.ppf(BULK, width))))


def own_sigmas(distance: Array, width: int, kind: NDArray[np.intp]) -> Array:
    """Deviations (n,) in own standard deviations from those in stated ones; kind (n,): readings with one scale."""
    out = distance.copy()
    for one in np.unique(kind):
        rows = kind == one
        out[rows] /= scale_of(distance[rows], width)
    return out


def are_elsewhere(miss_m: Array, *, spoiled: bool = False) -> NDArray[np.bool_]:
    """Which readings (n,) miss their expected places by so much (n,) more than most do that the station must have seen
    another reflector, or a mirror image. None where these are many: then something else is wrong.

    spoiled: those readings had a part in what is expected, so only the worst are told, after which the others may fit.
    """
    limit_m = max(ELSEWHERE_TIMES * float(np.median(miss_m)), ELSEWHERE_M)
    out = miss_m > (max(limit_m, 0.5 * float(np.max(miss_m))) if spoiled else limit_m)
    return np.asarray(out if np.mean(out) < MOST_ELSEWHERE else np.zeros_like(out))
