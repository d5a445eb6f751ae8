"""The PLC's registers (docs/plc.md): where each value is, what is plausible, and how it is decoded."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from drivers.errors import InterlockOpen, PlcError, StaleData

CHANGING = 0xFFFF
_MOST_WORDS = 125


@dataclass(frozen=True)
class Register:
    """A value in two registers, IEEE 754 single with the high word first, valid from `low` to `high`."""

    address: int
    low: float
    high: float


def _temperatures() -> dict[str, Register]:
    places = ("air", "struts", "columns", "base", "platform")
    return {place: Register(4 + 2 * i, -20.0, 60.0) for i, place in enumerate(places)}


@dataclass(frozen=True)
class RegisterMap:
    """Addresses of all registers. Commands (sequence, command, argument) are three in a row, the answer two.

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
    payload: int = 2
    temperatures_c: Mapping[str, Register] = field(default_factory=_temperatures)
    pressure_hpa: Register = Register(14, 500.0, 1100.0)
    humidity_percent: Register = Register(16, 0.0, 100.0)
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
        return max(self._addresses()) + 2 - self.first

    def _addresses(self) -> list[int]:
        floats = [*self.temperatures_c.values(), self.pressure_hpa, self.humidity_percent]
        return [self.heartbeat, self.interlocks, self.payload, *(r.address for r in floats)]


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

    def open_interlocks(self) -> list[str]:
        """Names of the interlocks that are not good."""
        return [name for name, good in self.interlocks.items() if not good]

    def require_safe(self, device: str = "PLC") -> None:
        """Raise StaleData while the heartbeat stands still, InterlockOpen while an interlock is open."""
        if not self.heartbeat_fresh:
            raise StaleData(
                device,
                self.where,
                f"the heartbeat stands still at {self.heartbeat}",
                "check that the PLC's program runs",
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

    Raises PlcError for a block of wrong length, for NaN and for what is outside its validity.
    """
    if len(words) != registers.count:
        raise PlcError(device, where, f"{len(words)} registers instead of {registers.count}", "check the register map")

    def word(address: int) -> int:
        return words[address - registers.first]

    def number(name: str, register: Register) -> float:
        raw = struct.pack(">HH", word(register.address), word(register.address + 1))
        value = float(struct.unpack(">f", raw)[0])
        if not (math.isfinite(value) and register.low <= value <= register.high):
            raise PlcError(
                device,
                f"{where}, register {register.address}",
                f"{name} of {value:g} is outside {register.low:g} to {register.high:g}",
                "check the sensor, its wiring and the word order",
            )
        return value

    bits, payload = word(registers.interlocks), word(registers.payload)
    return PlcState(
        heartbeat=word(registers.heartbeat),
        heartbeat_fresh=fresh,
        interlocks={name: fresh and bool(bits >> bit & 1) for name, bit in registers.interlock_bits.items()},
        payload=None if payload == CHANGING else payload,
        temperatures_c={name: number(f"{name} temperature", r) for name, r in registers.temperatures_c.items()},
        pressure_hpa=number("air pressure", registers.pressure_hpa),
        humidity=number("humidity", registers.humidity_percent) / 100.0,
        t_rig_s=times_s[0],
        t_host_s=times_s[1],
        where=where,
    )
