"""Kalman filters between readings and poses: the station's slow drift, and the pose of the platform at a visit.

Both gate a measurement by its normalised innovation squared before it is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray
from scipy.stats import chi2

from calibration.base.arrays import Array
from calibration.base.rotation import skew
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.recording.header import AccuracyEntry
from calibration.reduction.report_frame import ReportFrame, apply_increment

GATE_PROBABILITY = 0.9999
START_SD_M = 1.0e-3
START_SD_RAD = 3.0e-3
FIRST_DRIFT_SD = 1.0e-8  # m and rad: drift is counted from the first nest reading
FIRST_NEST_SD_M = 1.0e-3


def innovation_gate(dim: int) -> float:
    """Largest normalised innovation squared that is accepted for `dim` coordinates."""
    return float(chi2.ppf(GATE_PROBABILITY, dim))


def nis(filter_: KalmanFilter, z: Array, noise: Array) -> float:
    """Normalised innovation squared of a measurement that has not been used yet."""
    innovation = z - filter_.H @ filter_.x
    covariance = filter_.H @ filter_.P @ filter_.H.T + noise
    return float(innovation @ np.linalg.solve(covariance, innovation))


@dataclass(frozen=True)
class DriftEstimate:
    """Small rigid motion of the station's frame at some times (t,), since the first nest reading.

    state (t, 6): translation in m and rotation vector in rad about the station; covariance (t, 6, 6).
    rejected: rows of the nest readings that the gate refused.
    """

    state: Array
    covariance: Array
    rejected: NDArray[np.intp]

    def remove(self, points_m: Array, covariances_m2: Array) -> tuple[Array, Array]:
        """Points (t, 3) without drift, the drift's covariance added to theirs."""
        h = _drift_design(points_m)
        shift = np.einsum("tij,tj->ti", h, self.state)
        added = h @ self.covariance @ h.transpose(0, 2, 1)
        return points_m - shift, covariances_m2 + added


def _drift_design(points_m: Array) -> Array:
    """(t, 3, 6): shift of points with the drift state."""
    out = np.empty((len(points_m), 3, 6))
    out[:, :, :3] = np.eye(3)
    out[:, :, 3:] = -skew(points_m)
    return out


def estimate_drift(
    t_s: Array,
    nest: NDArray[np.intp],
    position_m: Array,
    covariance_m2: Array,
    stated: AccuracyEntry,
    at_s: Array,
) -> DriftEstimate:
    """Follow the frame through the nests and smooth (Rauch-Tung-Striebel).

    t_s (n,) ascending; nest (n,): which nest; position_m (n, 3), covariance_m2 (n, 3, 3); at_s (t,): times
    at which the drift is wanted. The drift is a random walk with the station's stated strength, zero at the
    first reading; where the nests stand is unknown and part of the state, so that the gauge is explicit and later
    readings do not shift the frame of earlier ones.
    """
    which, row = np.unique(nest, return_inverse=True)
    first = np.stack([position_m[nest == w][0] for w in which])
    size = 6 + 3 * len(which)
    design = np.zeros((len(t_s), 3, size))
    design[:, :, :6] = _drift_design(first[row])
    own = 6 + 3 * row[:, None] + np.arange(3)
    np.put_along_axis(design, own[:, None, :], np.broadcast_to(np.eye(3), (len(t_s), 3, 3)), axis=2)
    walk = np.zeros((size, size))
    walk[:3, :3] = np.eye(3) * stated.drift_m_per_sqrt_h**2 / 3600.0
    level, direction = stated.drift_of_level_rad_per_sqrt_h, stated.drift_rad_per_sqrt_h
    walk[3:6, 3:6] = np.diag([level, level, direction]) ** 2 / 3600.0

    times = np.concatenate([t_s, at_s])
    order = np.argsort(times, kind="stable")
    kf = KalmanFilter(dim_x=size, dim_z=3)
    kf.x = np.zeros(size)
    kf.P = np.diag([FIRST_DRIFT_SD**2] * 6 + [FIRST_NEST_SD_M**2] * (size - 6))
    kf.F = np.eye(size)
    states, covariances, process = [], [], []
    rejected = []
    last = t_s[0]
    for k in order:
        kf.Q = walk * abs(times[k] - last) + 1e-22 * np.eye(size)
        last = times[k]
        process.append(kf.Q)
        kf.predict()
        if k < len(t_s):
            kf.H = design[k]
            error = position_m[k] - first[row[k]]
            if nis(kf, error, covariance_m2[k]) <= innovation_gate(3):
                kf.update(error, R=covariance_m2[k])
            else:
                rejected.append(k)
        states.append(kf.x.copy())
        covariances.append(kf.P.copy())
    x, p, _, _ = kf.rts_smoother(np.array(states), np.array(covariances), Qs=np.array(process))
    place = np.empty(len(times), dtype=np.intp)
    place[order] = np.arange(len(times))
    wanted = place[len(t_s) :]
    return DriftEstimate(x[wanted, :6], p[wanted, :6, :6], np.array(rejected, dtype=np.intp))


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


def filter_poses(report: ReportFrame, seen: ReflectorObservations) -> FilteredPoses:
    """Pose of each visit from its platform reflectors, outliers gated.

    An outlier that is read first would make the good ones look wrong, so each order of readings is tried and
    the one that keeps most readings (then: the smallest innovations) counts.
    """
    dof = report.machine.dof
    target = seen.visits.target_m
    predicted, jacobian = report.points(target), report.jacobian(target)[..., dof]
    coordinates = np.full((len(seen.visits), 6), np.nan)
    covariance = np.full((len(seen.visits), dof.size, dof.size), np.nan)
    accepted = ~np.isin(seen.smr, report.smrs)
    measured = np.zeros(len(seen.visits), dtype=bool)
    start = np.diag(np.where(dof < 3, START_SD_M, START_SD_RAD) ** 2)
    for v in range(len(seen.visits)):
        rows = np.flatnonzero((seen.visit == v) & ~accepted)
        if rows.size == 0:
            continue
        smr = np.searchsorted(report.smrs, seen.smr[rows])
        best = _best_order(start, seen.position_m[rows] - predicted[v, smr], jacobian[v, smr], seen.covariance_m2[rows])
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
    kept, cost = [], 0.0
    for i in order:
        kf.H = design[i]
        innovation = nis(kf, error[i], noise[i])
        if innovation <= innovation_gate(3):
            kf.update(error[i], R=noise[i])
            kept.append(i)
            cost += innovation
    return _FilterRun(kept, cost, kf.x, kf.P)
