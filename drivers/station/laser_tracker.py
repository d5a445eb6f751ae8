"""A station that speaks GeoCOM: aim at a reflector, measure it, report the settings of the measurement.

Units are SI, angles in radians. A station with another protocol would be another class with these methods.
"""

from __future__ import annotations

import math
from dataclasses import replace
from enum import Enum

from geocompy.geo.gcdata import ATR, ATRLock, EDMModeV2, Face, Measurement, Position, Prism

from drivers.clock import HostClock, RigClock
from drivers.errors import LockLost, NoAnswer, NotSettled, ProtocolError, WrongTarget
from drivers.station.geocom import GeoComSession, StationLine
from drivers.station.polar import (
    TWO_PI,
    MeanReading,
    PolarReading,
    SettleCriterion,
    average,
    cartesian_to_polar,
    polar_to_cartesian,
    to_face_one,
    unrest,
)
from drivers.station.single_measurement import AppliedSettings, measure_full, measure_simple, read_angles
from drivers.station.station_setup import Air, StationIdentity, StationSettings, StationSetup

__all__ = [
    "EDMModeV2",
    "LaserTracker",
    "LockState",
    "MeanReading",
    "PolarReading",
    "Prism",
    "SettleCriterion",
    "StationIdentity",
    "StationLine",
    "StationSettings",
    "average",
    "cartesian_to_polar",
    "polar_to_cartesian",
    "to_face_one",
]

_TURN, _SEARCH, _FINE_ADJUST = 9027, 9029, 9037


class LockState(Enum):
    """Whether the station follows a reflector (6021); predicted: it has just lost it and extrapolates."""

    OUT = "not locked"
    IN = "locked"
    PREDICTED = "predicted"


_LOCK_STATES = {ATRLock.NONE: LockState.OUT, ATRLock.LOCK: LockState.IN, ATRLock.PREDICT: LockState.PREDICTED}


