"""Ordinary disturbances in campaigns of any length: what is finer than their columns would look like an effect."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.quiet_machines import BETWEEN_DAYS_S, NIGHT
from calibration.diagnosis import disturbed_recording
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.disturbances import SHORTEST_WAVE_S, drift_walk, temperature_waves
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.result import NONE
from calibration.effects.basis_functions import principal_columns
from mock_devices.effects import EffectChoice
from mock_devices.settings import DisturbanceLevels
from tests.calibration.diagnosis.campaigns import plant, recorded

DRIFTING = DisturbanceLevels(drift_m=2.5e-5, reseat_m=1e-6, reversal_m=5e-7, temperature_k=0.01)
WARM = DisturbanceLevels(drift_m=2e-6, reseat_m=1e-6, reversal_m=5e-7, temperature_k=0.4)


def times_h(hours, days, visits):
    """Times of visits on some days, so many hours each day."""
    rng = np.random.default_rng(3)
    t_h = np.sort(np.concatenate([24.0 * day + rng.uniform(0.0, hours, visits) for day in range(days)]))
    return t_h - t_h[0]


@pytest.mark.parametrize(("hours", "days"), [(0.5, 1), (1.7, 1), (4.0, 1), (8.0, 1), (1.0, 4), (2.5, 3)])
def test_little_of_a_walk_is_finer_than_its_columns(hours, days):
    """By the exact covariance of a walk, min(t, s)."""
    t_h = times_h(hours, days, 400 // days)
    basis = drift_walk(3600.0 * t_h)
    walk = np.minimum.outer(t_h, t_h)
    left = walk - basis @ basis.T
    assert np.sqrt(np.mean(np.diag(left))) < 0.105  # of what it goes in an hour
    assert np.linalg.eigvalsh(left).max() < 0.005 * np.trace(walk)
    assert np.linalg.eigvalsh(left).min() > -1e-9 * np.trace(walk)  # nowhere more than a walk goes


@pytest.mark.parametrize(("hours", "days"), [(1.7, 1), (4.0, 1), (8.0, 1), (14.0, 1), (1.0, 4), (3.0, 3)])
def test_no_wave_is_missed_between_others(hours, days):
    rng = np.random.default_rng(4)
    t_s = 3600.0 * times_h(hours, days, 800 // days)
    basis = np.column_stack([np.ones_like(t_s), temperature_waves(t_s)])
    for period_s in np.geomspace(SHORTEST_WAVE_S, 9000.0, 60):
        wave = np.sin(2.0 * np.pi * t_s / period_s + rng.uniform(0.0, 2.0 * np.pi))
        left = wave - basis @ np.linalg.lstsq(basis, wave)[0]
        assert np.linalg.norm(left) < 0.2 * np.linalg.norm(wave), period_s


def test_most_of_what_columns_vary_is_in_their_principal_ones():
    """By the singular values: no columns (Eckart and Young) leave less."""
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((60, 12)) @ np.diag(0.6 ** np.arange(12.0)) @ rng.standard_normal((12, 12))
    few = principal_columns(columns, 4)
    left = columns @ columns.T - few @ few.T
    assert few.shape == (60, 4)
    assert np.linalg.eigvalsh(left).max() == pytest.approx(np.linalg.svd(columns)[1][4] ** 2)
    assert principal_columns(columns, 12) is columns


@pytest.mark.parametrize(("levels", "seed"), [(DRIFTING, 1), (WARM, 3)], ids=["drifting", "warm"])
def test_a_quiet_campaign_of_nine_hours_has_no_cause(levels, seed):
    recording = recorded(plant(100, seed=seed, design=NIGHT, nuisance=levels))
    assert np.ptp(recording["t_rig_s"]) > 8.5 * 3600.0
    assert diagnose(recording).verdict == NONE


def test_a_quiet_campaign_of_four_days_has_no_cause():
    """What its station drifts over night draws the geometry 50 tolerances away, where a load bends it otherwise."""
    recording = recorded(plant(120, seed=14, exchange_s=BETWEEN_DAYS_S, nuisance=DRIFTING))
    assert np.ptp(recording["t_rig_s"]) > 40.0 * 3600.0
    linear = linearise_recording(recording)
    geometry = slice(len(linear.poses.model))
    assert np.abs(linear.values / linear.sigma[: len(linear.values)])[geometry].max() < 3.0
    assert diagnose(recording).verdict == NONE


def test_what_an_effect_draws_away_is_left_there(monkeypatch):
    """Disturbances that would have to stand for a soft strut lead back by a fifth only: they are not what drew it."""
    recording = recorded(plant(60, EffectChoice("link_stiffness", 20.0, "right_upper"), seed=3))
    found = linearise_recording(recording, judge=False).values
    monkeypatch.setattr(disturbed_recording, "MOST_STEPS", 0)
    np.testing.assert_array_equal(found, linearise_recording(recording, judge=False).values)
