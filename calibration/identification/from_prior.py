"""Identification from a former calibration: its values and its covariance, grown, are the prior of a few readings.

With correlated priors x ~ N(m, P) the minimum of |r(x)|^2 + (x - m)' P^-1 (x - m) is found by Gauss-Newton; its
covariance is (J'J + P^-1)^-1 (Gelman et al., Bayesian Data Analysis, 14.8). Unknowns that the former calibration does
not have (where the station stands now, its ranges) keep their own priors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.fit import Fit
from calibration.identification.gauss_newton import NEAR, accelerated_step, left_to_go
from calibration.identification.problem import LeastSquaresProblem
from calibration.instruments.readings import Readings
from calibration.model.model import Model
from calibration.model.visits import Visits

MOST_STEPS = 60
LARGEST_SHARE = 2.0  # steps that shrink by a third: what has changed little begins near its minimum
SETTLED = 1e-6  # of a step, in standard errors


@dataclass(frozen=True)
class Prior:
    """Names (k,), values (k,) and covariance (k, k), in SI units, of what a former calibration knows."""

    names: tuple[str, ...]
    values: Array
    covariance: Array


def identify_from_prior(model: Model, visits: Visits, readings: Sequence[Readings], prior: Prior) -> Fit:
    """Fit all unknowns to readings of visits, those of the prior around it.

    InputError if a reading is not finite, a pose has no equilibrium, or the prior has a name that the fit lacks.
    """
    problem = LeastSquaresProblem(model, visits, tuple(readings))
    sigma = problem.layout.sigma
    mean, precision = _scaled(prior, problem.layout.names, sigma)
    z, sizes = mean.copy(), [np.inf]
    previous: tuple[Array, Array] | None = None
    for _ in range(MOST_STEPS):
        system = problem.linearise(z)
        total = system.information() + precision
        step = np.asarray(-np.linalg.solve(total, system.gradient() + precision @ (z - mean)), dtype=np.float64)
        sizes.append(float(np.sqrt(step @ total @ step)))
        if sizes[-1] < SETTLED:
            break
        root = np.asarray(np.linalg.cholesky(total).T, dtype=np.float64)
        further = accelerated_step(root, previous, z, step, LARGEST_SHARE)
        previous, z = (z, step), z + further
    system = problem.linearise(z)
    scaled = np.linalg.inv(system.information() + precision)
    scaled = 0.5 * (scaled + scaled.T)
    residuals = problem.residuals(z)
    freedom = max(1.0, system.n_rows - float(np.sum(scaled * system.information())))
    return Fit(
        model=model,
        layout=problem.layout,
        visits=visits,
        instruments=tuple(problem.readings),
        unknowns=z * sigma,
        covariance_as_stated=scaled * sigma[:, None] * sigma[None, :],
        system=system,
        weight=1.0,
        chi2_per_dof=sum(float(np.sum(r**2)) for r in residuals) / freedom,
        residuals=tuple(residuals),
        estimator="map",
        converged=sizes[-1] < SETTLED or left_to_go(sizes) < NEAR,
    )


def _scaled(prior: Prior, names: Sequence[str], sigma: Array) -> tuple[Array, Array]:
    """Mean (u,) and inverse covariance (u, u) of all unknowns, divided by their own priors' standard deviations."""
    missing = [name for name in prior.names if name not in names]
    if missing:
        raise InputError(f"identification: the former calibration has '{missing[0]}', which these readings lack")
    rows = [names.index(name) for name in prior.names]
    mean, precision = np.zeros(len(names)), np.eye(len(names))
    mean[rows] = prior.values / sigma[rows]
    own = prior.covariance / np.outer(sigma[rows], sigma[rows])
    precision[np.ix_(rows, rows)] = np.linalg.inv(0.5 * (own + own.T))
    return mean, precision
