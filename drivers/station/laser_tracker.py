"""A laser station that speaks GeoCOM: aim at a reflector, measure it, say with which settings.

Units are SI, angles in radians. Another protocol beside GeoCOM would be another class with these methods.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum

from geocompy.geo.gcdata import ATR, ATRLock, EDMModeV2, Face, Inclination, Measurement, Position, Prism

from drivers.clock import HostClock, RigClock
from drivers.errors import LockLost, NoAnswer, NotSettled, ProtocolError, WrongTarget
from drivers.station.geocom import GeoComSession
from drivers.station.polar import (
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
from drivers.station.station_setup import Air, StationIdentity, StationSetup

__all__ = [
    "EDMModeV2",
    "LaserTracker",
    "LockState",
    "MeanReading",
    "PolarReading",
    "Prism",
    "SettleCriterion",
    "StationIdentity",
    "average",
    "cartesian_to_polar",
    "polar_to_cartesian",
    "to_face_one",
]

_TURN, _SEARCH, _FINE_ADJUST = 9027, 9029, 9037
_LONGEST_DISTANCE_M = 1000.0
_WAIT_S = 5


class LockState(Enum):
    """Whether the station follows a reflector (6021); predicted: it lost it a moment ago and extrapolates."""

    OUT = "not locked"
    IN = "locked"
    PREDICTED = "predicted"


_LOCK_STATES = {ATRLock.NONE: LockState.OUT, ATRLock.LOCK: LockState.IN, ATRLock.PREDICT: LockState.PREDICTED}


class LaserTracker:
    """One laser station on a serial port, pty or `socket://host:port`.

    Rig times come from `clock`; `reply_timeout_s` and `motion_timeout_s` are host time and only guards.
    Settings are those of the reflectors in use and are written and read back by `connect`; None for
    `edm_mode` or `prism_type` leaves the station's. With `checksums` they are used if the station can; where it
    cannot, each measured value is fetched twice and must come the same. The methods may be called from any
    thread; a point's aiming and measuring are one thread's business.
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
        checksums: bool = True,
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
        self._checksums = checksums
        self.settings_unchanged_on_connect = False
        self._settings = (-1, -1)
        self._air: Air | None = None
        self._wavelength_m = 0.0
        self._next_transaction = 0

    def connect(self) -> StationIdentity:
        """Open the port, learn who answers, set precision, distance mode and prism, read all back.

        `settings_unchanged_on_connect` then tells whether distance mode and prism were already those that are wanted.
        Raises ConnectionFailed, NoAnswer, ProtocolError (nonsense), IdentityMismatch, StationError.
        """
        self.close()
        self._air = None
        session = self._session = GeoComSession(
            self.name,
            self.port_url,
            self._clock,
            baudrate=self._baudrate,
            reply_timeout_s=self._reply_timeout_s,
            motion_timeout_s=self._motion_timeout_s,
            first_transaction=self._next_transaction,
        )
        try:
            if self._checksums:
                session.agree_on_checksums()
            else:
                session.ask(session.geocom.com.nullprocess, values=False)
            setup = StationSetup(session)
            setup.set_precision()
            self.identity = setup.read_identity(self._expected_serial)
            self.settings_unchanged_on_connect = setup.has_settings(
                self._edm_mode, self._prism_type, self.prism_constant_m
            )
            mode = setup.set_distance_mode(self._edm_mode)
            self._settings = (mode, setup.set_prism(self._prism_type, self.prism_constant_m))
            self._wavelength_m = setup.read_atmosphere()[0]
            self.ppm = setup.read_ppm(12.0, 1013.25, 0.6)
        except BaseException:
            self.close()
            raise
        return self.identity

    def close(self) -> None:
        """Close the port. May be called again."""
        session, self._session = self._session, None
        if session is not None:
            self._next_transaction = session.next_transaction
            session.close()

    @property
    def uses_checksums(self) -> bool:
        """Whether requests and answers carry checksums."""
        return self._open().uses_checksums

    def stop(self) -> None:
        """End a distance measurement that goes on (2008 with 'stop')."""
        tmc = self._open().geocom.tmc
        self._open().command(lambda: tmc.do_measurement(Measurement.STOP), idempotent=True)

    def set_atmosphere(self, temperature_c: float, pressure_hpa: float, humidity: float) -> float:
        """Give the air at the beam to the station and return its correction in ppm; `humidity` is 0 to 1.

        Raises ValueError for air that cannot be and ProtocolError if the station did not take it.
        """
        plausible = -40.0 <= temperature_c <= 70.0 and 500.0 <= pressure_hpa <= 1100.0 and 0.0 <= humidity <= 1.0
        if not plausible:
            raise ValueError(f"no such air: {temperature_c} degC, {pressure_hpa} hPa, humidity {humidity}")
        setup = StationSetup(self._open())
        self._air = None  # in doubt until it has been read back
        self._air = setup.set_atmosphere(self._wavelength_m, temperature_c, pressure_hpa, humidity)
        self.ppm = setup.read_ppm(temperature_c, pressure_hpa, humidity)
        return self.ppm

    def require_settings(self) -> None:
        """Raise SettingsChanged if distance mode, prism type, constant or air are not those that readings tell."""
        StationSetup(self._open()).require_settings(*self._settings, self.prism_constant_m, self._air)

    def point_and_aim(self, hz_rad: float, v_rad: float, window_rad: float = 0.01) -> None:
        """Turn near a direction (9027) and aim finely at the reflector in the window (9037).

        `window_rad` is the full width and height of the search. The direction decides the face.
        Raises TargetNotFound, MultipleTargets, AimingFailed, NoAnswer, ProtocolError.
        """
        if not all(math.isfinite(value) for value in (hz_rad, v_rad, window_rad)):
            raise ValueError("a direction must be finite")
        session = self._open()
        hz, v = hz_rad % TWO_PI, v_rad % TWO_PI
        session.command(session.call(_TURN, hz, v, Position.NORMAL.value, ATR.POSITION.value, 0), idempotent=True)
        self._fine_adjust(window_rad)

    def search(self, window_rad: float) -> None:
        """Look for a reflector around the line of sight (9029) and aim at it; full width and height in radians.

        Raises TargetNotFound, MultipleTargets, AimingFailed, NoAnswer, ProtocolError.
        """
        session = self._open()
        session.command(session.call(_SEARCH, float(window_rad), float(window_rad), 0), idempotent=True)

    def lock(self) -> None:
        """Follow the reflector that is aimed at (18007, 9013). Raises LockLost if there is none."""
        session, geocom = self._open(), self._open().geocom
        session.ask(lambda: geocom.aus.switch_user_lock(True), values=False)
        session.command(geocom.aut.lock_in, idempotent=True)

    def unlock(self) -> None:
        """Follow nothing."""
        aus = self._open().geocom.aus
        self._open().ask(lambda: aus.switch_user_lock(False), values=False)

    def lock_state(self) -> LockState:
        """Whether the station follows a reflector."""
        return _LOCK_STATES[self._open().ask(self._open().geocom.mot.get_lockon_status)]

    def keep_lock(self, hz_rad: float, v_rad: float, window_rad: float = 0.01) -> bool:
        """Make sure that a reflector is followed, aiming at its predicted direction if the lock was lost.

        Returns whether it had to be found again. Raises LockLost where it is found but not held, TargetNotFound.
        """
        if self.lock_state() is LockState.IN:
            return False
        self.point_and_aim(hz_rad, v_rad, window_rad)
        self.lock()
        if self.lock_state() is LockState.OUT:
            raise LockLost(self.name, self.port_url, "the lock is lost at once", "look for something in the beam", 8725)
        return True

    def change_face(self, window_rad: float = 0.01) -> None:
        """Turn to the other face (9028) and aim finely at the same reflector.

        Raises AimingFailed, NoAnswer, ProtocolError. A lost answer is cleared up by reading the face.
        """
        session, aut = self._open(), self._open().geocom.aut
        before = self.read_face()
        try:
            session.command(lambda: aut.change_face(Position.NORMAL, ATR.POSITION))
        except (NoAnswer, ProtocolError):
            if self.read_face() == before:
                session.command(lambda: aut.change_face(Position.NORMAL, ATR.POSITION))
        if self.read_face() == before:
            raise ProtocolError(self.name, self.port_url, "the face did not change", "check that it can turn freely")
        self._fine_adjust(window_rad)

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
        readings = self._measure_until_settled(settle) if settle else []
        readings = readings[-n:]
        readings += [self._measure_once() for _ in range(n - len(readings))]
        if two_face:
            self.change_face(window_rad)
            readings += [self._measure_once() for _ in range(n)]
        return readings

    def measure_averaged(self, n: int = 3, two_face: bool = False) -> MeanReading:
        """Mean of n readings on each face asked for, reduced to face 1, with its scatter."""
        return average(self.measure(n, two_face))

    def measure_simple(self) -> PolarReading:
        """One reading by the simple measurement (2108): quicker, without the station's own quality values."""
        session, tmc = self._open(), self._open().geocom.tmc
        return self._measure_with(lambda: session.ask_flagged(lambda: tmc.get_simple_measurement(_WAIT_S)), 2)

    def require_target(
        self, reading: PolarReading | MeanReading, expected_m: tuple[float, float, float], tolerance_m: float, name: str
    ) -> None:
        """Raise WrongTarget if a reading is farther than `tolerance_m` from where `name` was predicted (E, N, H)."""
        found_m = polar_to_cartesian(reading.hz_rad, reading.v_rad, reading.slope_distance_m)
        off_m = math.dist(found_m, expected_m)
        if not off_m <= tolerance_m:
            raise WrongTarget(
                self.name,
                self.port_url,
                f"SMR '{name}' was found {off_m * 1e3:.0f} mm from its predicted place",
                "check which reflector it sees, the station's place in the rig file and the machine file",
            )

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

    def _fine_adjust(self, window_rad: float) -> None:
        session = self._open()
        session.command(session.call(_FINE_ADJUST, float(window_rad), float(window_rad), 0), idempotent=True)

    def _measure_once(self) -> PolarReading:
        session, tmc = self._open(), self._open().geocom.tmc
        return self._measure_with(
            lambda: session.ask_flagged(lambda: tmc.get_complete_measurement(_WAIT_S, Inclination.AUTO)), 6
        )

    def _measure_with(
        self, fetch: Callable[[], tuple[tuple[float, ...], tuple[str, ...]]], distance_at: int
    ) -> PolarReading:
        session, tmc = self._open(), self._open().geocom.tmc
        session.command(lambda: tmc.do_measurement(Measurement.DISTANCE, Inclination.AUTO), idempotent=True)
        started = session.last_time
        values, flags = fetch()
        ended = session.last_time
        if not session.uses_checksums and fetch() != (values, flags):
            raise ProtocolError(
                self.name, self.port_url, "a measurement was fetched twice and came different", "check the line"
            )
        begin_s, end_s = started.t_rig_s - started.u_t_s, ended.t_rig_s + ended.u_t_s
        d_m = float(values[distance_at])
        if not (math.isfinite(d_m) and 0.0 < d_m <= _LONGEST_DISTANCE_M):
            raise self._out_of_range("slope distance", d_m)
        v = self._angle(float(values[1]), "V")
        return PolarReading(
            hz_rad=self._angle(float(values[0]), "Hz"),
            v_rad=v,
            slope_distance_m=d_m,
            face=face_of(v),
            prism_constant_m=self.prism_constant_m,
            ppm=self.ppm,
            t_rig_s=0.5 * (begin_s + end_s),
            t_host_s=0.5 * (started.t_host_s + ended.t_host_s),
            u_t_s=0.5 * (end_s - begin_s),
            flags=flags,
            edm_mode=self._settings[0],
            prism_type=self._settings[1],
        )

    def _measure_until_settled(self, criterion: SettleCriterion) -> list[PolarReading]:
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
        return StationSetup(self._open()).out_of_range(what, value)
