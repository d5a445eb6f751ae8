"""Follows a campaign that is being measured: identifies it from time to time, in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from pkm_rig.results.estimate import Estimate

REST = 2.0  # times as long as an estimate has taken; in a campaign of hours MORE_READINGS makes them rarer
LEAST_REST_S = 2.0
MORE_READINGS = 1.15  # times as many as the last time, to be worth another
FIRST_READINGS = 30
LIMIT_S = 600.0
MOST_ESTIMATES = 200


class Follower:
    """Estimates of one campaign after the other; `estimates` and `version` may be read from any thread."""

    def __init__(self, out: Path, host_s: Callable[[], float] = time.monotonic) -> None:
        self._out, self._host_s = out, host_s
        self._lock = threading.Lock()
        self._process: subprocess.Popen[str] | None = None
        self._campaign, self._tried, self._not_before_s = "", 0, 0.0
        self.estimates: tuple[Estimate, ...] = ()
        self.version = 0

    def look(self, campaign: str, readings: int) -> None:
        """Begin an estimate of a campaign with so many readings if there is need of one; returns at once."""
        with self._lock:
            if campaign != self._campaign:
                self._campaign, self._tried, self.estimates = campaign, 0, ()
                self.version += 1
            due = self._process is None and self._host_s() >= self._not_before_s
            if not campaign or not due or readings < max(FIRST_READINGS, MORE_READINGS * self._tried):
                return
            self._tried = readings
            command = [sys.executable, "-m", "pkm_rig.jobs.running_estimate", str(self._out), campaign]
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
            )
            threading.Thread(target=self._wait, args=(self._process, campaign), name="estimate", daemon=True).start()

    def close(self) -> None:
        """End an estimate that is under way."""
        with self._lock:
            if self._process is not None:
                self._process.kill()

    def _wait(self, process: subprocess.Popen[str], campaign: str) -> None:
        begun_s = self._host_s()
        try:
            printed, _ = process.communicate(timeout=LIMIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            printed, _ = process.communicate()
        with self._lock:
            self._process = None
            self._not_before_s = self._host_s() + max(LEAST_REST_S, REST * (self._host_s() - begun_s))
            if printed.strip() and campaign == self._campaign:
                self.estimates = (*self.estimates, Estimate.of_dict(json.loads(printed)))[-MOST_ESTIMATES:]
                self.version += 1
