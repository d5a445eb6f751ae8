"""Recording folders are hostile input: whatever is in them, the answer is a recording or one line."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.base.errors import InputError
from calibration.recording.folder import RecordFile, read_folder, write_folder, write_record
from calibration.recording.header import DeclaredLevels
from calibration.recording.recording import make_recording
from tests.pkm_rig.plant_recording import record


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("folder") / "good"
    write_folder(record(2, calibration_poses=6), path)
    return path


@pytest.fixture
def copy(folder, tmp_path):
    return shutil.copytree(folder, tmp_path / "copy")


def test_floats_round_trip(folder):
    one = read_folder(folder)
    other = record(2, calibration_poses=6)
    for name, column in other.columns.items():
        np.testing.assert_array_equal(one.columns[name], column, err_msg=name)
    assert one.file == other.file


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("format = 1", "format = 1\nplugin = 'x.py'", "unknown key 'plugin'"),
        ('campaign = "plant-2"', 'campaign = "../../etc/x"', "campaign"),
        ('campaign = "plant-2"', 'campaign = "/abs"', "campaign"),
        ('drives = ["left", "right"]', 'drives = ["left"]', "are not the machine's"),
        (
            "angle_sd_rad = 2.4e-06",
            "angle_sd_rad = 0.0",
            "'station.accuracy.angle_sd_rad': 0.0 should be greater than 0",
        ),
        (
            "[station]",
            "[nuisance]\ndrift_m = 3.0\n[station]",
            "'nuisance.drift_m': 3.0 should be less than or equal to",
        ),
        ("range_constant_u_m = 0.0001", "range_constant_u_m = 100.0", "'station.accuracy.range_constant_u_m': 100.0"),
        ("range_sd_m = 0.0001", "range_sd_m = 1.0", "'station.accuracy.range_sd_m': 1.0"),
        ("angle_sd_rad = 2.4e-06", "angle_sd_rad = 2.4", "'station.accuracy.angle_sd_rad': 2.4"),
        ("range_scale_u = 1e-06", "range_scale_u = 1.0", "'station.accuracy.range_scale_u': 1.0"),
        ("drift_m_per_sqrt_h = 1e-05", "drift_m_per_sqrt_h = 10.0", "'station.accuracy.drift_m_per_sqrt_h': 10.0"),
        ("format = 1", "", "no key 'format'; add it"),
    ],
)
def test_bad_headers_are_refused(copy, old, new, complaint):
    edit(copy / "recording.toml", old, new)
    with pytest.raises(InputError, match=complaint) as caught:
        read_folder(copy)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("column", "value", "complaint"),
    [
        ("x_m", "nan", "not finite"),
        ("x_m", "1e9", "out of range"),
        ("x_m", "abc", "not a number"),
        ("sequence", "1e300", "not a count"),
        ("visit", "7.5", "not a count"),
        ("samples", "0", "samples"),
        ("smr", "P9", r"row \d+: SMR 'P9' is not in its machine file"),
        ("phase", "lunch", "unknown phase 'lunch'"),
        ("payload", "9", r"row \d+: payload 9 is not listed; add it to"),
        ("payload_mass_kg", "55", r"row \d+: payload_mass_kg contradicts"),
        ("cov_xx_m2", "-1e-9", "covariance"),
        ("target_x_m", "350", "outside the workspace"),
        ("dwell_s", "-2.0", "row 5, column 'dwell_s' is negative"),
        ("speed_m_per_s", "-0.5", "row 5, column 'speed_m_per_s' is negative"),
    ],
)
def test_bad_values_are_named(copy, column, value, complaint):
    lines = (copy / "readings.csv").read_text(encoding="utf-8").splitlines()
    cells = lines[5].split(",")
    cells[lines[0].split(",").index(column)] = value
    lines[5] = ",".join(cells)
    (copy / "readings.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match=complaint) as caught:
        read_folder(copy)
    assert "\n" not in str(caught.value)


def test_columns_of_the_station_s_settings_may_be_there_or_not(folder, copy, tmp_path):
    assert "edm_mode" not in read_folder(folder).columns
    lines = (copy / "readings.csv").read_text(encoding="utf-8").splitlines()
    head, *rows = lines
    (copy / "readings.csv").write_text("\n".join([f"{head},edm_mode,prism_type", *(f"{r},2,1" for r in rows)]))
    one = read_folder(copy)
    assert set(one["edm_mode"].tolist()) == {2.0}
    assert set(one["prism_type"].tolist()) == {1.0}
    write_folder(one, tmp_path / "again")
    np.testing.assert_array_equal(read_folder(tmp_path / "again")["prism_type"], one["prism_type"])
    (copy / "readings.csv").write_text("\n".join([f"{head},edm_mode", *(f"{r},2.5" for r in rows)]))
    with pytest.raises(InputError, match="'edm_mode' is not a count"):
        read_folder(copy)


LEVELS = {"drift_m": 2e-6, "temperature_k": 0.02}  # one of them is its default


@pytest.mark.parametrize("levels", [{}, LEVELS], ids=["nothing", "two keys"])
def test_levels_that_are_not_declared_stay_so(levels, tmp_path):
    made = record(2, calibration_poses=6)
    recording = replace(made, file=made.file.model_copy(update={"nuisance": DeclaredLevels(**levels)}))
    write_folder(recording, tmp_path / "once")
    write_folder(read_folder(tmp_path / "once"), tmp_path / "twice")
    found = read_folder(tmp_path / "twice").file.nuisance
    assert (found.model_fields_set, found) == (set(levels), recording.file.nuisance)


def test_an_export_that_was_cut_short_is_refused(copy):
    write_record(copy, RecordFile(campaign="plant-2", head="ab", readings=len(read_folder(copy))))
    whole = (copy / "readings.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    read_folder(copy)
    (copy / "readings.csv").write_text("".join(whole[:-3]), encoding="utf-8")
    with pytest.raises(InputError, match=rf"{len(whole) - 4} readings, where record.toml says {len(whole) - 1}"):
        read_folder(copy)


def test_tables_of_other_programs_are_read_or_told_apart(copy):
    path = copy / "readings.csv"
    text = path.read_text(encoding="utf-8")
    number = len(read_folder(copy))
    path.write_text("\ufeff" + text, encoding="utf-8")
    assert len(read_folder(copy)) == number
    for mark, name in ((";", "semicolons"), ("\t", "tabulators")):
        path.write_text(text.replace(",", mark), encoding="utf-8")
        with pytest.raises(InputError, match=f"separated by {name}; separate them by commas"):
            read_folder(copy)
    path.write_text("", encoding="utf-8")
    with pytest.raises(InputError, match="nothing in it"):
        read_folder(copy)
    path.write_text(text.replace("x_m,", "x_mm,", 1), encoding="utf-8")
    with pytest.raises(InputError, match="no column 'x_m', but 'x_mm'"):
        read_folder(copy)


def test_readings_of_before_the_settings_were_told_count_as_not_known(folder):
    old = read_folder(folder)
    rows = [{name: column[i] for name, column in old.columns.items()} for i in range(len(old))]
    rows[-1] |= {"edm_mode": 2.0}
    mixed = make_recording(old.file, old.machine, rows)
    assert mixed["edm_mode"].tolist() == [-1.0] * (len(old) - 1) + [2.0]
    assert "prism_type" not in mixed.columns


def test_missing_columns_rows_and_files_are_named(copy):
    text = (copy / "readings.csv").read_text(encoding="utf-8")
    (copy / "readings.csv").write_text(text.replace("cov_xy_m2", "cov", 1), encoding="utf-8")
    with pytest.raises(InputError, match="no column 'cov_xy_m2'"):
        read_folder(copy)
    (copy / "readings.csv").write_text(text.splitlines()[0] + "\n", encoding="utf-8")
    with pytest.raises(InputError, match="no readings"):
        read_folder(copy)
    (copy / "readings.csv").unlink()
    with pytest.raises(InputError, match="check the path"):
        read_folder(copy)
    with pytest.raises(InputError, match="exists already"):
        write_folder(record(2, calibration_poses=6), copy)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.binary(max_size=300), at=st.integers(0, 5000))
def test_any_bytes_in_the_csv_give_a_recording_or_one_line(folder, tmp_path, data, at):
    broken = tmp_path / "broken"
    if not broken.exists():
        shutil.copytree(folder, broken)
    whole = (folder / "readings.csv").read_bytes()
    (broken / "readings.csv").write_bytes(whole[:at] + data + whole[at + len(data) :])
    assert "\n" not in complaint_about(broken)


def complaint_about(path):
    """The one line about a folder, empty if it is a recording; any other exception fails the test."""
    try:
        read_folder(path)
    except InputError as error:
        return str(error)
    return ""


def test_a_reading_that_stands_twice_is_refused(copy):
    path = copy / "readings.csv"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join([*lines, lines[-1]]), encoding="utf-8")
    with pytest.raises(InputError, match="occurs twice; keep one"):
        read_folder(copy)
