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
_MOST_WORDS = 125

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
    """A value and where it is: `type` in words of `order`, times `scale`, in `unit`, valid from `low` to `high`.

    `order` tells how the bytes of a value of two words come: ABCD (high word first), CDAB, BADC, DCBA. `low` and
    `high` are in the map's own unit (degC, hPa, %). A value whose words have not changed for `stale_s` of rig
    time counts as old; None leaves that to the heartbeat.
    """

    address: int
    low: float
    high: float
    type: RegisterType = "f32"
    order: WordOrder = "ABCD"
    scale: float = 1.0
    unit: str = ""
    stale_s: float | None = None

    def __post_init__(self) -> None:
        if self.unit not in _UNITS or self.scale == 0.0 or not self.low < self.high or not 0 <= self.address <= 0xFFFF:
            raise ValueError(f"register {self.address}: unit '{self.unit}', scale {self.scale} or range cannot be")

    @property
    def words(self) -> int:
        """How many registers the value takes."""
        return _LAYOUTS[self.type][1]

    def value(self, words: Sequence[int]) -> float:
        """The value in the map's own unit; NaN and what is out of range are the caller's to refuse."""
        layout, count = _LAYOUTS[self.type]
        raw = b"".join(word.to_bytes(2, "big") for word in words[:count])
        if count == 2:
            raw = bytes(raw["ABCD".index(letter)] for letter in self.order)
        elif self.order in ("BADC", "DCBA"):
            raw = raw[::-1]
        factor, offset = _UNITS[self.unit]
        return float(struct.unpack(layout, raw)[0]) * self.scale * factor + offset


def _temperatures() -> dict[str, Register]:
    places = ("air", "struts", "columns", "base", "platform")
    return {place: Register(4 + 2 * i, -20.0, 60.0) for i, place in enumerate(places)}


@dataclass(frozen=True)
class RegisterMap:
    """Addresses of all registers. Commands (sequence, command, argument) are three in a row, the answer two.

    `interlocks_inverted` holds the complement of `interlocks`, so that a bit that is stuck is noticed;
    `master_heartbeat` is where ours is written, `master_seen` is 1 while the PLC sees it. None: the PLC has none.
    Raises ValueError where the readable block is longer than one request can hold.
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

    def __post_init__(self) -> None:
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
        temperatures = {f"{name} temperature": register for name, register in self.temperatures_c.items()}
        return {**temperatures, "air pressure": self.pressure_hpa, "humidity": self.humidity_percent}

    def _single(self) -> list[int]:
        optional = [self.interlocks_inverted, self.master_seen]
        return [self.heartbeat, self.interlocks, self.payload, *(a for a in optional if a is not None)]

    def _addresses(self) -> list[int]:
        return [*self._single(), *(register.address for register in self.values.values())]


@dataclass(frozen=True)
class PlcState:
    """What the PLC says at one time. `payload` is the number in the rig's list, None while being changed.

    `humidity` is relative, 0 to 1. While `heartbeat_fresh` is False all interlocks read open.
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
    seen = registers.master_seen
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
        master_seen=seen is None or word(seen) == 1,
    )
