"""Recordings whose rig time begins anew in a session."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.diagnosis.diagnose import diagnose
from calibration.effects.catalogue import load_catalogue
from calibration.identification.calibration import calibration_part, identify_recording
from calibration.identification.held_out import held_out_error
from calibration.recording.folder import read_folder, write_folder
from calibration.recording.sessions import breaks_s, repaired_text, sessions_from_sequence
from calibration.reduction.drift_filter import Breaks
from calibration.reduction.nest_checks import drop_unclosed_readings
from calibration.reduction.reduction import reduce

FOLDER = Path(__file__).parents[2] / "data" / "version_0_1" / "recording"
FIRSTS = (200, 400)  # rows with which another session begins
OF_TIME = {"tracker_drift", "link_thermal_growth", "screw_thermal_growth", "column_thermal_growth"}


@pytest.fixture(scope="module")
def whole():
    return read_folder(FOLDER)


@pytest.fixture(scope="module")
def scrambled(whole):
    """Its rig time began near zero in each of three sessions."""
    t = whole["t_rig_s"].copy()
    for first, end in zip(FIRSTS, (*FIRSTS[1:], len(t)), strict=True):
        t[first:end] -= t[first] - 30.0
    return replace(whole, columns={**whole.columns, "t_rig_s": t})


@pytest.fixture(scope="module")
def risen(scrambled):
    return sessions_from_sequence(scrambled)


def test_a_folder_whose_time_falls_is_refused_and_names_the_row(tmp_path, scrambled):
    write_folder(scrambled, tmp_path / "folder")
    with pytest.raises(InputError, match=r"row 201: t_rig_s falls.*--sessions-from-sequence"):
        read_folder(tmp_path / "folder")
    again = read_folder(tmp_path / "folder", by_sequence=True)
    assert [s.first_sequence for s in again.file.sessions] == [0, *FIRSTS]
    write_folder(again, tmp_path / "again")
    kept = read_folder(tmp_path / "again")
    assert kept.file.sessions == again.file.sessions
    np.testing.assert_array_equal(kept["t_rig_s"], again["t_rig_s"])


def test_time_rises_and_is_unchanged_within_a_session(whole, risen):
    assert np.all(np.diff(risen["t_rig_s"]) > 0.0)
    step, before = np.diff(risen["t_rig_s"]), np.diff(whole["t_rig_s"])
    inside = np.delete(np.arange(len(step)), np.array(FIRSTS) - 1)
    np.testing.assert_allclose(step[inside], before[inside], atol=1e-6)
    assert breaks_s(risen) == tuple(risen["t_rig_s"][list(FIRSTS)])
    assert "2 after an unknown time" in repaired_text(risen)
    assert repaired_text(whole) is None


def test_a_recording_whose_time_rises_has_no_further_sessions(whole):
    assert sessions_from_sequence(whole) is whole


def test_the_drift_is_unknown_over_a_break_and_no_further_than_a_nest_check_allows(whole, risen):
    breaks = Breaks((10.0, 20.0), 80e-6, 4.0)
    assert not breaks.covariance(10.0, 19.0).any()
    np.testing.assert_allclose(np.sqrt(np.diag(breaks.covariance(5.0, 10.0))), [80e-6] * 3 + [20e-6] * 3)
    np.testing.assert_allclose(breaks.covariance(5.0, 25.0), 2.0 * breaks.covariance(5.0, 15.0))
    plain, broken = reduce(whole), reduce(risen)
    assert broken.dropped == plain.dropped
    assert np.mean(broken.observations.covariance_m2) > np.mean(plain.observations.covariance_m2)


def test_prediction_is_as_good_as_with_the_times_that_were(whole, risen):
    errors = []
    for recording in (whole, risen):
        held_out, _ = held_out_error(identify_recording(recording, "map", baselines=False), "map")
        errors.append(held_out["position_rms_m"])
    assert errors[1] < 1.1 * errors[0]


def test_no_effect_of_time_is_tested_across_a_break(whole, risen):
    catalogue = load_catalogue()
    found = diagnose(drop_unclosed_readings(calibration_part(risen)), catalogue)
    plain = diagnose(drop_unclosed_readings(calibration_part(whole)), catalogue)
    refused = {name for name, reason in found.not_tested.items() if "unknown time" in reason}
    assert refused >= OF_TIME
    assert not any("unknown time" in reason for reason in plain.not_tested.values())
    assert "backlash" not in refused
    assert found.verdict == plain.verdict


def test_a_visit_that_broke_off_after_one_reading_is_no_error(whole):
    """It has no pose of its own, which the closures from measured poses must not take for one."""
    is_calibration = np.asarray(whole["phase"]) == "calibration"
    visit = whole["visit"][np.flatnonzero(is_calibration)[40]]
    keep = np.ones(len(whole), dtype=bool)
    keep[np.flatnonzero(is_calibration & (whole["visit"] == visit))[1:]] = False
    identified = identify_recording(whole.take(keep))
    assert "per_leg_closure" in {baseline.name for baseline in identified.baselines}
