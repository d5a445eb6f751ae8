"""Where the station's circle has its zero says nothing of the machine: no number of a diagnosis may depend on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis.any_change import columns_of_any_change
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import LinearModel, linearise_recording
from calibration.diagnosis.non_parametric import rank_non_parametric
from calibration.recording.recording import Recording
from tests.calibration.diagnosis.campaigns import moved, simulated

TURN_RAD = 2.3
CORNERS = (("xx", "xy", "xz"), ("xy", "yy", "yz"), ("xz", "yz", "zz"))


def with_another_zero(recording: Recording) -> Recording:
    """The recording of a station whose circle is turned."""
    cos, sin = np.cos(TURN_RAD), np.sin(TURN_RAD)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])  # clockwise, as the circle reads
    position = recording.positions_m @ turn.T
    covariance = turn @ recording.covariances_m2 @ turn.T
    columns = {"hz_rad": np.mod(recording["hz_rad"] + TURN_RAD, 2.0 * np.pi)}
    columns |= {f"{axis}_m": position[:, k] for k, axis in enumerate("xyz")}
    for row in range(3):
        columns |= {f"cov_{CORNERS[row][k]}_m2": covariance[:, row, k] for k in range(row, 3)}
    entry = recording.file.station
    station = entry.model_copy(update={"heading_rad": entry.heading_rad - TURN_RAD})
    file = recording.file.model_copy(update={"station": station})
    return replace(recording, file=file, columns=dict(recording.columns) | columns)


@pytest.fixture(scope="module")
def both() -> tuple[LinearModel, LinearModel]:
    """A recording in which some readings are off along one axis, and the same with another zero of the circle."""
    recording = simulated("planar4", 40, seed=5)
    rows = np.flatnonzero(recording["phase"] == "calibration")[5::40]
    recording = moved(recording, rows, 6.0 * np.sqrt(float(np.median(recording["cov_xx_m2"]))))
    one, other = (linearise_recording(each) for each in (recording, with_another_zero(recording)))
    return one, other


def test_readings_have_the_same_weights_and_residuals(both):
    one, other = both
    assert np.min(one.weight) < 0.99
    np.testing.assert_allclose(other.weight, one.weight, atol=1e-6)
    np.testing.assert_array_equal(other.rows, one.rows)
    by_fit = [MarginalLikelihood.of(linear).weighted_residual for linear in both]
    np.testing.assert_allclose(by_fit[1], by_fit[0], atol=1e-5)


def test_whatever_may_change_is_the_same(both):
    grams = []
    for linear in both:
        columns = np.concatenate(columns_of_any_change(linear, linear.whiten), axis=2)
        flat = columns.reshape(-1, columns.shape[2])[:600]
        grams.append(flat @ flat.T)
    np.testing.assert_allclose(grams[1], grams[0], atol=1e-7 * np.max(grams[0]))


def test_functions_of_the_stations_place_have_the_same_evidence(both):
    found = []
    for linear in both:
        likelihood = MarginalLikelihood.of(linear)
        alternatives = rank_non_parametric(likelihood, inputs_of_recording(likelihood, periodograms(likelihood)))
        found.append({(a.channel, a.coordinate): a.log_evidence for a in alternatives})
    assert ("station.rx", "time") in found[0]
    assert found[1] == pytest.approx(found[0], abs=1e-4)