class LaserTracker:
    """A laser tracker, the station of the rig, on a serial port, pty or `socket://host:port`.

    Rig times come from `clock`; the time-outs of `line` are host time and only guards. The methods may be called from
    any thread, but one thread aims at a point and measures it.
    """

    def __init__(
        self,
        port_url: str,
        clock: RigClock | None = None,
        *,
        name: str = "station",
        line: StationLine | None = None,
        settings: StationSettings | None = None,
        expected_serial: int | None = None,
    ) -> None:
        self.name = name
        self.port_url = port_url
        self.identity: StationIdentity | None = None
        self.settings_unchanged_on_connect = False
        self._clock = clock or HostClock()
        self._session: GeoComSession | None = None
        self._line, self._settings = line or StationLine(), settings or StationSettings()
        self._expected_serial = expected_serial
        self._applied = AppliedSettings(prism_constant_m=float(self._settings.prism_constant_m))
        self._air: Air | None = None
        self._wavelength_m = 0.0
        self._next_transaction = 0

    def connect(self) -> StationIdentity:
        """Open the port, identify the station, set precision, distance mode and prism, and read all back.

        `settings_unchanged_on_connect` is then whether distance mode and prism were already those of `settings`.
        Raises ConnectionFailed, NoAnswer, ProtocolError (unintelligible answer), IdentityMismatch, StationError.
        """
        self.close()
        self._air = None
        session = self._session = GeoComSession(
            self.name, self.port_url, self._clock, self._line, first_transaction=self._next_transaction
        )
        try:
            if self._settings.checksums:
                session.agree_on_checksums()
            else:
                session.ask(session.geocom.com.nullprocess, values=False)
            setup = StationSetup(session)
            setup.set_precision()
            self.identity = setup.read_identity(self._expected_serial)
            self.settings_unchanged_on_connect = setup.has_settings(self._settings)
            self._applied = AppliedSettings(
                edm_mode=setup.set_distance_mode(self._settings.edm_mode),
                prism_type=setup.set_prism(self._settings.prism_type, self.prism_constant_m),
                prism_constant_m=self.prism_constant_m,
            )
            self._wavelength_m = setup.read_atmosphere()[0]
            self._applied = replace(self._applied, ppm=setup.read_ppm(12.0, 1013.25, 0.6))
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
    def prism_constant_m(self) -> float:
        """The prism constant that the station applies to distances."""
        return self._applied.prism_constant_m

    @property
    def ppm(self) -> float:
        """The atmospheric correction that the station applies to distances."""
        return self._applied.ppm

    @property
    def uses_checksums(self) -> bool:
        """Whether requests and answers carry checksums."""
        return self._open().uses_checksums

    def stop(self) -> None:
        """Stop a distance measurement in progress (2008 with 'stop')."""
        tmc = self._open().geocom.tmc
        self._open().command(lambda: tmc.do_measurement(Measurement.STOP), idempotent=True)

    def set_atmosphere(self, temperature_c: float, pressure_hpa: float, humidity: float) -> float:
        """Set the air along the beam in the station and return its correction in ppm; `humidity` is 0 to 1.

        Raises ValueError for implausible values and ProtocolError if the station did not accept them.
        """
        plausible = -40.0 <= temperature_c <= 70.0 and 500.0 <= pressure_hpa <= 1100.0 and 0.0 <= humidity <= 1.0
        if not plausible:
            raise ValueError(f"implausible air: {temperature_c} degC, {pressure_hpa} hPa, humidity {humidity}")
        setup = StationSetup(self._open())
        self._air = None  # in doubt until it has been read back
        self._air = setup.set_atmosphere(self._wavelength_m, temperature_c, pressure_hpa, humidity)
        self._applied = replace(self._applied, ppm=setup.read_ppm(temperature_c, pressure_hpa, humidity))
        return self.ppm

    def require_settings(self) -> None:
        """Raise SettingsChanged unless distance mode, prism type, constant and air are those recorded with readings."""
        applied = self._applied
        StationSetup(self._open()).require_settings(
            applied.edm_mode, applied.prism_type, applied.prism_constant_m, self._air
        )

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
        """Follow the reflector in the line of sight (18007, 9013). Raises LockLost if there is none."""
        session, geocom = self._open(), self._open().geocom
        session.ask(lambda: geocom.aus.switch_user_lock(True), values=False)
        session.command(geocom.aut.lock_in, idempotent=True)

    def unlock(self) -> None:
        """Stop following a reflector."""
        aus = self._open().geocom.aus
        self._open().ask(lambda: aus.switch_user_lock(False), values=False)

    def lock_state(self) -> LockState:
        """Whether the station follows a reflector."""
        return _LOCK_STATES[self._open().ask(self._open().geocom.mot.get_lockon_status, changing=True)]

    def keep_lock(self, hz_rad: float, v_rad: float, window_rad: float = 0.01) -> bool:
        """Make sure that a reflector is followed; if the lock was lost, aim at the predicted direction.

        Returns whether it had to be found again. Raises LockLost if it is found but not held, TargetNotFound.
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

        After a lost answer the face is read. Raises AimingFailed, NoAnswer, ProtocolError.
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
        """Measure the reflector in the line of sight `n` times and return each single reading.

        Each takes two exchanges, the minimum for angles, distance and quality code. With `two_face` another n follow on
        the other face. With `settle` a window of readings must be at rest first; the window counts towards the n.
        Raises SignalError, AngleOnly, NotSettled, NoAnswer, ProtocolError.
        """
        if n < 1:
            raise ValueError(f"n must be at least 1, not {n}")
        readings = self._measure_until_settled(settle) if settle else []
        readings = readings[-n:]
        readings += [measure_full(self._open(), self._applied) for _ in range(n - len(readings))]
        if two_face:
            self.change_face(window_rad)
            readings += [measure_full(self._open(), self._applied) for _ in range(n)]
        return readings

    def measure_averaged(self, n: int = 3, two_face: bool = False) -> MeanReading:
        """Mean of n readings on one or both faces, reduced to face 1, with its scatter."""
        return average(self.measure(n, two_face))

    def measure_simple(self) -> PolarReading:
        """One reading by the simple measurement (2108): faster, without the station's own quality values."""
        return measure_simple(self._open(), self._applied)

    def require_target(
        self, reading: PolarReading | MeanReading, expected_m: tuple[float, float, float], tolerance_m: float, name: str
    ) -> None:
        """Raise WrongTarget if a reading is over `tolerance_m` from the predicted position of `name` (E, N, H)."""
        measured_m = polar_to_cartesian(reading.hz_rad, reading.v_rad, reading.slope_distance_m)
        distance_m = math.dist(measured_m, expected_m)
        if not distance_m <= tolerance_m:
            raise WrongTarget(
                self.name,
                self.port_url,
                f"SMR '{name}' was found {distance_m * 1e3:.0f} mm from its predicted place",
                "check which reflector it sees, the station's place in the rig file and the machine file",
            )

    def read_face(self) -> int:
        """The face that the telescope is on: 1 or 2."""
        face = self._open().ask(self._open().geocom.tmc.get_face)
        return 1 if face is Face.F1 else 2

    def read_angles(self) -> tuple[float, float]:
        """Hz and V of the telescope in radians (2107), without a measurement."""
        return read_angles(self._open())

    def _open(self) -> GeoComSession:
        if self._session is None:
            raise RuntimeError(f"{self.name} is not connected: call connect() first")
        return self._session

    def _fine_adjust(self, window_rad: float) -> None:
        session = self._open()
        session.command(session.call(_FINE_ADJUST, float(window_rad), float(window_rad), 0), idempotent=True)

    def _measure_until_settled(self, criterion: SettleCriterion) -> list[PolarReading]:
        end_s = self._clock.now_s() + criterion.limit_s
        readings: list[PolarReading] = []
        while True:
            readings = [*readings, measure_full(self._open(), self._applied)][-criterion.window :]
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
