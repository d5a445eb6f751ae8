"""Readings of a station in polar form, and the geometry of its two faces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

TWO_PI = 2.0 * math.pi


@dataclass(frozen=True)
class PolarReading:
    """One single measurement as the station reported it.

    `hz_rad` runs clockwise from the station's zero, `v_rad` is the zenith angle (above pi on face 2), both
    in [0, 2 pi). `slope_distance_m` has the station's prism constant and ppm applied; both are recorded.
    `t_rig_s` and `t_host_s` are the middle of the exchange, `u_t_s` half of the measurement in rig seconds.
    `edm_mode` (2021) and `prism_type` (17009) are GeoCOM's numbers, -1 if unknown.
    """

    hz_rad: float
    v_rad: float
    slope_distance_m: float
    face: int
    prism_constant_m: float
    ppm: float
    t_rig_s: float
    t_host_s: float
    u_t_s: float
    flags: tuple[str, ...] = ()
    edm_mode: int = -1
    prism_type: int = -1


@dataclass(frozen=True)
class MeanReading:
    """Mean of readings of one point, reduced to face 1, with the standard deviation of a single one."""

    hz_rad: float
    v_rad: float
    slope_distance_m: float
    s_hz_rad: float
    s_v_rad: float
    s_distance_m: float
    n: int
    t_rig_s: float


def face_of(v_rad: float) -> int:
    """1 for a zenith angle in [0, pi], 2 above."""
    return 1 if v_rad % TWO_PI <= math.pi else 2


def to_face_one(hz_rad: float, v_rad: float) -> tuple[float, float]:
    """The same direction as seen on face 1: hz in [0, 2 pi), v in [0, pi]."""
    v = v_rad % TWO_PI
    if v > math.pi:
        return (hz_rad + math.pi) % TWO_PI, TWO_PI - v
    return hz_rad % TWO_PI, v


def polar_to_cartesian(hz_rad: float, v_rad: float, d_m: float) -> tuple[float, float, float]:
    """East, north and height in metres: E = d sin V sin Hz, N = d sin V cos Hz, H = d cos V (either face)."""
    horizontal_m = d_m * math.sin(v_rad)
    return horizontal_m * math.sin(hz_rad), horizontal_m * math.cos(hz_rad), d_m * math.cos(v_rad)


def cartesian_to_polar(e_m: float, n_m: float, h_m: float) -> tuple[float, float, float]:
    """Hz in [0, 2 pi), V in [0, pi] and distance of a point given by east, north and height in metres."""
    horizontal_m = math.hypot(e_m, n_m)
    return math.atan2(e_m, n_m) % TWO_PI, math.atan2(horizontal_m, h_m), math.hypot(horizontal_m, h_m)


def average(readings: Sequence[PolarReading]) -> MeanReading:
    """Mean of readings of one point on either or both faces; angles may wrap around.

    Raises ValueError without readings. Standard deviations are NaN for a single one.
    """
    if not readings:
        raise ValueError("no readings to average")
    directions = [to_face_one(reading.hz_rad, reading.v_rad) for reading in readings]
    hz0 = directions[0][0]
    hz, s_hz = _mean([math.remainder(hz - hz0, TWO_PI) for hz, _ in directions])
    v, s_v = _mean([v for _, v in directions])
    d, s_d = _mean([reading.slope_distance_m for reading in readings])
    t, _ = _mean([reading.t_rig_s for reading in readings])
    return MeanReading(
        hz_rad=(hz0 + hz) % TWO_PI,
        v_rad=v,
        slope_distance_m=d,
        s_hz_rad=s_hz,
        s_v_rad=s_v,
        s_distance_m=s_d,
        n=len(readings),
        t_rig_s=t,
    )


def _mean(values: Sequence[float]) -> tuple[float, float]:
    mean = math.fsum(values) / len(values)
    if len(values) < 2:
        return mean, math.nan
    return mean, math.sqrt(math.fsum((value - mean) ** 2 for value in values) / (len(values) - 1))


@dataclass(frozen=True)
class SettleCriterion:
    """When a point counts as at rest, judged on a window of `window` readings.

    Across the line of sight, where the station is accurate, the standard deviation and the drift from the
    window's first half to its second are at most `across_m`; along it, where range noise hides
    motion, at most `along_m`. The limit is `limit_s` of rig time.
    """

    window: int = 3
    across_m: float = 40e-6
    along_m: float = 2e-3
    limit_s: float = 60.0

    def __post_init__(self) -> None:
        if self.window < 2:
            raise ValueError("a window has at least two readings")


def unrest(readings: Sequence[PolarReading]) -> tuple[float, float]:
    """How far readings of one point are from rest, in metres: across the line of sight and along it.

    The larger of standard deviation and drift between the halves of the readings.
    """
    directions = [to_face_one(reading.hz_rad, reading.v_rad) for reading in readings]
    hz0 = directions[0][0]
    d_m = [reading.slope_distance_m for reading in readings]
    across_m = [
        [d_m[0] * math.sin(v) * math.remainder(hz - hz0, TWO_PI) for hz, v in directions],
        [d_m[0] * v for _, v in directions],
    ]
    return max(_unrest(values) for values in across_m), _unrest(d_m)


def _unrest(values: Sequence[float]) -> float:
    half = max(1, len(values) // 2)
    drift = abs(_mean(values[:half])[0] - _mean(values[-half:])[0])
    return max(_mean(values)[1], drift)
