"""Compensation computed from a perfect identification puts the tool where it is commanded."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from calibration.compensation.tables import build_table, corrected_drives, drive_box
from calibration.identification.prediction import predict_poses
from calibration.machine.inverse import nominal_drives
from calibration.model.operating_conditions import OperatingConditions
from calibration.model.visits import Visits
from calibration.reduction.report_frame import fit_report_frame
from tests.calibration.conftest import PLATE_COM_M, TEMPERATURES_C


@pytest.fixture(scope="module")
def known(synthetic):
    rig = synthetic(7)
    xy = rig.workspace(40)
    visits = rig.visits(np.concatenate([xy, xy]), np.repeat([0.0, 400.0], 40))
    seen = rig.see(visits)
    report = fit_report_frame(rig.machine, seen.of_visits(visits.payload_kg == 0.0), rig.rough)
    return rig, report, rig.fit(seen, report.frame)


def test_corrected_drives_bring_the_predicted_tool_onto_its_target(known):
    rig, report, fit = known
    load = OperatingConditions(200.0, PLATE_COM_M, TEMPERATURES_C)
    visits = rig.visits(rig.workspace(50), np.full(50, 200.0))
    drives = corrected_drives(fit, report, visits.target_m, load)
    error, _ = report.tool_error(predict_poses(fit, report, load.at_poses(drives, visits.target_m)), visits.target_m)
    assert np.abs(error[:, :2]).max() < 1e-9


def test_table_brings_the_true_tool_within_microns(known):
    rig, report, fit = known
    load = OperatingConditions(200.0, PLATE_COM_M, TEMPERATURES_C)
    table = build_table(fit, report, load)
    visits = rig.visits(rig.workspace(200), np.full(200, 200.0))
    axes = [table.start_m[a] + table.step_m[a] * np.arange(17) for a in range(2)]
    correction = [RegularGridInterpolator(axes, table.correction_m[a])(visits.drives) for a in range(2)]
    moved = Visits(
        visits.drives + np.stack(correction, axis=1),
        visits.target_m,
        visits.payload_kg,
        visits.payload_com_m,
        visits.temperatures_c,
    )

    def rms(which):
        points = rig.see(which, noise=False).position_m.reshape(200, 5, 3)[:, :3]
        error, _ = report.tool_error(report.poses(points, which.target_m), which.target_m)
        return np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1)))

    assert rms(moved) < 4e-6
    assert rms(visits) > 20e-6


def test_interpolation_between_nodes_is_below_two_microns(known):
    rig, report, fit = known
    load = OperatingConditions(0.0, (0.0, 0.0, 0.0), TEMPERATURES_C)
    table = build_table(fit, report, load)
    visits = rig.visits(rig.workspace(100), np.zeros(100))
    exact = corrected_drives(fit, report, visits.target_m, load) - visits.drives
    axes = [table.start_m[a] + table.step_m[a] * np.arange(17) for a in range(2)]
    for a in range(2):
        result = RegularGridInterpolator(axes, table.correction_m[a])(visits.drives)
        assert np.sqrt(np.mean((result - exact[:, a]) ** 2)) < 2e-6


@pytest.mark.parametrize(("noise_m", "points"), [(2e-4, 9), (7e-6, 33), (1e-12, 64)])
def test_the_grid_is_as_coarse_as_the_noise_lets_it(known, noise_m, points):
    """Interpolation adds at most 5 % of the noise, by the predicted tool at poses of the test's own."""
    rig, report, fit = known
    load = OperatingConditions(200.0, PLATE_COM_M, TEMPERATURES_C)
    table = build_table(fit, report, load, noise_m)
    count = table.correction_m.shape[1]
    assert count == points
    target = rig.visits(rig.workspace(300), np.full(300, 200.0)).target_m
    nominal = nominal_drives(rig.machine, target)
    axes = [table.start_m[a] + table.step_m[a] * np.arange(count) for a in range(2)]
    correction = np.stack([RegularGridInterpolator(axes, table.correction_m[a])(nominal) for a in range(2)], axis=1)
    error, _ = report.tool_error(predict_poses(fit, report, load.at_poses(nominal + correction, target)), target)
    added_m = np.linalg.norm(error[:, :2], axis=1)
    assert np.sqrt(np.mean(added_m**2)) == pytest.approx(table.interpolation_rms_m, rel=0.15)
    assert added_m.max() <= 1.2 * table.interpolation_max_m < 2e-5
    assert points == 64 or table.interpolation_rms_m <= 0.05 * noise_m


def test_no_node_within_the_workspace_is_taken_from_another(known):
    """A search that begins too far away is begun again from a neighbour: the finest grid has no dent anywhere."""
    _, report, fit = known
    table = build_table(fit, report, OperatingConditions(200.0, PLATE_COM_M, TEMPERATURES_C), 1e-12)
    assert table.correction_m.shape == (2, 64, 64)
    assert table.interpolation_max_m < 0.3e-6


def test_grid_covers_the_workspace_with_a_margin_and_every_node_is_a_number(known):
    rig, report, fit = known
    table = build_table(fit, report, OperatingConditions(0.0, (0.0, 0.0, 0.0), TEMPERATURES_C))
    assert table.correction_m.shape == (2, 17, 17)
    assert np.isfinite(table.correction_m).all()
    box = drive_box(rig.machine)
    drives = rig.visits(rig.workspace(500), np.zeros(500)).drives
    assert (drives > box[:, 0] + 0.015).all()
    assert (drives < box[:, 1] - 0.015).all()
    assert np.abs(table.correction_m).max() < 2e-3
