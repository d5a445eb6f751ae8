"""What a node watches and remembers by CiA 301: the master's heartbeat (0x1016) and its own errors (0x1003)."""

from __future__ import annotations

import threading
from collections.abc import Callable

from mock_devices.can.sdo_abort import VALUE_RANGE, RefusedWrite
from mock_devices.clock import RigClock

_HISTORY = 8
COMMUNICATION_ERROR_BIT = 0x10
GENERIC_ERROR_BIT = 0x01


class Watchdog:
    """Watches something that is to come again and again, from the first time on.

    `lost` is called once when it stays away for longer than the limit, `found` when it is back; both without a lock
    held, from a thread of the clock or of whoever feeds it.
    """

    def __init__(self, clock: RigClock, lost: Callable[[], None], found: Callable[[], None] = lambda: None) -> None:
        self._clock = clock
        self._lost, self._found = lost, found
        self._lock = threading.Lock()
        self._limit_s = 0.0
        self._last_s: float | None = None
        self._missing = False
        self._cancel: Callable[[], None] | None = None

    @property
    def limit_s(self) -> float:
        """For how long it may stay away; 0: it is not watched."""
        return self._limit_s

    def set_limit(self, limit_s: float) -> None:
        """Begin anew with another limit; 0 switches it off."""
        with self._lock:
            if self._cancel is not None:
                self._cancel()
            self._cancel, self._last_s, self._missing = None, None, False
            self._limit_s = limit_s

    def on_message(self) -> None:
        """It has come."""
        with self._lock:
            if self._limit_s <= 0.0:
                return
            first, self._last_s = self._last_s is None, self._clock.now_s()
            back, self._missing = self._missing, False
            if first or back:
                self._schedule(self._last_s + self._limit_s)
        if back:
            self._found()

    def _schedule(self, t_s: float) -> None:
        self._cancel = self._clock.call_at(t_s, self._check)

    def _check(self) -> None:
        with self._lock:
            if self._last_s is None or self._missing:
                return
            due_s = self._last_s + self._limit_s
            if self._clock.now_s() < due_s:
                self._schedule(due_s)
                return
            self._missing = True
        self._lost()


class HeartbeatConsumer:
    """Watches the heartbeat of one node by object 0x1016:01."""

    def __init__(self, clock: RigClock, lost: Callable[[], None], found: Callable[[], None]) -> None:
        self._watchdog = Watchdog(clock, lost, found)
        self.node = 0

    def configure(self, value: int) -> None:
        """Object 0x1016:01: node in bits 16 to 22, time in ms in bits 0 to 15; either 0 switches it off."""
        self.node = value >> 16 & 0x7F
        self._watchdog.set_limit((value & 0xFFFF) * 1e-3)

    @property
    def value(self) -> int:
        """What reading 0x1016:01 gives."""
        return self.node << 16 | round(self._watchdog.limit_s * 1e3)

    def on_heartbeat(self, node: int) -> None:
        """A heartbeat of some node has come."""
        if node == self.node:
            self._watchdog.on_message()

    def close(self) -> None:
        """Watch nothing any more."""
        self.configure(0)


class ErrorHistory:
    """Object 0x1003: the last eight error codes, newest first."""

    def __init__(self) -> None:
        self._codes: list[int] = []

    def add(self, code: int) -> None:
        """An error has come up."""
        self._codes = [code, *self._codes][:_HISTORY]

    def count(self) -> int:
        """Sub-index 0."""
        return len(self._codes)

    def code(self, number: int) -> int:
        """Sub-index `number`; 0 where there is none."""
        return self._codes[number - 1] if number <= len(self._codes) else 0

    def write_count(self, value: int) -> None:
        """Writing 0 forgets all; anything else is refused."""
        if value != 0:
            raise RefusedWrite(VALUE_RANGE)
        self._codes = []


def error_register(code: int) -> int:
    """Object 0x1001 for an error code: generic always, communication for 0x81xx."""
    if code == 0:
        return 0
    return GENERIC_ERROR_BIT | (COMMUNICATION_ERROR_BIT if code >> 8 == 0x81 else 0)
