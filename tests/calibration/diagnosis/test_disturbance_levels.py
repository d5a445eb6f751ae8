"""Levels of disturbances from campaigns of the mock plant, whose levels the estimate never sees."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis.disturbance_levels import estimate_levels
from calibration.diagnosis.level_posterior import COLUMNS, TOLERANCES, LevelPosterior
from calibration.diagnosis.linear_model import linearise_recording
from calibration.recording.header import DeclaredLevels
from mock_devices.settings import DisturbanceLevels
from tests.calibration.diagnosis.campaigns import plant, recorded, standing_off

QUIET = DisturbanceLevels(drift_m=1e-6, reseat_m=5e-7, reversal_m=3e-7, temperature_k=0.01)
ROUGH = DisturbanceLevels(drift_m=1e-5, reseat_m=8e-6, reversal_m=4e-6, temperature_k=0.06)


@pytest.fixture(scope="module")
def quiet_and_rough():
    return [recorded(plant(60, nuisance=levels)) for levels in (QUIET, ROUGH)]


def test_the_interval_holds_what_the_plant_has(quiet_and_rough):
    for recording, true in zip(quiet_and_rough, (QUIET, ROUGH), strict=True):
        found = estimate_levels(recording)
        for key, level in found.by_key.items():
            assert level.low < level.value < level.high
            # What the readings say nothing of lies where the default does, within its factor.
            assert not level.told or level.low <= getattr(true, key) <= level.high, key


def test_a_rough_rig_is_told_from_a_quiet_one(quiet_and_rough):
    """By its drift, of which a campaign shows many steps; a reversal error is drawn but once for each drive."""
    quiet, rough = (estimate_levels(recording).by_key["drift_m"] for recording in quiet_and_rough)
    assert rough.told
    assert rough.value > 3.0 * quiet.value


def test_scatter_is_told_from_disturbances(quiet_and_rough):
    """Readings that state half of their scatter: levels stay."""
    recording = quiet_and_rough[1]
    half = {name: c / 4.0 if name.startswith("cov_") else c for name, c in recording.columns.items()}
    stated, understated = estimate_levels(recording), estimate_levels(replace(recording, columns=half))
    assert understated.scatter.value == pytest.approx(2.0 * stated.scatter.value, rel=0.1)
    assert understated.by_key["drift_m"].value == pytest.approx(stated.by_key["drift_m"].value, rel=0.3)


def test_a_machine_that_does_not_repeat_is_told_from_scatter(quiet_and_rough):
    recording = quiet_and_rough[0]
    repeats, does_not = estimate_levels(recording), estimate_levels(standing_off(recording, 8e-6, 2))
    assert repeats.positioning_sd_m == 0.0
    assert does_not.positioning_sd_m == pytest.approx(8e-6, rel=0.3)
    assert does_not.scatter.value == pytest.approx(repeats.scatter.value, rel=0.1)


def test_what_a_campaign_declares_does_not_count(quiet_and_rough):
    recording = quiet_and_rough[0]
    loud = recording.file.model_copy(update={"nuisance": DeclaredLevels(drift_m=1e-4, reversal_m=0.0)})
    assert estimate_levels(replace(recording, file=loud)) == estimate_levels(recording)


def test_the_density_is_that_of_the_dense_covariance(quiet_and_rough):
    """Against a multivariate normal distribution of all readings, levels and scatter changed."""
    rng = np.random.default_rng(5)
    linear = linearise_recording(quiet_and_rough[0])
    some = np.sort(rng.choice(len(linear.rows), 60, replace=False))
    small = replace(linear, columns=linear.columns[some], residual=linear.residual[some])
    posterior, keys = LevelPosterior(small), list(COLUMNS)
    geometry = ("strut_length.", "platform_joint.", "base_joint.", "axis_tilt.", "drive_scale.")

    def dense(x: np.ndarray) -> float:
        flat, y = small.columns.reshape(len(some) * 3, -1), small.residual.ravel()
        declared = small.recording.file.nuisance
        scale = np.ones(flat.shape[1])
        for i, name in enumerate(small.names):
            if name.startswith(geometry):
                scale[i] = np.exp(x[-2])
            for key, level in zip(keys, np.exp(x[:-2]), strict=True):
                if name.startswith(COLUMNS[key]):
                    share = 0.0
                    if key == "drift_m":  # the station's stated drift stays, the rig's is `level` times the declared
                        own = declared.drift_m / np.sqrt(2.0)
                        accuracy, axis = small.recording.file.station.accuracy, name.split(".")[2]
                        stated = {"rz": accuracy.drift_rad_per_sqrt_h * 3.0}.get(
                            axis, accuracy.drift_of_level_rad_per_sqrt_h * 3.0 if axis[0] == "r" else 0.0
                        )
                        stated = accuracy.drift_m_per_sqrt_h if axis[0] != "r" else stated
                        share = stated**2 / (stated**2 + own**2)
                    scale[i] = np.sqrt(share + (1.0 - share) * level**2)
        covariance = np.exp(2.0 * x[-1]) * np.eye(len(y)) + (flat * scale**2) @ flat.T
        sign, determinant = np.linalg.slogdet(covariance)
        assert sign > 0.0
        prior = float(np.sum((x / np.log([2.0, 2.0, 2.0, 2.0, 2.0, 2.0])) ** 2))
        return -0.5 * (determinant + float(y @ np.linalg.solve(covariance, y)) + prior)

    assert posterior.keys == (*keys, TOLERANCES)
    one, other = np.array([0.3, -0.5, 0.8, -1.0, 0.4, 0.1]), np.zeros(6)
    assert posterior.log_density(one) - posterior.log_density(other) == pytest.approx(
        dense(one) - dense(other), abs=1e-5
    )
    steps = 1e-3 * np.eye(6)
    slope = [(dense(one + step) - dense(one - step)) / 2e-3 for step in steps]
    np.testing.assert_allclose(posterior.gradient(one), slope, rtol=1e-4, atol=1e-3)
