"""The PLC's registers (docs/reference/plc.md): where each value is, what is plausible, and how it is decoded."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

from drivers.errors import InterlockOpen, PlcError, StaleData

CHANGING = 0xFFFF
SIMULATED = int.from_bytes(b"SI", "big")  # what the register `simulated` of a PLC holds that is none
_MOST_WORDS = 125
_JUMP = 0.01

RegisterType = Literal["u16", "i16", "u32", "i32", "f32"]
WordOrder = Literal["ABCD", "CDAB", "BADC", "DCBA"]
_LAYOUTS: dict[str, tuple[str, int]] = {
    "u16": (">H", 1),
    "i16": (">h", 1),
    "u32": (">I", 2),
    "i32": (">i", 2),
    "f32": (">f", 2),
}
# Factor and offset to the map's own unit: degC, hPa, %.
_UNITS: dict[str, tuple[float, float]] = {
    "": (1.0, 0.0),
    "degC": (1.0, 0.0),
    "K": (1.0, -273.15),
    "hPa": (1.0, 0.0),
    "mbar": (1.0, 0.0),
    "Pa": (0.01, 0.0),
    "kPa": (10.0, 0.0),
    "%": (1.0, 0.0),
    "1": (100.0, 0.0),
}


@dataclass(frozen=True)
class Register:
    """A measured value of the map and where it is: number times `scale` plus `offset` in `unit`, `low` to `high`.

    `order` is the byte order of a value of two words: ABCD (high word first), CDAB, BADC or DCBA. `low` and `high` are
    in the map's own unit (degC, hPa, %), to which `unit` is converted. A value whose words have not changed for
    `stale_s` of rig time is stale; None leaves that to the heartbeat.
    """

    address: int
    low: float
    high: float
    type: RegisterType = "f32"
    order: WordOrder = "ABCD"
    scale: float = 1.0
    unit: str = ""
    stale_s: float | None = None
    offset: float = 0.0

    def __post_init__(self) -> None:
        """Raise ValueError for a unit, scale, offset, range or address that is not possible."""
        numbers = (self.scale, self.offset, self.low, self.high)
        if not self._unit_is_known() or not all(math.isfinite(number) for number in numbers) or self.scale == 0.0:
            raise ValueError(f"register {self.address}: unit '{self.unit}', scale {self.scale} or range is invalid")
        if not self.low < self.high or not 0 <= self.address <= 0x10000 - self.words:
            raise ValueError(f"register {self.address}: address or range {self.low:g} to {self.high:g} is invalid")

    def _unit_is_known(self) -> bool:
        return self.unit in _UNITS

    def _conversion(self) -> tuple[float, float]:
        """Factor and offset from `unit` to the map's own unit."""
        return _UNITS[self.unit]

    @property
    def words(self) -> int:
        """How many registers the value takes."""
        return _LAYOUTS[self.type][1]

    def value(self, words: Sequence[int]) -> float:
        """The value in the map's own unit; the caller rejects NaN and values out of range."""
        layout, count = _LAYOUTS[self.type]
        raw = b"".join(word.to_bytes(2, "big") for word in words[:count])
        if count == 2:
            raw = bytes(raw["ABCD".index(letter)] for letter in self.order)
        elif self.order in ("BADC", "DCBA"):
            raw = raw[::-1]
        factor, offset = self._conversion()
        return (float(struct.unpack(layout, raw)[0]) * self.scale + self.offset) * factor + offset


@dataclass(frozen=True)
class ReadingRegister(Register):
    """A further analogue value of the rig, for example a coolant temperature, in the unit that the user gives it.

    As `Register`, but `unit` is any name, nothing is converted, and `low` and `high` are in that unit.
    """

    def _unit_is_known(self) -> bool:
        return True

    def _conversion(self) -> tuple[float, float]:
        return 1.0, 0.0


def _temperatures() -> dict[str, Register]:
    places = ("air", "struts", "columns", "base", "platform")
    return {place: Register(4 + 2 * i, -20.0, 60.0) for i, place in enumerate(places)}


