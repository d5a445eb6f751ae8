"""NMT slave and heartbeat producer of a mock node, on the rig clock.

canopen's own NMT slave beats in host time, sends no boot-up after a reset and answers SDO when stopped.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from enum import IntEnum

from mock_devices.clock import RigClock


class NmtState(IntEnum):
    """State as a heartbeat tells it."""

    BOOT_UP = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


_COMMANDS = {1: NmtState.OPERATIONAL, 2: NmtState.STOPPED, 128: NmtState.PRE_OPERATIONAL}
_RESET_NODE, _RESET_COMMUNICATION = 129, 130


class NmtSlave:
    """NMT state of one node. `changed` is told the state left; `reset` whether the whole node restarts."""

    def __init__(
        self,
        node_id: int,
        *,
        send: Callable[[bytes], None],
        changed: Callable[[NmtState], None],
        reset: Callable[[bool], None],
    ) -> None:
        self._node_id = node_id
        self._send = send
        self._changed = changed
        self._reset = reset
        self.state = NmtState.BOOT_UP

    def boot_up(self) -> None:
        """Say that the node is there and go to pre-operational."""
        self.state = NmtState.PRE_OPERATIONAL
        self._send(bytes([NmtState.BOOT_UP]))

    def on_command(self, data: bytes) -> None:
        """An NMT frame: command and node, node 0 is everybody."""
        if len(data) < 2 or data[1] not in (0, self._node_id):
            return
        before = self.state
        if data[0] in (_RESET_NODE, _RESET_COMMUNICATION):
            self._changed(before)
            self._reset(data[0] == _RESET_NODE)
            self.boot_up()
        elif data[0] in _COMMANDS:
            self.state = _COMMANDS[data[0]]
            if self.state is not before:
                self._changed(before)


class Heartbeat:
    """Sends the NMT state every `period_s` of rig time."""

    def __init__(self, clock: RigClock, send: Callable[[], None]) -> None:
        self._clock = clock
        self._send = send
        self._lock = threading.Lock()
        self._period_s = 0.0
        self._cancel: Callable[[], None] | None = None

    def start(self, period_s: float) -> None:
        """Beat from now on with this period; 0 stops."""
        with self._lock:
            if self._cancel is not None:
                self._cancel()
                self._cancel = None
            self._period_s = period_s
            if period_s > 0.0:
                self._schedule(self._clock.now_s() + period_s)

    def stop(self) -> None:
        """Stop beating."""
        self.start(0.0)

    def _schedule(self, t_s: float) -> None:
        self._cancel = self._clock.call_at(t_s, lambda: self._beat(t_s))

    def _beat(self, t_s: float) -> None:
        with self._lock:
            if self._cancel is None:
                return
            self._schedule(max(t_s, self._clock.now_s() - self._period_s) + self._period_s)
        self._send()
