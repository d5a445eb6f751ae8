"""What is compared, written and read back before a station may be used."""

from __future__ import annotations

import math
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
    """Who answers on the port."""

    name: str
    serial: int
    firmware: tuple[int, int, int]
    geocom: tuple[int, int, int]


@dataclass(frozen=True)
class StationSetup:
    """The steps of connecting to one station. All raise NoAnswer, ProtocolError, ConnectionFailed, StationError."""

    session: GeoComSession

    def set_precision(self) -> None:
        """Have values written with all digits, and read that back."""
        session, com = self.session, self.session.geocom.com
        session.ask(lambda: com.set_double_precision(_DIGITS), values=False)
        digits = session.ask(com.get_double_precision)
        if digits != _DIGITS:
            raise self._not_taken("number of digits", _DIGITS, digits)

    def read_identity(self, expected_serial: int | None) -> StationIdentity:
        """Who answers. Raises IdentityMismatch."""
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
        """Set the distance mode (2020) unless it is None; returns the one that is on."""
        tmc = self.session.geocom.tmc
        if mode is None:
            return self.read_distance_mode()
        self._set("distance mode", mode, lambda: tmc.set_edm_mode_v2(mode), tmc.get_edm_mode_v2)
        return int(mode.value)

    def read_distance_mode(self) -> int:
        """The distance mode that is on (2021), GeoCOM's number."""
        return int(self.session.ask(self.session.geocom.tmc.get_edm_mode_v2).value)

    def read_prism(self) -> tuple[int, float]:
        """Prism type (17009), GeoCOM's number, and prism constant in metres (2023)."""
        bap, tmc = self.session.geocom.bap, self.session.geocom.tmc
        return int(self.session.ask(bap.get_prism_type).value), float(self.session.ask(tmc.get_prism_correction))

    def has_settings(self, mode: EDMModeV2 | None, prism: Prism | None, constant_m: float) -> bool:
        """Whether the station has these settings; None for one that does not matter."""
        mode_now = self.read_distance_mode()
        prism_now, constant_now_m = self.read_prism()
        return (
            (mode is None or mode_now == mode.value)
            and (prism is None or prism_now == prism.value)
            and _same_constant(constant_now_m, constant_m)
        )

    def require_settings(self, mode: int, prism: int, constant_m: float, air: Air | None) -> None:
        """Raise SettingsChanged where distance mode, prism type, prism constant or air (None: not set) are others."""
        mode_now = self.read_distance_mode()
        prism_now, constant_now_m = self.read_prism()
        air_now = air if air is None else tuple(self.read_atmosphere()[1:])
        for what, same, wanted, found in (
            ("edm_mode", mode_now == mode, _name(EDMModeV2, mode), _name(EDMModeV2, mode_now)),
            ("prism_type", prism_now == prism, _name(Prism, prism), _name(Prism, prism_now)),
            ("prism_constant_m", _same_constant(constant_now_m, constant_m), constant_m, constant_now_m),
            ("air (hPa, dry and wet degC)", air is None or _same_air(air, air_now or ()), air, air_now),
        ):
            if not same:
                raise SettingsChanged(
                    self.session.device,
                    self.session.where,
                    f"{what} was set to {wanted} and is now {found}",
                    "leave its keyboard alone and connect again; readings since the last nest check are not used",
                )

    def set_prism(self, prism: Prism | None, constant_m: float) -> int:
        """Set prism type (17008) unless it is None and constant (2024); returns the type that is on then.

        Both are read back after the constant was set, which may bring another type with it.
        """
        if prism is not None:
            bap = self.session.geocom.bap
            self.session.ask(lambda: bap.set_prism_type(prism), values=False)
        self.session.ask(self.session.call(_SET_PRISM_CONSTANT, constant_m), values=False)
        kind, taken_m = self.read_prism()
        if prism is not None and kind != prism.value:
            raise self._not_taken("prism type", _name(Prism, int(prism.value)), _name(Prism, kind))
        if not _same_constant(taken_m, constant_m):
            raise self._not_taken("prism constant", constant_m, taken_m)
        return kind

    def read_atmosphere(self) -> Sequence[float]:
        """Wavelength in m, pressure in hPa, dry and wet temperature in degC, as the station holds them."""
        values: Sequence[float] = self.session.ask(self.session.geocom.tmc.get_atmospheric_corrections)
        if not all(math.isfinite(value) for value in values):
            raise self.out_of_range("atmosphere", values[0])
        return values

    def set_atmosphere(self, wavelength_m: float, temperature_c: float, pressure_hpa: float, humidity: float) -> Air:
        """Write the air (2028) and read it back; returns it as written."""
        wet_c = wet_bulb_c(temperature_c, pressure_hpa, humidity)
        air = (float(pressure_hpa), float(temperature_c), wet_c)
        self.session.ask(self.session.call(_SET_ATMOSPHERE, wavelength_m, *air), values=False)
        taken = tuple(self.read_atmosphere()[1:])
        if not _same_air(air, taken):
            raise self._not_taken("atmosphere", air, taken)
        return air

    def read_ppm(self, temperature_c: float, pressure_hpa: float, humidity: float) -> float:
        """The station's own ppm (2151) where it tells; else by the formula of its manual."""
        try:
            ppm = float(self.session.ask(self.session.geocom.tmc.get_atmospheric_correction_ppm))
        except NotImplementedByStation:
            return atmospheric_ppm(temperature_c, pressure_hpa, humidity)
        if not abs(ppm) < 1000.0:
            raise self.out_of_range("ppm", ppm)
        return ppm

    def out_of_range(self, what: str, value: float) -> ProtocolError:
        """A value that cannot be."""
        return ProtocolError(
            self.session.device, self.session.where, f"{what} of {value} cannot be", "measure again; check the line"
        )

    def _set(self, what: str, value: object, write: Callable[[], Any], read: Callable[[], Any]) -> None:
        self.session.ask(write, values=False)
        taken = self.session.ask(read)
        if taken != value:
            raise self._not_taken(what, value, taken)

    def _not_taken(self, what: str, asked: object, taken: object) -> ProtocolError:
        return ProtocolError(
            self.session.device,
            self.session.where,
            f"{what}: {asked} was set, {taken} is read back",
            _CHECK_SETTINGS,
        )


def _same_constant(one_m: float, other_m: float) -> bool:
    return abs(one_m - other_m) < _CONSTANT_TOLERANCE_M


def _same_air(one: Sequence[float], other: Sequence[float]) -> bool:
    return all(abs(a - b) <= _AIR_TOLERANCE for a, b in zip(one, other, strict=True))


def _name(kind: type[Enum], number: int) -> str:
    """As the rig file calls it; the number where there is no such name."""
    try:
        return kind(number).name.lower()
    except ValueError:
        return str(number)
