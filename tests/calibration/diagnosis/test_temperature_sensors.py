"""Sensors of temperature that scatter, round or read something else: no effect of the machine, and they hide none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.result import NONE
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from mock_devices.effects import EffectChoice
from tests.calibration.diagnosis.campaigns import plant, recorded, sensed
from tests.calibration.effects.test_context import SWING

BAD = {
    "scatter": {"scatter_k": 0.3},
    "scatter much": {"scatter_k": 1.0},
    "coarse": {"step_k": 0.5},
    "elsewhere": {"elsewhere": 2},
}


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
@pytest.mark.parametrize("seed", [1002, 1003])
def test_a_sound_machine_with_bad_sensors_has_no_effect(seed, bad):
    diagnosis = diagnose(sensed(recorded(plant(80, seed=seed)), seed, **bad))
    assert diagnosis.verdict == NONE
    assert any("temperature sensor" in remark for remark in diagnosis.remarks)


@pytest.mark.parametrize("bad", [BAD["scatter"], BAD["elsewhere"]], ids=["scatter", "elsewhere"])
def test_parts_that_warm_otherwise_than_their_sensors_say_are_found_all_the_same(bad):
    campaign = plant(100, EffectChoice("link_thermal_growth", 6.0, "left_upper"), seed=5, temperature_programme=SWING)
    diagnosis = diagnose(sensed(recorded(campaign), 5, **bad))
    assert diagnosis.verdict == "link_thermal_growth"
    assert diagnosis.effects[0].place == "left_upper"


def test_what_a_coarse_sensor_leaves_open_is_a_disturbance_of_its_parts():
    recording = recorded(plant(40, seed=2))
    assert not any(name.startswith("sensor.") for name in linearise_recording(recording, judge=False).names)
    linear = linearise_recording(sensed(recording, 2, step_k=0.25), judge=False)
    sensor = linear.machine.sensors["base"]
    of_base = [i for i, name in enumerate(linear.names) if name.startswith("sensor.growth.base.")]
    metres = np.einsum("nij,njk->nik", np.linalg.inv(linear.whiten), linear.columns[:, :, of_base])
    # What the reflectors do when the sensor says that the base is 0.1 K warmer.
    visits = linear.poses.visits
    warmer = {**visits.temperatures_c, sensor: visits.temperatures_c[sensor] + 0.1}
    model = Model(ParameterSet(linear.machine, ()))
    shift_m = np.zeros((len(linear.smr), 3))
    there, here = (model.predict(np.zeros(0), v) for v in (replace(visits, temperatures_c=warmer), visits))
    for index in np.unique(linear.smr[linear.on_platform]):
        rows = np.flatnonzero(linear.smr == index)
        at = linear.machine.smrs[index].position_m
        by_visit = there.reflector_m(index, at) - here.reflector_m(index, at)
        shift_m[rows] = by_visit[linear.visit[rows]]
    rows = linear.on_platform
    expected_m = linear.sensors[sensor].u_k / 0.1 * np.sqrt(np.mean(np.sum(shift_m[rows] ** 2, axis=1)))
    found_m = np.sqrt(np.mean(np.sum(metres[rows] ** 2, axis=(1, 2))))
    assert found_m == pytest.approx(expected_m, rel=0.1)
    assert found_m > 5e-7
