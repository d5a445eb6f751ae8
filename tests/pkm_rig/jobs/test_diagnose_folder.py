"""`pkm-rig diagnose` of a measurement folder as a user types it."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from calibration.recording.measurement_folder import write_measurements
from tests.calibration.comparison.test_two_folders import DISTANCES, longer, two
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
    by_name = {c["name"]: c["file"] for c in result["next_measurement"]}
    assert by_name["t_rig_s"] is None
    assert set(by_name) & {"both directions", "varied rest", "another payload"} == set()  # nobody has written them down
    rows = list(csv.DictReader(Path(by_name["random poses"]).read_text(encoding="utf-8").splitlines()))
    assert [row["visit"] for row in rows[:2]] == ["120", "121"]
    assert all(row["z_m"] == "" for row in rows)
    assert 50 < len(rows) <= 60
    assert not {"time-line", "error-map"} & result["pictures"].keys()  # of heights, untimed
    for picture in result["pictures"].values():
        assert Path(picture).is_file()


def test_what_needs_a_recording_is_refused(run, folder, tmp_path):
    refused = run("diagnose", folder, "--estimate-disturbances", "--out", tmp_path)
    assert refused.returncode == 2
    assert "leave it out for a folder" in refused.stderr


def test_machine_and_effect_are_fitted_together_and_written_as_a_twin(run, folder, tmp_path, request):
    done = run("diagnose", folder, "--add", "--json", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    schema = request.config.rootpath / "docs" / "reference" / "diagnosis.schema.json"
    jsonschema.validate(result, json.loads(schema.read_text(encoding="utf-8")))
    twin = result["twin"]
    assert twin["effects"] == ["screw_cumulative_error"]
    assert twin["readings"] == 320
    assert twin["after_sigma"] < 1.25 < twin["before_sigma"]
    written = json.loads((Path(twin["folder"]) / "folder-twin.json").read_text(encoding="utf-8"))
    assert written["effects"] == [{"effect": "screw_cumulative_error", "place": "a"}]
    length = next(value for name, value in written["unknowns"].items() if name.startswith("strut_length."))
    assert length["unit"] == "m"
    assert 0.0 < length["u"] < 1e-4
    rows = list(csv.DictReader(Path(twin["predictions"]).read_text(encoding="utf-8").splitlines()))
    assert [row["of"] for row in (rows[0], rows[-1])] == ["visit 0, z_m", rows[-1]["of"]]
    assert rows[-1]["of"].startswith("distance, visit ")
    missed = [
        np.mean([((float(row["read"]) - float(row[by])) / float(row["sd"])) ** 2 for row in rows])
        for by in ("by_machine", "by_twin")
    ]
    assert missed[1] < 1.1 < missed[0]
    served = run("mock", "--rig", "any.toml", "--twin", twin["folder"])
    assert served.returncode == 2


def test_without_an_effect_the_twin_is_the_machine_as_it_was_fitted(run, tmp_path):
    write_measurements(made(Wanted(columns=("x_m", "y_m", "z_m"))), tmp_path / "good")
    done = run("diagnose", tmp_path / "good", "--add", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "no effect: none was found" in done.stdout
    assert "predicted.csv" in done.stdout.replace("\n", "")


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
