"""Interim test of a station on the shop floor: two-face errors and known distances between nests, pass or fail.

Not a certificate: it shows that the instrument is still in its previous condition.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from drivers.station.coordinates import StatedAccuracy, coordinates
from drivers.station.laser_tracker import LaserTracker
from drivers.station.polar import TWO_PI, MeanReading, PolarReading, average, cartesian_to_polar

_COVERAGE = 2.0


@dataclass(frozen=True)
class KnownDistance:
    """Two nests, their certified distance in metres and its standard uncertainty."""

    nests: tuple[str, str]
    length_m: float
    u_m: float


@dataclass(frozen=True)
class InterimLimits:
    """Largest permitted errors (not standard deviations), and how readings are taken.

    `tolerance_m` is the largest distance of a nest from its predicted position, `window_rad` the full width in which it
    is looked for.
    """

    two_face_rad: float = 20e-6
    distance_m: float = 0.5e-3
    readings: int = 3
    tolerance_m: float = 0.05
    window_rad: float = 0.02


@dataclass(frozen=True)
class TwoFaceError:
    """Half the difference between the faces at one nest: collimation across (Hz times sin V), index in V."""

    nest: str
    across_rad: float
    up_rad: float


@dataclass(frozen=True)
class DistanceError:
    """Measured minus known distance of two nests in metres, with U (k = 2) of the difference."""

    nests: tuple[str, str]
    error_m: float
    expanded_u_m: float


@dataclass(frozen=True)
class InterimTest:
    """What the test found. `failures` has a line for each error beyond its limit; the test is passed without any."""

    serial: int
    two_face: tuple[TwoFaceError, ...]
    distances: tuple[DistanceError, ...]
    failures: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether every error is within its limit."""
        return not self.failures


def interim_test(
    station: LaserTracker,
    nests_m: Mapping[str, tuple[float, float, float]],
    known_distances: Sequence[KnownDistance],
    stated: StatedAccuracy,
    limits: InterimLimits | None = None,
) -> InterimTest:
    """Measure every nest on both faces and compare.

    `nests_m` are predicted positions (E, N, H) in the station's frame; the two-face check needs no known distance.
    Raises what `point_and_aim` and `measure` raise, WrongTarget, and ValueError for an unknown nest.
    """
    limits = limits or InterimLimits()
    for distance in known_distances:
        for name in distance.nests:
            if name not in nests_m:
                raise ValueError(f"known distance: unknown nest '{name}'")
    means: dict[str, MeanReading] = {}
    two_face: list[TwoFaceError] = []
    for name, position_m in nests_m.items():
        hz, v, _ = cartesian_to_polar(*position_m)
        station.point_and_aim(hz, v, limits.window_rad)
        readings = station.measure(limits.readings, two_face=True)
        means[name] = average(readings)
        station.require_target(means[name], position_m, limits.tolerance_m, name)
        two_face.append(two_face_error(name, readings))
    distances = tuple(_compare(distance, means, stated) for distance in known_distances)
    identity = station.identity
    return InterimTest(
        serial=0 if identity is None else identity.serial,
        two_face=tuple(two_face),
        distances=distances,
        failures=(*_face_failures(two_face, limits), *_distance_failures(distances, limits)),
    )


def two_face_error(nest: str, readings: Sequence[PolarReading]) -> TwoFaceError:
    """Half of the difference between the faces. Raises ValueError unless both faces were measured."""
    faces = [[reading for reading in readings if reading.face == face] for face in (1, 2)]
    one, two = (average(face) for face in faces)  # reduced to face 1: a remaining difference is an error
    across = 0.5 * math.remainder(one.hz_rad - two.hz_rad, TWO_PI) * math.sin(one.v_rad)
    return TwoFaceError(nest, across, 0.5 * (one.v_rad - two.v_rad))


def _compare(known: KnownDistance, means: Mapping[str, MeanReading], stated: StatedAccuracy) -> DistanceError:
    first, second = (coordinates(means[name], stated) for name in known.nests)
    off = np.subtract(second.position_m, first.position_m)
    length_m = float(np.linalg.norm(off))
    along = off / length_m
    variance = float(along @ (first.covariance_m2 + second.covariance_m2) @ along) + known.u_m**2
    return DistanceError(known.nests, length_m - known.length_m, _COVERAGE * math.sqrt(variance))


def _face_failures(errors: Sequence[TwoFaceError], limits: InterimLimits) -> list[str]:
    return [
        f"nest {error.nest}: two-face error {max(abs(error.across_rad), abs(error.up_rad)) * 1e6:.1f} urad"
        f" (limit {limits.two_face_rad * 1e6:g} urad)"
        for error in errors
        if max(abs(error.across_rad), abs(error.up_rad)) > limits.two_face_rad
    ]


def _distance_failures(errors: Sequence[DistanceError], limits: InterimLimits) -> list[str]:
    return [
        f"distance {' to '.join(error.nests)}: error {error.error_m * 1e6:.0f} um,"
        f" U {error.expanded_u_m * 1e6:.0f} um (limit {limits.distance_m * 1e6:g} um)"
        for error in errors
        if abs(error.error_m) > limits.distance_m
    ]
