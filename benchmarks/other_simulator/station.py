"""The station: where it stands, what it sees, and how well it is said to see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Departures
from benchmarks.other_simulator.machine import Geometry, Machine

Array = NDArray[np.float64]

ANGLE_SD_RAD, RANGE_SD_M = (1.2e-6, 3.5e-6), (2e-6, 1.2e-5)
FINE_RANGE_SD_M = (1.8e-6, 4e-6)  # where the effect is of the air, which coarse ranges would hide
STATED_RANGE_CONSTANT_M, STATED_RANGE_SCALE = [5e-6, 1e-5, 2e-5], [5e-7, 1e-6]


@dataclass(frozen=True)
class Station:
    """A station in the machine frame; its own axes are east, north and up, headings clockwise from above."""

    stated_place_m: Array  # (3,)
    stated_heading_rad: float
    place_m: Array  # (3,), true
    axes: Array  # (3, 3), rows are the station's axes
    angle_sd_rad: float
    range_sd_m: float
    range_constant_u_m: float
    range_scale_u: float
    range_constant_m: float  # true error of all distances
    range_scale: float  # true relative error of all distances

    def sees(self, points_m: Array, geometry: Geometry, departures: Departures) -> Array:
        """Points (r, 3) of the machine frame in the station's frame, as light and frame have them."""
        own = (points_m - self.place_m) @ self.axes.T
        shift, turn = geometry.station[:3], geometry.station[3:]
        own = own - shift - np.cross(np.broadcast_to(turn, own.shape), own)
        return own - departures.station_m - np.cross(departures.station_rad, own) + departures.sights_m

    def with_range_errors(self, seen_m: Array) -> Array:
        """Sights (r, 3) with the station's own errors of distance."""
        distances = np.linalg.norm(seen_m, axis=1)
        factor = 1 + (self.range_constant_m + self.range_scale * distances) / distances
        return np.asarray(seen_m * factor[:, None])

    def covariances_m2(self, seen_m: Array) -> Array:
        """Covariance (r, 3, 3) of readings at (r, 3) by the stated accuracy of distance and of both angles."""
        distances = np.linalg.norm(seen_m, axis=1)
        sight = seen_m / distances[:, None]
        level = across_sight(seen_m, distances)
        level_distances = np.linalg.norm(level, axis=1)
        level /= level_distances[:, None]
        upright = np.cross(sight, level)
        return np.asarray(
            self.range_sd_m**2 * _squares(sight)
            + (self.angle_sd_rad * level_distances)[:, None, None] ** 2 * _squares(level)
            + (self.angle_sd_rad * distances)[:, None, None] ** 2 * _squares(upright)
        )


def across_sight(sight: Array, distances: Array) -> Array:
    """Level vectors (r, 3) to the right of lines of sight (r, 3), as long as these are in the level."""
    return np.stack([sight[:, 1], -sight[:, 0], 0 * distances], 1)


def draw_placing(machine: Machine, rng: np.random.Generator) -> tuple[float, Array, Array, Array]:
    """Stated heading and place, true place and true axes, 3 to 5 m in front of the machine."""
    north = np.array([0, 0, -1.0]) if machine.planar else np.array([0, 1.0, 0])
    east = np.cross(north, machine.up)
    heading = float(np.round(rng.uniform(-0.4, 0.4), 3))
    true_heading = heading + rng.normal() * 2e-3
    if machine.planar:
        place = np.array([rng.uniform(-0.5, 0.5), rng.uniform(-0.2, 0.6), rng.uniform(3.2, 5)])
    else:
        place = np.array([rng.uniform(-0.5, 0.5), -rng.uniform(3.2, 4.5), rng.uniform(0.4, 1.0)])
    place = place.round(2)
    true_place = place + rng.normal(size=3) * 0.005
    cos, sin = np.cos(true_heading), np.sin(true_heading)
    return heading, place, true_place, np.stack([east * cos - north * sin, north * cos + east * sin, machine.up])


def draw_accuracy(rng: np.random.Generator, *, fine_ranges: bool) -> dict[str, float]:
    """Stated accuracy and true errors, by the names of `Station`."""
    angle_sd = _rounded(np.exp(rng.uniform(*np.log(ANGLE_SD_RAD))))
    range_sd = _rounded(np.exp(rng.uniform(*np.log(RANGE_SD_M))))
    if fine_ranges:
        range_sd = _rounded(rng.uniform(*FINE_RANGE_SD_M))
    constant_u, scale_u = float(rng.choice(STATED_RANGE_CONSTANT_M)), float(rng.choice(STATED_RANGE_SCALE))
    return {
        "angle_sd_rad": angle_sd,
        "range_sd_m": range_sd,
        "range_constant_u_m": constant_u,
        "range_scale_u": scale_u,
        "range_constant_m": rng.normal() * constant_u,
        "range_scale": rng.normal() * scale_u,
    }


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def _squares(vectors: Array) -> Array:
    """Outer product of each vector (r, 3) with itself (r, 3, 3)."""
    return np.asarray(vectors[:, :, None] * vectors[:, None, :])
