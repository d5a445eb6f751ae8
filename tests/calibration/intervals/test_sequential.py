"""Error probabilities of a check that stops early, by simulation of nested readings."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.intervals.sequential import SequentialPlan, bounds

PLAN = SequentialPlan()
SD = np.sqrt(12.0 / np.array(PLAN.looks))


def simulated(limits, change, runs, seed, changes=6):
    """Answers and looks of checks in which the first of some independent changes has a size."""
    rng = np.random.default_rng(seed)
    answers, looks = [], []
    for _ in range(runs):
        noise = np.cumsum(rng.standard_normal((12, changes)), axis=0)
        for k, poses in enumerate(PLAN.looks):
            mean = noise[poses - 1] / poses * np.sqrt(12.0)  # in standard uncertainties of the whole check
            mean[0] += change
            answer = limits.answer(k, mean / SD[k])
            if answer != "go on":
                break
        answers.append(answer)
        looks.append(PLAN.looks[k])
    return np.array(answers), np.array(looks)


def test_an_unchanged_machine_is_rarely_called_changed():
    limits = bounds(PLAN, SD, 6.0)
    answers, looks = simulated(limits, 0.0, 6000, 1)
    assert np.mean(answers == "changed") < limits.false_alarm + 3.0 * np.sqrt(limits.false_alarm / 6000)
    assert np.mean(answers == "changed") > 0.3 * limits.false_alarm  # the bound is not idle
    assert np.median(looks) < 12


def test_a_change_of_the_stated_size_is_rarely_missed():
    limits = bounds(PLAN, SD, 6.0)
    answers, looks = simulated(limits, PLAN.size, 4000, 2)
    assert limits.miss < 0.05
    assert np.mean(answers == "unchanged") < limits.miss + 3.0 * np.sqrt(limits.miss / 4000)
    assert np.mean(looks) < 11.0


def test_a_large_change_ends_the_check_at_its_first_look():
    _, looks = simulated(bounds(PLAN, SD, 6.0), 15.0, 200, 3)
    assert np.mean(looks == 4) > 0.95


def test_the_last_look_always_decides():
    limits = bounds(PLAN, SD, 6.0)
    assert limits.answer(4, np.array([limits.upper[4] - 1e-9])) == "unchanged"
    assert limits.answer(4, np.array([limits.upper[4] + 1e-9])) == "changed"
    assert limits.answer(3, np.array([0.5 * (limits.upper[3] + limits.lower[3])])) == "go on"


def test_limits_widen_with_the_machine_s_own_scatter():
    assert bounds(PLAN, SD, 6.0, scale=1.5).upper == pytest.approx(1.5 * bounds(PLAN, SD, 6.0).upper)


@pytest.mark.parametrize(
    "make",
    [
        lambda: SequentialPlan(looks=(6, 4)),
        lambda: SequentialPlan(looks=()),
        lambda: SequentialPlan(false_alarm=0.0),
        lambda: bounds(PLAN, SD[:3], 6.0),
        lambda: bounds(PLAN, SD, 6.0).answer(0, np.array([np.nan])),
    ],
)
def test_plans_that_cannot_be_are_refused(make):
    with pytest.raises(InputError):
        make()
