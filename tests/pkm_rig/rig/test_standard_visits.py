"""Campaigns for the formulae of ISO 230-2 and ISO 9283, as files that `measure --campaign` takes."""

from __future__ import annotations

import json

import numpy as np
import pytest

from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.schedule import calibration_blocks
from pkm_rig.rig.standard_visits import axis_visits, pose_visits
from pkm_rig.rig.visits_file import with_visits


@pytest.fixture(scope="module")
def rig():
    return load_rig(embedded_rig_path())


@pytest.mark.parametrize(("axis", "column"), [("x", 0), ("y", 1)])
def test_eleven_targets_five_runs_from_either_side(rig, axis, column):
    file, machine = rig
    section = axis_visits(machine, file.campaign, axis)
    assert section.made_for == f"ISO 230-2 {axis}"
    rows = np.array([visit.target for visit in section.visits])
    sides = np.array([visit.direction for visit in section.visits])
    low, high = machine.commanded_limits.T
    assert np.all((rows >= low) & (rows <= high))
    assert np.ptp(rows[:, 1 - column]) == 0.0
    targets, counts = np.unique(rows[:, column], return_counts=True)
    assert (len(targets), set(counts.tolist())) == (11, {10})
    assert np.ptp(np.diff(targets)) > 1e-3  # irregular: an error with a period is met at several phases
    for run in range(5):
        up, back = rows[22 * run : 22 * run + 11], rows[22 * run + 11 : 22 * run + 22]
        assert np.all(np.diff(up[:, column]) > 0.0)
        assert np.all(np.diff(back[:, column]) < 0.0)
    ends = sides.reshape(5, 2, 11, 2)
    assert np.all(ends[:, 0] == -ends[:, 1])


def test_the_side_of_each_drive_is_the_one_that_the_tool_comes_from(rig):
    """Sliders stand above the platform on both sides: to the right the left one goes down and the right one up."""
    file, machine = rig
    assert axis_visits(machine, file.campaign, "x").visits[0].direction == (-1, 1)
    assert axis_visits(machine, file.campaign, "y").visits[0].direction == (1, 1)


def test_thirty_cycles_of_five_poses(rig):
    section = pose_visits(rig[1])
    assert section.made_for == "ISO 9283"
    targets = [visit.target for visit in section.visits]
    assert len(targets) == 150
    assert targets == targets[:5] * 30
    assert len(set(targets)) == 5
    assert targets[4] == (0.0, 0.0)


@pytest.mark.parametrize("options", [("--virtual-axis", "x"), ("--iso9283",)])
def test_the_file_is_one_that_measure_takes(run, rig, tmp_path, options):
    ended = run("poses", "--rig", "embedded", *options)
    assert ended.returncode == 0
    (tmp_path / "campaign.toml").write_text(ended.stdout, encoding="utf-8")
    file = with_visits(rig[0], tmp_path / "campaign.toml", rig[1])
    assert file.campaign.made_for is not None
    (block,) = calibration_blocks(rig[1], file.campaign)
    found = json.loads(run("poses", "--rig", "embedded", *options, "--json").stdout)
    assert found["made_for"] == file.campaign.made_for
    assert len(found["visits"]) == len(block.visits)


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (("--rig", "embedded", "--virtual-axis", "z"), "choose x or y"),
        (("--rig", "embedded", "--virtual-axis", "rz"), "choose x or y"),
        (("--rig", "embedded", "--virtual-axis", "x", "--iso9283"), "a campaign of its own"),
        (("--machine", "planar4", "--iso9283"), "need --rig"),
    ],
)
def test_what_cannot_be_is_one_line(run, options, complaint):
    ended = run("poses", *options)
    assert (ended.returncode, ended.stdout) == (2, "")
    assert complaint in ended.stderr
    assert len(ended.stderr.splitlines()) == 1
