"""What a slow quantity was, by readings of it that scatter: the local level model, a random walk read with white noise.

A. C. Harvey, Forecasting, Structural Time Series Models and the Kalman Filter (1989), 2.3 and 4.1; the first level is
free. Noise and walk are those of highest likelihood, so that readings without noise stay what they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize_scalar

from calibration.base.arrays import Array

RATIOS = np.linspace(-7.0, 25.0, 33)  # logarithms of noise over the walk's variance between two typical readings
NEAR = 0.01  # of such a logarithm
SHORTEST = 1e-3  # of the typical time between readings: nearer ones are as far apart as this
LEAST_VARIANCE = 1e-18  # over the readings' own


@dataclass(frozen=True)
class LocalLevel:
    """level (n,): most likely, at the times of the readings; deviation (n,): its standard deviation. noise: standard
    deviation of one reading about it."""

    level: Array
    deviation: Array
    noise: float


def local_level(t_s: Array, x: Array, least_noise: float = 0.0) -> LocalLevel:
    """The level at times (n,) that do not fall, of readings (n,) with at least so much noise; two readings or more."""
    wait = np.diff(t_s)
    wait = np.maximum(wait / np.median(wait[wait > 0.0]) if np.any(wait > 0.0) else np.ones(len(wait)), SHORTEST)
    x = x - (middle := float(np.mean(x)))
    least = max(least_noise**2, LEAST_VARIANCE * float(np.mean(x**2)), np.finfo(np.float64).tiny)
    fits = [_Fit.of(ratio, wait, x, least) for ratio in RATIOS]
    k = int(np.argmin([fit.cost for fit in fits]))
    bounds = RATIOS[max(k - 1, 0)], RATIOS[min(k + 1, len(RATIOS) - 1)]
    best = minimize_scalar(
        lambda ratio: _Fit.of(ratio, wait, x, least).cost, bounds=bounds, method="bounded", options={"xatol": NEAR}
    )
    fit = min(fits[k], _Fit.of(float(best.x), wait, x, least), key=lambda each: each.cost)
    return LocalLevel(middle + fit.level, np.sqrt(fit.variance / fit.information), float(np.sqrt(fit.variance)))


@dataclass(frozen=True)
class _Fit:
    """The levels of highest density where noise is so many times the walk (logarithm), and -2 log likelihood.

    variance: of the noise. information (n,): of the level at each reading, times that variance.
    """

    level: Array
    variance: float
    cost: float
    information: Array

    @classmethod
    def of(cls, ratio: float, wait: Array, x: Array, least: float) -> _Fit:
        """wait (n - 1,): between readings."""
        stiff = np.exp(ratio) / wait  # the levels minimise |x - level|^2 + sum stiff (change of level)^2
        upper = np.zeros((2, len(x)))
        upper[0, 1:] = -stiff
        upper[1] = 1.0
        upper[1, :-1] += stiff
        upper[1, 1:] += stiff
        factor = cholesky_banded(upper)
        level = np.asarray(cho_solve_banded((factor, False), x))
        square, freedom = float((x - level) @ x), len(x) - 1
        variance = max(square / freedom, least)
        determinant = 2.0 * float(np.sum(np.log(factor[1]))) - float(np.sum(np.log(stiff)))
        forward = factor[1] ** 2  # pivots; with those from the end they give the diagonal of the inverse
        backward = cholesky_banded(_turned(upper))[1, ::-1] ** 2
        cost = square / variance + freedom * np.log(variance) + determinant
        return cls(level, variance, float(cost), forward + backward - upper[1])


def _turned(upper: Array) -> Array:
    """The same symmetric tridiagonal matrix with its rows and columns in reverse order."""
    return np.stack([np.concatenate([[0.0], upper[0, :0:-1]]), upper[1, ::-1]])
