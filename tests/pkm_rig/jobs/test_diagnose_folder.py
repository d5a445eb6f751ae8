"""`pkm-rig diagnose` of a measurement folder as a user types it."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest

from calibration.recording.measurement_folder import write_measurements
from tests.calibration.diagnosis.measured import Wanted, made, wave


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Heights and distances of a delta with an error of 30 um along its first drive, and no word on sides or times."""
    path = tmp_path_factory.mktemp("folders") / "measured"
    write_measurements(made(Wanted(columns=("z_m",), pairs=200, shift=wave)), path)
    return path


def test_the_result_the_text_and_the_pictures(run, folder, tmp_path, request):
    done = run("diagnose", folder, "--json", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    schema = request.config.rootpath / "docs" / "reference" / "diagnosis.schema.json"
    jsonschema.validate(result, json.loads(schema.read_text(encoding="utf-8")))
    assert (result["verdict"], result["effects"][0]["place"]) == ("screw_cumulative_error", "a")
    assert result["simulated"] is False
    assert result["not_tested"]["drive_scale"] == "coordinates.csv has no column t_rig_s"
    assert [c["file"] for c in result["next_measurement"]] == [None] * len(result["next_measurement"])
    assert not {"time-line", "error-map"} & result["pictures"].keys()  # of heights, untimed
    for picture in result["pictures"].values():
        assert Path(picture).is_file()


def test_what_needs_a_recording_is_refused(run, folder, tmp_path):
    for option in ("--add", "--estimate-disturbances"):
        refused = run("diagnose", folder, option, "--out", tmp_path)
        assert refused.returncode == 2
        assert "leave them out for a folder" in refused.stderr


def test_too_few_readings_are_refused(run, tmp_path):
    write_measurements(made(Wanted(columns=("z_m",), visits=4)), tmp_path / "few")
    refused = run("diagnose", tmp_path / "few", "--out", tmp_path)
    assert refused.returncode == 2
    assert "4 different poses are too few" in refused.stderr


@pytest.fixture
def two_folders(tmp_path, monkeypatch):
    """Two measurement folders of one machine, whose drive b counts another length in the second."""
    monkeypatch.chdir(tmp_path)
    for name, measured in zip(("one", "other"), two(DISTANCES, longer), strict=True):
        write_measurements(measured, tmp_path / name)
    return tmp_path


def test_two_folders_are_compared(two_folders, run):
    done = run("compare", "one", "other", "--out", "runs")
    assert done.returncode == 0
    assert "drive b: its scale" in done.stdout
    assert (two_folders / "runs" / "later" / "compared-with" / "measured" / "workspace.png").is_file()


def test_a_folder_and_a_recording_are_not_compared(two_folders, run):
    (two_folders / "recording").mkdir()
    done = run("compare", "one", "recording", "--out", "runs")
    assert done.returncode == 2
    assert "one is a measurement folder and the other is not; give two folders or two recordings" in done.stderr
