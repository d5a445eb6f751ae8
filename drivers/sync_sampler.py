"""All drives sampled at one SYNC, from any thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence

from drivers.clock import RigClock
from drivers.errors import NoAnswer
from drivers.servo_drive import DriveSample, ServoDrive


class SyncSampler:
    """Sends SYNC and collects the TPDOs of drives on one line. `pdo_timeout_s` is host time."""

    def __init__(
        self, drives: Sequence[ServoDrive], clock: RigClock, sync: Callable[[], None], pdo_timeout_s: float
    ) -> None:
        self.drives = tuple(drives)
        self._line = drives[0].line
        self._clock = clock
        self._sync = sync
        self._pdo_timeout_s = pdo_timeout_s
        self._sample_lock = threading.Lock()
        self._out_of_step = False

    def sample(self) -> list[DriveSample]:
        """What each drive says at one SYNC, which is sent a second time where an answer is lost.

        Raises NoAnswer naming the silent drive, ConnectionFailed.
        """
        with self._sample_lock:
            try:
                t_rig_s, t_host_s = self._in_step()
            except NoAnswer:
                t_rig_s, t_host_s = self._in_step()
            return [drive.latest(t_rig_s, t_host_s) for drive in self.drives]

    def _in_step(self) -> tuple[float, float]:
        if self._out_of_step:  # a late answer to the SYNC before must not pass for one to the next
            self._sync_once()
        return self._sync_once()

    def _sync_once(self) -> tuple[float, float]:
        counts = [list(drive.tpdo_counts) for drive in self.drives]
        begin_s, t_rig_s = time.monotonic(), self._clock.now_s()
        self._sync()
        t_host_s = 0.5 * (begin_s + time.monotonic())

        def silent() -> list[ServoDrive]:
            return [
                drive
                for drive, old in zip(self.drives, counts, strict=True)
                if any(new == was for new, was in zip(drive.tpdo_counts, old, strict=True))
            ]

        with self._line.received:
            self._line.received.wait_for(lambda: self._line.failed or not silent(), self._pdo_timeout_s)
        self._line.check()
        self._out_of_step = bool(silent())
        for drive in silent():
            raise NoAnswer(
                drive.name,
                drive.where,
                f"no PDO after SYNC, heartbeat {drive.heartbeat().value}",
                "check power and cable of the drive, then connect again",
            )
        return t_rig_s, t_host_s
