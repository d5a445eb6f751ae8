"""What a machine that does not repeat adds to the uncertainty of what is identified of it.

Drives stand off anew at each visit, whatever they report. All readings of a visit are off together by it, so that
further ones of it do not average it out: whitened readings have the covariance v + s^2 E E', with E their responses to
each drive at each visit and v their variance over the stated one. With the residuals r of n numbers and the fit's hat
matrix H both follow from

    r' r     = v (n - tr H)       + s^2 tr E' (1 - H) E
    |E' r|^2 = v tr E' (1 - H) E  + s^2 |E' (1 - H) E|^2

in expectation (minimum norm quadratic unbiased estimation about s = 0: C. R. Rao, J. Multivariate Anal. 1 (1971) 257).
The estimate stays as it is; what the drives do passes through it as the noise of the readings does (GUM, 5.1.2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from calibration.base.arrays import Array
from calibration.identification.fit import Fit, Positioning
from calibration.identification.problem import VISITS_AT_ONCE, LeastSquaresProblem
from calibration.instruments.readings import Readings, split_by_visits

STEP_M = 1e-6  # of a drive at its joint, for differences
LEAST_SIGMAS = 3.0  # above zero, in standard deviations of what noise alone makes of s^2


@dataclass(frozen=True)
class DriveResponses:
    """Changes (r, w, e, d) of one instrument's whitened readings for one metre of each drive, of a crank at its joint,
    at each of the visits (r, e) that a reading needs."""

    by_drive: Array
    visit: NDArray[np.intp]

    def shift(self, off_m: Array) -> Array:
        """Whitened changes (r, w) where drives stand off by off_m (v, d)."""
        return np.asarray(np.einsum("rwed,red->rw", self.by_drive, off_m[self.visit]))

    def rows(self, some: NDArray[np.intp], visits: int) -> csr_array:
        """Of some readings (k,): (k w, v d)."""
        by_drive = self.by_drive[some]
        count, width, _, drives = by_drive.shape
        of_number = np.arange(count * width).reshape(count, width, 1, 1)
        of_drive = (self.visit[some][:, :, None] * drives + np.arange(drives))[:, None]
        row, column = (np.broadcast_to(index, by_drive.shape).ravel() for index in (of_number, of_drive))
        return csr_array((by_drive.ravel(), (row, column)), shape=(count * width, visits * drives))


def with_positioning(fit: Fit) -> Fit:
    """The fit, its covariance with what drives that stand off anew at each visit add to it, if that is more than noise.

    For the default estimator by squares; others keep their covariance.
    """
    if fit.estimator != "map":
        return fit
    sums, freedom = _Sums.of(fit), fit.degrees_of_freedom
    determinant = freedom * sums.norm - sums.trace**2
    if not determinant > 0.0:  # one reading a visit: what drives do is scatter
        return fit
    variance_m2 = (freedom * sums.of_drives - sums.trace * sums.of_readings) / determinant
    of_noise_m2 = sums.of_readings / freedom * np.sqrt(2.0 * freedom / determinant)
    if not variance_m2 > LEAST_SIGMAS * of_noise_m2:
        return fit
    passed = fit.covariance_as_stated @ sums.by_unknowns.T
    scatter = float(np.sqrt(max(sums.of_readings - variance_m2 * sums.trace, 0.0) / freedom))
    return replace(fit, positioning=Positioning(float(np.sqrt(variance_m2)), variance_m2 * passed @ passed.T, scatter))


@dataclass(frozen=True)
class _Sums:
    """Of the formulas above: r' r, |E' r|^2, tr E' (1 - H) E and |E' (1 - H) E|^2; by_unknowns (v d, u): E' J, with the
    derivatives J of the readings."""

    of_readings: float
    of_drives: float
    trace: float
    norm: float
    by_unknowns: Array

    @classmethod
    def of(cls, fit: Fit) -> _Sums:
        visits, unknowns = len(fit.visits), fit.layout.size
        numbers = visits * len(fit.machine.drive_names)
        gram, by_unknowns = csr_array((numbers, numbers)), np.zeros((numbers, unknowns))
        of_residual, square = np.zeros(numbers), 0.0
        responses = drive_responses(fit)
        problem = LeastSquaresProblem(fit.model, fit.visits, fit.instruments)
        for block in problem.derivatives(fit.unknowns / fit.layout.sigma):
            rows = responses[block.instrument].rows(block.rows, visits)
            gram = gram + rows.T @ rows
            by_unknowns += rows.T @ block.jacobian.reshape(-1, unknowns)
            of_residual += rows.T @ block.residual.ravel()
            square += float(np.sum(block.residual**2))
        absorbing = by_unknowns @ fit.covariance_as_stated  # E' H E is this times by_unknowns'
        absorbed = by_unknowns.T @ absorbing
        trace = float(gram.trace()) - float(np.trace(absorbed))
        crossed = float(np.sum((gram @ by_unknowns) * absorbing))
        norm = float(gram.power(2).sum()) - 2.0 * crossed + float(np.sum(absorbed * absorbed.T))
        return cls(square, float(of_residual @ of_residual), trace, norm, by_unknowns)


def drive_responses(fit: Fit) -> list[DriveResponses]:
    """Of each instrument's readings."""
    return [
        _responses(fit, readings, fit.unknowns[columns])
        for readings, columns in zip(fit.instruments, fit.layout.instrument_slices, strict=True)
    ]


def _responses(fit: Fit, readings: Readings, own: Array) -> DriveResponses:
    visit, steps = readings.visit_indices(), STEP_M / fit.machine.arms_m
    out = np.empty((len(readings), readings.width, visit.shape[1], len(steps)))
    for rows, some, needed, local in split_by_visits(readings, VISITS_AT_ONCE):
        visits = fit.visits.take(needed)
        start = fit.predict(visits).equilibrium.coordinates()
        for drive, step in enumerate(np.diag(steps)):
            moved = replace(visits, drives=visits.drives + step)
            both = visits.concatenate(moved)
            poses = fit.model.predict(fit.unknowns[: len(fit.model)], both, np.concatenate([start, start]))
            as_it_is = some.compare(poses, local, own, derivatives=False).residual
            for end in range(visit.shape[1]):
                of_end = local + len(visits) * (np.arange(visit.shape[1]) == end)
                change = some.compare(poses, of_end, own, derivatives=False).residual - as_it_is
                out[rows, :, end, drive] = change / STEP_M
    return DriveResponses(out, visit)
