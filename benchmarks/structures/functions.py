"""Random smooth functions: draws of Gaussian processes by random Fourier features, none of which has a formula.

Squared-exponential covariance, features of Rahimi and Recht (2007).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Function = Callable[[Array], Array]

FEATURES = 64
LENGTH = (0.35, 1.5)  # of correlation, where the coordinate runs from -1 to 1
HARMONICS = 3
SPREAD = 0.6  # of the logarithm of a positive function


def smooth(rng: np.random.Generator) -> Function:
    """A draw on [-1, 1] of unit variance."""
    length = float(np.exp(rng.uniform(*np.log(LENGTH))))
    rates, phases = rng.standard_normal(FEATURES) / length, rng.uniform(0.0, 2.0 * np.pi, FEATURES)
    weights = rng.standard_normal(FEATURES) * np.sqrt(2.0 / FEATURES)
    return lambda u: np.asarray(np.cos(u[..., None] * rates + phases) @ weights)


def positive(rng: np.random.Generator) -> Function:
    """The exponential of a draw: what has a width, and keeps its sign."""
    draw = smooth(rng)
    return lambda u: np.exp(SPREAD * draw(u))


def periodic(rng: np.random.Generator) -> Function:
    """A draw of period one, of a few harmonics."""
    orders = np.arange(1, HARMONICS + 1)
    weights = rng.standard_normal((2, HARMONICS)) / orders
    return lambda u: np.asarray(
        np.cos(2.0 * np.pi * u[..., None] * orders) @ weights[0]
        + np.sin(2.0 * np.pi * u[..., None] * orders) @ weights[1]
    )


def scaled(x: Array) -> Array:
    """A coordinate on [-1, 1] over the values that it takes."""
    low, high = float(x.min()), float(x.max())
    return (2.0 * x - low - high) / (high - low)
