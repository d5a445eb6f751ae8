"""When a SYNC was on the bus: the same moment for all drives, however late the thread of each comes to it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

from mock_devices.clock import RigClock

_KEPT = 8  # SYNCs by which the threads of two drives may lie apart


class SyncMoments:
    """Rig times of the last SYNCs, by the time stamps of their frames: that at which the first drive saw each."""

    def __init__(self, clock: RigClock) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._moments: deque[tuple[float, float]] = deque(maxlen=_KEPT)

    def moment_s(self, timestamp: float) -> float:
        """Rig time of the SYNC whose frame has this time stamp."""
        with self._lock:
            for stamp, moment_s in self._moments:
                if stamp == timestamp:
                    return moment_s
            moment_s = self._clock.now_s()
            self._moments.append((timestamp, moment_s))
            return moment_s


class DriveTime:
    """The time that one drive lives in: rig time, but a SYNC's moment while it deals with that. The drive locks."""

    def __init__(self, clock: RigClock, moments: SyncMoments) -> None:
        self._clock, self._moments = clock, moments
        self._sync_s: float | None = None

    def now_s(self) -> float:
        """Rig time, or the SYNC's moment."""
        return self._clock.now_s() if self._sync_s is None else self._sync_s

    @contextmanager
    def at_sync(self, timestamp: float) -> Iterator[float]:
        """Deal with the SYNC whose frame has this time stamp; its moment."""
        self._sync_s = moment_s = self._moments.moment_s(timestamp)
        try:
            yield moment_s
        finally:
            self._sync_s = None
