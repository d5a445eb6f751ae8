"""Staying: look every minute whether something is due, and do it when window, PLC and certificates allow it.

APScheduler's thread only says when to look; the work is done in the main thread, where an interrupt stops the drives.
"""

from __future__ import annotations

import queue
from collections.abc import Callable
from datetime import UTC, datetime

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.recalibration.run import RunResult
from pkm_rig.results.callbacks import Notify

MOST_WAIT_S = 1.0  # of the main thread at a time, so that an interrupt is taken soon


class Watcher:
    """One look after another; says and keeps what has changed, not the same every minute."""

    def __init__(self, look: Callable[[], RunResult], notify: Notify) -> None:
        """look: makes a run."""
        self._look, self._notify = look, notify
        self._last: tuple[str, str] | None = None

    def tick(self) -> RunResult | None:
        """Look once; None where another command has store or rig, or where it cannot be judged what is due."""
        try:
            result = self._look()
        except StoreError as error:
            self._say("busy", str(error))
            return None
        except InputError as error:  # a clock that was set back, a rig file that is being written: the next look tells
            self._say("cannot tell", str(error))
            return None
        if result.done in ("nothing", "skipped", "failed"):
            self._say(result.done, result.why)
        else:
            self._last = None
            self._notify(f"{result.done}: {result.why}")
        return result

    def _say(self, done: str, why: str) -> None:
        if (done, why) != self._last:
            self._last = (done, why)
            self._notify(f"{done}: {why}")


def watch(tick: Callable[[], object], every_s: float, most: int | None = None) -> None:
    """Call `tick` every so often until interrupted (or `most` times); looks that were missed meanwhile are one.

    InputError where APScheduler is not installed.
    """
    try:
        from apscheduler.schedulers.background import BackgroundScheduler  # noqa: PLC0415
    except ImportError as error:
        raise InputError("recalibrate watch: APScheduler is not installed; pip install 'pkm-rig[watch]'") from error
    due: queue.Queue[None] = queue.Queue()
    scheduler = BackgroundScheduler(timezone=UTC)
    scheduler.add_job(
        due.put,
        "interval",
        args=[None],
        seconds=every_s,
        next_run_time=datetime.now(UTC),
        coalesce=True,
        misfire_grace_time=None,
    )
    scheduler.start()
    try:
        count = 0
        while most is None or count < most:
            try:
                due.get(timeout=MOST_WAIT_S)
            except queue.Empty:
                continue
            while not due.empty():  # a long calibration: what was missed is one look
                due.get_nowait()
            tick()
            count += 1
    finally:
        scheduler.shutdown(wait=False)
