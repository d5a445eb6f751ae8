"""How well an identification predicts poses, and with what uncertainty: held-out and verification poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.identification.calibration import identify_recording, pose_u
from calibration.identification.held_out import _are_held_out, _without_held_out, held_out_error
from calibration.identification.model_comparison import orientation_prediction
from calibration.identification.prediction import predict_poses
from calibration.reduction.reduction import reduce


def test_the_uncertainty_of_a_pose_is_the_covariance_of_the_unknowns_through_its_derivatives(identified):
    """It takes whole standard deviations, so that curvature adds to the first order, but never much."""
    fit = identified.fit
    visits = fit.visits.take(np.arange(0, len(fit.visits), 40))
    base = predict_poses(fit, identified.report, visits)
    columns = []
    for k, step in enumerate(0.01 * np.sqrt(np.diag(fit.covariance))):
        moved = replace(fit, unknowns=fit.unknowns + step * np.eye(len(fit.unknowns))[k])
        shift, turn = identified.report.tool_error(predict_poses(moved, identified.report, visits), base)
        columns.append(np.column_stack([shift[:, :2], turn[:, 2]]) / step)
    derivatives = np.stack(columns, axis=2)  # (v, 3, u)
    variance = np.diagonal(derivatives @ fit.covariance @ derivatives.transpose(0, 2, 1), axis1=1, axis2=2)
    u_position, u_rotation = pose_u(identified, visits)
    for u, first_order in ((u_position, variance[:, 0] + variance[:, 1]), (u_rotation, variance[:, 2])):
        assert np.all(u > 0.98 * np.sqrt(first_order))
        assert np.all(u < 1.4 * np.sqrt(first_order))


def test_orientation_is_predicted_to_what_the_station_can_see(whole, identified):
    """Of the planar machine only the rotation about z is free; a payload that was never verified has no figure."""
    reduction = reduce(whole, identified.reduction)
    rows = reduction.rows("verification_before", 0)
    predicted = predict_poses(identified.fit, reduction.report, reduction.observations.visits.take(rows))
    turn = reduction.poses.coordinates[rows, 5] - predicted[:, 5]
    found = orientation_prediction(identified, reduction, "verification_before", 0)
    assert found == pytest.approx(np.sqrt(np.mean(turn**2)), rel=1e-3)
    assert 1e-7 < found < 5e-5
    assert orientation_prediction(identified, reduction, "verification_before", 9) is None


def test_poses_of_which_no_reading_passed_cannot_be_held_out(identified):
    """Every fifth pose would be."""
    info = identified.reduction.info
    without = replace(identified, reduction=replace(identified.reduction, info=replace(info, pose=5 * info.pose + 1)))
    with pytest.raises(InputError, match="no reading of them passed the gate"):
        held_out_error(without, "map")


def test_of_poses_without_a_number_every_fifth_visit_is_held_out(whole, identified):
    """-1 is no pose's number; each target of this campaign was visited once, in the order of their numbers."""
    numbered, _ = held_out_error(identified, "map")
    pose = np.asarray(whole["pose"]).copy()
    calibration = np.asarray(whole["phase"]) == "calibration"
    pose[calibration] = -1
    unnumbered = identify_recording(replace(whole, columns={**whole.columns, "pose": pose}), "map", baselines=False)
    error, _ = held_out_error(unnumbered, "map")
    assert error["position_rms_m"] == pytest.approx(numbered["position_rms_m"], rel=0.3)
    refitted = _without_held_out(unnumbered.reduction.recording)
    kept = set(refitted["visit"][np.asarray(refitted["phase"]) == "calibration"].astype(int))
    info = unnumbered.reduction.info
    predicted = set(info.number[_are_held_out(info.pose, info.number) & unnumbered.reduction.rows("calibration")])
    assert len(predicted) > 10
    assert not predicted & kept
