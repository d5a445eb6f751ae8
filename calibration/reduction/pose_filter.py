"""The pose of the platform at each visit: least squares over its reflectors, wrong readings left out.

Within a visit a reading is judged by the other reflectors alone, whatever model is identified: the figures before and
after a compensation must not depend on the model that they verify.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.outliers import GATE_SIGMAS, scale_of
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.reduction.report_frame import ReportFrame, apply_increment

START_SD_M = 1.0e-3
START_SD_RAD = 3.0e-3


@dataclass(frozen=True)
class FilteredPoses:
    """Measured platform poses in the report frame, one row a visit (v).

    coordinates (v, 6); covariance (v, f, f) over the free coordinates; accepted (r,): readings that the gate let pass;
    size_m and sigmas (r,): how far a refused one is off the others of its visit, in its own standard deviations too;
    measured (v,): False where fewer than two readings were left.
    """

    coordinates: Array
    covariance: Array
    accepted: NDArray[np.bool_]
    size_m: Array
    sigmas: Array
    measured: NDArray[np.bool_]


def filter_poses(report: ReportFrame, observations: ReflectorObservations) -> FilteredPoses:
    """Pose of each visit from its platform reflectors; the worst beyond the gate is left out first."""
    dof = report.machine.dof
    target = observations.visits.target_m
    predicted, jacobian = report.points(target), report.jacobian(target)[..., dof]
    start = 1.0 / np.where(dof < 3, START_SD_M, START_SD_RAD)
    n = len(observations.visits)
    out = FilteredPoses(
        coordinates=np.full((n, 6), np.nan),
        covariance=np.full((n, dof.size, dof.size), np.nan),
        accepted=np.ones(len(observations), dtype=bool),
        size_m=np.zeros(len(observations)),
        sigmas=np.zeros(len(observations)),
        measured=np.zeros(n, dtype=bool),
    )
    on_platform = np.flatnonzero(np.isin(observations.smr, report.smrs))
    visit = observations.visit[on_platform]
    smr = np.searchsorted(report.smrs, observations.smr[on_platform])
    error_m = observations.position_m[on_platform] - predicted[visit, smr]
    whiten = np.linalg.inv(np.linalg.cholesky(observations.covariance_m2[on_platform]))
    error, design = np.einsum("rij,rj->ri", whiten, error_m), whiten @ jacobian[visit, smr]
    order = np.argsort(visit, kind="stable")
    visits, first = np.unique(visit[order], return_index=True)
    groups = dict(zip(visits.tolist(), np.split(order, first[1:]), strict=True))
    everything = {v: _VisitFit.of(start, error[g], design[g], np.ones(g.size, dtype=bool)) for v, g in groups.items()}
    scale = scale_of(np.concatenate([fit.distance for fit in everything.values()]), 3) if everything else 1.0
    for v, g in groups.items():
        fit = everything[v]
        while np.max(fit.distance[fit.kept], initial=0.0) > GATE_SIGMAS * scale:
            fit = _VisitFit.of(start, error[g], design[g], fit.kept & (fit.distance < np.max(fit.distance[fit.kept])))
        rows, gone = on_platform[g], ~fit.kept
        out.accepted[rows], out.sigmas[rows] = fit.kept, fit.distance / scale
        out.size_m[rows[gone]] = np.linalg.norm(np.linalg.solve(whiten[g[gone]], fit.left[gone, :, None]), axis=1)[:, 0]
        out.measured[v] = np.count_nonzero(fit.kept) >= 2
        if out.measured[v]:
            out.coordinates[v] = apply_increment(target[v : v + 1], fit.x[None], dof)[0]
            out.covariance[v] = fit.covariance
    return out


@dataclass(frozen=True)
class _VisitFit:
    """The pose of one visit by the readings that are kept (k,): x (f,), residuals left (k, 3), and how far each reading
    is from what the others say (k,), in stated standard deviations (identification.gate)."""

    kept: NDArray[np.bool_]
    x: Array
    covariance: Array
    left: Array
    distance: Array

    @classmethod
    def of(cls, start: Array, error: Array, design: Array, kept: NDArray[np.bool_]) -> _VisitFit:
        """Whitened errors (k, 3) and design (k, 3, f); start (f,): inverse standard deviations of the increments."""
        flat = design[kept].reshape(-1, start.size)
        covariance = np.asarray(np.linalg.inv(np.diag(start**2) + flat.T @ flat), dtype=np.float64)
        x = covariance @ (flat.T @ error[kept].ravel())
        left = error - design @ x
        hat = design @ covariance @ design.transpose(0, 2, 1)
        spread = np.eye(3) + np.where(kept, -1.0, 1.0)[:, None, None] * hat
        square = np.einsum("ri,ri->r", left, np.linalg.solve(spread, left[:, :, None])[:, :, 0])
        return cls(kept, x, covariance, left, np.sqrt(np.maximum(square, 0.0)))
