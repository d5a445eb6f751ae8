"""Temperatures of parts from sensors that scatter, round or read something else; the truth is the plant's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis.diagnose import diagnose_measurements
from calibration.diagnosis.result import NONE
from calibration.identification.calibration import identified_summary, identify_recording
from calibration.model.visits import Visits
from calibration.recording.recording import Recording
from calibration.reduction.part_temperatures import (
    most_likely_temperatures,
    most_likely_temperatures_of_folder,
    remarks_on_sensors,
)
from calibration.reduction.reduction import reduce
from mock_devices.plant.thermal import Thermal
from pkm_rig.jobs.measured_machine import identify_measurements
from tests.calibration.diagnosis.campaigns import changed, plant, recorded, sensed
from tests.calibration.diagnosis.measured import Wanted, made
from tests.calibration.effects.test_context import SWING

VISITS = 80


@pytest.fixture(scope="module")
def bench():
    return plant(VISITS, seed=4)


@pytest.fixture(scope="module")
def recording(bench):
    return recorded(bench)


def true_c(bench, recording: Recording, sensor: str) -> np.ndarray:
    return Thermal(bench.settings).part_series_c(sensor, recording["t_rig_s"])


def off_k(bench, recording: Recording, sensor: str) -> float:
    """RMS of what a sensor's values are off, but for what they always are."""
    return float(np.std(recording[f"{sensor}_temperature_c"] - true_c(bench, recording, sensor)))


@pytest.mark.parametrize(("scatter_k", "left"), [(0.1, 0.35), (0.3, 0.3), (1.0, 0.25)])
def test_what_scatters_is_a_course_near_the_true_one(bench, recording, scatter_k, left):
    noisy = sensed(recording, 7, scatter_k=scatter_k)
    found, sensors = most_likely_temperatures(noisy)
    for name in recording.file.sensors:
        assert sensors[name].scatter_k == pytest.approx(scatter_k, rel=0.25)
        assert off_k(bench, noisy, name) > 0.7 * scatter_k
        assert off_k(bench, found, name) < left * scatter_k
        assert off_k(bench, found, name) < 2.5 * sensors[name].u_k
        assert sensors[name].elsewhere.size == 0


def test_sensors_without_scatter_say_what_they_said(recording):
    found, sensors = most_likely_temperatures(recording)
    for name, sensor in sensors.items():
        column = f"{name}_temperature_c"
        assert np.max(np.abs(found[column] - recording[column])) < 0.02
        assert sensor.scatter_k < 0.01
        assert sensor.elsewhere.size == 0
    assert remarks_on_sensors(sensors) == ()
    assert np.array_equal(found["air_temperature_c"], recording["air_temperature_c"])


@pytest.mark.parametrize("together", [False, True])
def test_what_is_no_temperature_of_the_part_is_left_out_and_said(bench, recording, together):
    wrong = np.arange(30, 34) if together else np.array([3, 40, 66])
    value_c = np.where(np.isin(recording["visit"], wrong), 85.0, recording["base_temperature_c"])
    found, sensors = most_likely_temperatures(changed(recording, base_temperature_c=value_c))
    assert sensors["base"].elsewhere.tolist() == wrong.tolist()
    assert sensors["base"].farthest_k == pytest.approx(85.0 - recording["base_temperature_c"].mean(), abs=1.0)
    assert off_k(bench, found, "base") < 0.02
    assert all(sensor.elsewhere.size == 0 for name, sensor in sensors.items() if name != "base")
    (said,) = remarks_on_sensors(sensors)
    assert f"'base' is up to {sensors['base'].farthest_k:.3g} K off" in said
    assert f"{len(wrong)} visits ({', '.join(map(str, wrong))})" in said


def test_a_shop_that_warms_and_cools_is_no_fault_of_sensors(bench):
    swinging = plant(VISITS, seed=4, temperature_programme=SWING)
    recording = recorded(swinging)
    found, sensors = most_likely_temperatures(recording)
    assert max(np.ptp(recording[f"{name}_temperature_c"]) for name in sensors) > 1.0
    for name, sensor in sensors.items():
        assert sensor.elsewhere.size == 0
        assert off_k(swinging, found, name) < 0.05


def test_a_part_that_is_suddenly_warmer_is_believed(recording):
    later = recording["visit"] >= 40
    value_c = recording["struts_temperature_c"] + 3.0 * later
    found, sensors = most_likely_temperatures(changed(recording, struts_temperature_c=value_c))
    assert sensors["struts"].elsewhere.size == 0
    assert np.std(found["struts_temperature_c"] - value_c) < 0.05


def test_two_temperatures_far_apart_are_no_rounding(recording):
    value_c = np.where(recording["visit"] >= 40, 24.0, 21.0)
    found, sensors = most_likely_temperatures(changed(recording, struts_temperature_c=value_c))
    assert sensors["struts"].u_k < 0.01
    np.testing.assert_allclose(found["struts_temperature_c"], value_c, atol=0.01)


def test_a_coarse_step_is_an_uncertainty(bench, recording):
    found, sensors = most_likely_temperatures(sensed(recording, 7, step_k=0.5))
    assert any(sensor.u_k > 0.1 for sensor in sensors.values())
    for name, sensor in sensors.items():
        assert sensor.u_k >= 0.5 / np.sqrt(12.0) - 1e-12
        assert off_k(bench, found, name) < 2.0 * sensor.u_k


