"""A GeoCOM station without its line: request lines in, answer lines out.

Answers the calls that a client of a measuring station makes; others with code 5 (not implemented).
Values have four decimals until COM_SetDoublePrecision (107). Fine adjustment and search windows are full widths.
A prism type brings its own constant with it, as of the stations' manuals; one that is set afterwards (2024) stays until
the next type. Distance modes differ only in duration, and all prism types are measured alike.
Not modelled: start-up and sleep, users and jobs, power search, image and keyboard calls, streaming.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import astuple

from mock_devices.faults import NO_FAULTS, FaultPlan
from mock_devices.lasting_state import StationState
from mock_devices.plant.base_plant import BasePlant
from mock_devices.station.geocom_line import LineError, Request, Value, format_answer, parse_request
from mock_devices.station.telescope import ANGLE_OK, OK, AimError, Air, Telescope, TelescopeReading

NAME, SERIAL, FIRMWARE, GEOCOM = "MOCK TDRA", 990001, (8, 10, 0), (1, 50, 0)

INVALID_PARAMETER = 2
NOT_IMPLEMENTED = 5
BUSY = 1293
NOT_ENABLED = 8714
COM_OFF = 3109

_PRISM_CONSTANTS_M = {0: 0.0, 1: 0.0175, 2: 0.0344, 3: 0.0231, 4: 0.0, 5: 0.0, 6: 0.0, 7: 0.03, 8: 0.0, 9: 0.0}
_MEASURING_COMMANDS = {1, 2, 6, 8, 10}
_ENDING_COMMANDS = {0, 3}
_SEARCH_S = 2.0
_SWITCH_ON = 111

Values = Sequence[Value]
Handler = Callable[..., Values]


class _Failure(Exception):
    def __init__(self, code: int) -> None:
        super().__init__(f"GeoCOM {code}")
        self.code = code


class MockStation:
    """The responder. Not safe for threads: one line serves one client at a time."""

    def __init__(self, plant: BasePlant, faults: FaultPlan = NO_FAULTS) -> None:
        self._plant = plant
        self._faults = faults
        self.telescope = Telescope(plant, faults)
        self._decimals = 4
        self._on = True
        self._atr = True
        self._lock = False
        self._prism_type = 0
        self._calls: dict[int, tuple[str, Handler]] = self._make_calls()

    def state(self) -> StationState:
        """The settings that outlive a restart."""
        air = self.telescope.air
        return StationState(
            prism_type=self._prism_type,
            prism_constant_m=self.telescope.prism_constant_m,
            edm_mode=self.telescope.edm_mode,
            wavelength_m=air.wavelength_m,
            pressure_hpa=air.pressure_hpa,
            dry_c=air.dry_c,
            wet_c=air.wet_c,
        )

    def restore(self, state: StationState) -> None:
        """Switch on with the settings of before."""
        self._prism_type = state.prism_type
        self.telescope.prism_constant_m, self.telescope.edm_mode = state.prism_constant_m, state.edm_mode
        self.telescope.air = Air(state.wavelength_m, state.pressure_hpa, state.dry_c, state.wet_c)

    def respond(self, line: bytes) -> bytes | None:
        """Answer one line (without its end), or None where a station stays silent. Never raises."""
        if line == b"c":
            self.telescope.clear()
            return b"?\r\n"
        if not line.startswith(b"%R1Q"):
            return None
        try:
            request = parse_request(line)
        except LineError as error:
            return format_answer(error.com_code, error.transaction, OK)
        if not self._on and request.rpc != _SWITCH_ON:
            return format_answer(COM_OFF, request.transaction, OK, checked=request.checked)
        code, values = self._execute(request)
        return format_answer(0, request.transaction, code, values, decimals=self._decimals, checked=request.checked)

    def _execute(self, request: Request) -> tuple[int, Values]:
        call = self._calls.get(request.rpc)
        if call is None:
            return NOT_IMPLEMENTED, ()
        kinds, handler = call
        if self._faults.strikes("tracker-busy"):
            return BUSY, ()
        try:
            return OK, handler(*_parameters(kinds, request.params))
        except (_Failure, AimError) as error:
            return error.code, ()

    def _make_calls(self) -> dict[int, tuple[str, Handler]]:
        """RPC number: kinds of its parameters (i integer, f real, b switch) and what it does."""
        telescope = self.telescope
        return {
            0: ("", lambda: ()),
            107: ("i", self._set_decimals),
            108: ("", lambda: (self._decimals,)),
            110: ("", lambda: GEOCOM),
            111: ("i", self._switch_on),
            112: ("i", self._switch_off),
            1004: ("b", lambda _on: ()),
            2003: ("i", self._full_angle),
            2107: ("i", lambda _mode: telescope.angles()),
            2008: ("ii", self._do_measure),
            2020: ("i", self._set_edm_mode),
            2021: ("", lambda: (telescope.edm_mode,)),
            2023: ("", lambda: (telescope.prism_constant_m,)),
            2024: ("f", self._set_prism_constant),
            2026: ("", lambda: (telescope.face,)),
            2028: ("ffff", self._set_air),
            2029: ("", lambda: astuple(telescope.air)),
            2082: ("ii", self._coordinates),
            2108: ("ii", lambda wait_ms, _mode: _polar(self._result(wait_ms))),
            2116: ("ii", lambda wait_ms, mode: self._coordinates(wait_ms, mode)[:3]),
            2117: ("", lambda: _polar(self._measure())),
            2151: ("", lambda: (telescope.ppm_set(),)),
            2167: ("ii", self._full_measurement),
            5003: ("", lambda: (SERIAL,)),
            5004: ("", lambda: (NAME,)),
            5009: ("", lambda: (12.6,)),
            5011: ("", lambda: (self._plant.thermal.air_c(self._now_s()) + 4.0,)),
            5034: ("", lambda: FIRMWARE),
            6021: ("", lambda: (int(telescope.locked is not None),)),
            9013: ("", self._lock_in),
            9018: ("b", self._switch_atr),
            9019: ("", lambda: (self._atr,)),
            9020: ("b", self._switch_lock),
            9021: ("", lambda: (self._lock,)),
            9027: ("ffiib", self._turn),
            9028: ("iib", self._change_face),
            9029: ("ffb", self._search),
            9037: ("ffb", self._fine_adjust),
            17008: ("i", self._set_prism_type),
            17009: ("", lambda: (self._prism_type,)),
            17017: ("i", self._measure_distance_angle),
            18007: ("b", self._switch_lock),
            18008: ("", lambda: (self._lock,)),
        }

    def _now_s(self) -> float:
        return self._plant.clock.now_s()

    # Settings.

    def _set_decimals(self, digits: int) -> Values:
        _demand(0 <= digits <= 15)
        self._decimals = digits
        return ()

    def _switch_on(self, _mode: int) -> Values:
        if self._on:
            raise _Failure(NOT_IMPLEMENTED)  # the answer of a station that is already on
        self._on = True
        return ()

    def _switch_off(self, _mode: int) -> Values:
        self._on = False
        return ()

    def _set_edm_mode(self, mode: int) -> Values:
        _demand(1 <= mode <= 13)
        self.telescope.edm_mode = mode
        return ()

    def _set_prism_type(self, prism: int) -> Values:
        _demand(prism in _PRISM_CONSTANTS_M)
        self._prism_type = prism
        self.telescope.prism_constant_m = _PRISM_CONSTANTS_M[prism]
        return ()

    def _set_prism_constant(self, constant_m: float) -> Values:
        _demand(abs(constant_m) < 0.2)
        self.telescope.prism_constant_m = constant_m
        return ()

    def _set_air(self, wavelength_m: float, pressure_hpa: float, dry_c: float, wet_c: float) -> Values:
        _demand(400.0 <= pressure_hpa <= 1200.0 and -60.0 <= wet_c <= dry_c + 0.01 and dry_c <= 80.0)
        air = self.telescope.air
        air.pressure_hpa, air.dry_c, air.wet_c = pressure_hpa, dry_c, wet_c
        if wavelength_m > 0.0:
            air.wavelength_m = wavelength_m  # a client with six decimals sends zero: kept as it was
        return ()

    def _switch_atr(self, on: bool) -> Values:
        self._atr = on
        return ()

    def _switch_lock(self, on: bool) -> Values:
        self._lock = on
        if not on:
            self.telescope.locked = None
        return ()

    # Aiming.

    def _turn(self, hz: float, v: float, _position: int, atr: int, _dummy: bool) -> Values:
        _demand(abs(hz) < 10.0 and abs(v) < 10.0)
        self.telescope.turn_to(hz, v)
        if atr:
            self._aim()
        return ()

    def _change_face(self, _position: int, atr: int, _dummy: bool) -> Values:
        self.telescope.change_face()
        if atr:
            self._aim()
        return ()

    def _fine_adjust(self, width: float, height: float, _dummy: bool) -> Values:
        self._aim(width, height)
        return ()

    def _search(self, width: float, height: float, _dummy: bool) -> Values:
        self._plant.clock.sleep_s(_SEARCH_S)
        self._aim(width, height)
        return ()

    def _aim(self, *window: float) -> None:
        if not self._atr:
            raise _Failure(NOT_ENABLED)
        _demand(all(0.0 <= side <= 2.0 * math.pi for side in window))
        self.telescope.aim(*window)

    def _lock_in(self) -> Values:
        if not self._lock:
            raise _Failure(NOT_ENABLED)
        self.telescope.lock_in()
        return ()

    # Measuring.

    def _do_measure(self, command: int, _mode: int) -> Values:
        _demand(command in _MEASURING_COMMANDS | _ENDING_COMMANDS)
        if command in _ENDING_COMMANDS:
            self.telescope.clear()
        else:
            self.telescope.start_measurement()
        return ()

    def _result(self, wait_ms: int) -> TelescopeReading:
        measured = self.telescope.finish(max(wait_ms, 0) * 1.0e-3)
        if measured is None:
            raise _Failure(ANGLE_OK)
        return measured

    def _measure(self) -> TelescopeReading:
        self.telescope.start_measurement()
        return self._result(round(1000.0 * self.telescope.duration_s()) + 1)

    def _full_measurement(self, wait_ms: int, _mode: int) -> Values:
        measured = self._result(wait_ms)
        accuracy = self._plant.settings.instrument.angle_sd_rad
        return (*_polar(measured)[:2], accuracy, 0.0, 0.0, accuracy, measured.distance_m, measured.t_s * 1.0e3)

    def _coordinates(self, wait_ms: int, _mode: int) -> Values:
        measured = self._result(wait_ms)
        horizontal = measured.distance_m * math.sin(measured.v_rad)
        east, north = horizontal * math.sin(measured.hz_rad), horizontal * math.cos(measured.hz_rad)
        up, t_ms = measured.distance_m * math.cos(measured.v_rad), round(measured.t_s * 1.0e3)
        return (east, north, up, t_ms, east, north, up, t_ms)

    def _measure_distance_angle(self, program: int) -> Values:
        if program == 1:  # angles only
            return (*self.telescope.angles(), 0.0, program)
        return (*_polar(self._measure()), program)

    def _full_angle(self, _mode: int) -> Values:
        hz, v = self.telescope.angles()
        accuracy, t_ms = self._plant.settings.instrument.angle_sd_rad, round(self._now_s() * 1.0e3)
        return (hz, v, accuracy, t_ms, 0.0, 0.0, accuracy, t_ms, self.telescope.face)


def _polar(measured: TelescopeReading) -> tuple[float, float, float]:
    return measured.hz_rad, measured.v_rad, measured.distance_m


def _demand(condition: bool) -> None:
    if not condition:
        raise _Failure(INVALID_PARAMETER)


def _parameters(kinds: str, texts: Sequence[str]) -> list[int | float | bool]:
    """Read parameters; a missing last switch ("dummy") counts as 0. Raises _Failure."""
    if kinds.endswith("b") and len(kinds) > 1 and len(texts) == len(kinds) - 1:
        texts = [*texts, "0"]
    _demand(len(texts) == len(kinds))
    try:
        values = [_parameter(kind, text) for kind, text in zip(kinds, texts, strict=True)]
    except ValueError:
        raise _Failure(INVALID_PARAMETER) from None
    _demand(all(math.isfinite(value) for value in values))
    return values


def _parameter(kind: str, text: str) -> int | float | bool:
    if kind == "f":
        return float(text)
    number = int(text)
    if abs(number) > 2**31:
        raise ValueError(text)
    return bool(number) if kind == "b" else number
