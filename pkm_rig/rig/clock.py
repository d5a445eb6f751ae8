"""The rig clock: one time for the machine, its devices and everyone who waits.

In one process time is virtual: it stands still while anyone works and jumps to the earliest due event
when everyone waits. Between processes it is host time, multiplied by the rig file's `time_scale`.
See docs/decisions/0001-rig-clock.md.
"""

from __future__ import annotations

import heapq
import itertools
import logging
import queue
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

_log = logging.getLogger(__name__)


class RigClock(Protocol):
    """What a device, a driver or a plan may ask of time."""

    def now_s(self) -> float:
        """Rig time in seconds; a campaign's later sessions begin where the earlier ones ended."""
        ...

    def sleep_s(self, duration_s: float) -> None:
        """Block the calling thread for a duration of rig time."""
        ...

    def call_at(self, t_s: float, callback: Callable[[], None]) -> Callable[[], None]:
        """Call back once at rig time `t_s`, from the clock's or a sleeping thread; returns a function that cancels."""
        ...

    def activity(self) -> AbstractContextManager[None]:
        """Take part as one activity: time stands still until this activity waits as well."""
        ...

    def hold(self) -> None:
        """Keep time from advancing: something is on its way (a frame on the bus)."""
        ...

    def release(self) -> None:
        """Undo one `hold`."""
        ...

    def close(self) -> None:
        """Stop the clock's own threads; sleepers are woken."""
        ...


class VirtualClock:
    """Event-ordered time for one process.

    `_running` counts what may still act at this instant: registered activities that do not sleep, frames
    in flight, callbacks being run. A thread that works on another's behalf (a server answering a request,
    a worker carrying out a move) is not counted: its client's activity is, and blocks. When such
    a thread sleeps it lends that activity's turn, so time can pass during a request and not around it.
    Time advances only towards a sleeper: callbacks alone (heartbeats) do not make it run away.
    It begins at `start_s`.
    """

    def __init__(self, start_s: float = 0.0) -> None:
        self._lock = threading.Lock()
        self._now_s = start_s
        self._running = 0
        self._sleepers = 0
        self._order = itertools.count()
        self._events: list[tuple[float, int, _Event]] = []
        self._closed = False
        self._due: queue.SimpleQueue[_Event | None] = queue.SimpleQueue()
        self._dispatcher = threading.Thread(target=self._dispatch, name="rig-clock", daemon=True)
        self._dispatcher.start()

    def now_s(self) -> float:
        """Rig time in seconds."""
        return self._now_s

    def sleep_s(self, duration_s: float) -> None:
        """Block until the clock has advanced by `duration_s`."""
        if duration_s <= 0.0:
            return
        wake = threading.Event()
        event = _Event(wake=wake)
        with self._lock:
            if self._closed:
                return
            self._push(self._now_s + duration_s, event)
            self._sleepers += 1
            self._running -= 1
            callback = self._advance(inline=True)
        while callback is not None:  # a thread that is about to sleep has time for what is due before it wakes
            _run(callback)
            with self._lock:
                self._running -= 1
                callback = self._advance(inline=True)
        wake.wait()

    def call_at(self, t_s: float, callback: Callable[[], None]) -> Callable[[], None]:
        """Call back once at `t_s`; returns a function that cancels."""
        event = _Event(callback=callback)
        with self._lock:
            self._push(max(t_s, self._now_s), event)
        return event.cancel

    @contextmanager
    def activity(self) -> Iterator[None]:
        """Take part: time stands still while the activity runs."""
        self.hold()
        try:
            yield
        finally:
            self.release()

    def hold(self) -> None:
        """Count one more thing that may act at this instant."""
        with self._lock:
            self._running += 1

    def release(self) -> None:
        """Count one thing less and advance when nothing is left."""
        with self._lock:
            self._running -= 1
            self._advance()

    def close(self) -> None:
        """Wake all sleepers and end the dispatcher."""
        with self._lock:
            self._closed = True
            for _, _, event in self._events:
                if event.wake is not None:
                    event.wake.set()
            self._events.clear()
        self._due.put(None)
        self._dispatcher.join(timeout=5.0)

    def _push(self, t_s: float, event: _Event) -> None:
        heapq.heappush(self._events, (t_s, next(self._order), event))

    def _advance(self, *, inline: bool = False) -> _Event | None:
        """Wake the earliest events while nobody runs. Called with the lock held.

        A due callback goes to the dispatcher, or with `inline` back to the caller, who then runs it and
        calls again: that spares two changes of thread.
        """
        while self._running <= 0 and self._sleepers > 0 and self._events:
            t_s, _, event = heapq.heappop(self._events)
            if event.cancelled:
                continue
            self._now_s = max(self._now_s, t_s)
            self._running += 1
            if event.wake is not None:
                self._sleepers -= 1
                event.wake.set()
            elif inline:
                return event
            else:
                self._due.put(event)
        return None

    def _dispatch(self) -> None:
        while (event := self._due.get()) is not None:
            try:
                _run(event)
            finally:
                self.release()


class ScaledClock:
    """Host time multiplied by a factor, counted from `start_s`; factor 1 is real time."""

    def __init__(self, time_scale: float = 1.0, start_s: float = 0.0) -> None:
        if not time_scale > 0.0:
            raise ValueError(f"time_scale must be positive, not {time_scale}")
        self.time_scale = time_scale
        self._start_s = start_s
        self._made_s = time.monotonic()
        self._closed = threading.Event()
        self._changed = threading.Condition()
        self._order = itertools.count()
        self._events: list[tuple[float, int, _Event]] = []
        self._dispatcher = threading.Thread(target=self._dispatch, name="rig-clock", daemon=True)
        self._dispatcher.start()

    def now_s(self) -> float:
        """Rig time in seconds."""
        return self._start_s + (time.monotonic() - self._made_s) * self.time_scale

    def sleep_s(self, duration_s: float) -> None:
        """Block for `duration_s` of rig time."""
        if duration_s > 0.0:
            self._closed.wait(duration_s / self.time_scale)

    def call_at(self, t_s: float, callback: Callable[[], None]) -> Callable[[], None]:
        """Call back once at `t_s`; returns a function that cancels."""
        event = _Event(callback=callback)
        with self._changed:
            heapq.heappush(self._events, (t_s, next(self._order), event))
            self._changed.notify()
        return event.cancel

    @contextmanager
    def activity(self) -> Iterator[None]:
        """Nothing to do: host time waits for nobody."""
        yield

    def hold(self) -> None:
        """Nothing to do."""

    def release(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Wake all sleepers and end the dispatcher."""
        self._closed.set()
        with self._changed:
            self._changed.notify()
        self._dispatcher.join(timeout=5.0)

    def _dispatch(self) -> None:
        while not self._closed.is_set():
            with self._changed:
                wait_s = (self._events[0][0] - self.now_s()) / self.time_scale if self._events else None
                if wait_s is None or wait_s > 0.0:
                    self._changed.wait(wait_s)
                    continue
                _, _, event = heapq.heappop(self._events)
            _run(event)


def _run(event: _Event) -> None:
    if event.cancelled or event.callback is None:
        return
    try:
        event.callback()
    except Exception:
        _log.exception("a clock callback failed")


class _Event:
    """A sleeper to wake or a callback to run."""

    __slots__ = ("callback", "cancelled", "wake")

    def __init__(self, *, wake: threading.Event | None = None, callback: Callable[[], None] | None = None) -> None:
        self.wake = wake
        self.callback = callback
        self.cancelled = False

    def cancel(self) -> None:
        self.cancelled = True
