"""One thread that does the rig's work, and the status of each of its jobs for bluesky."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


class WorkStatus:
    """Bluesky's Status of one job of the worker; names device and cause."""

    def __init__(self, what: str) -> None:
        self._reading_kind = what
        self._done = threading.Event()
        self._error: BaseException | None = None
        self._lock = threading.Lock()
        self._callbacks: list[Callable[[WorkStatus], None]] = []

    @property
    def done(self) -> bool:
        """Whether the job has ended."""
        return self._done.is_set()

    @property
    def success(self) -> bool:
        """Whether it has ended well."""
        return self.done and self._error is None

    def exception(self, timeout: float | None = 0.0) -> BaseException | None:
        """Why it failed."""
        self._done.wait(timeout)
        return self._error

    def add_callback(self, callback: Callable[[WorkStatus], None]) -> None:
        """Be called at the end, or at once if it has ended."""
        with self._lock:
            if not self.done:
                self._callbacks.append(callback)
                return
        callback(self)

    def finish(self, error: BaseException | None) -> None:
        """End the job."""
        with self._lock:
            self._error = error
            self._done.set()
            callbacks, self._callbacks = self._callbacks, []
        for callback in callbacks:
            callback(self)

    def __repr__(self) -> str:
        state = "running" if not self.done else "done" if self._error is None else f"failed: {self._error}"
        return f"<{self._reading_kind}: {state}>"


class Worker:
    """One thread that does the rig's work in order.

    A job whose error is pardoned ends well; the first such error waits in `pardoned` for whoever made the plan.
    """

    def __init__(self, pardons: Callable[[BaseException], bool] = lambda _error: False) -> None:
        self._pardons = pardons
        self.pardoned: BaseException | None = None
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="rig-worker")

    def submit(self, what: str, work: Callable[[], None]) -> WorkStatus:
        """Queue a job."""
        status = WorkStatus(what)

        def run() -> None:
            try:
                work()
            except BaseException as error:
                if self._pardons(error):
                    self.pardoned = self.pardoned or error
                    status.finish(None)
                else:
                    status.finish(error)
            else:
                status.finish(None)

        self._pool.submit(run)
        return status

    def close(self) -> None:
        """End the thread after the job in hand."""
        self._pool.shutdown(wait=True)
