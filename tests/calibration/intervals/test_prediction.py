"""Due dates of machines that wear, of machines that do not, and of those that only follow the season."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.intervals.drift import WEEK_S, DriftSettings
from calibration.intervals.prediction import YEAR_S, PredictionSettings, forecast_temperature, predict_due
from tests.calibration.intervals.facts_for_tests import START_S, calibration, check, history

DRIFT = DriftSettings()
LIMIT = np.sqrt(25e-6**2 - 2e-6**2) / 0.8  # of the first change of `check`, in its unit


def checks_of(change, count, seed, temperature=lambda i: 21.0):
    """Weekly checks of a machine whose first change is `change(week)`, with noise."""
    rng = np.random.default_rng(seed)
    return tuple(
        check(
            i,
            change=(float(change(i) + 2e-6 * rng.standard_normal()), float(3e-6 * rng.standard_normal())),
            temperature_c=temperature(i),
        )
        for i in range(1, count + 1)
    )


def worn(weeks, begins=10.0, seed=1):
    """A machine that wears from a week on, until half its tolerance is used; the week in which it leaves it."""
    count = int(begins + 0.5 * weeks)
    return checks_of(lambda i: LIMIT * max(0.0, i - begins) / weeks, count, seed), begins + weeks


def test_a_worn_machine_s_date_is_found_half_way():
    inside = 0
    for seed in range(20):
        checks, leaves = worn(40.0, seed=seed)
        found = predict_due(history(checks=checks), checks[-1].t_utc_s, DRIFT)
        assert found.change == "drive_scale.left"
        assert found.trend > 0.5
        assert found.used == pytest.approx(0.5, abs=0.15)
        due = (found.due_utc_s - START_S) / WEEK_S
        inside += abs(due - leaves) < 0.2 * 40.0
        assert found.act_by_utc_s < found.early_utc_s < found.due_utc_s
        assert (found.act_by_utc_s - START_S) / WEEK_S < leaves
    assert inside >= 16


def test_an_unworn_machine_has_no_near_date():
    checks = checks_of(lambda i: 0.0, 30, 2)
    found = predict_due(history(checks=checks), checks[-1].t_utc_s, DRIFT)
    assert found.trend < 0.3
    assert found.due_utc_s is None or found.due_utc_s > START_S + 2.0 * YEAR_S
    assert found.act_by_utc_s is None or found.act_by_utc_s > checks[-1].t_utc_s + 4 * WEEK_S


def test_what_temperature_does_is_not_taken_for_wear():
    def warm(i):
        return 21.0 + 3.0 * np.sin(2.0 * np.pi * i / 52.0)

    checks = checks_of(lambda i: 1.5e-6 * (warm(i) - 21.0), 40, 3, temperature=warm)
    found = predict_due(history(checks=checks), checks[-1].t_utc_s, DRIFT)
    assert found.trend < 0.6
    assert found.used < 0.1


def test_the_season_is_forecast_from_half_a_year_on():
    def warm(i):
        return 21.0 + 3.0 * np.sin(2.0 * np.pi * i * WEEK_S / YEAR_S)

    ahead = START_S + np.array([60.0, 80.0]) * WEEK_S
    known = history(checks=checks_of(lambda i: 0.0, 40, 4, temperature=warm))
    assert forecast_temperature(known, ahead) == pytest.approx([warm(60), warm(80)], abs=0.15)
    short = history(checks=checks_of(lambda i: 0.0, 8, 4, temperature=warm))
    assert forecast_temperature(short, ahead) == pytest.approx([warm(8), warm(8)])
    with pytest.raises(InputError, match="no temperature"):
        forecast_temperature(history(calibrations=()), ahead)


def test_a_new_calibration_ends_the_former_s_trend():
    checks, _ = worn(40.0)
    anew = history(checks=checks).with_calibration(calibration("c2", checks[-1].t_utc_s + 1.0))
    assert predict_due(anew, anew.last_time_utc_s, DRIFT) is None


def test_beyond_the_tolerance_it_is_due_now():
    checks = checks_of(lambda i: 1.3 * LIMIT, 12, 5)
    found = predict_due(history(checks=checks), checks[-1].t_utc_s, DRIFT)
    assert found.due_utc_s == checks[-1].t_utc_s
    assert found.used > 1.1


def test_a_wider_interval_covers_more():
    checks, _ = worn(60.0)
    now = checks[-1].t_utc_s
    narrow, wide = (
        predict_due(history(checks=checks), now, DRIFT, PredictionSettings(coverage=c)) for c in (0.5, 0.99)
    )
    assert wide.early_utc_s < narrow.early_utc_s < narrow.due_utc_s < narrow.late_utc_s
    assert wide.late_utc_s is None or wide.late_utc_s > narrow.late_utc_s
    with pytest.raises(InputError, match="between 0 and 1"):
        PredictionSettings(coverage=1.0)


@pytest.mark.parametrize(("sign", "compare"), [(1.0, np.less), (-1.0, np.greater)])
def test_what_the_season_does_to_the_same_error_counts_with_its_sign(sign, compare):
    """Three kelvin above the calibration: the tolerance is left earlier if both errors point the same way."""
    worn_out, _ = worn(16.0, begins=4.0)
    plain, with_season = (
        history(
            checks=tuple(replace(c, temperature_c=24.0, known_error_m=known, known_alignment=rows) for c in worn_out)
        )
        for known, rows in ((0.0, ()), (1e-5, (sign * 0.9, 0.0)))
    )
    now = worn_out[-1].t_utc_s
    dates = [predict_due(h, now, DRIFT).due_utc_s for h in (with_season, plain)]
    assert compare(*dates)
    assert abs(dates[0] - dates[1]) > 2 * WEEK_S


def test_the_first_checks_leave_the_prior_of_wear():
    checks = checks_of(lambda i: 0.0, 3, 6)
    now = checks[-1].t_utc_s
    usual, fast = (
        predict_due(history(checks=checks), now, DRIFT, PredictionSettings(fastest_weeks=w)).act_by_utc_s
        for w in (40.0, 4.0)
    )
    assert now + 2 * WEEK_S < usual
    assert fast < usual - WEEK_S
