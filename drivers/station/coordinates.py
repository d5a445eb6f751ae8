"""Coordinates from angles and distance, with the covariance by the instrument's stated accuracy."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.station.polar import MeanReading, PolarReading, polar_to_cartesian


@dataclass(frozen=True)
class StatedAccuracy:
    """Standard deviations of a single reading, from the instrument's data sheet.

    `angle_sd_rad` holds for both angles across the line of sight, `range_ppm` grows with the distance.
    """

    angle_sd_rad: float = 2.4e-6
    range_sd_m: float = 1.0e-4
    range_ppm: float = 1.0


@dataclass(frozen=True)
class Coordinates:
    """East, north and height of a point in metres, and their covariance (3, 3) in m^2."""

    position_m: tuple[float, float, float]
    covariance_m2: NDArray[np.float64]


def coordinates(reading: PolarReading | MeanReading, stated: StatedAccuracy) -> Coordinates:
    """Coordinates of a reading; a mean of n has a covariance n times smaller.

    First-order propagation through E = d sin V sin Hz, N = d sin V cos Hz, H = d cos V. The stated angle
    deviation holds across the line of sight: that of Hz is the stated one over sin V. Errors common to all readings
    (range constant, refraction, drift) are not included.
    """
    hz, v, d = reading.hz_rad, reading.v_rad, reading.slope_distance_m
    sin_v, cos_v, sin_hz, cos_hz = math.sin(v), math.cos(v), math.sin(hz), math.cos(hz)
    across = np.array([cos_hz, -sin_hz, 0.0])  # unit vectors along growing Hz, V and distance
    up = np.array([cos_v * sin_hz, cos_v * cos_hz, -sin_v])
    along = np.array([sin_v * sin_hz, sin_v * cos_hz, cos_v])
    side_m = d * stated.angle_sd_rad
    range_m = math.hypot(stated.range_sd_m, d * stated.range_ppm * 1e-6)
    n = reading.n if isinstance(reading, MeanReading) else 1
    covariance = side_m**2 * (np.outer(across, across) + np.outer(up, up)) + range_m**2 * np.outer(along, along)
    return Coordinates(polar_to_cartesian(hz, v, d), covariance / n)
