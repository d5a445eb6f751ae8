"""Identification: parameters, reflectors, frame and instrument together, from measured positions.

Maximum a posteriori with the tolerances as priors is the default; least squares, Tikhonov (GCV) and truncated SVD
are there for comparison (docs/method.md). Unknowns are scaled by their prior standard
deviation, readings whitened by their covariance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibration.machine import Array
from calibration.observation_model import Frame, Layout, ModelOptions, Observations, Prediction, predict
from calibration.toml_file import InputError

Estimator = Literal["map", "least_squares", "tikhonov", "truncated_svd"]
LEAST_SQUARES_WEIGHT = 1e-2  # of the tolerances: only keeps null directions from drifting


@dataclass(frozen=True)
class Fit:
    """A fitted model. unknowns (u,) and covariance (u, u) in SI, as laid out by `layout`.

    The covariance is that of the posterior with the weight of the priors that was used (truncated SVD: 1).
    spectrum: singular values of the whitened, prior-scaled Jacobian; above 1 the data beat the prior.
    chi2_per_dof: weighted sum of squares per degree of freedom of the readings.
    """

    layout: Layout
    start: Frame
    options: ModelOptions
    unknowns: Array
    covariance: Array
    spectrum: Array
    chi2_per_dof: float
    residual_m: Array
    estimator: Estimator

    @property
    def theta(self) -> Array:
        """Machine parameters (p,), deviations from nominal."""
        return self.unknowns[: len(self.layout.parameters)]

    @property
    def theta_u(self) -> Array:
        """Standard uncertainties (p,) of the machine parameters."""
        return np.sqrt(np.diag(self.covariance)[: len(self.layout.parameters)])

    @property
    def frame(self) -> Frame:
        """The machine's frame as the station sees it."""
        return self.start.moved(self.unknowns[self.layout.frame : self.layout.frame + 6])

    @property
    def payload_error(self) -> float:
        """Relative error of the payload's stated mass."""
        return float(self.unknowns[self.layout.payload])

    def mounting_m(self, smr: int) -> Array:
        """Identified position (3,) of a reflector on its part."""
        column = self.layout.mounting + 3 * self.layout.smrs.index(smr)
        nominal = self.layout.parameters.machine.smrs[smr].position_m
        return nominal + self.unknowns[column : column + 3]


def identify(
    layout: Layout,
    start: Frame,
    seen: Observations,
    options: ModelOptions | None = None,
    estimator: Estimator = "map",
) -> Fit:
    """Fit all unknowns. Geometry is fitted before stiffness (its columns vanish at zero misfit).

    Raises InputError if there are fewer readings than unknowns of the frame and reflectors, or if a pose
    has no equilibrium.
    """
    if 3 * len(seen) < layout.size:
        raise InputError(
            f"identification: {len(seen)} readings cannot determine {layout.size} unknowns; measure more poses"
        )
    problem = _Problem(layout, start, options or ModelOptions(), seen)
    stiffness = layout.parameters.rows("ln_stiffness")
    z = np.zeros(layout.size)
    if stiffness.size:
        free = np.setdiff1d(np.arange(layout.size), stiffness)
        z = problem.minimise(z, free, 1.0)
    everything = np.arange(layout.size)
    match estimator:
        case "map":
            z = problem.minimise(z, everything, 1.0)
            weight = 1.0
        case "least_squares":
            z = problem.minimise(z, everything, LEAST_SQUARES_WEIGHT)
            weight = LEAST_SQUARES_WEIGHT
        case "tikhonov":
            weight = problem.gcv_weight(z)
            z = problem.minimise(z, everything, weight)
        case "truncated_svd":
            z = problem.truncated(z)
            weight = 1.0
    return problem.result(z, weight, estimator)


