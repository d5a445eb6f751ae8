"""What the station sees: the angle a reflector accepts, struts in the way; both codes agree on random scenes."""

from __future__ import annotations

import re

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.base.rotation import rotation_matrix
from calibration.identification.pose_selection import workspace_poses
from calibration.instruments.visibility import segment_gap, visible
from calibration.machine.description import parse_machine, shipped_machine
from calibration.machine.inverse import nominal_drives, nominal_poses
from mock_devices.plant.sight_lines import hides, looks_here
from pkm_rig.rig.campaign_sections import CampaignSettings
from pkm_rig.rig.schedule import calibration_targets

SIDE = np.array([0.3, -2.2, 1.6])
TEXT = shipped_machine("gough8").read_text(encoding="utf-8")


def machine_with(*, facing=None, acceptance=None, diameter=None):
    """gough8 with what its reflectors face, and with struts of a diameter."""
    text = TEXT
    if facing is not None:
        extra = f"facing = {list(facing)}\n" + ("" if acceptance is None else f"acceptance_rad = {acceptance}\n")
        text = re.sub(r'(on = "platform"\n)', lambda m: m.group(1) + extra, text)
    if diameter is not None:
        text = text.replace("force_limit_n", f"diameter_m = {diameter}\nforce_limit_n")
    return parse_machine(text, "test")


def poses_of(machine, count=40):
    tool = workspace_poses(machine, count, 5)
    pose = nominal_poses(machine, tool[:, machine.commanded])
    return pose, nominal_drives(machine, pose)


def test_without_facing_and_diameter_everything_is_seen():
    machine = machine_with()
    assert visible(machine, SIDE, *poses_of(machine)).all()


def test_reflectors_that_look_away_are_not_seen():
    machine = machine_with(facing=(0.0, 1.0, 0.0))
    seen = visible(machine, SIDE, *poses_of(machine))
    on_platform = np.array([smr.on == "platform" for smr in machine.smrs])
    assert not seen[:, on_platform].any()
    assert seen[:, ~on_platform].all()


def test_the_acceptance_is_the_angle_to_the_station():
    machine = machine_with(facing=(0.0, -1.0, 0.0), acceptance=0.3)
    pose, drives = poses_of(machine)
    seen = visible(machine, SIDE, pose, drives)[:, 0]
    turn = rotation_matrix(pose[:, 3:])
    beam = SIDE - (pose[:, :3] + turn @ machine.smrs[0].position_m)
    beam /= np.linalg.norm(beam, axis=1)[:, None]
    angle = np.arccos(np.sum(beam * (turn @ np.array([0.0, -1.0, 0.0])), axis=1))
    assert (seen == (angle <= 0.3)).all()
    assert 0 < seen.sum() < len(seen)


def test_a_strut_in_the_beam_hides():
    """From below, struts stand before the reflectors; the mock, by points of the strut, finds the same."""
    machine = machine_with(diameter=0.06)
    pose, drives = poses_of(machine)
    low = np.array([0.3, -2.2, 0.3])
    seen = visible(machine, low, pose, drives)
    assert 0 < (~seen).sum() < seen.size
    agree = 0
    turn = rotation_matrix(pose[:, 3:])
    geometry = machine.nominal
    for n in range(len(pose)):
        for i, smr in enumerate(machine.smrs):
            if smr.on != "platform":
                continue
            place = pose[n, :3] + turn[n] @ smr.position_m
            hidden = any(
                hides(geometry.base_joint_m[k], pose[n, :3] + turn[n] @ geometry.platform_joint_m[k], 0.06, place, low)
                for k in range(8)
            )
            agree += hidden != seen[n, i]
    assert agree >= 0.97 * len(pose) * 4  # but for grazing beams


def test_both_codes_agree_on_where_a_reflector_looks():
    rng = np.random.default_rng(3)
    for _ in range(50):
        place, station, facing = rng.normal(size=(3, 3))
        facing /= np.linalg.norm(facing)
        beam = station - place
        angle = np.arctan2(np.linalg.norm(np.cross(beam, facing)), beam @ facing)
        assert looks_here(facing, 0.9, place, station) == (angle <= 0.9)


def test_the_gap_of_two_segments_is_the_least_over_their_points():
    rng = np.random.default_rng(4)
    a, b, c, d = rng.normal(size=(4, 30, 3))
    s = np.linspace(0.0, 1.0, 300)
    for n, gap in enumerate(segment_gap(a, b, c, d)):
        first = a[n] + s[:, None] * (b[n] - a[n])
        second = c[n] + s[:, None] * (d[n] - c[n])
        least = np.linalg.norm(first[:, None] - second[None], axis=2).min()
        assert gap <= least + 1e-12
        assert gap == pytest.approx(least, abs=0.02)


def test_poses_are_planned_where_all_reflectors_are_seen():
    machine = machine_with(facing=(0.0, -1.0, 0.0), acceptance=0.42)
    chosen = calibration_targets(machine, CampaignSettings(calibration_poses=20), tuple(SIDE))
    assert visible(machine, SIDE, chosen, nominal_drives(machine, chosen)).all()
    assert not visible(machine, SIDE, *poses_of(machine)).all()


def test_a_reflector_that_is_never_seen_is_named():
    machine = machine_with(facing=(0.0, 1.0, 0.0))
    with pytest.raises(InputError, match="never sees reflector P1 of gough8"):
        calibration_targets(machine, CampaignSettings(calibration_poses=20), tuple(SIDE))