def test_order_of_rows_does_not_matter(recording):
    noisy = sensed(recording, 7, scatter_k=0.3, elsewhere=2)
    shuffle = np.random.default_rng(1).permutation(len(noisy))
    found, other = most_likely_temperatures(noisy)[0], most_likely_temperatures(noisy.take(shuffle))[0]
    for name in recording.file.sensors:
        column = f"{name}_temperature_c"
        np.testing.assert_allclose(other[column], found[column][shuffle], atol=1e-6)


def test_a_handful_of_visits_says_nothing_of_sensors(recording):
    few = sensed(recording, 7, scatter_k=0.3).rows("calibration")
    few = few.take(few["visit"] < 3)
    found, sensors = most_likely_temperatures(few)
    assert sensors == {}
    assert np.array_equal(found["base_temperature_c"], few["base_temperature_c"])


def test_of_few_visits_one_is_told(recording):
    few = recording.rows("calibration")
    few = few.take(few["visit"] < 6)
    value_c = np.where(few["visit"] == 2, 85.0, few["base_temperature_c"])
    found, sensors = most_likely_temperatures(changed(few, base_temperature_c=value_c))
    assert sensors["base"].elsewhere.tolist() == [2]
    np.testing.assert_allclose(found["base_temperature_c"], few["base_temperature_c"], atol=0.02)
    two = np.where(few["visit"] >= 4, 85.0, few["base_temperature_c"])  # of six: nothing tells which are wrong
    assert most_likely_temperatures(changed(few, base_temperature_c=two))[1]["base"].elsewhere.size == 0


def test_a_folder_by_its_times_alone():
    rng, measured = np.random.default_rng(2), made(Wanted("delta6", ("z_m",), visits=60))
    t_s = rng.permutation(60) * 40.0
    true = 20.0 + t_s / 2000.0
    sensor = next(iter(measured.visits.temperatures_c))
    read_c = true + 0.3 * rng.standard_normal(60)
    visits: Visits = replace(measured.visits, temperatures_c={**measured.visits.temperatures_c, sensor: read_c})
    without_times = replace(measured, visits=visits, sensors=(sensor,))
    assert most_likely_temperatures_of_folder(without_times) == (without_times, {})
    found, sensors = most_likely_temperatures_of_folder(replace(without_times, conditions={"t_rig_s": t_s}))
    assert np.std(found.visits.temperatures_c[sensor] - true) < 0.2
    assert sensors[sensor].scatter_k == pytest.approx(0.3, rel=0.3)


def test_false_temperatures_of_a_folder_change_nothing_and_are_said():
    measured = made(Wanted("delta6", ("x_m", "y_m", "z_m"), visits=60))
    said = replace(measured, conditions={"t_rig_s": 40.0 * np.arange(60.0)}, sensors=("struts",))
    value_c = np.where(np.isin(np.arange(60), [7, 31]), 85.0, 20.0)
    visits = replace(measured.visits, temperatures_c={**measured.visits.temperatures_c, "struts": value_c})
    plain, found = (identify_measurements(one, "map") for one in (said, replace(said, visits=visits)))
    assert "struts" in measured.visits.temperatures_c
    for name, entry in plain["parameters"].items():
        assert found["parameters"][name]["value"] == pytest.approx(entry["value"], abs=0.01 * entry["u"])
    assert any("'struts' is up to 65 K off" in remark for remark in found["remarks"])
    diagnosis = diagnose_measurements(replace(said, visits=visits))
    assert diagnosis.verdict == NONE
    assert any("'struts' is up to 65 K off" in remark for remark in diagnosis.remarks)


@pytest.mark.parametrize("seed", [1, 2])
def test_two_false_temperatures_leave_the_identified_machine_as_it_is(seed):
    """Without it they move well-decided directions by more than ten standard deviations, and no residual shows it."""
    recording = recorded(plant(VISITS, seed=seed))
    plain = identify_recording(recording, baselines=False).fit
    fit = identify_recording(sensed(recording, seed, elsewhere=2), baselines=False).fit
    assert np.max(np.abs(fit.theta - plain.theta) / plain.theta_u) < 0.01


def test_sensors_that_scatter_move_it_by_less_than_its_uncertainty(recording):
    plain = identify_recording(recording, baselines=False).fit
    calibration = identify_recording(sensed(recording, 3, scatter_k=1.0), baselines=False)
    size = len(plain.theta)
    values, vectors = np.linalg.eigh(plain.covariance[:size, :size])
    off = vectors.T @ (calibration.fit.theta - plain.theta) / np.sqrt(values)
    assert np.sqrt(np.mean(off**2)) < 0.6
    assert calibration.fit.chi2_per_dof == pytest.approx(plain.chi2_per_dof, rel=0.05)


def test_an_identification_says_what_its_sensors_did(recording):
    assert set(reduce(recording).sensors) == set(recording.file.sensors)
    calibration = identify_recording(sensed(recording, 3, elsewhere=2), baselines=False)
    assert any("temperature sensor" in remark for remark in identified_summary(calibration)["remarks"])
