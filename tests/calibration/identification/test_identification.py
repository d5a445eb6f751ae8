"""Identification on machines with known errors: statistical bounds, not our own output."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from calibration.base.errors import InputError
from calibration.identification.prediction import predict_poses
from calibration.instruments.smr_positions import ReflectorObservations, SmrPositions
from calibration.reduction.report_frame import fit_report_frame

RIGS = 12


@pytest.fixture(scope="module")
def fits(synthetic):
    """Some rigs, each measured without and with payload and fitted."""
    out = []
    for seed in range(RIGS):
        rig = synthetic(seed)
        xy = rig.workspace(30)
        visits = rig.visits(np.concatenate([xy, xy]), np.repeat([0.0, 400.0], 30))
        seen = rig.see(visits)
        report = fit_report_frame(rig.machine, seen.of_visits(visits.payload_kg == 0.0), rig.rough)
        out.append((rig, seen, report, rig.fit(seen, report.frame)))
    return out


def test_weighted_residuals_have_the_size_of_the_stated_noise(fits):
    total = sum(f.chi2_per_dof for *_, f in fits) / RIGS
    freedom = RIGS * (3 * 300 - 51)
    low, high = chi2.ppf([1e-4, 1 - 1e-4], freedom) / freedom
    assert low < total < high


def test_truth_lies_within_the_posterior(fits):
    """Errors of well observed directions, whitened by the posterior, have unit variance."""
    squares, count = 0.0, 0
    for rig, _, _, fit in fits:
        n = len(rig.model.parameters)
        error = fit.theta - rig.truth[:n]
        values, vectors = np.linalg.eigh(fit.covariance[:n, :n] / np.outer(rig.layout.sigma[:n], rig.layout.sigma[:n]))
        sharp = values < 0.3  # directions that the data decide, not the prior
        z = (vectors.T @ (error / rig.layout.sigma[:n]))[sharp] / np.sqrt(values[sharp])
        squares, count = squares + float(z @ z), count + int(sharp.sum())
    assert count > 6 * RIGS
    low, high = chi2.ppf([1e-4, 1 - 1e-4], count) / count
    assert low < squares / count < high


def test_held_out_poses_at_a_payload_that_was_never_measured(fits):
    rms = []
    for rig, _, report, fit in fits:
        visits = rig.visits(rig.workspace(60), np.full(60, 200.0))
        points = rig.see(visits, noise=False).position_m.reshape(60, 5, 3)[:, :3]
        true = report.poses(points, visits.target_m)
        error, _ = report.tool_error(true, predict_poses(fit, report, visits))
        rms.append(np.sqrt(np.mean(np.sum(error[:, :2] ** 2, axis=1))))
    assert np.median(rms) < 2.5e-6
    assert max(rms) < 5e-6


def test_truncated_svd_and_tikhonov_predict_about_as_well(fits):
    rig, seen, report, best = fits[0]
    visits = rig.visits(rig.workspace(40), np.full(40, 200.0))
    reference = predict_poses(best, report, visits)
    for estimator, limit_m in (("truncated_svd", 6e-6), ("tikhonov", 6e-6), ("l_curve", 15e-6)):
        other = rig.fit(seen, report.frame, estimator)
        shift, _ = report.tool_error(predict_poses(other, report, visits), reference)
        assert np.sqrt(np.mean(np.sum(shift[:, :2] ** 2, axis=1))) < limit_m, estimator


def test_least_squares_recovers_the_pose_but_not_the_parameters(fits):
    """The priors rescue parameters more than poses."""
    rig, seen, report, best = fits[1]
    plain = rig.fit(seen, report.frame, "least_squares")
    truth = rig.truth[: len(rig.model.parameters)]
    scale = rig.model.parameters.sigma
    assert np.linalg.norm((plain.theta - truth) / scale) > 2.0 * np.linalg.norm((best.theta - truth) / scale)
    visits = rig.visits(rig.workspace(40), np.zeros(40))
    shift, _ = report.tool_error(predict_poses(plain, report, visits), predict_poses(best, report, visits))
    assert np.sqrt(np.mean(np.sum(shift[:, :2] ** 2, axis=1))) < 6e-6


def test_absolute_stiffness_needs_a_known_load_difference(synthetic):
    rig = synthetic(40)
    xy = rig.workspace(40)
    rows = rig.model.parameters.rows("ln_stiffness")
    common = []
    for payload_kg in (0.0, 400.0):
        visits = rig.visits(np.concatenate([xy, xy]), np.repeat([0.0, payload_kg], 40))
        seen = rig.see(visits)
        fit = rig.fit(seen, rig.rough)
        common.append(np.sqrt(fit.covariance[np.ix_(rows, rows)].sum()) / 4.0)
    assert common[0] > 0.8 * 0.3 / np.sqrt(3.0) / 2.0
    assert common[1] < 0.3 * common[0]


def test_jacobian_agrees_with_differences(synthetic):
    rig = synthetic(41)
    visits = rig.visits(rig.workspace(3), np.array([0.0, 200.0, 400.0]))
    seen = SmrPositions(rig.see(visits), rig.station)
    count = len(rig.model)

    def predict(unknowns):
        poses = rig.model.predict(unknowns[:count], visits)
        return seen.compare(poses, seen.visit_indices(), unknowns[count:])

    at = predict(rig.truth)
    exact = np.concatenate([at.by_model, at.by_own], axis=2)
    sigma = rig.layout.sigma
    for u, name in enumerate(rig.layout.names):
        step = np.zeros(rig.layout.size)
        step[u] = 1e-2 * sigma[u]
        ahead, behind = (predict(rig.truth + s).residual for s in (step, -step))
        result = (ahead - behind) / (2 * step[u])
        np.testing.assert_allclose(exact[:, :, u] * sigma[u], result * sigma[u], atol=2e-2, rtol=1e-4, err_msg=name)


def test_too_few_readings_are_refused(synthetic):
    rig = synthetic(42)
    seen = rig.see(rig.visits(rig.workspace(3), np.zeros(3)))
    few = ReflectorObservations(seen.visits, seen.visit[:5], seen.smr[:5], seen.position_m[:5], seen.covariance_m2[:5])
    with pytest.raises(InputError, match="measure more poses"):
        rig.fit(few, rig.rough)
