"""Effects over the real protocols: the embedded rig sees what the plant's own campaigns say of the same motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from mock_devices.plant.affected_machine import AffectedMachine, make_effects, motion_states
from mock_devices.plant.motion_history import MotionHistory
from pkm_rig.rig.config import embedded_rig_path, machine_path
from pkm_rig.virtual.mock_rig import settings_of
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file

EVERYWHERE = (
    "backlash=2e-5,place=right",
    "friction_windup=2e-8",
    "servo_settling=4e-5,place=right,tau_s=5",
    "column_compliance=1e-8",
    "joint_clearance=2e-5,place=right_lower",
    "screw_periodic_error=8e-6",
    "guide_angular=3e-5",
    "screw_thermal_growth=3",
    "link_thermal_growth=2,tau_s=600",
    "refraction=5",
    "smr_reseat=2e-5,place=P2,onset_s=0",
    "tracker_drift=4e-5,variant=random_walk",
)
STOPS = ((1.20, 1.10), (1.25, 1.00), (1.15, 1.10), (1.1500005, 1.10))


def rig_file(*effects):
    file, machine = short_rig_file()
    return file.model_copy(update={"mock": file.mock.model_copy(update={"effects": effects})}), machine


def test_the_rig_meets_the_same_effects_as_a_campaign_without_wire():
    file, machine = rig_file(*EVERYWHERE)
    seen, times, positions = [], [], []
    with mock_and_rig(file, machine) as (mock, rig):
        start = [drive.encoder_m(0.0) for drive in mock.drives]
        rig.enable()
        for stop in STOPS:
            rig.move(np.array(stop), 0.3)
            rig.clock.sleep_s(2.0)
            t = rig.clock.now_s()
            seen.append([(s.polar.hz_rad, s.polar.v_rad, s.polar.distance_m) for s in mock.plant.sightings(t)])
            times.append(t)
            positions.append([drive.encoder_m(t) for drive in mock.drives])
            rig.clock.sleep_s(0.5)  # the next motion does not begin at the very moment of the reading
        torque = [sample.torque_fraction for sample in rig.drives.sample()]
        motions = sorted(
            (
                (states.start_s, a, states)
                for a, drive in enumerate(mock.drives)
                for states in drive.motions_after(-1.0)
            ),
            key=lambda entry: entry[:2],
        )
        plant = mock.plant
    fresh = AffectedMachine(plant._machine, plant.view, make_effects(plant.nominal, plant.settings))
    history = MotionHistory(start, fresh.effects)
    for _, drive, motion in motions:
        history.add(drive, motion.start_s, motion.end_s, motion.to_m, motion.speed_m_per_s)
    q, n = np.array(positions), len(times)
    zero = np.zeros(n)
    states = motion_states(history, np.array(times), q, 0.0 * q, zero, zero, plant.thermal)
    expected = fresh.sight(states, np.zeros(n, dtype=np.intp))
    got = np.array(seen)
    assert got[:, :, 0] == pytest.approx(expected.hz_rad, abs=1e-10)
    assert got[:, :, 1] == pytest.approx(expected.v_rad, abs=1e-10)
    assert got[:, :, 2] == pytest.approx(expected.distance_m, abs=1e-10)
    friction = fresh.deviation(states).force_n[-1, 0]
    assert torque[0] - torque[1] == pytest.approx(friction * 0.01 / (2.0 * np.pi) / 10.0, abs=2e-3)
    assert abs(friction) > 100.0


def test_without_effects_the_plant_takes_its_old_path():
    file, machine = rig_file()
    with mock_and_rig(file, machine) as (mock, _rig):
        assert mock.plant._affected is None


def test_a_campaigns_measurement_sees_the_play_of_a_drive():
    width_m = 4e-5
    file, machine = rig_file(f"backlash={width_m},place=left")
    places = []
    with mock_and_rig(file, machine) as (mock, rig):
        rig.enable()
        for side in (-1.0, 1.0):
            rig.move(np.array([1.2 + side * 0.01, 1.1]), 0.3)
            rig.move(np.array([1.2, 1.1]), 0.3)
            t = rig.clock.now_s() + 1.0
            left = next(s.polar for s in mock.plant.sightings(t) if s.name == "SL")
            places.append(left.distance_m * np.cos(left.v_rad))
    assert places[1] - places[0] == pytest.approx(width_m, abs=1e-6)


@pytest.mark.parametrize("text", ["nope=1", "backlash=1", "backlash=1e-5,place=top"])
def test_a_rig_file_with_an_impossible_effect_is_refused_in_one_line(text):
    file, _ = rig_file(text)
    with pytest.raises(InputError, match=r"^mock: .*effect") as caught:
        settings_of(file, embedded_rig_path())
    assert "\n" not in str(caught.value)


def test_settings_of_the_mock_section_reach_the_plant():
    file, _ = rig_file("backlash=1e-5")
    mock = file.mock.model_copy(update={"noise_tails": 5.0, "temperature_programme": ((0.0, 0.0), (60.0, 1.0))})
    settings = settings_of(file.model_copy(update={"mock": mock}))
    assert settings.effects[0].name == "backlash"
    assert settings.noise_tails == 5.0
    assert settings.temperature_programme[1] == (60.0, 1.0)
    assert replace(settings, effects=()).effects == ()
    assert machine_path(file, embedded_rig_path()).name == "planar4.toml"
