"""The station's slow drift, followed through its readings of the floor nests by a Kalman filter and smoothed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.rotation import skew
from calibration.recording.header import AccuracyEntry

FIRST_DRIFT_SD = 1.0e-8  # m and rad: drift is counted from the first nest reading
FIRST_NEST_SD_M = 1.0e-3


@dataclass(frozen=True)
class Breaks:
    """Rig times before which an unknown time passed: the frame may have moved by `shift_m` in any direction there, and
    turned by as much at `distance_m`, that of the nests.
    """

    at_s: tuple[float, ...]
    shift_m: float
    distance_m: float

    def covariance(self, from_s: float, to_s: float) -> Array:
        """Covariance (6, 6) of the breaks between two times, the later one included."""
        count = sum(from_s < t <= to_s for t in self.at_s)
        turn_rad = self.shift_m / self.distance_m
        return np.diag([count * self.shift_m**2] * 3 + [count * turn_rad**2] * 3)


@dataclass(frozen=True)
class DriftEstimate:
    """Small rigid motion of the station's frame at some times (t,), since the first nest reading.

    state (t, 6): translation in m and rotation vector in rad about the station; covariance (t, 6, 6).
    nests_m (k, 3): the nests' places in the frame of the first reading, in the order of their numbers;
    nest_covariance_m2 (3 k, 3 k).
    """

    state: Array
    covariance: Array
    nests_m: Array
    nest_covariance_m2: Array

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
    accuracy: AccuracyEntry,
    at_s: Array,
    breaks: Breaks | None = None,
) -> DriftEstimate:
    """Follow the frame through the nests and smooth (Rauch-Tung-Striebel).

    t_s (n,) ascending; nest (n,): which nest; position_m (n, 3), covariance_m2 (n, 3, 3); at_s (t,): times
    of the requested estimates. The drift is a random walk with the station's stated strength, zero at the
    first reading; the nests' positions are unknown and part of the state, so that the gauge is explicit and later
    readings do not shift the frame of earlier ones. Over a break the frame may have moved as far as nest checks allow.
    """
    breaks = breaks or Breaks((), 0.0, 1.0)
    which, row = np.unique(nest, return_inverse=True)
    first = np.stack([position_m[nest == w][0] for w in which])
    size = 6 + 3 * len(which)
    design = np.zeros((len(t_s), 3, size))
    design[:, :, :6] = _drift_design(first[row])
    own_columns = 6 + 3 * row[:, None] + np.arange(3)
    np.put_along_axis(design, own_columns[:, None, :], np.broadcast_to(np.eye(3), (len(t_s), 3, 3)), axis=2)
    walk = np.zeros((size, size))
    walk[:3, :3] = np.eye(3) * accuracy.drift_m_per_sqrt_h**2 / 3600.0
    level, direction = accuracy.drift_of_level_rad_per_sqrt_h, accuracy.drift_rad_per_sqrt_h
    walk[3:6, 3:6] = np.diag([level, level, direction]) ** 2 / 3600.0

    times = np.concatenate([t_s, at_s])
    order = np.argsort(times, kind="stable")
    kf = KalmanFilter(dim_x=size, dim_z=3)
    kf.x = np.zeros(size)
    kf.P = np.diag([FIRST_DRIFT_SD**2] * 6 + [FIRST_NEST_SD_M**2] * (size - 6))
    kf.F = np.eye(size)
    states, covariances, process = [], [], []
    last = t_s[0]
    for k in order:
        kf.Q = walk * abs(times[k] - last) + 1e-22 * np.eye(size)
        kf.Q[:6, :6] += breaks.covariance(last, times[k])
        last = times[k]
        process.append(kf.Q)
        kf.predict()
        if k < len(t_s):
            kf.H = design[k]
            kf.update(position_m[k] - first[row[k]], R=covariance_m2[k])
        states.append(kf.x.copy())
        covariances.append(kf.P.copy())
    x, p, _, _ = kf.rts_smoother(np.array(states), np.array(covariances), Qs=np.array(process))
    place = np.empty(len(times), dtype=np.intp)
    place[order] = np.arange(len(times))
    requested = place[len(t_s) :]
    return DriftEstimate(
        state=x[requested, :6],
        covariance=p[requested, :6, :6],
        nests_m=first + x[-1, 6:].reshape(-1, 3),
        nest_covariance_m2=p[-1, 6:, 6:],
    )
