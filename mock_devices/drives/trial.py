"""A table on trial: if the master stays away, the drive stops, takes its power off and uses no table any more.

The master keeps a table when it has verified it. Whoever never comes back has not, so the drive ends the trial itself.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager

from mock_devices.can.node_watch import HeartbeatConsumer, Watchdog
from mock_devices.clock import RigClock
from mock_devices.drives.compensation import OFF, TRIAL
from mock_devices.drives.drive_axis import DriveAxis

EMCY_TRIAL = 0xFF11


class Trial:
    """Watches the node of object 0x1016:01 while mode is 2; `lock` guards the axis, `emergency` sends an EMCY."""

    def __init__(
        self,
        clock: RigClock,
        axis: DriveAxis,
        master: HeartbeatConsumer,
        lock: AbstractContextManager[bool],
        emergency: Callable[[int], None],
    ) -> None:
        self._clock, self._axis, self._master, self._lock = clock, axis, master, lock
        self._emergency = emergency
        self._watchdog = Watchdog(clock, self._master_lost)

    def set_mode(self, mode: int) -> None:
        """Object 0x2100:01; the time begins when a trial does, whether the master was heard before or not."""
        compensation = self._axis.compensation
        compensation.set_mode(mode, self._axis.powered)
        self._watchdog.set_limit(compensation.trial_ms * 1e-3 if mode == TRIAL else 0.0)
        self._watchdog.on_message()

    def on_heartbeat(self, node: int) -> None:
        """A heartbeat of some node."""
        if node == self._master.node:
            self._watchdog.on_message()

    def stop(self) -> None:
        """Watch no more: the drive restarts, or leaves the bus."""
        self._watchdog.set_limit(0.0)

    def _master_lost(self) -> None:
        with self._lock:
            self._end()

    def _end(self) -> None:
        """Stop, then remove the power, then use no table: only a drive at standstill without power may change over."""
        axis = self._axis
        if axis.compensation.mode != TRIAL:
            return
        axis.quick_stop()
        t_s = self._clock.now_s()
        if axis.motion.is_moving(t_s):
            self._clock.call_at(max(axis.motion.end_s, t_s), self._master_lost)
            return
        axis.refresh()
        axis.remove_power()
        axis.compensation.mode = OFF
        self.stop()
        self._emergency(EMCY_TRIAL)
