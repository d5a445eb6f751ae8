"""A former calibration as the prior: what two sets of readings say one after the other is what they say together."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.identification.estimators import identify
from calibration.identification.from_prior import Prior, identify_from_prior
from calibration.identification.pose_selection import PlannedLoad, visits_at, workspace_poses
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.description import load_machine, shipped_machine
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet

KINDS = ("strut_length", "base_joint")


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
