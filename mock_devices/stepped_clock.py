"""A clock that jumps: the time of a computer that was suspended, or set."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from mock_devices.clock import RigClock
from mock_devices.faults import FaultPlan

STEP_S = 10.0


class HostClock(RigClock, Protocol):
    """The whole of a rig clock, as a host uses it."""

    def activity(self) -> AbstractContextManager[None]:
        """Take part as one activity."""
        ...

    def hold(self) -> None:
        """Keep time from advancing."""
        ...

    def release(self) -> None:
        """Undo `hold`."""
        ...

    def close(self) -> None:
        """Wake all sleepers."""
        ...


class SteppedClock:
    """Another clock's time, ten seconds ahead or back from the Nth wait on; waits and call-backs keep their length."""

    def __init__(self, clock: HostClock, faults: FaultPlan) -> None:
        self._clock = clock
        self._faults = faults
        self._lock = threading.Lock()
        self._offset_s = 0.0

    def now_s(self) -> float:
        """Rig time as this host takes it."""
        return self._clock.now_s() + self._offset_s

    def sleep_s(self, duration_s: float) -> None:
        """Wait; the clock may have jumped afterwards."""
        self._clock.sleep_s(duration_s)
        with self._lock:
            ahead, back = self._faults.strikes("time-step"), self._faults.strikes("time-step-back")
            if ahead or back:
                self._offset_s = STEP_S if ahead else -STEP_S

    def call_at(self, t_s: float, callback: Callable[[], None]) -> Callable[[], None]:
        """Call back after as long as it is from now to `t_s`."""
        return self._clock.call_at(t_s - self._offset_s, callback)

    def activity(self) -> AbstractContextManager[None]:
        """Take part as one activity."""
        return self._clock.activity()

    def hold(self) -> None:
        """Keep time from advancing."""
        self._clock.hold()

    def release(self) -> None:
        """Undo `hold`."""
        self._clock.release()

    def close(self) -> None:
        """The other clock goes on: it is not this one's to close."""
