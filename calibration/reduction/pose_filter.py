"""The pose of the platform at each visit: a Kalman filter over its reflectors that gates outliers."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.reduction.innovation import innovation_gate, nis
from calibration.reduction.report_frame import ReportFrame, apply_increment

START_SD_M = 1.0e-3
START_SD_RAD = 3.0e-3


@dataclass(frozen=True)
class FilteredPoses:
    """Measured platform poses in the report frame, one row a visit (v).

    coordinates (v, 6); covariance (v, f, f) over the free coordinates; accepted (r,): readings that the
    gate let pass; measured (v,): False where fewer than two readings were left.
    """

    coordinates: Array
    covariance: Array
    accepted: NDArray[np.bool_]
    measured: NDArray[np.bool_]


def filter_poses(report: ReportFrame, observations: ReflectorObservations) -> FilteredPoses:
    """Pose of each visit from its platform reflectors, outliers gated.

    An outlier that is read first would make the good ones look wrong, so each order of readings is tried and
    the one that keeps most readings (then: the smallest innovations) counts.
    """
    dof = report.machine.dof
    target = observations.visits.target_m
    predicted, jacobian = report.points(target), report.jacobian(target)[..., dof]
    coordinates = np.full((len(observations.visits), 6), np.nan)
    covariance = np.full((len(observations.visits), dof.size, dof.size), np.nan)
    accepted = ~np.isin(observations.smr, report.smrs)
    measured = np.zeros(len(observations.visits), dtype=bool)
    start = np.diag(np.where(dof < 3, START_SD_M, START_SD_RAD) ** 2)
    for v in range(len(observations.visits)):
        rows = np.flatnonzero((observations.visit == v) & ~accepted)
        if rows.size == 0:
            continue
        smr = np.searchsorted(report.smrs, observations.smr[rows])
        best = _best_order(
            start, observations.position_m[rows] - predicted[v, smr], jacobian[v, smr], observations.covariance_m2[rows]
        )
        accepted[rows[best.kept]] = True
        measured[v] = len(best.kept) >= 2
        if measured[v]:
            coordinates[v] = apply_increment(target[v : v + 1], best.x[None], dof)[0]
            covariance[v] = best.p
    return FilteredPoses(coordinates, covariance, accepted, measured)


@dataclass(frozen=True)
class _FilterRun:
    kept: list[int]
    cost: float
    x: Array
    p: Array


def _best_order(start: Array, error: Array, design: Array, noise: Array) -> _FilterRun:
    """Filter the readings of one visit; other orders are tried only if a reading was refused."""
    everything = list(range(len(error)))
    best = _filter_in_order(everything, start, error, design, noise)
    if len(best.kept) == len(error):
        return best
    firsts = permutations(everything, min(2, len(everything)))
    orders = ([*head, *(i for i in everything if i not in head)] for head in firsts)
    runs = [_filter_in_order(order, start, error, design, noise) for order in orders]
    return min(runs, key=lambda run: (-len(run.kept), run.cost))


def _filter_in_order(order: list[int], start: Array, error: Array, design: Array, noise: Array) -> _FilterRun:
    kf = KalmanFilter(dim_x=len(start), dim_z=3)
    kf.x = np.zeros(len(start))
    kf.P = start.copy()
    accepted, cost = [], 0.0
    for i in order:
        kf.H = design[i]
        innovation = nis(kf, error[i], noise[i])
        if innovation <= innovation_gate(3):
            kf.update(error[i], R=noise[i])
            accepted.append(i)
            cost += innovation
    return _FilterRun(accepted, cost, kf.x, kf.P)
