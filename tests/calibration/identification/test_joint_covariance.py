"""The covariance of all unknowns together, against true parameters that were drawn from the priors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.joint_covariance import error_in_directions, fitted
from calibration.identification.joint_covariance import joint_covariance

RIGS = 6
DECIDED = 1e-2  # posterior over prior variance of directions that the readings decide


@pytest.mark.parametrize(("name", "overconfident"), [("planar4", 5.0), ("gough8", 2.0)])
def test_well_decided_combinations_hold_the_truth(name, overconfident):
    """Of over-constrained machines, where the covariance at the minimum alone is far too small."""
    fits = [fitted(name, seed) for seed in range(RIGS)]
    linear = np.concatenate([error_in_directions(fit, truth, fit.covariance, DECIDED) for fit, truth in fits])
    joint = np.concatenate([error_in_directions(fit, truth, joint_covariance(fit), DECIDED) for fit, truth in fits])
    assert np.mean(linear**2) > overconfident
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], len(joint)) / len(joint)
    assert low < np.mean(joint**2) < high


def test_a_machine_that_is_not_overconstrained_keeps_its_covariance():
    fit, _ = fitted("stewart6", 1)
    joint = joint_covariance(fit)
    ratio = np.linalg.eigvals(np.linalg.solve(fit.covariance, joint)).real
    assert np.max(ratio) < 1.5
    assert np.median(ratio) < 1.01


def test_single_unknowns_hardly_change():
    fit, _ = fitted("gough8", 2)
    u, linear_u = (np.sqrt(np.diag(c)) for c in (joint_covariance(fit), fit.covariance))
    assert np.all(u >= linear_u)
    assert np.median(u / linear_u) < 1.01


def test_other_estimators_keep_the_error_of_their_regularisation():
    fit, _ = fitted("planar4", 1, "truncated_svd")
    assert joint_covariance(fit) is fit.covariance
