"""Covariance of all unknowns together, with what the model's curvature adds.

Of an over-constrained machine stiffness and misfit are each known poorly, but their product well: the readings leave
a curved valley, and a covariance at its bottom describes its tangent. Along the valley well-decided combinations of
lengths and joints move by many of their linear standard uncertainties. For single unknowns and for predicted poses the
linear covariance serves: there the valley's direction dominates, or the product counts.

A draw d from the linear covariance is brought back into the valley by c = -C J' q, with q the part of the readings'
change that is not linear in d (one Gauss-Newton step of randomised maximum likelihood: Bardsley et al., SIAM J. Sci.
Comput. 36 (2014) A1895). d is odd and q even to second order, so that the covariance of d + c is C + E[c c'].
"""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.fit import Fit
from calibration.identification.gate import LinearReadings
from calibration.identification.problem import LeastSquaresProblem

DRAWS = 200  # a variance from so many is good to a tenth
SEED = 1
ROUND_OFF = 1e-14  # of scaled variances


def joint_covariance(fit: Fit, draws: int = DRAWS) -> Array:
    """Covariance (u, u) of the error of all unknowns, in SI units and the order of the fit's layout.

    For the default estimator; others, whose error is their regularisation's, keep their own.
    """
    if fit.estimator != "map":
        return fit.covariance
    problem = LeastSquaresProblem(fit.model, fit.visits, fit.instruments)
    sigma = fit.layout.sigma
    z, scale = fit.unknowns / sigma, np.outer(sigma, sigma)
    covariance, as_stated = fit.covariance / scale, fit.covariance_as_stated / scale
    root = np.linalg.cholesky(covariance + ROUND_OFF * np.eye(len(z)))
    linear = LinearReadings.of(problem, z, ())
    jacobian = np.concatenate([part.reshape(-1, len(z)) for part in linear.jacobian])
    at_solution = np.concatenate([part.ravel() for part in linear.residual])
    rng, added, count = np.random.default_rng(SEED), np.zeros_like(covariance), 0
    for _ in range(draws):
        change = root @ rng.standard_normal(len(z))
        try:
            residual = np.concatenate([part.ravel() for part in problem.residuals(z + change)])
        except InputError:  # no equilibrium: such a machine cannot have given these readings
            continue
        back = as_stated @ (jacobian.T @ (residual - at_solution - jacobian @ change))
        added += np.outer(back, back)
        count += 1
    return np.asarray(fit.covariance + added / max(count, 1) * scale)
