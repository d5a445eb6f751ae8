"""The filter over checks against one joint Gaussian computation, and the limits that it leads to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.intervals import drift
from calibration.intervals.drift import WEEK_S, DriftSettings, expect, follow, followed_checks
from calibration.intervals.limits import chart_scale
from tests.calibration.intervals.facts_for_tests import START_S, calibration, check, history

SETTINGS = DriftSettings()


def drawn(count, seed, scale=1.0, temperature=lambda i: 21.0):
    """Checks of a machine that drifts as the settings say."""
    rng = np.random.default_rng(seed)
    unit = np.array([2e-6, 3e-6]) * np.sqrt(8 / 12)
    reference, level = rng.standard_normal(2) * np.array([5e-7, 1e-6]), np.zeros(2)
    per_k = rng.standard_normal(2) * SETTINGS.per_k * unit
    out = []
    for i in range(1, count + 1):
        level = level + SETTINGS.walk_per_sqrt_week * unit * rng.standard_normal(2)
        warm = temperature(i) - 21.0
        found = reference + level + per_k * warm + scale * np.array([2e-6, 3e-6]) * rng.standard_normal(2)
        out.append(check(i, change=tuple(found), temperature_c=21.0 + warm))
    return tuple(out)


def test_innovations_are_those_of_the_joint_normal_distribution():
    checks = drawn(6, 1, temperature=lambda i: 20.0 + 0.4 * i)
    track = follow(history(checks=checks), SETTINGS)
    weeks, warm = np.arange(1.0, 7.0), np.array([c.temperature_c - 21.0 for c in checks])
    for w in range(2):
        unit = checks[0].change_u[w] * np.sqrt(8 / 12)
        covariance = (
            checks[0].reference_u[w] ** 2
            + (SETTINGS.walk_per_sqrt_week * unit) ** 2 * np.minimum.outer(weeks, weeks)
            + (SETTINGS.per_k * unit) ** 2 * np.outer(warm, warm)
            + np.eye(6) * checks[0].change_u[w] ** 2
        )
        found = np.array([c.change[w] for c in checks])
        # the inverse of the Cholesky factor gives standardised one-step-ahead differences
        assert track.innovations[:, w] == pytest.approx(np.linalg.solve(np.linalg.cholesky(covariance), found))


def test_what_is_expected_is_what_the_filter_then_sees():
    checks = drawn(5, 2)
    facts = history(checks=checks)
    track = follow(facts, SETTINGS)
    expected = expect(facts, SETTINGS, checks[-1])
    last = expected.standardised(np.array(checks[-1].change), np.array(checks[-1].change_u))
    assert last == pytest.approx(track.innovations[-1])
    assert expect(history(), SETTINGS, checks[0]).mean == pytest.approx([0.0, 0.0])


def test_quiet_checks_have_unit_innovations():
    rows = [follow(history(checks=drawn(40, seed)), SETTINGS).innovations for seed in range(30)]
    assert np.std(np.concatenate(rows)) == pytest.approx(1.0, abs=4.0 / np.sqrt(2 * 2400))


def test_a_calibration_takes_levels_back_but_keeps_what_temperature_does():
    checks = drawn(12, 3, temperature=lambda i: 21.0 + 3.0 * np.sin(i))
    before = follow(history(checks=checks), SETTINGS)
    anew = history(
        calibrations=(calibration(), calibration("c2", START_S + 13 * WEEK_S)),
        checks=(*checks, check(14, calibration="c2")),
    )
    after = follow(anew, SETTINGS)
    assert np.all(after.level()[1] < np.array([2e-6, 3e-6]))
    assert after.per_k()[0] == pytest.approx(before.per_k()[0], rel=0.3)
    expected = expect(anew, SETTINGS, anew.checks[-1])
    walk = SETTINGS.walk_per_sqrt_week * after.unit
    assert expected.mean == pytest.approx([0.0, 0.0], abs=1e-12)
    assert expected.variance == pytest.approx(np.array([5e-7, 1e-6]) ** 2 + walk**2)


def test_another_instrument_is_not_a_change_of_the_machine():
    checks = drawn(10, 4)
    step = tuple(np.array(checks[-1].change) + 10.0 * np.array(checks[-1].change_u))
    same = history(checks=(*checks[:-1], check(10, change=step)))
    other = history(checks=(*checks[:-1], check(10, change=step, instrument="T2")))
    assert np.abs(follow(same, SETTINGS).innovations[-1]).min() > 7.0
    assert np.abs(follow(other, SETTINGS).innovations[-1]).max() < 3.5
    assert follow(other, SETTINGS).judged[-2:] == (True, False)
    assert (
        chart_scale(follow(other, SETTINGS)).checks == chart_scale(follow(history(checks=checks[:9]), SETTINGS)).checks
    )


def test_checks_with_other_names_begin_another_history():
    checks = (*drawn(3, 5), check(4, watched=("a", "b")))
    assert [c.id for c in followed_checks(history(checks=checks))] == ["h4"]
    assert follow(history(), SETTINGS) is None


def test_limits_are_provisional_until_the_machine_has_its_own_history():
    few, many = (follow(history(checks=drawn(n, 6)), SETTINGS) for n in (5, 60))
    assert chart_scale(None).provisional
    assert chart_scale(None).scale == 1.0
    assert "provisional" in chart_scale(few).reason
    assert not chart_scale(many).provisional
    assert chart_scale(many).scale == pytest.approx(1.0, abs=0.12)


def test_limits_learn_a_machine_s_larger_scatter_but_not_its_alarms():
    noisy = follow(history(checks=drawn(60, 7, scale=1.3)), SETTINGS)
    assert 1.1 < chart_scale(noisy).scale < 1.35
    checks = drawn(60, 6)
    struck = tuple(check(i, change=(5e-5 * (-1) ** i, 0.0)) if i % 9 == 0 else c for i, c in enumerate(checks, start=1))
    plain = chart_scale(follow(history(checks=checks), SETTINGS))
    shaken = chart_scale(follow(history(checks=struck), SETTINGS))
    assert shaken.checks < plain.checks
    assert shaken.scale < 2.0


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="below zero"):
        DriftSettings(walk_per_sqrt_week=-0.1)


def test_a_remembered_pass_changes_nothing():
    checks, base = drawn(12, 8), history()
    other = (*checks[:5], check(6, change=(9e-6, 9e-6)), *checks[6:])
    anew = base.with_calibration(calibration("c2", START_S + 20 * WEEK_S)).with_check(check(21, calibration="c2"))
    asked = [replace(base, checks=c) for c in (checks[:7], checks, other, checks[:3])] + [anew]
    settings = [SETTINGS, SETTINGS, SETTINGS, SETTINGS, DriftSettings(walk_per_sqrt_week=0.5)]
    remembered = [follow(*one).innovations for one in zip(asked, settings, strict=True)]
    for rows, one in zip(remembered, zip(asked, settings, strict=True), strict=True):
        drift._MEMORY.clear()
        assert np.array_equal(rows, follow(*one).innovations)
