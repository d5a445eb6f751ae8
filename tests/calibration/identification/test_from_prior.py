"""A former calibration as the prior: what two sets of readings say one after the other is what they say together."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.joint_covariance import ORIENTATION_RAD, POSITION_M, fitted
from calibration.base.errors import InputError
from calibration.identification.estimators import identify
from calibration.identification.from_prior import Prior, identify_from_prior
from calibration.identification.pose_selection import PlannedLoad, visits_at, workspace_poses
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.description import load_machine, shipped_machine
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet

KINDS = ("strut_length", "base_joint")
PLANE = (0, 1, 5)  # coordinates of a planar machine
CHANGE_M = 1e-5  # of each strut's length since the former calibration


@pytest.fixture(scope="module")
def halves():
    """A model, and readings of a machine with errors at two sets of poses, the second with 400 kg."""
    machine = load_machine(shipped_machine("planar4"))
    model = Model(ParameterSet.of(machine, KINDS))
    rng = np.random.default_rng(5)
    theta = rng.normal(0.0, [p.sigma for p in model.parameters.parameters])
    dof = tuple(machine.dof.tolist())
    sigma = np.where(machine.dof < 3, 5e-6, 2e-5)
    out = []
    for seed, mass in ((1, 0.0), (2, 400.0)):
        visits = visits_at(machine, workspace_poses(machine, 14, seed), [PlannedLoad(mass)])
        poses = model.predict(theta, visits)
        blank = ToolCoordinates.of(visits, dof, visits.target_m, sigma)
        exact = blank.compare(poses, blank.visit_indices(), np.zeros(0), derivatives=False).residual
        out.append((visits, blank.with_noise(exact + rng.standard_normal(exact.shape))))
    return model, out


def test_one_after_the_other_is_both_together(halves):
    model, ((first, early), (second, late)) = halves
    former = identify(model, first, [early])
    prior = Prior(former.layout.names, former.unknowns, former.covariance)
    updated = identify_from_prior(model, second, [late], prior)
    own = identify(model, second, [late])
    assert updated.converged
    precision = np.linalg.inv(former.covariance) + np.linalg.inv(own.covariance)
    precision -= np.diag(1.0 / updated.layout.sigma**2)  # the tolerances are in both
    np.testing.assert_allclose(updated.covariance, np.linalg.inv(precision), rtol=0.05, atol=1e-14)
    right = np.linalg.solve(former.covariance, former.unknowns) + np.linalg.solve(own.covariance, own.unknowns)
    together = np.linalg.solve(precision, right)
    u = np.sqrt(np.diag(updated.covariance))
    assert np.max(np.abs(updated.unknowns - together) / u) < 0.3  # what the models' curvature leaves
    assert np.all(u <= np.sqrt(np.diag(former.covariance)) * 1.0001)


def test_what_the_prior_holds_fast_does_not_move(halves):
    model, ((first, early), (second, late)) = halves
    former = identify(model, first, [early])
    prior = Prior(former.layout.names, former.unknowns, former.covariance * 1e-8)
    held = identify_from_prior(model, second, [late], prior)
    assert np.max(np.abs(held.unknowns - former.unknowns) / former.theta_u) < 0.01


def test_a_name_that_is_not_fitted_is_refused(halves):
    model, (_, (second, late)) = halves
    with pytest.raises(InputError, match=r"has 'mounting\.P9\.x', which these readings lack"):
        identify_from_prior(model, second, [late], Prior(("mounting.P9.x",), np.zeros(1), np.eye(1)))


@pytest.fixture(scope="module")
def changed():
    """Over-constrained machines, each with its true unknowns, after a few readings have followed a small change."""
    out = []
    for seed in range(4):
        former, parameters = fitted("planar4", seed)
        model, rng = former.model, np.random.default_rng([seed, 7])
        struts = [i for i, unknown in enumerate(model.unknowns) if unknown.name.startswith("strut_length.")]
        truth, growth = np.zeros(len(model)), np.zeros_like(former.covariance)
        truth[: len(parameters)] = parameters
        truth[struts] += CHANGE_M * rng.standard_normal(len(struts))
        growth[struts, struts] = CHANGE_M**2
        visits = visits_at(model.machine, workspace_poses(model.machine, 10, 500 + seed), [PlannedLoad()])
        sigma = np.array([POSITION_M, POSITION_M, ORIENTATION_RAD])
        blank = ToolCoordinates.of(visits, PLANE, visits.target_m, sigma)
        exact = blank.compare(model.predict(truth, visits), blank.visit_indices(), np.zeros(0), derivatives=False)
        late = blank.with_noise(exact.residual + rng.standard_normal(exact.residual.shape))
        prior = Prior(former.layout.names, former.unknowns, former.covariance + growth)
        out.append((identify_from_prior(model, visits, [late], prior), truth))
    return out


def test_in_the_curved_valley_of_a_strained_machine_it_settles(changed):
    """Steps shrink by a third or less there: of twenty too much was left."""
    assert all(fit.converged for fit, _ in changed)


def test_poses_are_where_it_says_with_the_covariance_at_the_minimum_as_the_prior(changed):
    errors = []
    for fit, truth in changed:
        model = fit.model
        visits = visits_at(model.machine, workspace_poses(model.machine, 40, 900), [PlannedLoad()])
        ones = np.array([1.0, 1.0, 1.0])
        at_fit = ToolCoordinates.of(visits, PLANE, visits.target_m, ones)

        def coordinates(unknowns, model=model, visits=visits, at_fit=at_fit):
            poses = model.predict(unknowns, visits)
            return at_fit.compare(poses, at_fit.visit_indices(), np.zeros(0), derivatives=False).residual.ravel()

        count = len(model)
        found, u = fit.unknowns[:count], np.sqrt(np.diag(fit.covariance)[:count])
        steps = 0.1 * np.diag(u)
        slope = np.stack([coordinates(found + step) - coordinates(found - step) for step in steps], axis=1) / (0.2 * u)
        stated = np.sqrt(np.einsum("ri,ij,rj->r", slope, fit.covariance[:count, :count], slope))
        errors.append((coordinates(found) - coordinates(truth)) / stated)
    together = np.concatenate(errors)
    assert 0.9 < np.mean(np.abs(together) < 2.0) < 0.999
    assert 0.5 < np.mean(together**2) < 1.6  # correlated: some forty independent numbers
