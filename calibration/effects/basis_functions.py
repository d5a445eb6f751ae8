"""Families of functions of one coordinate: columns (n, k) whose random combinations are smooth, rough or periodic."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array


def unit(x: Array) -> Array:
    """A coordinate (n,) on [0, 1]; zeros where it does not vary."""
    low, span = float(x.min()), float(np.ptp(x))
    return np.asarray((x - low) / span) if span > 0.0 else np.zeros_like(x)


def brownian(t: Array, terms: int) -> Array:
    """Karhunen-Loeve terms (n, k) of a random walk of unit variance at t = 1 that starts at zero."""
    span = max(float(t.max()), 1e-9)
    k = np.arange(terms) + 0.5
    return np.asarray(np.sqrt(2.0 * span) * np.sin(np.pi * np.outer(t / span, k)) / (np.pi * k))


def smooth(x: Array, terms: int, *, roughness: float = 2.0, constant: bool = False) -> Array:
    """Cosines (n, k) over the range of x: term k has k half waves and the standard deviation k^-roughness, RMS one."""
    k = np.arange(0 if constant else 1, terms + 1)
    sd = np.maximum(k, 1).astype(np.float64) ** -roughness
    columns = np.cos(np.pi * np.outer(unit(x), k)) * np.sqrt(2.0)
    return np.asarray(columns * (sd / np.sqrt(np.sum(sd**2))))


def waves(t_s: Array, shortest_s: float, pairs: int) -> Array:
    """Sines and cosines (n, 2 k) down to a shortest period, RMS one altogether, all alike: slow wander."""
    longest = max(2.0 * float(np.ptp(t_s)), 2.0 * shortest_s)
    frequency = np.linspace(1.0 / longest, 1.0 / shortest_s, pairs)
    phase = 2.0 * np.pi * np.outer(t_s, frequency)
    return np.concatenate([np.sin(phase), np.cos(phase)], axis=1) / np.sqrt(pairs)


def products(a: Array, b: Array) -> Array:
    """All products (n, j k) of the columns of two families."""
    return np.asarray((a[:, :, None] * b[:, None, :]).reshape(len(a), -1))


def centred(x: Array) -> Array:
    """A coordinate on [-1, 1]; zeros where it does not vary."""
    return 2.0 * unit(x) - 1.0 if np.ptp(x) > 0.0 else np.zeros_like(x)
