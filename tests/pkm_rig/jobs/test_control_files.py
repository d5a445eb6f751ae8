"""`pkm-rig compensate --format`: files for controls, their losses told first, refusals with nothing written."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.compensation.formats.catalogue import FORMATS
from calibration.compensation.kinematics.catalogue import KINEMATICS
from calibration.compensation.remaining_error import Change, RemainingError
from calibration.compensation.tables import corrected_drives
from calibration.machine.inverse import nominal_drives, platform_poses
from calibration.recording.folder import write_folder
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.control_files import IdentifiedLoad, find_former, require_enough_removed
from tests.calibration.compensation import control_readers as readers
from tests.pkm_rig.plant_recording import record


@pytest.fixture(scope="module")
def recording():
    return record(11, calibration_poses=12)


@pytest.fixture(scope="module")
def folder(recording, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "folder"
    write_folder(recording, path)
    return path


def test_what_the_beckhoff_control_adds_puts_the_predicted_tool_where_it_is_commanded(run, recording, folder, tmp_path):
    done = run("compensate", folder, "--payload", 1, "--format", "beckhoff-plane", "--out", tmp_path, "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert re.search(
        r"left: correction max [\d.]+, RMS [\d.]+ .m; the format leaves max 0\.\d+, RMS 0\.\d+", done.stderr
    )
    assert result["files"] == ["achskw1.lis", "achskw2.lis"]
    assert result["tool_position_rms_m"]["after"] < 0.01 * result["tool_position_rms_m"]["before"]
    written = tmp_path / "plant-11" / "beckhoff-plane-payload-1"
    assert (written / "map.png").read_bytes().startswith(b"\x89PNG")
    parts = [readers.read_plane((written / name).read_text(encoding="utf-8")) for name in result["files"]]
    identified = IdentifiedLoad.of(recording, 1)
    machine = recording.machine
    target = platform_poses(machine, np.random.default_rng(3).uniform(-0.25, 0.25, (20, 2)))
    nominal = nominal_drives(machine, target)
    exact = corrected_drives(identified.calibration.fit, identified.calibration.report, target, identified.load)
    for q, wanted in zip(nominal, exact - nominal, strict=True):
        at = {"1": q[0] * 1e3, "2": q[1] * 1e3}
        added = [parts[0](at)["1"] * 1e-3, parts[1](at)["2"] * 1e-3]
        assert added == pytest.approx(wanted, abs=3e-7)


def test_a_format_that_loses_more_than_half_is_written_only_on_demand(run, folder, tmp_path):
    arguments = ("compensate", folder, "--format", "linuxcnc-comp", "--payload", 1, "--out", tmp_path)
    refused = run(*arguments)
    written = tmp_path / "plant-11" / "linuxcnc-comp-payload-1"
    found = re.search(
        r"on planar4 at payload 1 it would remove (\d+)% of the tool's predicted position error "
        r"\(([\d.]+) .m to ([\d.]+) .m RMS\), less than 50%; choose another format or give --accept-loss$",
        refused.stderr.strip(),
    )
    share, before, after = map(float, found.groups())
    assert share == pytest.approx(100.0 * (1.0 - after / before), abs=1.0)
    assert share < 50.0
    assert f"predicted error of the tool, RMS: position {found[2]}" in refused.stderr
    assert refused.returncode == 1
    assert "--accept-loss" in refused.stderr.splitlines()[-1]
    assert "the format leaves max" in refused.stderr
    assert not written.exists()
    accepted = run(*arguments, "--accept-loss")
    assert accepted.returncode == 0
    assert (written / "joint0.comp").is_file()
    assert "Read by LinuxCNC 2.9 of Debian 12, not in real time" in accepted.stdout


@pytest.mark.parametrize("accept", [False, True])
def test_what_makes_the_tool_worse_is_refused_whatever_is_accepted(recording, accept):
    """In position or in rotation alone, too; what removes enough passes."""
    good, poor, worse = Change(24.5e-6, 1e-6), Change(24.5e-6, 20e-6), Change(24.5e-6, 40.6e-6)
    machine = recording.machine
    for remaining, name in (
        (RemainingError(worse, None), "position"),
        (RemainingError(good, worse), "rotation"),
        (RemainingError(poor, worse), "rotation"),
        (RemainingError(None, worse), "rotation"),
    ):
        complaint = (
            f"format beckhoff-plane: on planar4 at payload 1 the tool's predicted {name} error would grow from 24.5"
        )
        with pytest.raises(CampaignRefused, match=complaint):
            require_enough_removed("beckhoff-plane", machine, 1, remaining, accept=accept)
    require_enough_removed("beckhoff-plane", machine, 1, RemainingError(good, good), accept=accept)
    require_enough_removed("beckhoff-plane", machine, 1, RemainingError(good, poor), accept=True)
    with pytest.raises(CampaignRefused, match="would remove 18% of the tool's predicted rotation error"):
        require_enough_removed("beckhoff-plane", machine, 1, RemainingError(good, poor), accept=False)


def test_a_correction_that_has_changed_much_needs_a_word(run, recording, folder, tmp_path):
    arguments = ("compensate", folder, "--format", "csv", "--payload", 1, "--out", tmp_path)
    former = tmp_path / "rig-1" / "csv-payload-1" / "written.csv"
    former.parent.mkdir(parents=True)
    former.write_text("rig,planar4,200.0\n0.9,0.9,0.001,0.0\n1.1,1.0,0.001,0.0\n", encoding="utf-8")
    refused = run(*arguments)
    assert refused.returncode == 2
    assert "from that of rig-1 (limit 200); if the machine was altered give --accept-change" in refused.stderr
    assert not (tmp_path / "plant-11").exists()
    accepted = run(*arguments, "--accept-change")
    assert accepted.returncode == 0
    assert "largest change against what was written before" in accepted.stdout
    written = tmp_path / "plant-11" / "csv-payload-1"
    assert find_former(written, recording.machine, 200.0).source == "rig-1"
    assert find_former(tmp_path / "rig-2" / "csv-payload-1", recording.machine, 200.0).source == "plant-11"
    assert find_former(tmp_path / "rig-2" / "csv-payload-1", recording.machine, 0.0) is None


@pytest.mark.parametrize("text", ["", "rig,planar4,200.0\nno,number,0,0\n", "rig,planar4,200.0\nnan,0,0,0\n"])
def test_a_damaged_record_of_what_was_written_is_named(recording, tmp_path, text):
    path = tmp_path / "rig-1" / "csv-payload-1" / "written.csv"
    path.parent.mkdir(parents=True)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=r"written\.csv: damaged"):
        find_former(tmp_path / "rig-2" / "csv-payload-1", recording.machine, 200.0)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--format", "fanuc"), "format 'fanuc' is unknown; known: csv"),
        (("--format", "siemens-cec", "--control", "s7"), "known: sinumerik-828d"),
        (("--format", "heidenhain-com"), "--axes"),
        (("--format", "heidenhain-com", "--axes", "x,y"), "'x' is no name of an axis"),
        (("--axes", "X,Y"), "are for --format"),
        (("--format", "csv", "--payload", "7"), "payload 7"),
        (("--format", "genhexkins"), "planar4 is none for it: genhexkins has telescopic struts"),
        (("--format", "klipper-delta"), "planar4 is none for it: a linear delta has three sliders"),
        (("--format", "genhexkins", "--axes", "X,Y"), "leave out --control, --axes"),
    ],
)
def test_bad_choices_are_one_line_and_status_2(run, folder, tmp_path, arguments, complaint):
    done = run("compensate", folder, "--out", tmp_path, *arguments)
    assert done.returncode == 2
    assert complaint in done.stderr.splitlines()[-1]
    assert not (tmp_path / "plant-11").exists()


def test_the_help_names_every_format_and_says_what_no_vendor_has_read(run):
    text = " ".join(run("compensate", "--help").stdout.replace("│", " ").split())
    flat = text.replace(" ", "")
    for form in (*FORMATS.values(), *KINEMATICS.values()):
        assert form.name in flat
    unread = sorted(form.name for form in (*FORMATS.values(), *KINEMATICS.values()) if form.read_by is None)
    assert unread == ["beckhoff-plane", "heidenhain-com", "klipper-delta", "siemens-cec"]
    assert "OfvendorsonlyLinuxCNC'ssoftwarehasreadfilesofours" in flat
