"""The free part of a correction: internal force falls by as much as its U lets it, and the tool stays where it is."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest

from calibration.compensation.correction import model_error
from calibration.compensation.free_part import MOST_GROWTH, find_free_part, force_u
from calibration.compensation.host import host_correction
from calibration.identification.calibration import identify_recording
from calibration.machine.description import shipped_machine
from calibration.machine.inverse import nominal_drives
from pkm_rig.rig.config import demo_rig_path, load_rig
from pkm_rig.rig.schedule import verification_block
from tests.pkm_rig.spatial_recording import TEMPERATURES_C, plant_of, record, true_errors, true_forces_n

PAYLOAD = 1


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


class Corrected:
    """A machine's plant, its identification, and poses that no fit has seen; with and without a free part."""

    def __init__(self, rig, seed):
        self.calibration = identify_recording(record(rig, seed, poses=20), baselines=False)
        self.plant, _ = plant_of(rig, seed)
        file, self.machine = load_rig(rig)
        block = verification_block(self.machine, file.campaign, PAYLOAD)
        self.target_m = np.array([visit.target_m for visit in block.visits[:20]])
        self.free = host_correction(self.calibration, PAYLOAD, TEMPERATURES_C)
        self.smallest = replace(self.free, free=None)

    def true(self, correction):
        """RMS of the noise-free errors in the commanded coordinates (m, rad), and of the forces (N)."""
        drives = correction.drives(self.target_m)
        errors = np.hstack(true_errors(self.plant, self.calibration.report, drives, self.target_m, PAYLOAD))
        commanded = self.machine.commanded
        moves, turns = errors[:, commanded[commanded < 3]], errors[:, commanded[commanded > 2]]
        return rms(moves), rms(turns) if turns.size else 0.0, rms(true_forces_n(self.plant, drives, PAYLOAD))


def rig_with_known_stiffness(name, folder, ln_stiffness):
    """A demo rig whose machine file knows the struts' stiffness; both readers read it."""
    text = shipped_machine(name).read_text(encoding="utf-8")
    known = text.replace("ln_stiffness = 0.3", f"ln_stiffness = {ln_stiffness}")
    assert known != text
    (folder / "known.toml").write_text(known, encoding="utf-8")
    rig = folder / "rig.toml"
    shutil.copy(demo_rig_path(name), rig)
    rig.write_text(rig.read_text(encoding="utf-8").replace(f'machine = "{name}"', 'machine = "known.toml"'), "utf-8")
    return rig


@pytest.fixture(scope="module", params=["gough8", "delta8", "rrr4"])
def known(request, tmp_path_factory):
    """Stiffness within 0.5 %."""
    return Corrected(rig_with_known_stiffness(request.param, tmp_path_factory.mktemp("known"), 0.005), 2)


@pytest.fixture(scope="module")
def unknown():
    """Stiffness within 30 %, as the file of gough8 has it."""
    return Corrected(demo_rig_path("gough8"), 2)


def test_where_stiffness_is_known_internal_force_goes_and_the_tool_stays(known):
    """By the plant's own struts and its noise-free poses."""
    moves, turns, force_n = known.true(known.smallest)
    moves_free, turns_free, force_free_n = known.true(known.free)
    assert force_free_n < 0.5 * force_n
    assert moves_free < 1.05 * moves
    assert turns_free <= 1.05 * turns
    assert 0.0 < known.free.free.u_growth <= MOST_GROWTH


def test_the_predicted_tool_is_where_it_was(known):
    error = model_error(known.calibration.fit, known.calibration.report, known.free.conditions)
    drives = known.free.drives(known.target_m)
    assert np.abs(error(drives, known.target_m)[:, known.machine.commanded]).max() < 1e-9
    assert np.abs(drives - known.smallest.drives(known.target_m)).max() > 1e-5


def test_where_stiffness_is_not_known_only_a_little_is_taken(unknown):
    moves, turns, force_n = unknown.true(unknown.smallest)
    moves_free, turns_free, force_free_n = unknown.true(unknown.free)
    assert force_free_n < force_n
    assert moves_free < 1.05 * moves
    assert turns_free < 1.05 * turns


def test_taken_to_the_end_it_costs_the_tool_its_place(unknown, monkeypatch):
    """Why there is a limit: without it the forces go, and the tool with them, as the uncertainty said."""
    monkeypatch.setattr("calibration.compensation.free_part.MOST_GROWTH", 1e3)
    smallest, calibration = unknown.smallest, unknown.calibration
    whole = find_free_part(calibration.fit, calibration.report, smallest.conditions, smallest.measured.box)
    moves, _, force_n = unknown.true(smallest)
    moves_free, _, force_free_n = unknown.true(replace(smallest, free=whole))
    assert force_free_n < 0.4 * force_n
    assert moves_free > 2.0 * moves
    assert whole.u_growth > 2.0


def test_forces_are_as_uncertain_as_they_are_said_to_be(unknown):
    drives = nominal_drives(unknown.machine, unknown.target_m[:6])
    smallest = unknown.smallest
    u = force_u(smallest.fit, smallest.conditions, drives, unknown.target_m[:6])
    off = smallest.forces_n(drives, unknown.target_m[:6]) - true_forces_n(unknown.plant, drives, PAYLOAD)
    assert 0.3 < rms(off / u) < 2.0


def test_a_machine_with_a_drive_for_each_coordinate_has_no_free_part():
    calibration = identify_recording(record("prs3", 5, poses=12), baselines=False)
    assert host_correction(calibration, PAYLOAD, TEMPERATURES_C).free is None
