"""Families of functions of one coordinate: columns (n, k) whose random combinations are smooth, rough or periodic."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from calibration.base.arrays import Array

CURVE_TERMS = 4
EVEN = np.linspace(-0.5, 0.5, 1001)  # a course that is gone through evenly
STEPS = 49  # at which a course is watched for turning: twice as many as a walk has terms


def scale_to_unit(x: Array) -> Array:
    """A coordinate (n,) scaled to [0, 1]; zeros if it does not vary."""
    low, span = float(x.min()), float(np.ptp(x))
    return np.asarray((x - low) / span) if span > 0.0 else np.zeros_like(x)


def scale_to_symmetric(x: Array) -> Array:
    """A coordinate (n,) scaled to [-1, 1]; zeros if it does not vary."""
    return 2.0 * scale_to_unit(x) - 1.0 if np.ptp(x) > 0.0 else np.zeros_like(x)


def random_walk_basis(t: Array, terms: int) -> Array:
    """Karhunen-Loeve terms (n, k) of a random walk that starts at zero and has unit variance at t = 1."""
    span = max(float(t.max()), 1e-9)
    k = np.arange(terms) + 0.5
    return np.asarray(np.sqrt(2.0 * span) * np.sin(np.pi * np.outer(t / span, k)) / (np.pi * k))


def any_course(t_s: Array, terms: int) -> Array:
    """Any course in time (n, k): a random walk over the whole time."""
    return random_walk_basis(t_s / max(float(t_s.max()), 1.0), terms)


def course_with_jumps(t_s: Array, terms: int, jumps_s: Sequence[float]) -> Array:
    """Any course in time (n, k): a random walk over the whole time, and jumps at some moments."""
    return np.column_stack([any_course(t_s, terms), *((t_s >= jump_s).astype(np.float64) for jump_s in jumps_s)])


def steps_over(t_s: Array, course: Array) -> Array:
    """By how much courses (n, k) change from one of STEPS evenly chosen readings to the next in time (STEPS - 1, k)."""
    in_time = np.argsort(t_s, kind="stable")
    chosen = in_time[np.linspace(0, len(in_time) - 1, STEPS).round().astype(np.intp)]
    return np.asarray(np.diff(course[chosen], axis=0))


def cosine_basis(x: Array, terms: int, *, roughness: float = 2.0, constant: bool = False) -> Array:
    """Cosines (n, k) over the range of x, total RMS one: term k has k half waves and is weighted by k^-roughness."""
    k = np.arange(0 if constant else 1, terms + 1)
    sd = np.maximum(k, 1).astype(np.float64) ** -roughness
    columns = np.cos(np.pi * np.outer(scale_to_unit(x), k)) * np.sqrt(2.0)
    return np.asarray(columns * (sd / np.sqrt(np.sum(sd**2))))


def wave_of(q_m: Array, period_m: float) -> Array:
    """Sine and cosine (n, 2) of a coordinate: a wave of any phase."""
    phase = 2.0 * np.pi * q_m / period_m
    return np.stack([np.sin(phase), np.cos(phase)], axis=1)


def fourier_basis(t_s: Array, shortest_s: float, pairs: int) -> Array:
    """Sines and cosines (n, 2 k) of equal size down to a shortest period, total RMS one: a slow variation in time."""
    longest = max(2.0 * float(np.ptp(t_s)), 2.0 * shortest_s)
    frequency = np.linspace(1.0 / longest, 1.0 / shortest_s, pairs)
    phase = 2.0 * np.pi * np.outer(t_s, frequency)
    return np.concatenate([np.sin(phase), np.cos(phase)], axis=1) / np.sqrt(pairs)


def principal_columns(columns: Array, most: int) -> Array:
    """Columns (n, most) whose random combinations are nearly those of all (n, k); all where there are no more.

    By principal components over the readings: of a family in time what varies while something is read.
    """
    if columns.shape[1] <= most:
        return columns
    directions = np.linalg.eigh(columns.T @ columns)[1][:, ::-1]
    return np.asarray(columns @ directions[:, :most])


def tensor_product(a: Array, b: Array) -> Array:
    """Products (n, j k) of each column of one family with each of another."""
    return np.asarray((a[:, :, None] * b[:, None, :]).reshape(len(a), -1))


def curve_over(course: Array) -> Array:
    """A straight line and cosines (n, 1 + CURVE_TERMS) over the range of a course (n,): any smooth curve."""
    return np.column_stack([course / max(float(np.ptp(course)), 1e-9), cosine_basis(course, CURVE_TERMS)])


@cache
def rises_of_curve() -> tuple[float, ...]:
    """By how much straight lines through the columns of a curve rise over its course: its ends say little."""
    return _rises(curve_over(EVEN))


@cache
def rises_of_walk(terms: int) -> tuple[float, ...]:
    """The same of any course in time: straight lines over the whole time."""
    return _rises(any_course(EVEN + 0.5, terms))


def _rises(columns: Array) -> tuple[float, ...]:
    return tuple(float(rise) for rise in EVEN @ columns / (EVEN @ EVEN))
