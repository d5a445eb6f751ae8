"""What the mock PLC knows and does, and how that stands in its registers (docs/reference/plc.md)."""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable, Sequence

from mock_devices.faults import NO_FAULTS, FaultPlan
from mock_devices.plant.base_plant import BasePlant
from mock_devices.plant.thermal import SENSORS
from mock_devices.settings import PlcReading

REGISTERS = 60
CHANGING = 0xFFFF
GOOD_INTERLOCKS = 0b1111
DONE, REFUSED, IN_PROGRESS = 0, 1, 2

_HEARTBEAT_PERIOD_S = 0.1
_SIMULATED_AT, _SIMULATED = 18, int.from_bytes(b"SI", "big")
_ACKNOWLEDGE_AT = 19
_RELEASE_AT = 20
_AUTOMATIC_AT = 21  # 1: the automatic mode is granted
_TOLD_AT, _TOLD = 22, 3  # words that the master tells: state, days left, alarm
_MASTER_HEARTBEAT, _SEQUENCE, _MASTER_SEEN = 30, 31, 36
_FOREIGN = 0x5A5A
_REQUEST_PAYLOAD = 1
_FLOATS_AT = 4
_GUARD_BIT = 0
_FIRST_FREE = 37
_PARTS = ("air", *SENSORS)


def check_readings(readings: Sequence[PlcReading]) -> None:
    """Raise ValueError, in one line, for further readings that the mock PLC cannot serve."""
    for reading in readings:
        last = REGISTERS - len(_words_of(reading, 0.0))
        if not _FIRST_FREE <= reading.address <= last:
            raise ValueError(
                f"PLC reading '{reading.name}': register {reading.address} is not free in the mock PLC; "
                f"use {_FIRST_FREE} to {last}"
            )
        if reading.part not in _PARTS:
            raise ValueError(f"PLC reading '{reading.name}': no part '{reading.part}'; known: {', '.join(_PARTS)}")


