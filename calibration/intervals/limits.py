"""Limits of checks: from the stated uncertainty U while the machine has no history, then from its own.

The standardised innovations of quiet checks would have the variance 1 if U and the drift were as stated. The variance
of a machine is estimated from its own quiet checks, with U counted as `PRIOR_CHECKS` checks of variance 1 (the mean of
a scaled inverse chi-square distribution), so that limits neither jump nor have to be set by trial and error.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.intervals.drift import DriftSettings, DriftTrack
from calibration.intervals.sequential import BoundedLooks, SequentialPlan, bounds

PRIOR_CHECKS = 60
LEAST_CHECKS = 20  # fewer quiet ones leave limits provisional
SCALE_RANGE = (0.9, 2.0)  # beyond, the stated uncertainty itself is wrong: limits do not follow
_QUIET = 3.0  # checks with a larger innovation are left out of the estimate ...
_QUIET_SHARE = 0.97  # ... which takes about this share of the variance away


@dataclass(frozen=True)
class ChartScale:
    """Standard deviation of quiet checks' standardised innovations, from how many, and whether it is provisional."""

    scale: float
    checks: int
    provisional: bool
    reason: str


def chart_scale(track: DriftTrack | None, before: int | None = None) -> ChartScale:
    """The scale of a machine's limits from its checks, of them the first `before` only if given."""
    rows = np.empty((0, 1)) if track is None else _quiet(track, before)
    square = np.mean(rows**2, axis=1) / _QUIET_SHARE if len(rows) else np.empty(0)
    variance = (PRIOR_CHECKS + float(square.sum())) / (PRIOR_CHECKS + len(square))
    scale = float(np.clip(np.sqrt(variance), *SCALE_RANGE))
    provisional = len(square) < LEAST_CHECKS
    words = f"limits from U and {len(square)} quiet checks of this machine, {scale:.2f} times those of U alone"
    return ChartScale(scale, len(square), provisional, words + (" (provisional)" if provisional else ""))


def _quiet(track: DriftTrack, before: int | None) -> Array:
    rows = track.innovations[:before]
    judged = np.array(track.judged[:before], dtype=bool)
    return np.asarray(rows[judged & (np.abs(rows).max(axis=1, initial=0.0) < _QUIET)])


def bounds_of_check(
    plan: SequentialPlan, settings: DriftSettings, variance: Array, unit: Array, independent: float, scale: float
) -> BoundedLooks:
    """Limits of a check's looks, given what the expectation adds.

    variance (w,): of the expectation; unit (w,): standard uncertainty of a check with all poses. A look after n poses
    has the uncertainty unit sqrt(full / n); the median over the watched changes stands for all.
    """
    added = float(np.median(variance / unit**2))
    looks = np.asarray(plan.looks, dtype=np.float64)
    return bounds(plan, np.sqrt(settings.full_poses / looks + added), independent, scale)
