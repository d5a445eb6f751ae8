"""What a check says: how much each watched change has grown, and the error of the tool point, from its readings.

Readings are linear in the parameters' changes and in what the station adds, which is taken out first:
w = D d + F n + e with white noise e. After projection onto what F cannot explain, the change of a watched combination
alone, with the column a = D k, is a' w / a' a with the standard uncertainty (a' a)^-1/2 (GUM, least squares).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import ndtr

from calibration.base.arrays import Array, RowSelection
from calibration.base.errors import InputError
from calibration.intervals.facts import ErrorFigure
from calibration.intervals.watched import WatchedChanges

SEED, EXPECTED_CHECKS = 14, 101
_DRAWS = 200_000
_AT_LIMIT = 3.2  # about where limits of charts lie


@dataclass(frozen=True)
class CheckDesign:
    """What readings (m numbers, divided by their standard deviation) do with changes.

    by_parameter (m, p): per unit of each machine parameter; nuisance (m, k): per unit of what the station adds, its
    prior standard deviation nuisance_u (k,), inf if nothing is known; workspace (g, p): shift of the tool point's
    coordinates over the workspace, points: how many points these are; prior (p, p): covariance of the
    parameters' changes since the calibration; reference (p, p): covariance of the calibration itself.
    """

    by_parameter: Array
    nuisance: Array
    nuisance_u: Array
    workspace: Array
    points: int
    watched: WatchedChanges
    prior: Array
    reference: Array

    def rows(self, keep: RowSelection) -> CheckDesign:
        """The design of some of the readings."""
        return CheckDesign(
            self.by_parameter[keep],
            self.nuisance[keep],
            self.nuisance_u,
            self.workspace,
            self.points,
            self.watched,
            self.prior,
            self.reference,
        )

    @cached_property
    def _basis(self) -> Array:
        """Orthonormal columns (m + k, k) of the nuisances, with their priors as further readings."""
        known = np.where(np.isfinite(self.nuisance_u), 1.0 / self.nuisance_u, 0.0)
        q, r = np.linalg.qr(np.concatenate([self.nuisance, np.diag(known)]))
        size = np.abs(np.diag(r))
        if np.any(size < 1e-12 * size.max(initial=0.0)):
            raise InputError("check: its readings do not tie the station to the machine: measure both nests")
        return np.asarray(q)

    def free_of_station(self, values: Array) -> Array:
        """Readings or columns (m, ...) without what the station may have added, (m + k, ...)."""
        more = np.concatenate([values, np.zeros((len(self.nuisance_u), *values.shape[1:]))])
        return np.asarray(more - self._basis @ (self._basis.T @ more))

    @cached_property
    def free(self) -> Array:
        """Columns (m + k, p) of the parameters, station removed."""
        return self.free_of_station(self.by_parameter)

    @cached_property
    def columns(self) -> Array:
        """Columns (m + k, w) of the watched changes, station removed."""
        return np.asarray(self.free @ self.watched.combination)

    @cached_property
    def change_u(self) -> Array:
        """Standard uncertainty (w,) of each change, the calibration taken as exact."""
        information = np.sum(self.columns**2, axis=0)
        blind = information <= 0.0
        if np.any(blind):
            names = [n for n, b in zip(self.watched.names, blind, strict=True) if b]
            raise InputError(f"check: its poses do not show {', '.join(names)}: choose other ones")
        return np.asarray(1.0 / np.sqrt(information))

    @cached_property
    def reference_u(self) -> Array:
        """Standard uncertainty (w,) of each change that comes from the calibration."""
        return self.reference_u_of(self.reference)

    def reference_u_of(self, reference: Array) -> Array:
        """The same for another calibration's covariance (p, p)."""
        by_reference = (self.columns.T @ self.free) * (self.change_u**2)[:, None]
        variance = np.einsum("wp,pq,wq->w", by_reference, reference, by_reference)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    @cached_property
    def error_per_change(self) -> Array:
        """RMS position error (w,) over the workspace for a unit of each change."""
        square = np.sum((self.workspace @ self.watched.combination) ** 2, axis=0)
        return np.asarray(np.sqrt(square / self.points))

    def alignment(self, known_m: Array) -> Array:
        """Correlation (w,) over the workspace of a known error (g,) with what each change does; zero without either."""
        field = self.workspace @ self.watched.combination
        size = np.linalg.norm(field, axis=0) * np.linalg.norm(known_m)
        return np.asarray(np.where(size > 0.0, known_m @ field / np.where(size > 0.0, size, 1.0), 0.0))

    @cached_property
    def correlation(self) -> Array:
        """Correlation (w, w) of the changes' estimates."""
        unit = self.columns * self.change_u
        return np.asarray(unit.T @ unit)

    @cached_property
    def independent(self) -> float:
        """Number of independent changes that exceed a limit of 3.2 as often as the watched ones together."""
        values, vectors = np.linalg.eigh(self.correlation)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        rng = np.random.default_rng(SEED)
        beyond = 0
        for _ in range(20):
            white = rng.standard_normal((_DRAWS // 20, len(values)))
            beyond += int(np.count_nonzero(np.abs(white @ root.T).max(axis=1) > _AT_LIMIT))
        single = 2.0 * float(ndtr(-_AT_LIMIT))
        number = np.log1p(-beyond / _DRAWS) / np.log1p(-single)
        return float(np.clip(number, 1.0, len(values)))

    @cached_property
    def _posterior(self) -> tuple[Array, Array]:
        """Gain (p, m + k) of the most probable joint change, and its covariance (p, p)."""
        # P D' (D P D' + 1)^-1 needs no inverse of the prior, which may be singular.
        spread = self.prior @ self.free.T
        gain = np.linalg.solve(self.free @ spread + np.eye(len(self.free)), spread.T).T
        covariance = self.prior - gain @ self.free @ self.prior
        return np.asarray(gain), np.asarray(0.5 * (covariance + covariance.T))

    @cached_property
    def _error_terms(self) -> tuple[Array, float, Array]:
        gain, covariance = self._posterior
        at_tool = self.workspace @ gain
        noise = float(np.sum(at_tool**2))
        return at_tool, noise, np.asarray(self.workspace @ covariance @ self.workspace.T)


@dataclass(frozen=True)
class CheckEstimate:
    """Change (w,) of each watched combination, if it alone has changed, its standard uncertainty, and the error."""

    change: Array
    change_u: Array
    error: ErrorFigure

    @property
    def standardised(self) -> Array:
        """Changes divided by their standard uncertainty (w,)."""
        return self.change / self.change_u


def estimate_check(design: CheckDesign, residual: Array, known_m: Array | None = None) -> CheckEstimate:
    """What a check's residuals (m,) say: measured minus predicted, divided by their standard deviation.

    known_m (g,): error of the tool's coordinates over the workspace that is known without measuring, since the tables
    were made for another temperature. The error is that of the most probable joint change and the known one together,
    its noise taken out: |known + J d|^2 less what noise adds. Raises InputError for residuals that are not finite.
    """
    free = design.free_of_station(_finite_residual(design, residual))
    change = (design.columns.T @ free) * design.change_u**2
    at_tool, noise, covariance = design._error_terms
    shift = at_tool @ free if known_m is None else at_tool @ free + known_m
    square = max(float(shift @ shift) - noise, 0.0) / design.points
    variance = 4.0 * float(shift @ covariance @ shift) + 2.0 * float(np.sum(covariance**2))
    smallest = (2.0 * float(np.sum(covariance**2))) ** 0.25
    u = np.sqrt(variance) / (2.0 * max(np.sqrt(square * design.points), smallest)) / np.sqrt(design.points)
    return CheckEstimate(change, design.change_u, ErrorFigure(float(np.sqrt(square)), float(u)))


def expected_error_u_m(design: CheckDesign) -> float:
    """Standard uncertainty of the error that such a check will state of a machine that has not changed.

    The median over checks with the design's noise: the figure of one check depends on its noise.
    """
    noise = np.random.default_rng(SEED).standard_normal((EXPECTED_CHECKS, len(design.by_parameter)))
    return float(np.median([estimate_check(design, row).error.u_m for row in noise]))


def joint_change(design: CheckDesign, residual: Array) -> tuple[Array, Array]:
    """Most probable change of all parameters (p,) and its covariance (p, p), the design's prior taken in.

    With the former calibration's grown covariance as the prior this is a partial calibration; with the
    tolerances' a full one.
    """
    gain, covariance = design._posterior
    return gain @ design.free_of_station(_finite_residual(design, residual)), covariance


def _finite_residual(design: CheckDesign, residual: Array) -> Array:
    if residual.shape != (len(design.by_parameter),) or not np.all(np.isfinite(residual)):
        raise InputError(f"check: needs {len(design.by_parameter)} finite residuals")
    return residual