@dataclass(frozen=True)
class RegisterMap:
    """Addresses of all registers. Commands (sequence, command, argument) are three in a row, the answer two.

    `interlocks_inverted` holds the complement of `interlocks`, so that a stuck bit is detected; `master_heartbeat` is
    where ours is written, `master_seen` is 1 while the PLC sees it, `simulated` holds SIMULATED in a simulated PLC,
    `local_release` is 1 while the key switch lets a remote operator move the machine; None where the PLC has none.
    `readings` are further analogue values by name: they are read in the same request, checked for range and age like
    the others, and stand in `PlcState.readings`:

        RegisterMap(readings={"coolant": ReadingRegister(40, 5.0, 50.0, type="i16", scale=0.1, unit="degC")})

    Raises ValueError if the block of values is longer than one request can hold or two values have one name.
    """

    heartbeat: int = 0
    interlocks: int = 1
    interlock_bits: Mapping[str, int] = field(
        default_factory=lambda: {
            "guard closed": 0,
            "emergency stop released": 1,
            "drive power on": 2,
            "air pressure": 3,
        }
    )
    interlocks_inverted: int | None = 3
    payload: int = 2
    temperatures_c: Mapping[str, Register] = field(default_factory=_temperatures)
    pressure_hpa: Register = Register(14, 500.0, 1100.0)
    humidity_percent: Register = Register(16, 0.0, 100.0)
    master_heartbeat: int | None = 30
    master_seen: int | None = 36
    sequence: int = 31
    sequence_taken: int = 34
    simulated: int | None = None
    acknowledge: int | None = None
    local_release: int | None = None
    readings: Mapping[str, ReadingRegister] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the names of the readings and the length of the block."""
        for name in self.readings:
            if not name or name in self._map_values():
                raise ValueError(f"a reading of the PLC cannot be called '{name}'")
        if self.count > _MOST_WORDS:
            raise ValueError(f"the PLC's values span {self.count} registers, one request holds {_MOST_WORDS}")

    @cached_property
    def first(self) -> int:
        """First register of the block that holds all values."""
        return min(self._addresses())

    @cached_property
    def count(self) -> int:
        """Number of registers of that block."""
        ends = [*self._single(), *(r.address + r.words - 1 for r in self.values.values())]
        return max(ends) + 1 - self.first

    @cached_property
    def values(self) -> Mapping[str, Register]:
        """All measured values by name."""
        return {**self._map_values(), **self.readings}

    def jump(self, before: PlcState, now: PlcState) -> str | None:
        """What differs by more than a hundredth of its range between two readings of the PLC, and the payload."""
        if now.payload != before.payload:
            return f"payload {before.payload} and {now.payload}"
        old, new = before.values(), now.values()
        for name, register in self.values.items():
            if not abs(new[name] - old[name]) <= _JUMP * (register.high - register.low):
                return f"{name} {old[name]:g} and {new[name]:g}"
        return None

    def _map_values(self) -> dict[str, Register]:
        temperatures = {f"{name} temperature": register for name, register in self.temperatures_c.items()}
        return {**temperatures, "air pressure": self.pressure_hpa, "humidity": self.humidity_percent}

    def _single(self) -> list[int]:
        optional = [self.interlocks_inverted, self.master_seen, self.simulated, self.acknowledge, self.local_release]
        return [self.heartbeat, self.interlocks, self.payload, *(a for a in optional if a is not None)]

    def _addresses(self) -> list[int]:
        return [*self._single(), *(register.address for register in self.values.values())]


@dataclass(frozen=True)
class PlcState:
    """What the PLC says at one time. `payload` is the number in the rig's list, None while being changed.

    `humidity` is relative, 0 to 1; `readings` are the further values of the map, each in its register's unit.
    While `heartbeat_fresh` is False all interlocks read open. `acknowledge` changes with each acknowledgement.
    `local_release`: whether the key switch at the machine lets a remote operator move it, None without its register.
    """

    heartbeat: int
    heartbeat_fresh: bool
    interlocks: Mapping[str, bool]
    payload: int | None
    temperatures_c: Mapping[str, float]
    pressure_hpa: float
    humidity: float
    t_rig_s: float
    t_host_s: float
    where: str = ""
    master_seen: bool = True
    simulated: bool = False
    acknowledge: int = 0
    local_release: bool | None = None
    readings: Mapping[str, float] = field(default_factory=dict)

    def values(self) -> dict[str, float]:
        """All measured values, by the names and in the units of the register map."""
        temperatures = {f"{name} temperature": value for name, value in self.temperatures_c.items()}
        own = {**temperatures, "air pressure": self.pressure_hpa, "humidity": 100.0 * self.humidity}
        return {**own, **self.readings}

    def open_interlocks(self) -> list[str]:
        """Names of the interlocks that are not good."""
        return [name for name, good in self.interlocks.items() if not good]

    def require_safe(self, device: str = "PLC") -> None:
        """Raise StaleData while the PLC's heartbeat stands still or ours is not seen, InterlockOpen for an open one."""
        if not self.heartbeat_fresh:
            raise StaleData(
                device,
                self.where,
                f"the heartbeat stands still at {self.heartbeat}",
                "check that the PLC's program runs",
            )
        if not self.master_seen:
            raise StaleData(
                device, self.where, "the PLC does not see our heartbeat", "check the register map and the PLC's program"
            )
        missing = self.open_interlocks()
        if missing:
            raise InterlockOpen(
                device,
                self.where,
                f"interlock open: {', '.join(missing)}",
                "close it, then start again",
            )


