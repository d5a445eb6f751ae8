"""The linearised least-squares problem of a fit, however many readings: a triangular factor, not the Jacobian.

Blocks of whitened rows are folded one after the other into the R of a QR factorisation (sequential tall-skinny QR), so
memory does not grow with the readings and no normal equations square the condition number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dtpqrt

from calibration.base.arrays import Array

ROWS_AT_ONCE = 1536  # of a block, so that it stays in the processor's cache
PANEL = 8  # columns that are eliminated together


@dataclass(frozen=True)
class TriangularSystem:
    """|J d + r|^2 = |R d + c|^2 + rest: factor R (u, u), right side c (u,), rest, number of rows m."""

    factor: Array
    right_side: Array
    residual_squares: float
    n_rows: int

    @property
    def cost(self) -> float:
        """Sum of squares at d = 0."""
        return float(self.right_side @ self.right_side) + self.residual_squares

    def gradient(self) -> Array:
        """J^T r (u,)."""
        return np.asarray(self.factor.T @ self.right_side)

    def information(self) -> Array:
        """J^T J (u, u)."""
        return np.asarray(self.factor.T @ self.factor)

    def spectrum(self) -> Array:
        """Singular values (u,) of J, largest first."""
        return np.asarray(np.linalg.svd(self.factor, compute_uv=False))


class QrAccumulator:
    """Folds blocks of rows into a `TriangularSystem`."""

    def __init__(self, unknowns: int) -> None:
        self._r = np.zeros((unknowns + 1, unknowns + 1), order="F")
        self._unknowns, self._rows = unknowns, 0

    def add(self, jacobian: Array, residual: Array) -> None:
        """Add rows (m, u) and residuals (m,)."""
        self._rows += len(residual)
        for first in range(0, len(residual), ROWS_AT_ONCE):
            rows = slice(first, first + ROWS_AT_ONCE)
            block = np.empty((len(residual[rows]), self._unknowns + 1), order="F")
            block[:, :-1] = jacobian[rows]
            block[:, -1] = residual[rows]
            # A QR factorisation of the triangle over the block that leaves the triangle's zeros alone.
            self._r = dtpqrt(0, min(PANEL, self._unknowns + 1), self._r, block, overwrite_a=1, overwrite_b=1)[0]

    def result(self, scale: Array | None = None) -> TriangularSystem:
        """The factor of all rows so far, their columns multiplied by scale (u,)."""
        u = self._unknowns
        r = np.triu(self._r)
        if scale is not None:
            r[:, :u] *= scale
        return TriangularSystem(r[:u, :u], r[:u, u].copy(), float(r[u, u] ** 2), self._rows)


def regularised_step(system: TriangularSystem, offset: Array, weight: Array) -> Array:
    """d (u,) that minimises |R d + c|^2 + |w (offset + d)|^2."""
    stacked = np.vstack([system.factor, np.diag(weight)])
    q, r = np.linalg.qr(stacked)
    right = np.concatenate([system.right_side, weight * offset])
    return np.asarray(-solve_triangular(r, q.T @ right))


def posterior_covariance(system: TriangularSystem, weight: Array) -> Array:
    """(J^T J + diag(w^2))^-1 (u, u), from a triangular factor; the weights must determine what the rows do not."""
    r = np.linalg.qr(np.vstack([system.factor, np.diag(weight)]), mode="r")
    inverse = solve_triangular(r, np.eye(len(r)))
    return np.asarray(inverse @ inverse.T)


def estimator_covariance(system: TriangularSystem, weight: Array) -> Array:
    """Covariance (u, u) of the error of |J d + r|^2 + |w d|^2 at its minimum, the truth drawn from unit priors.

    With P = (J^T J + W^2)^-1: P W^4 P from what the weights pull aside, P J^T J P from the readings' noise. With unit
    weights it is the posterior covariance P.
    """
    posterior = posterior_covariance(system, weight)
    if np.all(weight == 1.0):
        return posterior
    pulled = posterior * weight**2
    noisy = posterior @ system.factor.T
    return np.asarray(pulled @ pulled.T + noisy @ noisy.T)


def truncated_covariance(system: TriangularSystem) -> Array:
    """The same of truncated singular values: prior where a direction is left out, noise where it is kept."""
    _, s, vt = np.linalg.svd(system.factor)
    return np.asarray((vt.T * np.where(s > 1.0, 1.0 / np.maximum(s, 1.0) ** 2, 1.0)) @ vt)
