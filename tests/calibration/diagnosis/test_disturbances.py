"""Ordinary disturbances in campaigns of any length: what is finer than their columns would look like an effect."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.quiet_machines import NIGHT
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.disturbances import SHORTEST_WAVE_S, walk_terms, wave_pairs
from calibration.diagnosis.result import NONE
from calibration.effects.basis_functions import fourier_basis, random_walk_basis
from mock_devices.settings import DisturbanceLevels
from tests.calibration.diagnosis.campaigns import plant, recorded

DRIFTING = DisturbanceLevels(drift_m=2.5e-5, reseat_m=1e-6, reversal_m=5e-7, temperature_k=0.01)
WARM = DisturbanceLevels(drift_m=2e-6, reseat_m=1e-6, reversal_m=5e-7, temperature_k=0.4)


@pytest.mark.parametrize("hours", [0.5, 1.7, 4.0, 8.0])
def test_little_of_a_walk_is_finer_than_its_columns(hours):
    """By the exact covariance of a walk, min(t, s)."""
    t_h = np.sort(np.random.default_rng(3).uniform(0.0, hours, 400))
    basis = random_walk_basis(t_h, walk_terms(3600.0 * hours))
    left = np.minimum.outer(t_h, t_h) - basis @ basis.T
    assert np.sqrt(np.mean(np.diag(left))) < 0.14  # of what it goes in an hour
    assert np.linalg.eigvalsh(left).max() < 0.005 * np.trace(np.minimum.outer(t_h, t_h))


@pytest.mark.parametrize("hours", [1.7, 4.0, 8.0, 14.0])
def test_no_wave_is_missed_between_others(hours):
    rng = np.random.default_rng(4)
    t_s = np.sort(rng.uniform(0.0, 3600.0 * hours, 800))
    basis = np.column_stack([np.ones_like(t_s), fourier_basis(t_s, SHORTEST_WAVE_S, wave_pairs(3600.0 * hours))])
    for period_s in np.geomspace(SHORTEST_WAVE_S, 9000.0, 60):
        wave = np.sin(2.0 * np.pi * t_s / period_s + rng.uniform(0.0, 2.0 * np.pi))
        left = wave - basis @ np.linalg.lstsq(basis, wave)[0]
        assert np.linalg.norm(left) < 0.2 * np.linalg.norm(wave), period_s


@pytest.mark.parametrize(("levels", "seed"), [(DRIFTING, 1), (WARM, 3)], ids=["drifting", "warm"])
def test_a_quiet_campaign_of_nine_hours_has_no_cause(levels, seed):
    recording = recorded(plant(100, seed=seed, design=NIGHT, nuisance=levels))
    assert np.ptp(recording["t_rig_s"]) > 8.5 * 3600.0
    assert diagnose(recording).verdict == NONE
