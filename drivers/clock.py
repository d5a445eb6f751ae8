"""The clock that drivers wait by."""

from __future__ import annotations

import time
from typing import Protocol


class RigClock(Protocol):
    """What a driver needs of a clock. All waiting between polls goes through it."""

    def now_s(self) -> float:
        """Rig time in seconds."""
        ...

    def sleep_s(self, duration_s: float) -> None:
        """Block the calling thread for a duration of rig time, in seconds."""
        ...


class HostClock:
    """Host time used as rig time: the default for scripts and real hardware."""

    def now_s(self) -> float:
        """Monotonic host time in seconds."""
        return time.monotonic()

    def sleep_s(self, duration_s: float) -> None:
        """Sleep for `duration_s` seconds."""
        if duration_s > 0.0:
            time.sleep(duration_s)