class PlcState:
    """What the PLC knows and does, without its line. Safe to use from several threads.

    The master counts as seen while its heartbeat has changed within `master_limit_s` of rig time.
    """

    def __init__(self, plant: BasePlant, faults: FaultPlan = NO_FAULTS, master_limit_s: float = 2.0) -> None:
        check_readings(plant.settings.plc_readings)
        self._plant = plant
        self._faults = faults
        self._master_limit_s = master_limit_s
        self._lock = threading.Lock()
        self._interlocks = GOOD_INTERLOCKS
        self._acknowledged = 0
        self._released = True
        self._automatic = True
        self._told = [0] * _TOLD
        self._command = [0, 0, 0]
        self._taken, self._result = 0, DONE
        self._cancel: Callable[[], None] | None = None
        self._master_beat = 0
        self._master_seen_s = float("-inf")
        self._frozen: list[int] | None = None

    def set_interlock(self, bit: int, good: bool) -> None:
        """Open or close an interlock."""
        with self._lock:
            self._interlocks = self._interlocks | 1 << bit if good else self._interlocks & ~(1 << bit)

    def set_automatic(self, granted: bool) -> None:
        """Turn the key: grant the automatic mode or not."""
        with self._lock:
            self._automatic = granted

    @property
    def told(self) -> tuple[int, ...]:
        """State, days left and alarm, as the master has written them."""
        return tuple(self._told)

    def acknowledge(self) -> None:
        """Press the button by which a campaign that waits may go on."""
        with self._lock:
            self._acknowledged = (self._acknowledged + 1) & 0xFFFF

    def set_release(self, released: bool) -> None:
        """Turn the key switch by which whoever stands at the machine lets a remote operator move it."""
        with self._lock:
            self._released = released

    def answer(self) -> list[int]:
        """All registers for one request, with the faults that strike at it."""
        if self._faults.strikes("modbus-stale-heartbeat"):
            self._frozen = self._frozen or self.registers()
            return list(self._frozen)
        self._frozen = None
        if self._faults.strikes("modbus-other-client"):
            self.write(_MASTER_HEARTBEAT, [self._master_beat ^ _FOREIGN, self._taken ^ _FOREIGN, _FOREIGN, 0])
        words = self.registers()
        if self._faults.strikes("modbus-stuck-coil"):
            words[3] |= 1 << _GUARD_BIT  # the guard is open; the bit that should say so stays good
        return words

    def registers(self) -> list[int]:
        """All registers as they are now."""
        t_s, thermal = self._plant.clock.now_s(), self._plant.thermal
        words = [0] * REGISTERS
        with self._lock:
            words[0] = int(t_s / _HEARTBEAT_PERIOD_S) & 0xFFFF
            words[1] = self._interlocks
            words[2] = self._plant.payload if self._cancel is None else CHANGING
            words[3] = self._interlocks ^ 0xFFFF
            words[_SIMULATED_AT] = _SIMULATED
            words[_ACKNOWLEDGE_AT] = self._acknowledged
            words[_RELEASE_AT] = int(self._released)
            words[_AUTOMATIC_AT] = int(self._automatic)
            words[_TOLD_AT : _TOLD_AT + _TOLD] = self._told
            words[_MASTER_HEARTBEAT] = self._master_beat
            words[_SEQUENCE : _SEQUENCE + 5] = [*self._command, self._taken, self._result]
            words[_MASTER_SEEN] = int(t_s - self._master_seen_s <= self._master_limit_s)
        sensors = [thermal.sensor_c(name, t_s) for name in ("air", "struts", "columns", "base", "platform")]
        floats = [*sensors, thermal.pressure_hpa(t_s), 100.0 * thermal.humidity()]
        words[_FLOATS_AT : _FLOATS_AT + 2 * len(floats)] = struct.unpack(
            f">{2 * len(floats)}H", struct.pack(f">{len(floats)}f", *floats)
        )
        for reading in self._plant.settings.plc_readings:
            contents = _words_of(reading, self._true_c(reading.part, t_s) + reading.offset_k)
            words[reading.address : reading.address + len(contents)] = contents
        return words

    def _true_c(self, part: str, t_s: float) -> float:
        thermal = self._plant.thermal
        return thermal.air_c(t_s) if part == "air" else thermal.part_c(part, t_s)

    def write(self, address: int, values: list[int]) -> bool:
        """Write registers: the master's heartbeat, the command's three and what the master tells. False for others."""
        if address >= _TOLD_AT and address + len(values) <= _TOLD_AT + _TOLD:
            with self._lock:
                self._told[address - _TOLD_AT : address - _TOLD_AT + len(values)] = values
            return True
        if address < _MASTER_HEARTBEAT or address + len(values) > _SEQUENCE + 3:
            return False
        with self._lock:
            if address == _MASTER_HEARTBEAT:
                beat, values, address = values[0], values[1:], _SEQUENCE
                if beat != self._master_beat:
                    self._master_beat, self._master_seen_s = beat, self._plant.clock.now_s()
            if not values:
                return True
            at = address - _SEQUENCE
            self._command[at : at + len(values)] = values
            sequence, command, argument = self._command
            if sequence != self._taken:
                self._taken = sequence
                self._result = self._take(command, argument)
        return True

    def close(self) -> None:
        """Send the operator home."""
        with self._lock:
            if self._cancel is not None:
                self._cancel()

    def _take(self, command: int, argument: int) -> int:
        known = command == _REQUEST_PAYLOAD and argument < len(self._plant.settings.payloads)
        if not known or self._cancel is not None or self._plant.is_moving():
            return REFUSED
        if argument == self._plant.payload:
            return DONE
        clock, sequence = self._plant.clock, self._taken
        self._cancel = clock.call_at(
            clock.now_s() + self._plant.settings.operator_time_s, lambda: self._payload_is_on(argument, sequence)
        )
        return IN_PROGRESS

    def _payload_is_on(self, payload: int, sequence: int) -> None:
        with self._lock:
            self._plant.put_on(payload)
            self._cancel = None
            if self._taken == sequence:
                self._result = DONE


def _words_of(reading: PlcReading, value_c: float) -> list[int]:
    if reading.type == "f32":
        return list(struct.unpack(">2H", struct.pack(">f", value_c)))
    return [round(value_c / reading.scale) & 0xFFFF]
