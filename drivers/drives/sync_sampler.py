"""All drives sampled at one SYNC, from any thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from drivers.clock import RigClock
from drivers.drives.servo_drive import DriveSample, ServoDrive
from drivers.errors import NoAnswer

_POLLS_PER_PERIOD = 20

CyclicSync = Callable[[Callable[[], None]], list[DriveSample]]


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
        self._cyclic_samples: list[DriveSample] | None = None
        self._out_of_step = False

    def sample(self) -> list[DriveSample]:
        """A sample of each drive at one SYNC, which is sent a second time if an answer is lost.

        During a cyclic motion these are the samples of its last SYNC: another one would make the drives take over their
        targets at the wrong time. Raises NoAnswer naming the silent drive, ConnectionFailed.
        """
        samples = self._cyclic_samples
        if samples is not None:  # without the lock: the thread of the motion may be asleep on the clock
            return samples
        with self._sample_lock:
            return self._cyclic_samples or self._sample(self._wait_host)

    @contextmanager
    def cyclic_sync(self, samples: list[DriveSample], period_s: float) -> Iterator[CyclicSync]:
        """Reserve SYNC for a cyclic motion; yields a function that sends targets and SYNC and returns the samples.

        `samples` are the last ones. An answer is awaited for about `period_s` of rig time, because moving drives do not
        tolerate a longer silence; SYNC is then sent once more.
        """

        def send_row(send_targets: Callable[[], None]) -> list[DriveSample]:
            send_targets()
            self._cyclic_samples = samples = self._sample(lambda answered: self._wait_rig(answered, period_s))
            return samples

        with self._sample_lock:  # from here on no other thread sends SYNC
            self._cyclic_samples = samples
        try:
            yield send_row
        finally:
            self._cyclic_samples = None

    def _sample(self, wait: Callable[[Callable[[], bool]], None]) -> list[DriveSample]:
        try:
            t_rig_s, t_host_s = self._in_step(wait)
        except NoAnswer:
            t_rig_s, t_host_s = self._in_step(wait)
        return [drive.latest(t_rig_s, t_host_s) for drive in self.drives]

    def _in_step(self, wait: Callable[[Callable[[], bool]], None]) -> tuple[float, float]:
        if self._out_of_step:  # a late answer to the previous SYNC must not count for the next
            self._sync_once(wait)
        return self._sync_once(wait)

    def _sync_once(self, wait: Callable[[Callable[[], bool]], None]) -> tuple[float, float]:
        counts = [list(drive.messages.tpdo_counts) for drive in self.drives]
        begin_s, t_rig_s = time.monotonic(), self._clock.now_s()
        self._sync()
        t_host_s = 0.5 * (begin_s + time.monotonic())

        def silent() -> list[ServoDrive]:
            return [
                drive
                for drive, old in zip(self.drives, counts, strict=True)
                if any(new == was for new, was in zip(drive.messages.tpdo_counts, old, strict=True))
            ]

        wait(lambda: self._line.failed is not None or not silent())
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

    def _wait_host(self, answered: Callable[[], bool]) -> None:
        with self._line.received:
            self._line.received.wait_for(answered, self._pdo_timeout_s)

    def _wait_rig(self, answered: Callable[[], bool], limit_s: float) -> None:
        for _ in range(_POLLS_PER_PERIOD):
            if answered():
                return
            self._clock.sleep_s(limit_s / _POLLS_PER_PERIOD)
