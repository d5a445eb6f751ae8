"""A laser station that speaks GeoCOM: aim at a reflector, measure it, say with which settings.

Units are SI, angles in radians. Another protocol beside GeoCOM would be another class with these methods.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from geocompy.geo.gcdata import ATR, EDMModeV2, Face, Inclination, Measurement, Position, Prism

from drivers.atmosphere import atmospheric_ppm, wet_bulb_c
from drivers.clock import HostClock, RigClock
from drivers.errors import IdentityMismatch, NotImplementedByStation, NotSettled, ProtocolError
from drivers.geocom import GeoComSession
from drivers.polar import (
    TWO_PI,
    MeanReading,
    PolarReading,
    SettleCriterion,
    average,
    cartesian_to_polar,
    face_of,
    polar_to_cartesian,
    to_face_one,
    unrest,
)

__all__ = [
    "LaserTracker",
    "MeanReading",
    "PolarReading",
    "SettleCriterion",
    "StationIdentity",
    "average",
    "cartesian_to_polar",
    "polar_to_cartesian",
    "to_face_one",
]

_TURN, _FINE_ADJUST, _SET_ATMOSPHERE, _SET_PRISM_CONSTANT = 9027, 9037, 2028, 2024
_DIGITS = 15
_LONGEST_DISTANCE_M = 1000.0
_WAIT_S = 5
_CHECK_SETTINGS = "check the station's configuration and connect again"


@dataclass(frozen=True)
class StationIdentity:
    """Who answers on the port."""

    name: str
    serial: int
    firmware: tuple[int, int, int]
    geocom: tuple[int, int, int]


class LaserTracker:
    """One laser station on a serial port, pty or `socket://host:port`.

    Rig times come from `clock`; `reply_timeout_s` and `motion_timeout_s` are host time and only guards.
    Settings are those of the reflectors in use and are written and read back by `connect`; None for
    `edm_mode` or `prism_type` leaves the station's. The methods may be called from any thread; a point's
    aiming and measuring are one thread's business.
    """

    def __init__(
        self,
        port_url: str,
        clock: RigClock | None = None,
        *,
        name: str = "laser tracker",
        baudrate: int = 115200,
        reply_timeout_s: float = 5.0,
        motion_timeout_s: float = 30.0,
        expected_serial: int | None = None,
        edm_mode: EDMModeV2 | None = EDMModeV2.SINGLE_STANDARD,
        prism_type: Prism | None = Prism.MINI,
        prism_constant_m: float = 0.0,
    ) -> None:
        self.name = name
        self.port_url = port_url
        self.identity: StationIdentity | None = None
        self.prism_constant_m = float(prism_constant_m)
        self.ppm = 0.0
        self._clock = clock or HostClock()
        self._session: GeoComSession | None = None
        self._baudrate = baudrate
        self._reply_timeout_s = reply_timeout_s
        self._motion_timeout_s = motion_timeout_s
        self._expected_serial = expected_serial
        self._edm_mode = edm_mode
        self._prism_type = prism_type
        self._wavelength = 0.0

    def connect(self) -> StationIdentity:
        """Open the port, learn who answers, set precision, distance mode and prism, read all back.

        Raises ConnectionFailed, NoAnswer, ProtocolError (nonsense), IdentityMismatch, StationError.
        """
        self.close()
        self._session = GeoComSession(
            self.name,
            self.port_url,
            self._clock,
            baudrate=self._baudrate,
            reply_timeout_s=self._reply_timeout_s,
            motion_timeout_s=self._motion_timeout_s,
        )
        try:
            self._session.ask(self._session.geocom.com.nullprocess, values=False)
            self._set_precision()
            self.identity = self._read_identity()
            self._set_distance_mode()
            self._set_prism()
            self._wavelength = self._read_atmosphere()[0]
            self.ppm = self._read_ppm(12.0, 1013.25, 0.6)
        except BaseException:
            self.close()
            raise
        return self.identity

    def close(self) -> None:
        """Close the port. May be called again."""
        session, self._session = self._session, None
        if session is not None:
            session.close()

    def stop(self) -> None:
        """End a distance measurement that goes on (2008 with 'stop')."""
        tmc = self._open().geocom.tmc
        self._open().command(lambda: tmc.do_measurement(Measurement.STOP))

    def set_atmosphere(self, temperature_c: float, pressure_hpa: float, humidity: float) -> float:
        """Give the air at the beam to the station and return its correction in ppm; `humidity` is 0 to 1.

        Raises ValueError for air that cannot be and ProtocolError if the station did not take it.
        """
        plausible = -40.0 <= temperature_c <= 70.0 and 500.0 <= pressure_hpa <= 1100.0 and 0.0 <= humidity <= 1.0
        if not plausible:
            raise ValueError(f"no such air: {temperature_c} degC, {pressure_hpa} hPa, humidity {humidity}")
        session = self._open()
        wet_c = wet_bulb_c(temperature_c, pressure_hpa, humidity)
        asked = (self._wavelength, float(pressure_hpa), float(temperature_c), wet_c)
        session.ask(session.call(_SET_ATMOSPHERE, *asked), values=False)
        taken = self._read_atmosphere()
        if any(abs(a - b) > 1e-3 for a, b in zip(asked[1:], taken[1:], strict=True)):
            raise self._not_taken("atmosphere", asked, taken)
        self.ppm = self._read_ppm(temperature_c, pressure_hpa, humidity)
        return self.ppm

    def point_and_aim(self, hz_rad: float, v_rad: float, window_rad: float = 0.01) -> None:
        """Turn near a direction (9027) and aim finely at the reflector in the window (9037).

        `window_rad` is the full width and height of the search. The direction decides the face.
        Raises TargetNotFound, MultipleTargets, AimingFailed, NoAnswer, ProtocolError.
        """
        if not all(math.isfinite(value) for value in (hz_rad, v_rad, window_rad)):
            raise ValueError("a direction must be finite")
        session = self._open()
        hz, v = hz_rad % TWO_PI, v_rad % TWO_PI
        session.command(session.call(_TURN, hz, v, Position.NORMAL.value, ATR.POSITION.value, 0))
        session.command(session.call(_FINE_ADJUST, float(window_rad), float(window_rad), 0))

    def change_face(self, window_rad: float = 0.01) -> None:
        """Turn to the other face (9028) and aim finely at the same reflector."""
        session, aut = self._open(), self._open().geocom.aut
        session.command(lambda: aut.change_face(Position.NORMAL, ATR.POSITION))
        session.command(lambda: aut.fine_adjust(window_rad, window_rad))

    def measure(
        self,
        n: int = 1,
        two_face: bool = False,
        settle: SettleCriterion | None = None,
        window_rad: float = 0.01,
    ) -> list[PolarReading]:
        """Measure the reflector that is aimed at `n` times and return each single reading.

        Each takes two exchanges, the fewest that give angles, distance and the code of quality:
        DoMeasure (2008) and GetFullMeas (2167). With `two_face` another n follow on the other face.
        With `settle` a window of readings must be at rest first; the window counts towards the n.
        Raises SignalError, AngleOnly, NotSettled, NoAnswer, ProtocolError.
        """
        if n < 1:
            raise ValueError(f"n must be at least 1, not {n}")
        readings = self._settled(settle) if settle else []
        readings = readings[-n:]
        readings += [self._measure_once() for _ in range(n - len(readings))]
        if two_face:
            self.change_face(window_rad)
            readings += [self._measure_once() for _ in range(n)]
        return readings

    def read_face(self) -> int:
        """The face that the telescope is on: 1 or 2."""
        face = self._open().ask(self._open().geocom.tmc.get_face)
        return 1 if face is Face.F1 else 2

    def read_angles(self) -> tuple[float, float]:
        """Hz and V of the telescope in radians (2107), without a measurement."""
        hz, v = self._open().ask(self._open().geocom.tmc.get_angle)
        return self._angle(float(hz), "Hz"), self._angle(float(v), "V")

    def _open(self) -> GeoComSession:
        if self._session is None:
            raise RuntimeError(f"{self.name} is not connected: call connect() first")
        return self._session

    def _measure_once(self) -> PolarReading:
        session, tmc = self._open(), self._open().geocom.tmc
        session.command(lambda: tmc.do_measurement(Measurement.DISTANCE, Inclination.AUTO))
        started = session.last_time
        values, flags = session.ask_flagged(lambda: tmc.get_complete_measurement(_WAIT_S, Inclination.AUTO))
        ended = session.last_time
        begin_s, end_s = started.t_rig_s - started.u_t_s, ended.t_rig_s + ended.u_t_s
        hz, v, d = float(values[0]), float(values[1]), float(values[6])
        if not (math.isfinite(d) and 0.0 < d <= _LONGEST_DISTANCE_M):
            raise self._out_of_range("slope distance", d)
        v = self._angle(v, "V")
        return PolarReading(
            hz_rad=self._angle(hz, "Hz"),
            v_rad=v,
            slope_distance_m=d,
            face=face_of(v),
            prism_constant_m=self.prism_constant_m,
            ppm=self.ppm,
            t_rig_s=0.5 * (begin_s + end_s),
            t_host_s=0.5 * (started.t_host_s + ended.t_host_s),
            u_t_s=0.5 * (end_s - begin_s),
            flags=flags,
        )

    def _settled(self, criterion: SettleCriterion) -> list[PolarReading]:
        end_s = self._clock.now_s() + criterion.limit_s
        readings: list[PolarReading] = []
        while True:
            readings = [*readings, self._measure_once()][-criterion.window :]
            if len(readings) == criterion.window:
                across_m, along_m = unrest(readings)
                if across_m <= criterion.across_m and along_m <= criterion.along_m:
                    return readings
                if self._clock.now_s() >= end_s:
                    raise NotSettled(
                        self.name,
                        self.port_url,
                        f"not steady in {criterion.limit_s:g} s: {across_m * 1e6:.0f} um across,"
                        f" {along_m * 1e6:.0f} um along the line of sight",
                        "look for vibration, a loose reflector or a moving stand",
                    )

    def _angle(self, value: float, what: str) -> float:
        if not (math.isfinite(value) and -TWO_PI <= value <= 2.0 * TWO_PI):
            raise self._out_of_range(what, value)
        return value % TWO_PI

    def _out_of_range(self, what: str, value: float) -> ProtocolError:
        return ProtocolError(self.name, self.port_url, f"{what} of {value} cannot be", "measure again; check the line")

    def _set_precision(self) -> None:
        session, com = self._open(), self._open().geocom.com
        session.ask(lambda: com.set_double_precision(_DIGITS), values=False)
        digits = session.ask(com.get_double_precision)
        if digits != _DIGITS:
            raise self._not_taken("number of digits", _DIGITS, digits)

    def _read_identity(self) -> StationIdentity:
        session, csv, com = self._open(), self._open().geocom.csv, self._open().geocom.com
        identity = StationIdentity(
            name=session.ask(csv.get_instrument_name),
            serial=session.ask(csv.get_serial_number),
            firmware=session.ask(csv.get_firmware_version),
            geocom=session.ask(com.get_geocom_version),
        )
        if self._expected_serial not in (None, identity.serial):
            raise IdentityMismatch(
                self.name,
                self.port_url,
                f"serial number {identity.serial} answers, {self._expected_serial} is configured",
                "connect the right station or correct the rig file",
            )
        return identity

    def _set_distance_mode(self) -> None:
        mode, tmc = self._edm_mode, self._open().geocom.tmc
        if mode is not None:
            self._set("distance mode", mode, lambda: tmc.set_edm_mode_v2(mode), tmc.get_edm_mode_v2)

    def _set_prism(self) -> None:
        prism, bap, tmc = self._prism_type, self._open().geocom.bap, self._open().geocom.tmc
        if prism is not None:
            self._set("prism type", prism, lambda: bap.set_prism_type(prism), bap.get_prism_type)
        constant_m = self.prism_constant_m
        self._open().ask(self._open().call(_SET_PRISM_CONSTANT, constant_m), values=False)
        taken_m = self._open().ask(tmc.get_prism_correction)
        if not abs(taken_m - constant_m) < 1e-6:
            raise self._not_taken("prism constant", constant_m, taken_m)

    def _set(self, what: str, value: object, write: Callable[[], Any], read: Callable[[], Any]) -> None:
        self._open().ask(write, values=False)
        taken = self._open().ask(read)
        if taken != value:
            raise self._not_taken(what, value, taken)

    def _read_atmosphere(self) -> Sequence[float]:
        values: Sequence[float] = self._open().ask(self._open().geocom.tmc.get_atmospheric_corrections)
        if not all(math.isfinite(value) for value in values):
            raise self._out_of_range("atmosphere", values[0])
        return values

    def _read_ppm(self, temperature_c: float, pressure_hpa: float, humidity: float) -> float:
        """The station's own ppm (2151) where it tells; else by the formula of its manual."""
        try:
            ppm = float(self._open().ask(self._open().geocom.tmc.get_atmospheric_correction_ppm))
        except NotImplementedByStation:
            return atmospheric_ppm(temperature_c, pressure_hpa, humidity)
        if not abs(ppm) < 1000.0:
            raise self._out_of_range("ppm", ppm)
        return ppm

    def _not_taken(self, what: str, asked: object, taken: object) -> ProtocolError:
        return ProtocolError(
            self.name, self.port_url, f"{what}: {asked} was set, {taken} is read back", _CHECK_SETTINGS
        )
