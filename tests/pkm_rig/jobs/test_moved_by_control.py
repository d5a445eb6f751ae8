"""A machine that its control leads: visits as an NC program, and the verdict on two campaigns."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.compensation.error_map import correction_at
from calibration.compensation.tables import build_table
from calibration.machine.description import load_machine, shipped_machine
from calibration.machine.inverse import nominal_drives
from calibration.recording.folder import write_folder
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.control_files import IdentifiedLoad
from pkm_rig.jobs.nc_program import NcChoice, axis_words, with_first_poses, write_program
from pkm_rig.jobs.verify_folders import largest_error_poses, verify_folders
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.schedule import calibration_blocks
from tests.calibration.compensation.control_kinematics import rpy_matrix
from tests.pkm_rig.plant_recording import record

POSES = 14


@pytest.fixture(scope="module")
def before():
    return record(6, calibration_poses=POSES)


@pytest.fixture(scope="module")
def tables(before):
    return {n: build_table(i.calibration.fit, i.calibration.report, i.load) for n in (0, 2) for i in [load(before, n)]}


def load(recording, payload):
    return IdentifiedLoad.of(recording, payload)


@pytest.fixture(scope="module")
def with_correction(tables):
    def make(factor=1.0, poses=None, **changes):
        def correct(drives, payload):
            table = tables[payload if payload in tables else 0]
            added = correction_at(table, np.array([drives]))[0] * factor
            return tuple(float(q + c) for q, c in zip(drives, np.nan_to_num(added), strict=True))

        made = record(6, calibration_poses=POSES, correct=correct, noise=7, **changes)
        if poses is not None:
            nests = np.asarray(made["phase"]) == "nests"
            made = made.take(nests | np.isin(made["pose"], poses) & (made["payload"] == 0.0))
        return replace(made, file=made.file.model_copy(update={"campaign": "corrected"}))

    return make


def test_a_correction_that_helps_is_accepted_at_every_payload(before, with_correction):
    result = verify_folders(before, with_correction())
    assert result["accepted"]
    assert [entry["payload_kg"] for entry in result["payloads"]] == [0.0, 400.0]
    for entry in result["payloads"]:
        assert entry["after"]["position_rms_m"] < 0.6 * entry["before"]["position_rms_m"]
        assert entry["rule"].endswith("the correction stays")
    assert result["frame"].startswith("a frame each")


@pytest.mark.parametrize(("factor", "hint"), [(-1.0, "about twice: the sign"), (10.0, "not twice: the unit")])
def test_a_wrong_sign_or_unit_shows_at_the_first_three_poses(before, with_correction, factor, hint):
    first = largest_error_poses(before)
    assert len(first) == 3
    with pytest.raises(CampaignRefused, match=f"sign or unit: at poses .* times .{hint}"):
        verify_folders(before, with_correction(factor, first))


def test_three_good_poses_are_not_called_wrong(before, with_correction):
    result = verify_folders(before, with_correction(1.0, largest_error_poses(before)))
    assert result["first_poses"]["after_m"] < 0.6 * result["first_poses"]["before_m"]
    assert [entry["payload"] for entry in result["payloads"]] == [0]


def test_without_a_correction_nothing_is_accepted(before):
    again = record(6, calibration_poses=POSES, noise=8)
    again = replace(again, file=again.file.model_copy(update={"campaign": "again"}))
    result = verify_folders(before, again)
    assert not result["accepted"]
    assert all(entry["rule"].endswith("switch it off") for entry in result["payloads"])


def test_a_station_that_was_moved_gives_each_campaign_a_frame_of_its_own(before, with_correction):
    moved = with_correction()
    for name in ("x_m", "y_m"):
        moved.columns[name][:] = moved.columns[name] + 5e-4
    result = verify_folders(before, moved)
    assert result["accepted"]
    assert result["frame"].startswith("a frame each")
    few = with_correction(1.0, largest_error_poses(before))
    few.columns["x_m"][:] = few.columns["x_m"] + 5e-4
    with pytest.raises(InputError, match="the station was moved"):
        verify_folders(before, few)


def test_campaigns_that_cannot_be_compared_are_refused(before, with_correction):
    with pytest.raises(InputError, match="twice"):
        verify_folders(before, before)
    light = with_correction()
    light = light.take((np.asarray(light["phase"]) == "nests") | (light["payload"] == 0.0))
    with pytest.raises(InputError, match="payload 2 was not measured without and with the correction"):
        verify_folders(before, light)
    other = with_correction()
    other.columns["target_x_m"][:] = other.columns["target_x_m"] + 1e-3
    with pytest.raises(InputError, match="is another one in the second campaign"):
        verify_folders(before, other)


def test_the_command_decides_by_folders(run, before, with_correction, tmp_path):
    for name, recording in (("before", before), ("after", with_correction()), ("wrong", with_correction(-1.0))):
        write_folder(recording, tmp_path / name)
    good = run("verify", "--before", tmp_path / "before", "--after", tmp_path / "after", "--json")
    assert good.returncode == 0, good.stderr
    assert json.loads(good.stdout)["accepted"]
    wrong = run("verify", "--before", tmp_path / "before", "--after", tmp_path / "wrong")
    assert wrong.returncode == 1
    assert "sign or unit" in wrong.stderr
    assert run("verify", "--before", tmp_path / "before").returncode == 2
    assert run("verify").returncode == 2


def test_the_program_visits_what_the_campaign_plans_from_the_side_it_plans(run, tmp_path):
    file, machine = load_rig(embedded_rig_path())
    done = run("poses", "--rig", "embedded", "--nc", tmp_path / "visits.ngc", "--axes", "Y1=,Y2=", "--dwell", 5)
    assert done.returncode == 0, done.stderr
    visits = [v for block in calibration_blocks(machine, file.campaign) for v in block.visits]
    assert f"{len(visits)} visits" in done.stdout
    text = (tmp_path / "visits.ngc").read_text(encoding="ascii")
    moves = re.findall(r"^G1 Y1=(\S+) Y2=(\S+) F(\d+)$", text, re.M)
    places = np.array(moves, dtype=float).reshape(-1, 2, 3)
    assert places[:, 1, :2] == pytest.approx(np.array([v.drives_m for v in visits]) * 1e3, abs=1e-6)
    sides = np.sign(places[:, 1, :2] - places[:, 0, :2])
    assert sides == pytest.approx(np.array([v.direction for v in visits]))
    assert places[:, 1, 2] == pytest.approx([v.speed_m_per_s * 6e4 for v in visits])
    assert text.count("G4 P5") == len(visits)
    assert re.findall(r"^M0 \((.*)\)$", text, re.M) == ["no payload may be on", "put it on", "no payload may be on"]
    rows = list(csv.DictReader((tmp_path / "visits.csv").read_text(encoding="utf-8").splitlines()))
    assert [int(row["pose"]) for row in rows] == [v.pose for v in visits]
    assert [float(row["left_m"]) for row in rows] == pytest.approx([float(v.drives_m[0]) for v in visits], abs=0.0)


def test_the_tools_pose_is_commanded_where_the_control_knows_the_machine(tmp_path):
    machine = load_machine(shipped_machine("gough8"))
    file, _ = load_rig(embedded_rig_path())
    file = file.model_copy(update={"campaign": file.campaign.model_copy(update={"approach_m": 0.002})})
    with pytest.raises(InputError, match="use --coordinates tool"):
        write_program(file, machine, tmp_path / "a.ngc", NcChoice())
    result = write_program(file, machine, tmp_path / "a.ngc", NcChoice("tool"))
    rows = list(csv.DictReader((tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()))
    assert len(rows) == result["visits"]
    words = np.array([[float(row[name]) for name in "XYZABC"] for row in rows])[:5]
    drives = np.array([[float(row[f"{name}_m"]) for name in machine.drive_names] for row in rows])[:5]
    for word, q in zip(words, drives, strict=True):
        turn = rpy_matrix(*np.radians(word[3:]))
        ends = word[:3] * 1e-3 + (machine.nominal.platform_joint_m - machine.tool_point_m) @ turn.T
        length = np.linalg.norm(ends - machine.nominal.base_joint_m, axis=1)
        assert (length - machine.nominal.length_m) == pytest.approx(q[machine.strut_drive], abs=1e-8)


def test_poses_with_the_largest_errors_come_first(before):
    file, machine = load_rig(embedded_rig_path())
    blocks = calibration_blocks(machine, file.campaign)
    ordered = with_first_poses(blocks, (5, 2, 9))
    assert [v.pose for v in ordered[0].visits[:3]] == [5, 2, 9]
    assert sorted(map(id, ordered[0].visits)) == sorted(map(id, blocks[0].visits))
    assert ordered[1:] == tuple(blocks[1:])
    with pytest.raises(InputError, match="pose 999"):
        with_first_poses(blocks, (999,))
    assert nominal_drives(machine, blocks[0].visits[0].target_m[None])[0] == pytest.approx(blocks[0].visits[0].drives_m)


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--nc", "{tmp}/a.ngc"), "with --rig"),
        (("--rig", "embedded", "--nc", "{tmp}/a.csv"), "beside the program"),
        (("--rig", "embedded", "--nc", "{tmp}/a.ngc", "--axes", "X"), "give 2 different names"),
        (("--rig", "embedded", "--nc", "{tmp}/a.ngc", "--axes", "X,G1"), "'G1' is no axis word"),
        (("--rig", "embedded", "--nc", "{tmp}/a.ngc", "--dwell", "-1"), "--dwell -1"),
        (("--rig", "embedded", "--nc", "{tmp}/a.ngc", "--coordinates", "base"), "use drives or tool"),
        (("--rig", "embedded", "--axes", "X,Y"), "are for --nc"),
    ],
)
def test_bad_choices_of_a_program_are_one_line(run, tmp_path, arguments, complaint):
    done = run("poses", *(str(a).format(tmp=tmp_path) for a in arguments))
    assert done.returncode == 2
    assert complaint in done.stderr.splitlines()[-1]
    assert not list(tmp_path.iterdir())
    assert axis_words(load_machine(shipped_machine("rrr3")), NcChoice()) == ("X", "Y", "Z")
