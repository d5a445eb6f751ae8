"""The processes of the sweep: a mock that outlives the host, and hosts that are killed; and the store between them."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pkm_rig.store.place import STORE_NAME
from pkm_rig.virtual.new_rig import with_values, write_new_rig

RIG = Path(__file__).with_name("rig.toml")
# The mock's station scatters and drifts by a quarter of what the host is told. What is measured anew, and later, has
# other noise: the predictions of two campaigns with the stated one are apart by up to 0.75 u, and errors of the
# bookkeeping would hide behind that.
_QUIET = {
    ("station.accuracy", "angle_sd_rad"): "0.6e-6",
    ("station.accuracy", "range_sd_m"): "2.5e-5",
    ("station.accuracy", "drift_rad_per_sqrt_h"): "7.5e-7",
    ("station.accuracy", "drift_of_level_rad_per_sqrt_h"): "2.5e-7",
    ("station.accuracy", "drift_m_per_sqrt_h"): "2.5e-6",
}
START_S = 60.0
LONGEST_S = 900.0  # of a command, on a computer that does other things as well


class MockProcess:
    """A mock in a process of its own, with a state file: killed and started again it goes on."""

    def __init__(self, folder: Path, template: Path = RIG) -> None:
        self.rig, self._state = folder / "rig.toml", folder / "mock.state"
        if not self.rig.exists():
            write_new_rig(template, self.rig, anywhere=True)
        self._served = folder / "served.toml"
        self._served.write_text(with_values(self.rig.read_text(encoding="utf-8"), _QUIET), encoding="utf-8")
        self._said = (folder / "mock.out").open("a", encoding="utf-8")
        self.start()

    def start(self) -> None:
        """Start it; returns when it serves."""
        command = [sys.executable, "-m", "pkm_rig.cli", "mock", "--rig", str(self._served), "--state", str(self._state)]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._said, text=True
        )
        while not self._line().startswith("connect:"):
            pass

    def tell(self, line: str) -> str:
        """Have it carry out a line; returns its answer."""
        stdin = self.process.stdin
        if stdin is None:
            raise RuntimeError("the mock has no stdin")
        stdin.write(f"{line}\n")
        stdin.flush()
        return self._line().strip()

    def status(self) -> dict[str, Any]:
        """What its drives do."""
        found: dict[str, Any] = json.loads(self.tell("status"))
        return found

    def kill(self) -> None:
        """End it as a power failure does."""
        self.process.kill()
        self.process.wait(START_S)
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                stream.close()

    def close(self) -> None:
        """End it for good."""
        self.kill()
        self._said.close()

    def _line(self) -> str:
        stdout = self.process.stdout
        line = "" if stdout is None else stdout.readline()
        if not line:
            raise RuntimeError(f"the mock has ended; see {self._said.name}")
        return line


@dataclass(frozen=True)
class Ended:
    """How a host ended: its status (-9 if it was killed), the last line that it said, and what struck it."""

    status: int
    last_line: str
    log: dict[str, Any]
    seconds: float


class HostProcess:
    """One command of pkm-rig in a process of its own."""

    def __init__(self, arguments: list[str], folder: Path, kill: str = "none") -> None:
        self._log, self._out = folder / "kills.jsonl", folder / "host.out"
        self._log.touch()
        self._lines = len(self._log.read_text(encoding="utf-8").splitlines())
        self._begin_s = time.monotonic()
        with self._out.open("ab") as out:
            out.write(f"\n$ {kill} pkm-rig {' '.join(arguments)}\n".encode())
            out.flush()
            command = [sys.executable, "-m", "benchmarks.kill_sweep.host", kill, str(self._log), *arguments]
            environment = {**os.environ, "COLUMNS": "200"}
            self.process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT, env=environment
            )

    def wait(self, limit_s: float = LONGEST_S) -> Ended:
        """Wait for its end; one that does not end is killed and raises TimeoutError."""
        try:
            status = self.process.wait(limit_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait(START_S)
            raise TimeoutError(f"the host has not ended in {limit_s:g} s; see {self._out}") from None
        lines = [line for line in self._out.read_text(encoding="utf-8", errors="replace").splitlines() if line.strip()]
        logged = self._log.read_text(encoding="utf-8").splitlines()[self._lines :]
        log = json.loads(logged[-1]) if logged else {}
        return Ended(status, lines[-1].strip(), log, time.monotonic() - self._begin_s)

    def stop(self) -> None:
        """Have it stand still (SIGSTOP), as a computer that hangs."""
        self.process.send_signal(signal.SIGSTOP)


class StoreView:
    """The store as another program sees it, read without the product's code."""

    def __init__(self, out: Path) -> None:
        self._path = out / STORE_NAME

    def campaign(self) -> str | None:
        """Id of the campaign that was begun last."""
        rows = self._rows("SELECT id FROM campaigns ORDER BY created DESC LIMIT 1")
        return str(rows[0][0]) if rows else None

    def readings(self) -> dict[str, str]:
        """Stored text of every reading, by its uid."""
        return {str(uid): f"{sequence} {data}" for uid, sequence, data in self._rows(
            "SELECT uid, sequence, data FROM readings"
        )}  # fmt: skip

    def count(self) -> int:
        """Number of readings."""
        rows = self._rows("SELECT COUNT(*) FROM readings")
        return int(rows[0][0]) if rows else 0

    def kinds(self) -> list[str]:
        """Kinds of all events, in their order."""
        return [str(kind) for (kind,) in self._rows("SELECT kind FROM events ORDER BY rowid")]

    def _rows(self, query: str) -> list[tuple[Any, ...]]:
        if not self._path.is_file():
            return []
        try:
            with closing(sqlite3.connect(f"file:{self._path}?mode=ro", uri=True, timeout=20.0)) as connection:
                return connection.execute(query).fetchall()
        except sqlite3.OperationalError as error:  # the tables are not made yet
            if "no such table" in str(error):
                return []
            raise


def wait_until(condition: Callable[[], bool], process: subprocess.Popen[Any], poll_s: float = 0.02) -> bool:
    """Wait for something while a process runs; whether it came before the process ended."""
    while process.poll() is None:
        if condition():
            return True
        time.sleep(poll_s)
    return condition()
