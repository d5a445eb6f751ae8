"""Coloured noise: its power over frequency as a smooth function, fitted together with what is explained.

Cosine transforms (DCT-II) of evenly sampled stationary noise are almost independent, also where it is not periodic, so
its covariance is a power per cosine. The logarithm of the power is linear between knots, one an octave.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct

from calibration.base.arrays import Array

KNOTS_PER_OCTAVE = 1.0
GROUPS_PER_OCTAVE = 24  # of cosines, for the time that a fit takes
BEND = 1.0  # prior standard deviation of the change of slope at a knot, of the logarithm of the power
SLOPE, SLOPE_SD = -0.7, 0.7  # the same of the slope an octave: white to a random walk's. What falls faster is motion's
NEWTON_STEPS = 25
SMALL = 1e-5  # change of the logarithm at which a fit has settled
FLOOR = 1e-9  # of the mean power, below which the power of a channel without noise is not taken


def cosines(signals: Array) -> Array:
    """Cosine coefficients (n - 1, ...) of signals (n, ...), without their mean: an offset is not known."""
    return np.asarray(dct(signals, axis=0, norm="ortho")[1:])


def from_cosines(coefficients: Array) -> Array:
    """Signals (n, ...) without a mean, of their cosine coefficients (n - 1, ...)."""
    padded = np.concatenate([np.zeros((1, *coefficients.shape[1:])), coefficients])
    return np.asarray(idct(padded, axis=0, norm="ortho"))


@dataclass(frozen=True)
class NoiseShape:
    """How the logarithm of the power (c,) follows from its values at the knots (k,): weights (c, k).

    first (b,): the first cosine of each group that shares its power in a fit; count (b,): how many; of_groups (b, k):
    their weights; prior (p, k), expected (p,): rows over their standard deviations, of bends and slopes; least: power,
    below which no noise is fitted.
    """

    weights: Array
    prior: Array
    expected: Array
    first: NDArray[np.intp]
    count: Array
    of_groups: Array
    least: float

    @classmethod
    def of(cls, count: int, least: float = 0.0) -> NoiseShape:
        """For a number of cosines, whose mean power is not below a least one."""
        log = np.log2(np.arange(1, count + 1))
        knots = np.linspace(0.0, log[-1], max(3, 1 + round(KNOTS_PER_OCTAVE * log[-1])))
        place = np.clip(np.searchsorted(knots, log, side="right") - 1, 0, len(knots) - 2)
        share = (log - knots[place]) / (knots[place + 1] - knots[place])
        weights = np.zeros((count, len(knots)))
        rows = np.arange(count)
        weights[rows, place], weights[rows, place + 1] = 1.0 - share, share
        bend, slope = (np.diff(np.eye(len(knots)), order, axis=0) for order in (2, 1))
        octaves = float(knots[1] - knots[0])
        prior = np.concatenate([bend / BEND, slope / (SLOPE_SD * octaves)])
        expected = np.concatenate([np.zeros(len(bend)), np.full(len(slope), SLOPE / SLOPE_SD)])
        _, first, counts = np.unique(np.floor(GROUPS_PER_OCTAVE * log), return_index=True, return_counts=True)
        of_groups = np.add.reduceat(weights, first, axis=0) / counts[:, None]
        return cls(weights, prior, expected, first, counts.astype(np.float64), of_groups, least)

    def power(self, knots: Array) -> Array:
        """Power (c,) of each cosine."""
        return np.asarray(np.exp(self.weights @ knots))

    def log_prior(self, knots: Array) -> float:
        """Logarithm of the prior of the knots (k,), less a constant: slopes are moderate, and change little."""
        return -0.5 * float(np.sum((self.prior @ knots - self.expected) ** 2))

    def fit(self, squares: Array, start: Array | None = None) -> Array:
        """The most likely knots (k,) for squares (c,) of the coefficients: Newton's steps on a convex function."""
        means = np.add.reduceat(squares, self.first) / self.count
        means = np.maximum(means, max(FLOOR * float(squares.mean()), self.least, 1e-300))
        weights, half = self.of_groups, 0.5 * self.count
        if start is None:
            start = np.asarray(np.linalg.lstsq(weights, np.log(means), rcond=None)[0], dtype=np.float64)
        knots = start
        prior = self.prior.T @ self.prior
        value = self._misfit(knots, means)
        for _ in range(NEWTON_STEPS):
            ratio = means * np.exp(-(weights @ knots))
            gradient = weights.T @ (half * (1.0 - ratio)) + self.prior.T @ (self.prior @ knots - self.expected)
            curvature = weights.T @ (weights * (half * ratio)[:, None]) + prior
            step = np.linalg.solve(curvature + 1e-9 * np.eye(len(knots)), gradient)
            step /= max(1.0, float(np.max(np.abs(step))) / 3.0)
            while (new := self._misfit(knots - step, means)) > value + 1e-9 * abs(value):
                step = 0.5 * step
            knots, value = knots - step, new
            if float(np.max(np.abs(step))) < SMALL:
                break
        return knots

    def _misfit(self, knots: Array, means: Array) -> float:
        log = self.of_groups @ knots
        return 0.5 * float(np.sum(self.count * (log + means * np.exp(-log)))) - self.log_prior(knots)
