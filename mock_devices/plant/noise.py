"""Noise of readings with tails heavier than the normal distribution's."""

from __future__ import annotations

import numpy as np

from mock_devices.effects.base import Array


def heavy_tailed(normal: Array, degrees: float, rng: np.random.Generator) -> Array:
    """Student's t of unit variance from unit normal values (..., k): one common divisor a reading; 0 leaves them."""
    if not degrees:
        return normal
    spread = rng.chisquare(degrees, normal.shape[:-1])[..., None]
    return np.asarray(normal * np.sqrt((degrees - 2.0) / spread))