class _Problem:
    """Residuals and Jacobian of one identification in scaled unknowns z = unknowns / sigma."""

    def __init__(self, layout: Layout, start: Frame, options: ModelOptions, seen: Observations) -> None:
        self.layout, self.start, self.options, self.seen = layout, start, options, seen
        self.whiten = np.linalg.inv(np.linalg.cholesky(seen.covariance_m2))
        self._at: Array | None = None
        self._prediction: Prediction | None = None

    def _predict(self, z: Array) -> Prediction:
        if self._prediction is None or self._at is None or not np.array_equal(z, self._at):
            self._prediction = predict(self.layout, self.start, self.options, z * self.layout.sigma, self.seen)
            self._at = z.copy()
            if not np.all(np.isfinite(self._prediction.position_m)):
                raise InputError(
                    "identification: the model finds no equilibrium for a measured pose; "
                    "check that the machine file fits the machine"
                )
        return self._prediction

    def residual(self, z: Array) -> Array:
        """Whitened residuals (3 r,), prediction minus measurement."""
        error = self._predict(z).position_m - self.seen.position_m
        return np.einsum("rij,rj->ri", self.whiten, error).ravel()

    def jacobian(self, z: Array) -> Array:
        """Whitened Jacobian (3 r, u) in scaled unknowns."""
        scaled = self._predict(z).jacobian * self.layout.sigma
        return np.einsum("rij,rju->riu", self.whiten, scaled).reshape(-1, self.layout.size)

    def prior(self, weight: float) -> Array:
        """Weights (u,) of the priors: `weight` for the machine's tolerances.

        What is known of reflectors, frame, instrument and payload is not regularisation and keeps its weight.
        """
        weights = np.ones(self.layout.size)
        weights[: len(self.layout.parameters)] = weight
        return weights

    def minimise(self, z: Array, free: NDArray[np.intp], weight: float) -> Array:
        """Levenberg-Marquardt over the unknowns `free`; the tolerances have the given weight."""
        full, prior = z.copy(), self.prior(weight)[free]

        def place(part: Array) -> Array:
            full[free] = part
            return full

        def residual(part: Array) -> Array:
            return np.concatenate([self.residual(place(part)), prior * part])

        def jacobian(part: Array) -> Array:
            return np.vstack([self.jacobian(place(part))[:, free], np.diag(prior)])

        answer = least_squares(residual, z[free], jac=jacobian, method="lm", xtol=1e-10, ftol=1e-12, max_nfev=60)
        return place(answer.x).copy()

    def gcv_weight(self, z: Array) -> float:
        """Prior weight of least generalised cross-validation for the problem linearised at z."""
        jac = self.jacobian(z)
        right = jac @ z - self.residual(z)
        normal, moment = jac.T @ jac, jac.T @ right
        best, least = 1.0, np.inf
        for weight in np.logspace(-3.0, 3.0, 61):
            inverse = np.linalg.inv(normal + np.diag(self.prior(weight) ** 2))
            misfit = right - jac @ (inverse @ moment)
            score = float(misfit @ misfit) / (len(right) - float(np.trace(inverse @ normal))) ** 2
            if score < least:
                best, least = float(weight), score
        return best

    def truncated(self, z: Array) -> Array:
        """Gauss-Newton in the directions whose singular value exceeds 1 (data beat the prior)."""
        for _ in range(8):
            jac = self.jacobian(z)
            right = jac @ z - self.residual(z)
            u, s, vt = np.linalg.svd(jac, full_matrices=False)
            keep = s > 1.0
            new = vt[keep].T @ ((u.T @ right)[keep] / s[keep])
            if np.max(np.abs(new - z)) < 1e-9:
                return np.asarray(new)
            z = new
        return z

    def result(self, z: Array, weight: float, estimator: Estimator) -> Fit:
        jac = self.jacobian(z)
        residual = self.residual(z)
        information = jac.T @ jac + np.diag(self.prior(weight) ** 2)
        covariance = np.linalg.inv(information)
        spectrum = np.asarray(np.linalg.svd(jac, compute_uv=False), dtype=np.float64)
        effective = float(np.trace(covariance @ (jac.T @ jac)))
        dof = max(1.0, residual.size - effective)
        sigma = self.layout.sigma
        return Fit(
            self.layout,
            self.start,
            self.options,
            z * sigma,
            covariance * sigma[:, None] * sigma[None, :],
            spectrum,
            float(residual @ residual / dof),
            self._predict(z).position_m - self.seen.position_m,
            estimator,
        )
