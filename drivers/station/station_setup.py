"""What is compared, written and read back before a station is used."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

from geocompy.geo.gcdata import EDMModeV2, Prism

from drivers.errors import IdentityMismatch, NotImplementedByStation, ProtocolError, SettingsChanged
from drivers.station.atmosphere import atmospheric_ppm, wet_bulb_c
from drivers.station.geocom import GeoComSession

_SET_ATMOSPHERE, _SET_PRISM_CONSTANT = 2028, 2024
_DIGITS = 15
_CONSTANT_TOLERANCE_M = 1e-6
_AIR_TOLERANCE = 1e-3  # hPa and degC
_CHECK_SETTINGS = "check the station's configuration and connect again"

Air = tuple[float, float, float]  # pressure in hPa, dry and wet temperature in degC


@dataclass(frozen=True)
class StationIdentity:
    """Which station answers on the port."""

    name: str
    serial: int
    firmware: tuple[int, int, int]
    geocom: tuple[int, int, int]

    @property
    def simulated(self) -> bool:
        """Whether the name says so: by the word MOCK or SIMULATED (docs/reference/devices.md)."""
        return any(word in ("MOCK", "SIMULATED") for word in re.split(r"[^A-Z0-9]+", self.name.upper()))


@dataclass(frozen=True)
class StationSettings:
    """What `connect` writes to a station and reads back: the settings of the reflectors in use.

    None for `edm_mode` or `prism_type` keeps the station's own. With `checksums` they are used if the station supports
    them; otherwise each measured value is fetched twice and must be the same both times.
    """

    edm_mode: EDMModeV2 | None = EDMModeV2.SINGLE_STANDARD
    prism_type: Prism | None = Prism.MINI
    prism_constant_m: float = 0.0
    checksums: bool = True


@dataclass(frozen=True)
class StationSetup:
    """The steps of connecting to one station. All raise NoAnswer, ProtocolError, ConnectionFailed, StationError."""

    session: GeoComSession

    def set_precision(self) -> None:
        """Have the station send all digits, and read that back."""
        session, com = self.session, self.session.geocom.com
        session.ask(lambda: com.set_double_precision(_DIGITS), values=False)
        digits = session.ask(com.get_double_precision)
        if digits != _DIGITS:
            raise self._setting_refused("number of digits", _DIGITS, digits)

    def read_identity(self, expected_serial: int | None) -> StationIdentity:
        """Read the identity. Raises IdentityMismatch."""
        session, csv, com = self.session, self.session.geocom.csv, self.session.geocom.com
        identity = StationIdentity(
            name=session.ask(csv.get_instrument_name),
            serial=session.ask(csv.get_serial_number),
            firmware=session.ask(csv.get_firmware_version),
            geocom=session.ask(com.get_geocom_version),
        )
        if expected_serial not in (None, identity.serial):
            raise IdentityMismatch(
                session.device,
                session.where,
                f"serial number {identity.serial} answers, {expected_serial} is configured",
                "connect the right station or correct the rig file",
            )
        return identity

    def set_distance_mode(self, mode: EDMModeV2 | None) -> int:
        """Set the distance mode (2020) unless it is None; returns the active one."""
        tmc = self.session.geocom.tmc
        if mode is None:
            return self.read_distance_mode()
        self._set("distance mode", mode, lambda: tmc.set_edm_mode_v2(mode), tmc.get_edm_mode_v2)
        return int(mode.value)

    def read_distance_mode(self) -> int:
        """The active distance mode (2021), GeoCOM's number."""
        return int(self.session.ask(self.session.geocom.tmc.get_edm_mode_v2).value)

    def read_prism(self) -> tuple[int, float]:
        """Prism type (17009), GeoCOM's number, and prism constant in metres (2023)."""
        bap, tmc = self.session.geocom.bap, self.session.geocom.tmc
        return int(self.session.ask(bap.get_prism_type).value), float(self.session.ask(tmc.get_prism_correction))

    def has_settings(self, settings: StationSettings) -> bool:
        """Whether the station has this distance mode, prism type and constant already."""
        mode, prism = settings.edm_mode, settings.prism_type
        mode_now = self.read_distance_mode()
        prism_now, constant_now_m = self.read_prism()
        return (
            (mode is None or mode_now == mode.value)
            and (prism is None or prism_now == prism.value)
            and _same_constant(constant_now_m, settings.prism_constant_m)
        )

    def require_settings(self, mode: int, prism: int, constant_m: float, air: Air | None) -> None:
        """Raise SettingsChanged if distance mode, prism type, prism constant or air (None: not set) differ."""
        mode_now = self.read_distance_mode()
        prism_now, constant_now_m = self.read_prism()
        air_now = air if air is None else tuple(self.read_atmosphere()[1:])
        for what, same, required_value, value_on_station in (
            ("edm_mode", mode_now == mode, _name(EDMModeV2, mode), _name(EDMModeV2, mode_now)),
            ("prism_type", prism_now == prism, _name(Prism, prism), _name(Prism, prism_now)),
            ("prism_constant_m", _same_constant(constant_now_m, constant_m), constant_m, constant_now_m),
            ("air (hPa, dry and wet degC)", air is None or _same_air(air, air_now or ()), air, air_now),
        ):
            if not same:
                raise SettingsChanged(
                    self.session.device,
                    self.session.where,
                    f"{what} was set to {required_value} and is now {value_on_station}",
                    "do not use its keyboard; connect again; readings since the last nest check are not used",
                )

    def set_prism(self, prism: Prism | None, constant_m: float) -> int:
        """Set prism type (17008) unless it is None and constant (2024); returns the type that is then active.

        Both are read back after the constant was set, which may change the type.
        """
        if prism is not None:
            bap = self.session.geocom.bap
            self.session.ask(lambda: bap.set_prism_type(prism), values=False)
        self.session.ask(self.session.call(_SET_PRISM_CONSTANT, constant_m), values=False)
        active_prism, constant_read_back_m = self.read_prism()
        if prism is not None and active_prism != prism.value:
            raise self._setting_refused("prism type", _name(Prism, int(prism.value)), _name(Prism, active_prism))
        if not _same_constant(constant_read_back_m, constant_m):
            raise self._setting_refused("prism constant", constant_m, constant_read_back_m)
        return active_prism

    def read_atmosphere(self) -> Sequence[float]:
        """Wavelength in m, pressure in hPa, dry and wet temperature in degC, as set in the station."""
        values: Sequence[float] = self.session.ask(self.session.geocom.tmc.get_atmospheric_corrections)
        if not all(math.isfinite(value) for value in values):
            raise out_of_range(self.session, "atmosphere", values[0])
        return values

    def set_atmosphere(self, wavelength_m: float, temperature_c: float, pressure_hpa: float, humidity: float) -> Air:
        """Write the air (2028) and read it back; returns it as written."""
        wet_c = wet_bulb_c(temperature_c, pressure_hpa, humidity)
        air = (float(pressure_hpa), float(temperature_c), wet_c)
        self.session.ask(self.session.call(_SET_ATMOSPHERE, wavelength_m, *air), values=False)
        value_read_back = tuple(self.read_atmosphere()[1:])
        if not _same_air(air, value_read_back):
            raise self._setting_refused("atmosphere", air, value_read_back)
        return air

    def read_ppm(self, temperature_c: float, pressure_hpa: float, humidity: float) -> float:
        """The station's own ppm (2151) if it reports it, otherwise by the formula of its manual."""
        try:
            ppm = float(self.session.ask(self.session.geocom.tmc.get_atmospheric_correction_ppm))
        except NotImplementedByStation:
            return atmospheric_ppm(temperature_c, pressure_hpa, humidity)
        if not abs(ppm) < 1000.0:
            raise out_of_range(self.session, "ppm", ppm)
        return ppm

    def _set(self, what: str, value: object, write: Callable[[], Any], read: Callable[[], Any]) -> None:
        self.session.ask(write, values=False)
        value_read_back = self.session.ask(read)
        if value_read_back != value:
            raise self._setting_refused(what, value, value_read_back)

    def _setting_refused(self, what: str, requested_value: object, value_read_back: object) -> ProtocolError:
        return ProtocolError(
            self.session.device,
            self.session.where,
            f"{what}: {requested_value} was set, {value_read_back} is read back",
            _CHECK_SETTINGS,
        )


def out_of_range(session: GeoComSession, what: str, value: float) -> ProtocolError:
    """The error for a value that is not possible."""
    return ProtocolError(session.device, session.where, f"{what} of {value} cannot be", "measure again; check the line")


def _same_constant(one_m: float, other_m: float) -> bool:
    return abs(one_m - other_m) < _CONSTANT_TOLERANCE_M


def _same_air(one: Sequence[float], other: Sequence[float]) -> bool:
    return all(abs(a - b) <= _AIR_TOLERANCE for a, b in zip(one, other, strict=True))


def _name(kind: type[Enum], number: int) -> str:
    """The name in the rig file, or the number if there is none."""
    try:
        return kind(number).name.lower()
    except ValueError:
        return str(number)
