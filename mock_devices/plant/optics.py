"""Where the true station stands, how it drifts, and what it would see: noise-free polar coordinates.

Station frame: E, N, H with E = d sinV sinHz, N = d sinV cosHz, H = d cosV. H is against gravity. Where gravity is
along -y and the heading zero the station looks along -z of the machine: E is machine x, H is machine y, N is machine
-z. For any other gravity that view is turned as gravity is, the shortest way: where it is along -z the station looks
along y.
Not modelled: bending of the beam, tilt compensator, axis and eccentricity errors, reflectors' own errors.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mock_devices.machine_file import Vector3
from mock_devices.plant.thermal import SlowSignal
from mock_devices.seeds import generator
from mock_devices.settings import MockSettings

TWO_PI = 2.0 * math.pi
_POSITION_HALF_WIDTH_M = 0.010
_ZERO_DIRECTION_HALF_WIDTH_RAD = 5.0e-3
_LEVEL_HALF_WIDTH_RAD = 20.0e-6

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Polar:
    """Direction and distance from the station's origin, face I: Hz clockwise in [0, 2 pi), zenith angle V."""

    hz_rad: float
    v_rad: float
    distance_m: float


class StationView:
    """The true station of a seed: set up once, then wandering slowly."""

    def __init__(self, settings: MockSettings, gravity: Array | None = None) -> None:
        rng = generator(settings.seed, "station")
        wobble = settings.instrument
        offset = rng.uniform(-_POSITION_HALF_WIDTH_M, _POSITION_HALF_WIDTH_M, 3)
        turn = rng.uniform(-_ZERO_DIRECTION_HALF_WIDTH_RAD, _ZERO_DIRECTION_HALF_WIDTH_RAD)
        level = rng.uniform(-_LEVEL_HALF_WIDTH_RAD, _LEVEL_HALF_WIDTH_RAD, 2)
        forward = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        heading = rotation(np.array([0.0, 0.0, settings.station_heading_rad + turn]))
        tilt = rotation(np.array([level[0], level[1], 0.0]))
        self.rotation: Array = tilt @ heading @ forward
        if gravity is not None:
            self.rotation = self.rotation @ turn_upright(gravity)
        self.translation_m: Array = -self.rotation @ (np.array(settings.station_position_m) + offset)
        angles = (wobble.drift_of_level_rad, wobble.drift_of_level_rad, wobble.drift_about_vertical_rad)
        drift = generator(settings.seed, "station drift")
        self._turns = [_SlowDrift(drift, amplitude) for amplitude in angles]
        self._shifts = [_SlowDrift(drift, wobble.drift_m) for _ in range(3)]
        constants = generator(settings.seed, "range")
        self.range_constant_m = float(wobble.range_constant_u_m * constants.standard_normal())
        self.range_scale = float(1.0 + wobble.range_scale_u * constants.standard_normal())

    def move(self, by_m: Vector3, turn_rad: float) -> None:
        """Set the station up elsewhere: moved in the machine's frame, turned clockwise seen from above."""
        position = -self.rotation.T @ self.translation_m + np.array(by_m)
        self.rotation = rotation(np.array([0.0, 0.0, turn_rad])) @ self.rotation
        self.translation_m = -self.rotation @ position

    def drift_free(self, position_m: Vector3) -> Array:
        """A point of the machine frame in the station frame of time zero, shape (3,)."""
        return np.asarray(self.rotation @ np.array(position_m) + self.translation_m)

    def drift_free_series(self, places_m: Array, t_s: Array) -> Array:
        """Points of the machine frame at times (n,), (n, k, 3), in the frame of the set-up without its drift."""
        del t_s  # it stands where it stands
        return np.asarray(places_m @ self.rotation.T + self.translation_m)

    def drift_series(self, t_s: Array) -> tuple[Array, Array]:
        """Small rotation and shift of what is seen at times (n,): (n, 3) each, station frame."""
        turns = np.stack([turn.series(t_s) for turn in self._turns], axis=1)
        return turns, np.stack([shift.series(t_s) for shift in self._shifts], axis=1)

    def polar(self, position_m: Vector3, t_s: float) -> Polar:
        """A point of the machine frame as the drifting station sees it."""
        x, y, z = (float(value) for value in self.drift_free(position_m))
        a, b, c = (turn.at(t_s) for turn in self._turns)
        east = x + b * z - c * y + self._shifts[0].at(t_s)  # small angles: second order is below 1e-10 m
        north = y + c * x - a * z + self._shifts[1].at(t_s)
        up = z + a * y - b * x + self._shifts[2].at(t_s)
        distance = math.sqrt(east * east + north * north + up * up)
        return Polar(math.atan2(east, north) % TWO_PI, math.acos(up / distance), distance)


class _SlowDrift:
    """A slow signal that starts at zero."""

    def __init__(self, rng: np.random.Generator, amplitude: float) -> None:
        self._signal = SlowSignal(rng, amplitude, 5400.0, 28800.0)
        self._start = self._signal.at(0.0)

    def at(self, t_s: float) -> float:
        return self._signal.at(t_s) - self._start

    def series(self, t_s: Array) -> Array:
        return self._signal.series(t_s) - self._start


def turn_upright(gravity: Array) -> Array:
    """The shortest turn (3, 3) of the machine frame after which gravity is along -y; about z where it was along y."""
    up = -gravity / float(np.linalg.norm(gravity))
    y = np.array([0.0, 1.0, 0.0])
    axis, cosine = np.cross(up, y), float(up @ y)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-12:
        return np.eye(3) if cosine > 0.0 else np.diag([-1.0, -1.0, 1.0])
    return rotation(axis / sine * math.atan2(sine, cosine))


def rotation(vector_rad: Array) -> Array:
    """Rotation matrix of a rotation vector (Rodrigues), shape (3, 3)."""
    angle = float(np.linalg.norm(vector_rad))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector_rad / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * (k @ k))


def direction_between(a: Polar, hz_rad: float, v_rad: float) -> float:
    """Angle between a reflector's direction and another direction, in radians."""
    d_hz, d_v = hz_difference(a.hz_rad, hz_rad), a.v_rad - v_rad
    haversine = math.sin(0.5 * d_v) ** 2 + math.sin(a.v_rad) * math.sin(v_rad) * math.sin(0.5 * d_hz) ** 2
    return 2.0 * math.asin(min(1.0, math.sqrt(max(haversine, 0.0))))


def hz_difference(a_rad: float, b_rad: float) -> float:
    """a - b, in (-pi, pi]."""
    return math.pi - (math.pi - (a_rad - b_rad)) % TWO_PI
