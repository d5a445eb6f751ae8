from __future__ import annotations

import numpy as np
import pytest

from calibration.base.rotation import rotation_matrix
from calibration.identification.estimators import identify
from calibration.identification.pose_selection import PlannedLoad, visits_at, workspace_poses
from calibration.identification.prediction import predict_poses
from calibration.identification.rigid import closure
from calibration.identification.rigid.closure import MeasuredPoses
from calibration.identification.rigid.models import (
    fit_rigid_identifications,
    minimal_subsets,
    rigid_model,
    without_struts,
)
from calibration.instruments.smr_positions import SmrPositions, StationModel
from calibration.machine.description import load_machine, shipped_machine
from calibration.machine.equilibrium import make_conditions, solve, state_at
from calibration.reduction.report_frame import fit_report_frame
from tests.calibration.conftest import SMRS


@pytest.fixture(scope="module")
def fitted(synthetic):
    rig = synthetic(9)
    xy = rig.workspace(40)
    visits = rig.visits(np.concatenate([xy, xy]), np.repeat([0.0, 400.0], 40))
    seen = rig.see(visits)
    report = fit_report_frame(rig.machine, seen.of_visits(visits.payload_kg == 0.0), rig.rough)
    ours = rig.fit(seen, report.frame)
    instrument = StationModel(report.frame, SMRS, 1e-5)

    def fit(model, rows):
        some = seen.of_visits(rows)
        return identify(model, some.visits, [SmrPositions(some, instrument)])

    points = seen.position_m.reshape(len(visits), 5, 3)[:, :3]
    sigma = np.diag([8e-6, 8e-6, 3e-5]) ** 2
    measured = MeasuredPoses(visits, report.poses(points, visits.target_m), np.tile(sigma, (len(visits), 1, 1)))
    stated = lambda found, at: predict_poses(found, report, at)  # noqa: E731
    return rig, report, ours, fit_rigid_identifications(rig.machine, visits, fit, stated, measured)


def error(rig, report, predicted, visits):
    points = rig.see(visits, noise=False).position_m.reshape(len(visits), -1, 3)[:, :3]
    shift, _ = report.tool_error(report.poses(points, visits.target_m), predicted)
    return np.sqrt(np.mean(np.sum(shift[:, :2] ** 2, axis=1)))


def test_one_rigid_geometry_cannot_serve_two_payloads(fitted):
    rig, report, ours, baselines = fitted
    for kg in (0.0, 400.0):
        visits = rig.visits(rig.workspace(60), np.full(60, kg))
        best = error(rig, report, predict_poses(ours, report, visits), visits)
        for name in ("leave_out_link", "mean_of_minimal_subsets", "equal_weight_closure", "per_leg_closure"):
            rigid = next(b for b in baselines if b.name == name)
            assert error(rig, report, rigid.predict(visits), visits) > 4.0 * best, (kg, name)


def test_refitted_per_payload_equal_weight_closure_is_the_strong_baseline(fitted):
    rig, report, _, baselines = fitted
    refitted = next(b for b in baselines if b.name == "equal_weight_closure_per_payload")
    for kg in (0.0, 200.0, 400.0):
        visits = rig.visits(rig.workspace(60), np.full(60, kg))
        assert error(rig, report, refitted.predict(visits), visits) < 4e-6, kg


def test_interpolation_between_payloads_is_linear_in_mass(fitted):
    rig, _, _, baselines = fitted
    refitted = next(b for b in baselines if b.name == "equal_weight_closure_per_payload")
    at = [refitted.predict(rig.visits(np.zeros((1, 2)), np.array([kg]))) for kg in (0.0, 100.0, 400.0)]
    np.testing.assert_allclose(at[1], 0.75 * at[0] + 0.25 * at[2], atol=1e-15)


def test_leaving_out_a_strut_keeps_the_others(machine):
    fewer = without_struts(machine, [3])
    assert fewer.strut_names == machine.strut_names[:3]
    assert fewer.nominal.length_m.shape == (3,)
    assert fewer.strut_drive.tolist() == [0, 0, 1]


@pytest.mark.parametrize("name", ["rrr4", "delta8", "gough8"])
def test_what_may_be_left_out_holds_the_platform_everywhere(name):
    machine = load_machine(shipped_machine(name))
    pose = visits_at(machine, workspace_poses(machine, 60, 2), [PlannedLoad()])
    subsets = minimal_subsets(machine)
    assert 1 <= len(subsets) <= 8
    for drop in subsets:
        fewer = without_struts(machine, drop)
        at = make_conditions(fewer, len(pose)).without_loads()
        assert solve(fewer, fewer.nominal, pose.drives, at, pose.target_m).converged.all(), drop


def residuals_at(machine, geometry, visits, coordinates):
    """Gaps (c, v) of all loops at given poses."""
    at = make_conditions(machine, len(visits), visits.temperatures_c).without_loads()
    rotation = rotation_matrix(coordinates[:, 3:])
    return state_at(machine, geometry, visits.drives, at, coordinates[:, :3], rotation)


@pytest.mark.parametrize("name", ["planar4", "rrr4", "gough8", "delta8", "prs3"])
def test_derivatives_of_the_loops_are_their_differences(name):
    machine = load_machine(shipped_machine(name))
    parameters = rigid_model(machine).parameters
    visits = visits_at(machine, workspace_poses(machine, 6, 2), [PlannedLoad()])
    rng = np.random.default_rng(3)
    theta = 0.3 * parameters.sigma * rng.standard_normal(len(parameters))
    state = residuals_at(machine, parameters.geometry(theta), visits, visits.target_m)
    at = make_conditions(machine, len(visits), visits.temperatures_c).without_loads()
    found = closure._closure_jacobian(parameters, parameters.geometry(theta), visits.drives, at, state)
    for i, sigma in enumerate(parameters.sigma):
        step = 1e-3 * sigma * np.eye(len(parameters))[i]
        above, below = (
            residuals_at(machine, parameters.geometry(theta + sign * step), visits, visits.target_m).residual
            for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose(
            found[i], (above - below) / (2e-3 * sigma), atol=1e-6 * max(1.0, 1e-3 / sigma), err_msg=parameters.names[i]
        )


@pytest.mark.parametrize("name", ["delta6", "stewart6"])
def test_loops_of_a_machine_that_is_not_overconstrained_are_closed(name):
    """Its true poses close every loop exactly: what is found must too, wherever the true parameters lie."""
    machine = load_machine(shipped_machine(name))
    parameters, rng = rigid_model(machine).parameters, np.random.default_rng(5)
    visits = visits_at(machine, workspace_poses(machine, 30, 2), [PlannedLoad()])
    truth = parameters.geometry(parameters.sigma * rng.standard_normal(len(parameters)))
    at = make_conditions(machine, len(visits), visits.temperatures_c).without_loads()
    there = solve(machine, truth, visits.drives, at, visits.target_m)
    assert there.converged.all()
    measured = MeasuredPoses(
        visits, there.coordinates(), np.tile(1e-14 * np.eye(len(machine.dof)), (len(visits), 1, 1))
    )
    theta = closure.close_loops(parameters, measured)
    open_m, closed_m = (
        np.max(np.abs(residuals_at(machine, geometry, visits, there.coordinates()).residual))
        for geometry in (machine.nominal, parameters.geometry(theta))
    )
    assert open_m > 1e-4
    assert closed_m < 1e-7