def decode(
    registers: RegisterMap,
    words: Sequence[int],
    fresh: bool,
    times_s: tuple[float, float],
    device: str = "PLC",
    where: str = "",
) -> PlcState:
    """The state in a block of words that starts at `registers.first`; `times_s` is rig and host time.

    Raises PlcError for a block of wrong length, for NaN, for what is outside its validity and for interlocks
    that do not agree with their complement.
    """
    if len(words) != registers.count:
        raise PlcError(device, where, f"{len(words)} registers instead of {registers.count}", "check the register map")

    def word(address: int) -> int:
        return words[address - registers.first]

    def number(name: str) -> float:
        register = registers.values[name]
        at = register.address - registers.first
        value = register.value(words[at : at + register.words])
        if not (math.isfinite(value) and register.low <= value <= register.high):
            raise PlcError(
                device,
                f"{where}, register {register.address}",
                f"{name} of {value:g} is outside {register.low:g} to {register.high:g}",
                "check the sensor, its wiring, type and word order",
            )
        return value

    bits, payload = word(registers.interlocks), word(registers.payload)
    inverted = registers.interlocks_inverted
    if inverted is not None and word(inverted) != bits ^ 0xFFFF:
        raise PlcError(
            device,
            f"{where}, registers {registers.interlocks} and {inverted}",
            f"interlocks 0x{bits:04X} and their complement 0x{word(inverted):04X} do not agree: a bit is stuck",
            "check the PLC's inputs and its program",
        )
    master_seen_address, simulated_address = registers.master_seen, registers.simulated
    return PlcState(
        heartbeat=word(registers.heartbeat),
        heartbeat_fresh=fresh,
        interlocks={name: fresh and bool(bits >> bit & 1) for name, bit in registers.interlock_bits.items()},
        payload=None if payload == CHANGING else payload,
        temperatures_c={name: number(f"{name} temperature") for name in registers.temperatures_c},
        pressure_hpa=number("air pressure"),
        humidity=number("humidity") / 100.0,
        t_rig_s=times_s[0],
        t_host_s=times_s[1],
        where=where,
        master_seen=master_seen_address is None or word(master_seen_address) == 1,
        simulated=simulated_address is not None and word(simulated_address) == SIMULATED,
        acknowledge=0 if registers.acknowledge is None else word(registers.acknowledge),
        local_release=None if registers.local_release is None else fresh and word(registers.local_release) == 1,
        readings={name: number(name) for name in registers.readings},
    )
