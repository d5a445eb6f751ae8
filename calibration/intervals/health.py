"""A short check while it is made: what the machine's history expects of it, and when it may stop."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.intervals.drift import Expectation, expect, follow
from calibration.intervals.facts import CheckFact, MachineHistory
from calibration.intervals.limits import ChartScale, bounds_of_check, chart_scale
from calibration.intervals.sequential import Answer, BoundedLooks
from calibration.intervals.settings import IntervalSettings


@dataclass(frozen=True)
class HealthTest:
    """Expectation, limits and their scale, fixed before the first pose of a check is measured."""

    expected: Expectation
    looks: BoundedLooks
    scale: ChartScale

    def standardised(self, change: Array, change_u: Array) -> Array:
        """Changes (w,) against what was expected, in standard deviations."""
        return self.expected.standardised(change, change_u)

    def answer(self, look: int, change: Array, change_u: Array) -> Answer:
        """Whether to go on after a look (0 to k - 1), from the changes found so far (w,)."""
        return self.looks.answer(look, self.standardised(change, change_u))


def health_test(history: MachineHistory, settings: IntervalSettings, planned: CheckFact) -> HealthTest:
    """The test of a check, planned or made: only facts stored before it count.

    Of the check its time, temperature, calibration, instrument, watched names, poses, change_u and
    reference_u are used, not what it found.
    """
    before = _until(history, planned)
    expected = expect(before, settings.drift, planned)
    unit = np.asarray(planned.change_u) * np.sqrt(planned.poses / settings.drift.full_poses)
    scale = chart_scale(follow(before, settings.drift))
    looks = bounds_of_check(settings.check, settings.drift, expected.variance, unit, planned.independent, scale.scale)
    return HealthTest(expected, looks, scale)


def _until(history: MachineHistory, check: CheckFact) -> MachineHistory:
    return replace(history, checks=tuple(c for c in history.checks if c.t_utc_s < check.t_utc_s and c.id != check.id))
