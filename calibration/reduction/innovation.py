"""The gate of a Kalman filter: a measurement is used only if its normalised innovation squared is plausible."""

from __future__ import annotations

import numpy as np
from filterpy.kalman import KalmanFilter
from scipy.stats import chi2

from calibration.base.arrays import Array

GATE_PROBABILITY = 0.9999


def innovation_gate(dim: int) -> float:
    """Largest normalised innovation squared that is accepted for `dim` coordinates."""
    return float(chi2.ppf(GATE_PROBABILITY, dim))


def nis(filter_: KalmanFilter, z: Array, noise: Array) -> float:
    """Normalised innovation squared of a measurement that has not been used yet."""
    innovation = z - filter_.H @ filter_.x
    covariance = filter_.H @ filter_.P @ filter_.H.T + noise
    return float(innovation @ np.linalg.solve(covariance, innovation))
