"""A further register of the PLC, added to the rig file alone: recorded, exported, and no matter to the analysis."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from calibration.base.errors import InputError
from pkm_rig.cli.entry import app
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.plc_connection import register_map
from pkm_rig.store.store import find_recording
from tests.pkm_rig.conftest import SHORT, SLIDERS, campaign_lines

COOLANT = """
[[plc.readings]]
name = "coolant_temperature_c"
meaning = "coolant at the pump"
address = 40
type = "i16"
scale = 0.1
low = 5.0
high = 50.0
"""


@pytest.fixture(scope="module")
def write_rig(tmp_path_factory):
    """Writes the embedded rig with a short campaign and some text more."""

    def write(more):
        text = embedded_rig_path().read_text(encoding="utf-8")
        path = tmp_path_factory.mktemp("rig") / "rig.toml"
        path.write_text(f"{text}\n[campaign]\n{campaign_lines(SHORT | SLIDERS)}{more}", encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="module")
def measured(write_rig, tmp_path_factory):
    """A campaign with the coolant in the rig file: its id and its store's folder."""
    out = tmp_path_factory.mktemp("out")
    run("measure", "--rig", write_rig(COOLANT), "--out", out)
    (listed,) = json.loads(run("list", "--out", out, "--json"))["campaigns"]
    return listed["campaign"], out


def run(*arguments):
    from typer.testing import CliRunner  # noqa: PLC0415

    done = CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def test_it_is_recorded_with_each_reading_and_exported(measured, tmp_path):
    campaign, out = measured
    recording = find_recording(campaign, out)
    coolant = recording["coolant_temperature_c"]
    assert recording.file.extra_columns == {"coolant_temperature_c": "coolant at the pump"}
    assert np.all(np.abs(coolant - recording["base_temperature_c"]) < 0.2)  # the mock serves the base's temperature
    assert np.allclose(coolant, np.round(coolant, 1))
    run("export", campaign, tmp_path / "folder", "--out", out)
    with (tmp_path / "folder" / "readings.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["coolant_temperature_c"]) for row in rows] == coolant.tolist()


def test_identification_and_diagnosis_run_as_before(measured):
    campaign, out = measured
    assert json.loads(run("identify", campaign, "--out", out, "--json"))["calibration"] == campaign
    assert json.loads(run("diagnose", campaign, "--out", out, "--json"))["campaign"] == campaign


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('"coolant_temperature_c"', '"base_temperature_c"', "one of the recording's own"),
        ('"coolant_temperature_c"', '"coolant"', "does not end in a unit"),
        ("high = 50.0", "high = 1.0", "range 5 to 1"),
        ("address = 40", "address = 40\ncolour = 1", "unknown key"),
    ],
)
def test_a_section_that_cannot_be_is_refused_in_one_line(write_rig, old, new, complaint):
    with pytest.raises(InputError, match=complaint):
        register_map(load_rig(write_rig(COOLANT.replace(old, new)))[0].plc)


def test_two_of_the_same_name_are_refused(write_rig):
    with pytest.raises(InputError, match="two readings have the same name"):
        load_rig(write_rig(COOLANT + COOLANT))
