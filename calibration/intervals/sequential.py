"""A check that stops as soon as it can decide, with stated error probabilities.

After each group of poses the largest standardised change is compared with two limits. Beyond the upper one the machine
has changed; below the lower one no watched change has the size that must be found. The probabilities of a false alarm
and of a miss are spent over the groups (Lan and DeMets 1983): by Bonferroni's inequality the whole check keeps them,
however its looks are correlated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import ndtr, ndtri

from calibration.base.arrays import Array
from calibration.base.errors import InputError

Answer = Literal["go on", "unchanged", "changed"]


@dataclass(frozen=True)
class SequentialPlan:
    """When a check looks, and with which error probabilities it may stop.

    looks: numbers of poses after which it looks, the last one ends it. false_alarm: probability that one check of an
    unchanged machine says changed. early_miss: probability that a change of the size to be found is taken
    for none at a look before the last; what the last one adds is stated by `BoundedLooks.miss`. size: the change to be
    found, in standard uncertainties of the check with all poses.
    """

    looks: tuple[int, ...] = (4, 6, 8, 10, 12)
    false_alarm: float = 0.012
    early_miss: float = 0.02
    size: float = 5.5

    def __post_init__(self) -> None:
        if not self.looks or min(self.looks) < 1 or list(self.looks) != sorted(set(self.looks)):
            raise InputError(f"sequential check: looks {self.looks} must be ascending numbers of poses")
        if not (0.0 < self.false_alarm < 1.0 and 0.0 < self.early_miss < 1.0 and self.size > 0.0):
            raise InputError("sequential check: probabilities lie between 0 and 1, and the size is above zero")


@dataclass(frozen=True)
class BoundedLooks:
    """Limits of the largest standardised change at each look: upper (k,) and lower (k,), -1 where none is possible.

    size (k,): the change to be found in standard deviations of each look. false_alarm and miss: bounds of the error
    probabilities of the whole check.
    """

    upper: Array
    lower: Array
    size: Array
    false_alarm: float
    miss: float

    def answer(self, look: int, standardised: Array) -> Answer:
        """The answer at a look (0 to k - 1) for standardised changes (w,); the last look always decides."""
        largest = float(np.max(np.abs(standardised), initial=0.0))
        if not np.isfinite(largest):
            raise InputError("sequential check: a standardised change is not finite")
        if largest > self.upper[look]:
            return "changed"
        last = look == len(self.upper) - 1
        return "unchanged" if last or largest < self.lower[look] else "go on"


def bounds(plan: SequentialPlan, sd: Sequence[float] | Array, independent: float, scale: float = 1.0) -> BoundedLooks:
    """Limits of a plan.

    sd (k,): standard deviation of a change at each look, in standard uncertainties of the check with all poses (what
    the prediction adds included). independent: number of independent changes. scale: standard deviation of quiet
    checks' standardised changes, from the machine's own history (`limits.chart_scale`).
    """
    spread = np.asarray(sd, dtype=np.float64)
    if spread.shape != (len(plan.looks),) or not np.all(spread > 0.0) or scale <= 0.0:
        raise InputError("sequential check: needs a standard deviation above zero for each look")
    # A false alarm costs the same at each look, but power is greatest at the last one. A miss is spent more evenly, so
    # that most checks of an unchanged machine end after two thirds of their poses.
    part = np.asarray(plan.looks, dtype=np.float64) / plan.looks[-1]
    alpha = plan.false_alarm * part**8 / np.sum(part**8)
    upper = -ndtri(0.5 * alpha / independent) * scale
    size = plan.size / spread
    early = np.zeros(len(spread))
    if len(spread) > 1:
        early[:-1] = plan.early_miss * part[:-1] ** 3 / np.sum(part[:-1] ** 3)
    lower = np.full(len(spread), -1.0)
    lower[:-1] = np.maximum(size[:-1] + ndtri(np.maximum(early[:-1], 1e-300)) * scale, -1.0)
    lower = np.minimum(lower, upper)
    miss = float(early.sum() + ndtr((upper[-1] - size[-1]) / scale))
    return BoundedLooks(upper, lower, size, plan.false_alarm, min(miss, 1.0))
