"""One measurement of the reflector that a station is aimed at, checked value by value."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from geocompy.geo.gcdata import Inclination, Measurement

from drivers.station.geocom import GeoComSession
from drivers.station.polar import TWO_PI, PolarReading, face_of
from drivers.station.station_setup import out_of_range

_LONGEST_DISTANCE_M = 1000.0
_WAIT_S = 5
_Fetch = Callable[[], tuple[tuple[float, ...], tuple[str, ...]]]


@dataclass(frozen=True)
class AppliedSettings:
    """What the station applies to a distance, as recorded with each reading; the types are GeoCOM's numbers."""

    edm_mode: int = -1
    prism_type: int = -1
    prism_constant_m: float = 0.0
    ppm: float = 0.0


def measure_full(session: GeoComSession, applied: AppliedSettings) -> PolarReading:
    """Measure by DoMeasure (2008) and GetFullMeas (2167), which gives the station's own quality values as well."""
    tmc = session.geocom.tmc
    return _measure(
        session,
        applied,
        lambda: session.ask_flagged(lambda: tmc.get_complete_measurement(_WAIT_S, Inclination.AUTO)),
        distance_at=6,
    )


def measure_simple(session: GeoComSession, applied: AppliedSettings) -> PolarReading:
    """Measure by DoMeasure (2008) and GetSimpleMea (2108)."""
    tmc = session.geocom.tmc
    return _measure(
        session, applied, lambda: session.ask_flagged(lambda: tmc.get_simple_measurement(_WAIT_S)), distance_at=2
    )


def read_angles(session: GeoComSession) -> tuple[float, float]:
    """Hz and V of the telescope in radians (2107), without a measurement."""
    hz, v = session.ask(session.geocom.tmc.get_angle, changing=True)
    return _angle(session, float(hz), "Hz"), _angle(session, float(v), "V")


def _measure(session: GeoComSession, applied: AppliedSettings, fetch: _Fetch, distance_at: int) -> PolarReading:
    tmc = session.geocom.tmc
    session.command(lambda: tmc.do_measurement(Measurement.DISTANCE, Inclination.AUTO), idempotent=True)
    started = session.last_time
    values, flags = fetch()
    ended = session.last_time
    begin_s, end_s = started.t_rig_s - started.u_t_s, ended.t_rig_s + ended.u_t_s
    distance_m = float(values[distance_at])
    if not (math.isfinite(distance_m) and 0.0 < distance_m <= _LONGEST_DISTANCE_M):
        raise out_of_range(session, "slope distance", distance_m)
    v_rad = _angle(session, float(values[1]), "V")
    return PolarReading(
        hz_rad=_angle(session, float(values[0]), "Hz"),
        v_rad=v_rad,
        slope_distance_m=distance_m,
        face=face_of(v_rad),
        prism_constant_m=applied.prism_constant_m,
        ppm=applied.ppm,
        t_rig_s=0.5 * (begin_s + end_s),
        t_host_s=0.5 * (started.t_host_s + ended.t_host_s),
        u_t_s=0.5 * (end_s - begin_s),
        flags=flags,
        edm_mode=applied.edm_mode,
        prism_type=applied.prism_type,
    )


def _angle(session: GeoComSession, value: float, what: str) -> float:
    if not (math.isfinite(value) and -TWO_PI <= value <= 2.0 * TWO_PI):
        raise out_of_range(session, what, value)
    return value % TWO_PI
