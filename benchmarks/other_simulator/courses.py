"""Courses in time: what follows slowly, and what wanders."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HOUR_S = 3600.0


def lagging(t_s: Array, x: Array, tau_s: float) -> Array:
    """What follows x (r,) with a time constant; it begins where x does."""
    out = np.empty_like(x, dtype=float)
    out[0] = x[0]
    for k in range(1, len(t_s)):
        out[k] = out[k - 1] + (1 - np.exp(-(t_s[k] - t_s[k - 1]) / tau_s)) * (x[k] - out[k - 1])
    return out


def wandering(t_s: Array, tau_s: float, rng: np.random.Generator) -> Array:
    """An Ornstein-Uhlenbeck process (r,) of unit variance."""
    out = np.empty(len(t_s))
    out[0] = rng.normal()
    for k in range(1, len(t_s)):
        keep = np.exp(-(t_s[k] - t_s[k - 1]) / tau_s)
        out[k] = keep * out[k - 1] + np.sqrt(1 - keep * keep) * rng.normal()
    return out


def walking(t_s: Array, rng: np.random.Generator) -> Array:
    """Random walks (r, 3) of unit variance after an hour, each."""
    steps = np.sqrt(np.maximum(np.diff(t_s, prepend=t_s[0]), 0) / HOUR_S)
    return np.cumsum(rng.normal(size=(len(t_s), 3)) * steps[:, None], 0)
