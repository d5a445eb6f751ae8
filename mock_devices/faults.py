"""Faults by name that strike at the Nth operation, on the wire and in the devices.

A plan is shared by all servers of a mock rig. Each place where a fault can strike asks `strikes(name)` at every
operation of that kind; only those whose fault is armed are counted. Some faults strike once, others last from then on.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class FaultKind:
    """What a fault does and what counts as an operation. `lasting`: from the Nth operation on."""

    site: str
    operation: str
    what: str
    lasting: bool = False


_ANSWER, _AIM, _MEASUREMENT, _CALL = "answer of the station", "aiming", "measurement", "call to the station"
_FRAME, _REQUEST, _MODBUS = "frame at the host's bus", "SDO frame to a drive", "request to the PLC"

FAULTS: dict[str, FaultKind] = {
    "serial-dropped-byte": FaultKind("serial", _ANSWER, "one byte of the answer is missing"),
    "serial-doubled-byte": FaultKind("serial", _ANSWER, "one byte of the answer comes twice"),
    "serial-garbled-byte": FaultKind("serial", _ANSWER, "one bit of the answer is turned over"),
    "serial-split": FaultKind("serial", _ANSWER, "the answer comes in two parts"),
    "serial-late": FaultKind("serial", _ANSWER, "the answer comes only when the next request has come"),
    "serial-lost": FaultKind("serial", _ANSWER, "the answer never comes"),
    "serial-previous": FaultKind("serial", _ANSWER, "the answer before comes again in place of this one"),
    "serial-gone": FaultKind("serial", _ANSWER, "the port goes away", lasting=True),
    "tracker-beam-break": FaultKind("tracker", _MEASUREMENT, "something stands in the beam"),
    "tracker-no-target": FaultKind("tracker", _AIM, "no reflector is found"),
    "tracker-wrong-nest": FaultKind("tracker", _AIM, "another reflector is aimed at"),
    "tracker-drift": FaultKind("tracker", _MEASUREMENT, "the stand has been knocked: 100 urad in Hz", lasting=True),
    "tracker-busy": FaultKind("tracker", _CALL, "the station says that it is busy"),
    "can-lost-frame": FaultKind("can", _FRAME, "a frame is lost"),
    "can-bus-off": FaultKind("can", _FRAME, "the host's controller goes bus off", lasting=True),
    "can-other-master": FaultKind(
        "can", "frame that the host sends", "another master sends the first drive 0.1 m away"
    ),
    "can-peer-dead": FaultKind("can", _FRAME, "the peer of the bus is gone without a word", lasting=True),
    "sdo-abort": FaultKind("can", _REQUEST, "the transfer is aborted with 0x06060000"),
    "sdo-toggle": FaultKind("can", "segment or answer of an SDO server", "the toggle bit is wrong"),
    "drive-heartbeat": FaultKind("can", "heartbeat of the first drive", "its heartbeat stops", lasting=True),
    "drive-emergency": FaultKind("can", "SYNC at the first drive", "over-current: EMCY 0x2310 and fault"),
    "drive-reboot": FaultKind("can", "SDO frame of a write", "the drive restarts in the middle of it"),
    "modbus-exception": FaultKind("modbus", _MODBUS, "an exception response, device failure"),
    "modbus-transaction": FaultKind("modbus", _MODBUS, "the answer carries another transaction id"),
    "modbus-short": FaultKind("modbus", _MODBUS, "half of the answer is missing"),
    "modbus-reset": FaultKind("modbus", _MODBUS, "the connection is reset"),
    "modbus-other-client": FaultKind("modbus", _MODBUS, "another client writes a heartbeat and a command"),
    "modbus-stuck-coil": FaultKind("modbus", _MODBUS, "the guard opens and its bit goes on reading good", lasting=True),
    "modbus-stale-heartbeat": FaultKind("modbus", _MODBUS, "heartbeat and values stand still", lasting=True),
    "time-step": FaultKind("time", "wait of the host", "the clock jumps ten seconds ahead", lasting=True),
    "time-step-back": FaultKind("time", "wait of the host", "the clock jumps ten seconds back", lasting=True),
}


@dataclass(frozen=True)
class Fault:
    """A fault by name at its Nth operation, counted from 1."""

    name: str
    at: int

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        if self.name not in FAULTS:
            raise ValueError(f"there is no fault '{self.name}'; there are {', '.join(FAULTS)}")
        if self.at < 1:
            raise ValueError(f"fault {self.name}: operations count from 1, not {self.at}")

    def __str__(self) -> str:
        return f"{self.name}@{self.at}"


def parse_fault(text: str) -> Fault:
    """Read NAME@N; raises ValueError in one line."""
    name, mark, number = text.partition("@")
    if not mark or not number.isascii() or not number.isdigit():
        raise ValueError(f"fault {text[:60]!r} is not NAME@N")
    return Fault(name, int(number[:9]))


class FaultPlan:
    """The faults that are armed. Safe to use from several threads."""

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self._lock = threading.Lock()
        self._at: dict[str, int] = {}
        self._count: dict[str, int] = {}
        self._struck: dict[str, None] = {}
        self.arm(faults)

    def arm(self, faults: Iterable[Fault]) -> None:
        """Arm more faults, each counting from now on. Raises ValueError for one that is armed already."""
        with self._lock:
            for fault in faults:
                if fault.name in self._at:
                    raise ValueError(f"fault {fault.name} is given twice")
                self._at[fault.name], self._count[fault.name] = fault.at, 0

    def strikes(self, name: str) -> bool:
        """Count one operation at which `name` could strike; whether it does."""
        if name not in self._at:  # not armed: nothing to count
            return False
        with self._lock:
            at = self._at.get(name)
            if at is None:
                return False
            self._count[name] += 1
            due = self._count[name] == at or (self._count[name] > at and FAULTS[name].lasting)
            if due:
                self._struck[name] = None
            return due

    def lasts(self, name: str) -> bool:
        """Whether a lasting fault has struck; counts nothing."""
        with self._lock:
            return name in self._at and name in self._struck and FAULTS[name].lasting

    @property
    def counts(self) -> dict[str, int]:
        """How many operations each armed fault has counted."""
        with self._lock:
            return dict(self._count)

    @property
    def armed(self) -> tuple[str, ...]:
        """The faults that are armed, as NAME@N."""
        with self._lock:
            return tuple(f"{name}@{at}" for name, at in self._at.items())

    @property
    def struck(self) -> tuple[str, ...]:
        """Names of the faults that have struck, first to last."""
        with self._lock:
            return tuple(self._struck)

    def clear(self) -> None:
        """Disarm all: everything works again."""
        with self._lock:
            self._at.clear()


NO_FAULTS = FaultPlan()
