"""From a station's raw readings to points with covariance, and the certified length that ties its scale.

The station's frame is that of its angles: E = d sin V sin Hz, N = d sin V cos Hz, H = d cos V.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array


@dataclass(frozen=True)
class StationAccuracy:
    """Stated standard deviations of one reading, and the standard uncertainty of its certificate."""

    angle_sd_rad: float
    range_sd_m: float
    range_constant_u_m: float
    range_scale_u: float


def polar_to_points(hz_rad: Array, v_rad: Array, distance_m: Array) -> Array:
    """Points (n, 3) in the station's frame from angles and slope distances (n,)."""
    return np.asarray(distance_m)[:, None] * lines_of_sight(hz_rad, v_rad)


def lines_of_sight(hz_rad: Array, v_rad: Array) -> Array:
    """Unit vectors (n, 3) from the station to its targets."""
    sin_v = np.sin(v_rad)
    return np.stack([sin_v * np.sin(hz_rad), sin_v * np.cos(hz_rad), np.cos(v_rad)], axis=1)


def axes_of_sight(point_m: Array) -> Array:
    """Unit vectors (n, 3, 3) at points (n, 3), as rows: along the line of sight, across it on the level and upwards.

    At the station itself, where no such line is, those of its frame.
    """
    hz_rad = np.arctan2(point_m[:, 0], point_m[:, 1])
    v_rad = np.pi / 2.0 - np.arctan2(point_m[:, 2], np.hypot(point_m[:, 0], point_m[:, 1]))
    on_level = np.stack([np.cos(hz_rad), -np.sin(hz_rad), np.zeros_like(hz_rad)], axis=1)
    along = lines_of_sight(hz_rad, v_rad)
    axes = np.stack([along, on_level, np.cross(on_level, along)], axis=1)
    return np.where(np.any(point_m != 0.0, axis=1)[:, None, None], axes, np.eye(3))


def whitening(covariances_m2: Array, point_m: Array) -> Array:
    """Whitening matrices (n, 3, 3) of readings at points (n, 3): of the line of sight, across it on the level and
    upwards, each less what those before say of it.

    What is judged by single coordinates, such as by the worst one, must not depend on where the circle's zero points.
    """
    axes = axes_of_sight(point_m)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(axes @ covariances_m2 @ axes.transpose(0, 2, 1))) @ axes)


def across_line_of_sight(shift_m: Array, point_m: Array) -> Array:
    """The part of shifts (..., 3) that is perpendicular to the line of sight to a point (3,)."""
    sight = point_m / np.linalg.norm(point_m)
    return np.asarray(shift_m - (shift_m @ sight)[..., None] * sight)


def points_to_polar(point_m: Array) -> tuple[Array, Array, Array]:
    """Horizontal angle [0, 2 pi), zenith angle and slope distance of points (n, 3)."""
    distance = np.linalg.norm(point_m, axis=1)
    hz = np.mod(np.arctan2(point_m[:, 0], point_m[:, 1]), 2.0 * np.pi)
    return hz, np.arccos(point_m[:, 2] / distance), distance


def point_covariances(hz_rad: Array, v_rad: Array, distance_m: Array, accuracy: StationAccuracy) -> Array:
    """Covariances (n, 3, 3) in m^2 of single readings from the stated random accuracy.

    The range constant and scale are common to all readings: they are unknowns of the fit, not part of this.
    """
    sin_v, cos_v = np.sin(v_rad), np.cos(v_rad)
    sin_h, cos_h = np.sin(hz_rad), np.cos(hz_rad)
    along = lines_of_sight(hz_rad, v_rad)
    turn = np.stack([cos_h, -sin_h, np.zeros_like(hz_rad)], axis=1)
    tip = np.stack([cos_v * sin_h, cos_v * cos_h, -sin_v], axis=1)
    sd_turn = accuracy.angle_sd_rad * distance_m * sin_v
    sd_tip = accuracy.angle_sd_rad * distance_m
    sd_along = np.full_like(distance_m, accuracy.range_sd_m)
    out = np.zeros((len(along), 3, 3))
    for direction, sd in ((turn, sd_turn), (tip, sd_tip), (along, sd_along)):
        out += (sd**2)[:, None, None] * direction[:, :, None] * direction[:, None, :]
    return out


@dataclass(frozen=True)
class CertifiedLength:
    """A calibrated distance between two nests."""

    nests: tuple[str, str]
    value_m: float
    u_m: float


def range_constant(
    first_m: Array,
    second_m: Array,
    first_cov: Array,
    second_cov: Array,
    length: CertifiedLength,
    prior_u_m: float,
) -> tuple[float, float]:
    """The range constant (to be subtracted from ranges) and its standard uncertainty, in m.

    first_m, second_m (n, 3): the two nests at n checks, station's frame. All ranges being too long by c, the
    measured distance is too long by c times its derivative; the certificate of the station is the
    prior. At nearly equal ranges a range scale acts like a constant and is contained in it.
    """
    between = second_m - first_m
    distance = np.linalg.norm(between, axis=1)
    along = between / distance[:, None]
    sight_1 = first_m / np.linalg.norm(first_m, axis=1)[:, None]
    sight_2 = second_m / np.linalg.norm(second_m, axis=1)[:, None]
    per_constant = np.mean(np.sum(along * (sight_2 - sight_1), axis=1))
    variance = np.einsum("ni,nij,nj->n", along, first_cov + second_cov, along)
    u_mean = np.sqrt(np.mean(variance) / len(distance) + length.u_m**2)
    weight = per_constant**2 / u_mean**2 + 1.0 / prior_u_m**2
    estimate = per_constant * (np.mean(distance) - length.value_m) / u_mean**2 / weight
    return float(estimate), float(1.0 / np.sqrt(weight))
