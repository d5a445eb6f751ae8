from __future__ import annotations

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.base.rotation import rotation_vector
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.reduction.report_frame import apply_increment, fit_report_frame

SHIFT_M = np.array([1e-3, 0.0, 0.0])


def test_poses_are_found_back_from_the_points_they_give(synthetic):
    rig = synthetic(1)
    seen = rig.see(rig.visits(rig.workspace(20), np.zeros(20)))
    report = fit_report_frame(rig.machine, seen, rig.rough)
    rng = np.random.default_rng(0)
    start = seen.visits.target_m
    moved = apply_increment(start, rng.normal(0.0, 1e-3, (20, 3)), rig.machine.dof)
    np.testing.assert_allclose(report.poses(report.points(moved), start), moved, atol=1e-12)


def test_jacobian_agrees_with_differences(synthetic):
    rig = synthetic(2)
    seen = rig.see(rig.visits(rig.workspace(8), np.zeros(8)))
    report = fit_report_frame(rig.machine, seen, rig.rough)
    pose, every = seen.visits.target_m, np.arange(6)
    exact = report.jacobian(pose)
    for c in range(6):
        step = np.zeros((8, 6))
        step[:, c] = 1e-6
        ahead, behind = (report.points(apply_increment(pose, s, every)) for s in (step, -step))
        np.testing.assert_allclose(exact[..., c], (ahead - behind) / 2e-6, atol=1e-9)


def test_the_machines_own_errors_do_not_tilt_the_frame(synthetic):
    """Weighed by angle noise alone the tilt would be some 300 urad; range noise over the readings allows about 40."""
    tilts = []
    for seed in range(8):
        rig = synthetic(seed)
        seen = rig.see(rig.visits(rig.workspace(100), np.zeros(100)))
        report = fit_report_frame(rig.machine, seen, rig.rough)
        tilt = rotation_vector((rig.frame.rotation.T @ report.frame.rotation)[None])[0]
        tilts.append(tilt[:2])
    assert np.sqrt(np.mean(np.square(tilts))) < 60e-6


def test_a_constant_shift_of_all_poses_is_no_error(synthetic):
    rig = synthetic(3)
    seen = rig.see(rig.visits(rig.workspace(30), np.zeros(30)))
    report = fit_report_frame(rig.machine, seen, rig.rough)
    moved = ReflectorObservations(seen.visits, seen.visit, seen.smr, seen.position_m + SHIFT_M, seen.covariance_m2)
    again = fit_report_frame(rig.machine, moved, rig.rough)
    points = seen.position_m.reshape(30, 5, 3)[:, :3]
    target = seen.visits.target_m
    one, _ = report.tool_error(report.poses(points, target), target)
    other, _ = again.tool_error(again.poses(points + SHIFT_M, target), target)
    np.testing.assert_allclose(one, other, atol=2e-8)


def test_too_few_poses_or_reflectors_on_a_line_are_refused(synthetic):
    rig = synthetic(4)
    seen = rig.see(rig.visits(rig.workspace(3), np.zeros(3)))
    with pytest.raises(InputError, match="4 or more poses"):
        fit_report_frame(rig.machine, seen, rig.rough)
    from dataclasses import replace  # noqa: PLC0415

    smrs = list(rig.machine.smrs)
    smrs[2] = replace(smrs[2], position_m=np.array([0.0, -0.12, 0.10]))
    line = replace(rig.machine, smrs=tuple(smrs))
    many = rig.see(rig.visits(rig.workspace(10), np.zeros(10)))
    with pytest.raises(InputError, match="on a line"):
        fit_report_frame(line, many, rig.rough)


def test_single_readings_of_quite_another_place_are_passed_over(synthetic):
    rig = synthetic(4)
    seen = rig.see(rig.visits(rig.workspace(40), np.zeros(40)))
    rows, position = [3, 60], seen.position_m.copy()
    position[rows] += np.array([[10.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    spoiled = ReflectorObservations(seen.visits, seen.visit, seen.smr, position, seen.covariance_m2)
    keep = np.setdiff1d(np.arange(len(seen.smr)), rows)
    report = fit_report_frame(rig.machine, spoiled, rig.rough)
    without = fit_report_frame(rig.machine, seen.take(keep), rig.rough)
    np.testing.assert_allclose(report.frame.rotation, without.frame.rotation, atol=1e-9)
    np.testing.assert_allclose(report.mounting_m, without.mounting_m, atol=1e-9)
