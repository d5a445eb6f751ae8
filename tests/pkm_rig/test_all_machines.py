"""Every shipped machine from its plant's readings to a correction by the host, without any wire; one over the wire."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.compensation.host import host_correction
from calibration.identification.calibration import identify_recording
from calibration.machine.description import shipped_machines
from calibration.machine.inverse import nominal_drives
from calibration.reduction.figures import figure_axes
from pkm_rig.jobs.measure import measure
from pkm_rig.rig.campaign_sections import VisitEntry
from pkm_rig.rig.config import demo_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.schedule import verification_block
from pkm_rig.store.store import open_store
from pkm_rig.virtual.mock_rig import embedded_mock_rig
from tests.pkm_rig.conftest import SHORT, silent
from tests.pkm_rig.spatial_recording import TEMPERATURES_C, frame_of_rig, plant_of, record, true_errors

CRANK_VISITS = tuple(
    VisitEntry(target=(x, y, turn), direction=(side,), payload=payload)
    for payload in (0, 2)
    for x, y, turn, side in ((0.05, -0.03, 0.1, 1), (-0.04, 0.05, -0.1, -1), (0.06, 0.06, 0.05, 1))
)
SPATIAL = tuple(name for name in shipped_machines() if name != "planar4")


@pytest.mark.parametrize("name", SPATIAL)
def test_the_station_sees_reflectors_where_the_rig_file_puts_it(name):
    """Level against gravity: the plant's own set-up is within its draw of the calibration's rough frame."""
    plant, _ = plant_of(name, 3)
    frame, machine = frame_of_rig(name)
    rotation, translation_m = plant.truth.station_from_machine
    assert np.abs(rotation - frame.rotation).max() < 6e-3  # zero direction within 5 mrad, level within 20 urad
    assert np.abs(-rotation.T @ translation_m + frame.rotation.T @ frame.translation_m).max() < 0.011
    up = rotation @ (-machine.gravity_m_per_s2 / 9.80665)
    assert up == pytest.approx([0.0, 0.0, 1.0], abs=4e-5)


@pytest.mark.parametrize(("name", "least"), [("stewart6", 4.0), ("prs3", 3.0), ("rrr4", 4.0), ("delta6", 4.0)])
def test_the_hosts_correction_puts_the_true_tool_where_it_is_commanded(name, least):
    """Scored by the plant's own noise-free truth, at poses that no fit has seen and a payload between the measured."""
    recording = record(name, 5, poses=12)
    identification = identify_recording(recording, baselines=False)
    plant, _ = plant_of(name, 5)
    file, machine = load_rig(demo_rig_path(name))
    target_m = np.array([visit.target_m for visit in verification_block(machine, file.campaign, 1).visits[:8]])
    correction = host_correction(identification, 1, TEMPERATURES_C)
    moves, turns = figure_axes(machine)
    rms = []
    for drives in (nominal_drives(machine, target_m), correction.drives(target_m)):
        position, rotation = true_errors(plant, identification.report, drives, target_m, 1)
        rms.append((np.sqrt(np.mean(position[:, moves] ** 2)), np.sqrt(np.mean(rotation[:, turns] ** 2))))
    before, after = rms
    assert before[0] > least * after[0]
    if np.any(machine.commanded > 2):
        assert before[1] > least * after[1]


def measured_over_the_wire(name, folder):
    """A short campaign over the real protocols: its recording, and the plant's truth and temperatures."""
    path = demo_rig_path(name)
    file, machine = load_rig(path)
    short = {**SHORT, "calibration_poses": 6, "speeds_m_per_s": (0.4, 0.2), "readings_per_smr": 1}
    if name == "rrr4":
        short |= {"speeds_m_per_s": (0.2, 0.1), "visits": CRANK_VISITS}
    file = file.model_copy(update={"campaign": file.campaign.model_copy(update=short)})
    with (
        embedded_mock_rig(file, path) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory, rig_path=path) as rig,
        open_store(folder) as store,
    ):
        campaign = measure(rig, store, silent, silent)
        return store.recording(campaign), mock.mock.plant.truth, mock.mock.plant.thermal


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """A hexapod, whose legs move by their profiles."""
    return measured_over_the_wire("stewart6", tmp_path_factory.mktemp("stewart6"))


def test_four_cranks_are_led_over_the_wire_in_radians(tmp_path):
    """More cranks than coordinates: led by SYNC, recorded in radians, and every reading is the plant's."""
    recording, truth, thermal = measured_over_the_wire("rrr4", tmp_path)
    assert recording.file.rotary_drives == ("a", "b", "c", "d")
    calibration = recording.rows("calibration")
    assert "a_actual_rad" in calibration.columns
    assert "a_actual_m" not in calibration.columns
    wanted = nominal_drives(recording.machine, calibration.targets_m())
    assert calibration.drives("commanded_m") == pytest.approx(wanted, abs=2e-8)
    sides = [tuple(side) for side in calibration.drives("direction").tolist()]
    assert all(set(side) == {-1.0, 1.0} for side in sides)  # cranks come from where the tool comes from
    assert len(set(sides)) >= 2
    off = reading_errors(calibration, truth, thermal)
    assert np.abs(off).max() < 1.5e-4


def test_six_legs_are_measured_over_the_wire(measured):
    recording, _, _ = measured
    assert recording.file.drives == tuple(f"leg{n}" for n in range(1, 7))
    calibration = recording.rows("calibration")
    assert len(set(calibration["visit"].tolist())) == 24
    assert np.abs(calibration.drives("following_error_m")).max() < 2e-5
    assert np.abs(calibration.drives("commanded_m") - calibration.drives("actual_m")).max() < 2e-5
    torque, loaded = np.abs(calibration.drives("torque_ratio")), calibration["payload"] == 2.0
    assert np.all(torque[loaded].mean(axis=0) > 1.5 * torque[~loaded].mean(axis=0))


def reading_errors(calibration, truth, thermal):
    """Readings (n, 3) less the true places of their reflectors, every seventh."""
    drives, off = calibration.drives("actual_m"), []
    for row in range(0, len(calibration), 7):
        t_s = float(calibration["t_rig_s"][row])
        places = truth.smr_positions(
            drives[row], int(calibration["payload"][row]), temperatures_c=thermal.parts_c(t_s), in_station_frame=True
        )
        off.append(calibration.positions_m[row] - places[str(calibration["smr"][row])])
    return np.array(off)


def test_readings_over_the_wire_are_the_plants(measured):
    """Each reading is the true place of its reflector but for the stated noise, drift and the range constant."""
    recording, truth, thermal = measured
    assert np.abs(reading_errors(recording.rows("calibration"), truth, thermal)).max() < 1.5e-4
