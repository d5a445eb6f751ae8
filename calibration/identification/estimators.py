"""Identification: parameters, instruments and systematic unknowns together, from readings of visits.

Maximum a posteriori with the tolerances as priors is the default; least squares, Tikhonov (generalised
cross-validation or L-curve) and truncated SVD are there for comparison (docs/explanation/method.md). Geometry is
fitted before stiffness: its columns vanish at zero misfit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.fit import Estimator, Fit
from calibration.identification.linear_system import (
    TriangularSystem,
    estimator_covariance,
    posterior_covariance,
    truncated_covariance,
)
from calibration.identification.problem import LeastSquaresProblem
from calibration.instruments.readings import Readings
from calibration.model.model import Model
from calibration.model.visits import Visits

LEAST_SQUARES_WEIGHT = 1e-2  # of the tolerances: only keeps null directions from drifting
WEIGHTS = np.logspace(-3.0, 3.0, 61)
SVD_STEPS = 20
VISITS_TO_START = 128  # the slow part of a fit, away from the minimum, needs no more


def identify(
    model: Model,
    visits: Visits,
    readings: Sequence[Readings],
    estimator: Estimator = "map",
    *,
    robust: bool = False,
) -> Fit:
    """Fit all unknowns to readings of visits; robust: Huber's loss, for outliers.

    Raises InputError if readings are not finite, if there are fewer numbers than unknowns that only readings can
    determine, or if a pose has no equilibrium.
    """
    problem = LeastSquaresProblem(model, visits, tuple(readings), robust)
    _require_solvable(problem)
    everything = np.arange(problem.layout.size)
    stiffness = model.parameters.rows("ln_stiffness")
    z = np.zeros(problem.layout.size)
    if stiffness.size:
        few = problem.subsample(VISITS_TO_START)
        z = few.minimise(z, np.setdiff1d(everything, stiffness), 1.0)
        if few is not problem:
            z = few.minimise(z, everything, 1.0, start_only=True)
    weight, converged = 1.0, True
    if estimator == "truncated_svd":
        z, converged = _fit_truncated_svd(problem, z)
    else:
        if estimator == "least_squares":
            weight = LEAST_SQUARES_WEIGHT
        elif estimator in ("tikhonov", "l_curve"):
            choose = gcv_weight if estimator == "tikhonov" else l_curve_weight
            weight = choose(problem.linearise(z), z, len(model.parameters))
        z = problem.minimise(z, everything, weight)
        converged = problem.converged
    return _fit(problem, z, weight, estimator, converged)


def _require_solvable(problem: LeastSquaresProblem) -> None:
    visits = problem.visits
    numbers = (visits.drives, visits.target_m, visits.payload_kg, visits.payload_com_m, *visits.temperatures_c.values())
    if not all(np.all(np.isfinite(a)) for a in numbers):
        raise InputError(
            "identification: a drive coordinate, target or payload is not a finite number; repair the data"
        )
    loose = sum(1 for u in problem.layout.unknowns if u.name.startswith(("frame.", "mounting.")))
    if problem.n_numbers < loose + len(problem.machine.dof):
        raise InputError(
            f"identification: {problem.n_numbers} numbers cannot determine the instrument ({loose} unknowns) and the "
            "machine; measure more poses"
        )


def _fit(problem: LeastSquaresProblem, z: Array, weight: float, estimator: Estimator, converged: bool) -> Fit:
    system = problem.linearise(z)
    if estimator == "truncated_svd":
        scaled = truncated_covariance(system)
    else:
        scaled = estimator_covariance(system, problem.prior(weight))
    residuals = problem.residuals(z)
    sigma = problem.layout.sigma
    dof = max(1.0, system.n_rows - float(np.sum(scaled * system.information())))
    return Fit(
        model=problem.model,
        layout=problem.layout,
        visits=problem.visits,
        instruments=tuple(problem.readings),
        unknowns=z * sigma,
        covariance_as_stated=scaled * sigma[:, None] * sigma[None, :],
        system=system,
        weight=weight,
        chi2_per_dof=sum(float(np.sum(r**2)) for r in residuals) / dof,
        residuals=tuple(residuals),
        estimator=estimator,
        converged=converged,
    )


def _regularisation_path(
    system: TriangularSystem, z: Array, parameters: int
) -> list[tuple[float, float, float, float]]:
    """For every weight: the weight, squared misfit, squared size of the parameters, effective number of unknowns."""
    out = []
    right = system.factor @ z - system.right_side
    information = system.information()
    for weight in WEIGHTS:
        prior = np.ones(z.size)
        prior[:parameters] = weight
        covariance = posterior_covariance(system, prior)
        x = covariance @ (system.factor.T @ right)
        misfit = float(np.sum((system.factor @ x - right) ** 2)) + system.residual_squares
        size = float(np.sum(x[:parameters] ** 2))
        out.append((float(weight), misfit, size, float(np.sum(covariance * information))))
    return out


def gcv_weight(system: TriangularSystem, z: Array, parameters: int) -> float:
    """Prior weight of least generalised cross-validation (Golub, Heath, Wahba 1979) of the linear problem at z."""
    scores = [
        (misfit / (system.n_rows - used) ** 2, weight)
        for weight, misfit, _, used in _regularisation_path(system, z, parameters)
    ]
    return min(scores)[1]


def l_curve_weight(system: TriangularSystem, z: Array, parameters: int) -> float:
    """Prior weight at the corner of the L-curve: largest curvature of log misfit against log size (Hansen 1992)."""
    curve = np.log([(misfit, size) for _, misfit, size, _ in _regularisation_path(system, z, parameters)])
    first, second = np.gradient(curve, axis=0), np.gradient(np.gradient(curve, axis=0), axis=0)
    bend = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    curvature = bend / np.maximum(np.sum(first**2, axis=1), 1e-12) ** 1.5
    return float(WEIGHTS[2:-2][np.argmax(curvature[2:-2])])


def _fit_truncated_svd(problem: LeastSquaresProblem, z: Array) -> tuple[Array, bool]:
    """Gauss-Newton in the directions whose singular value exceeds 1 (data beat the prior); whether it settled."""
    for _ in range(SVD_STEPS):
        system = problem.linearise(z)
        u, s, vt = np.linalg.svd(system.factor)
        keep = s > 1.0
        projected = u.T @ (system.factor @ z - system.right_side)
        new = vt[keep].T @ (projected[keep] / s[keep])
        if np.max(np.abs(new - z)) < 1e-7:
            return np.asarray(new), True
        z = new
    return z, False
