"""The posterior bound of an identification, and errors as figures.

The bound is the posterior covariance of the linearised model (docs/reference/definitions.md), linearised at the truth
and propagated to held-out poses by plain normal equations, not by the code of the fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.identification.problem import Layout
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.model.model import Model
from calibration.model.visits import Visits


@dataclass(frozen=True)
class Bound:
    """A covariance of a model's unknowns at some values, to be propagated to poses.

    drawn (u,): the error of the linear estimate for these very draws of errors and noise. Its covariance is the
    bound, exactly: where an estimator's error differs from it, that is the estimator; where it differs from the
    bound, that is the luck of the draw.
    """

    model: Model
    values: Array
    covariance: Array
    error: Array

    @classmethod
    def of(cls, model: Model, values: Array, visits: Visits, readings: ToolCoordinates) -> Bound:
        """Inverse of the information of readings plus priors at the true values."""
        sigma = Layout.of(model, [readings]).sigma
        compared = readings.compare(model.predict(values, visits), readings.visit_indices(), np.zeros(0))
        jacobian = (compared.by_model * sigma).reshape(-1, sigma.size)
        scaled = np.linalg.inv(jacobian.T @ jacobian + np.eye(sigma.size))
        error = scaled @ (-jacobian.T @ compared.residual.ravel() - values / sigma)
        return cls(model, values, scaled * np.outer(sigma, sigma), error * sigma)

    def spread(self, visits: Visits) -> Array:
        """Covariance (v, 6, 6) of tool point (m) and rotation (rad)."""
        jacobian = self._jacobian(visits)
        return np.asarray(jacobian @ self.covariance @ jacobian.transpose(0, 2, 1))

    def linear_error(self, visits: Visits) -> Array:
        """Errors (v, 6) of the linear estimate, for the errors and the noise that were drawn."""
        return np.asarray(self._jacobian(visits) @ self.error)

    def _jacobian(self, visits: Visits) -> Array:
        poses = self.model.predict(self.values, visits)
        by_point = poses.platform_point_derivatives(self.model.machine.tool_point_m)
        return np.concatenate([by_point, poses.jacobian[:, 3:]], axis=1)


def rms(error: Array) -> list[float]:
    """Root mean square of the tool point's distance, um, and of the angle, urad, of errors (n, 6)."""
    square = np.mean(error**2, axis=0)
    return [float(np.sqrt(np.sum(square[:3])) * 1e6), float(np.sqrt(np.sum(square[3:])) * 1e6)]


def rms_of_spread(spread: Array) -> list[float]:
    """The same of errors with covariances (n, 6, 6)."""
    variance = np.mean(np.diagonal(spread, axis1=1, axis2=2), axis=0)
    return [float(np.sqrt(np.sum(variance[:3])) * 1e6), float(np.sqrt(np.sum(variance[3:])) * 1e6)]
