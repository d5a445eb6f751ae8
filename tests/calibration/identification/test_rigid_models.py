from __future__ import annotations

import numpy as np
import pytest

from calibration.identification.estimators import identify
from calibration.identification.pose_selection import PlannedLoad, visits_at, workspace_poses
from calibration.identification.prediction import predict_poses
from calibration.identification.rigid.closure import MeasuredPoses
from calibration.identification.rigid.models import fit_rigid_identifications, minimal_subsets, without_struts
from calibration.instruments.smr_positions import SmrPositions, StationModel
from calibration.machine.description import load_machine, shipped_machine
from calibration.machine.equilibrium import make_conditions, solve
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
