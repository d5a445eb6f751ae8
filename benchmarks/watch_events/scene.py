"""One event's stage: a mock in a process of its own, a store with a calibrated machine, and a watcher beside them."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.kill_sweep.processes import RIG, MockProcess, StoreView
from benchmarks.watch_events.tables import Held

WEEK_S = 8.0 * 86400.0  # after the calibration: a check is due
TIME_SCALE = 20.0  # slow enough for a check to last minutes of rig time on a computer that does other things as well
LIMIT_S = 1500.0  # of anything that is waited for, on a computer that does other things as well
SETTINGS = """
[recalibration]
tolerance_m = 60e-6
alone = true
windows = [{ begin = "00:00", end = "00:00" }]
[recalibration.plc]
automatic = 21
state = 22
days_left = 23
alarm = 24
"""
CLOSED = 'windows = [{ days = ["%s"], begin = "03:00", end = "03:01" }]'


def write_template(folder: Path, top: str = "") -> Path:
    """The short rig of the kill sweep, to be re-calibrated by itself."""
    path = folder / "template.toml"
    text = RIG.read_text(encoding="utf-8").replace("time_scale = 40.0 ", f"time_scale = {TIME_SCALE} ")
    head, campaign = text.split("[nuisance]")
    path.write_text(f"{head}{top}\n[nuisance]{campaign}{SETTINGS}", encoding="utf-8")
    return path


def run_command(words: list[str], said: Path, shift_s: float = 0.0) -> int:
    """Run a command of pkm-rig to its end; its status."""
    with said.open("ab") as out:
        command = [sys.executable, "-m", "benchmarks.watch_events.host", str(shift_s), *words]
        return subprocess.run(command, stdout=out, stderr=subprocess.STDOUT, check=False, timeout=LIMIT_S).returncode


def make_baseline(folder: Path) -> Path:
    """A machine that was calibrated once: its store and the mock's state, made once."""
    done = folder / "done"
    if done.exists():
        return folder
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    mock = MockProcess(folder, write_template(folder))
    try:
        words = ["calibrate", "--rig", str(mock.rig), "--out", str(folder / "runs")]
        status = run_command(words, folder / "said.txt")
        time.sleep(1.0)  # the mock writes its state every 0.25 s
    finally:
        mock.close()
    if status != 0:
        raise RuntimeError(f"the first calibration: status {status}; see {folder / 'said.txt'}")
    done.touch()
    return folder


class Scene:
    """A copy of the calibrated machine in a folder of its own, its tables in use; `top`: more of its rig file."""

    def __init__(self, folder: Path, baseline: Path, top: str = "") -> None:
        if folder.exists():
            shutil.rmtree(folder)
        shutil.copytree(baseline / "runs", folder / "runs")
        shutil.copy(baseline / "mock.state", folder / "mock.state")
        self.folder, self.out, self.said = folder, folder / "runs", folder / "said.txt"
        self.mock = MockProcess(folder, write_template(folder, top))
        self.rig, self.store = self.mock.rig, StoreView(self.out)
        self._watch: subprocess.Popen[bytes] | None = None
        self.statuses: list[int] = []
        words = ["health", "--rig", str(self.rig), "--out", str(self.out)]
        if run_command(words, self.said) != 0:
            self.close()
            raise RuntimeError(f"the machine is not fit before the event; see {self.said}")
        self.before = self.held()

    def held(self) -> Held:
        """What the drives hold and use now."""
        return Held.of(self.mock.status())

    def edit(self, old: str, new: str) -> None:
        """Change the rig file, as an editor does: in one step."""
        text = self.rig.read_text(encoding="utf-8")
        if old not in text:
            raise RuntimeError(f"the rig file has no {old!r}")
        beside = self.rig.with_suffix(".new")
        beside.write_text(text.replace(old, new), encoding="utf-8")
        os.replace(beside, self.rig)

    def note(self, event: str, part: str, shift_s: float = WEEK_S) -> None:
        """Enter an event, as somebody at the machine does."""
        words = ["recalibrate", "note", "--rig", str(self.rig), "--out", str(self.out), "--event", event]
        status = run_command([*words, "--part", part, "--who", "the setter", "--why", "seen"], self.said, shift_s)
        if status != 0:
            raise RuntimeError(f"recalibrate note: status {status}; see {self.said}")

    def watch(self, shift_s: float = WEEK_S) -> None:
        """Start the watcher."""
        words = ["recalibrate", "watch", "--rig", str(self.rig), "--out", str(self.out), "--every-s", "2"]
        command = [sys.executable, "-m", "benchmarks.watch_events.host", str(shift_s), *words]
        with self.said.open("ab") as out:
            self._watch = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.STDOUT)

    def lines(self) -> list[dict[str, Any]]:
        """The journal."""
        path = self.out / "recalibration-mock-rig.jsonl"
        if not path.is_file():
            return []
        return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.endswith("}")]

    def wait_for(self, *done: str, after: int = 0) -> dict[str, Any]:
        """The first line of the journal, after so many, that says one of these; TimeoutError without."""
        self._wait(lambda: any(line["done"] in done for line in self.lines()[after:]), " or ".join(done))
        return next(line for line in self.lines()[after:] if line["done"] in done)

    def wait_for_trial(self) -> None:
        """Until new tables are on trial and have been measured with."""
        before = self.store.kinds().count("activated")
        self._wait(lambda: self.store.kinds().count("activated") > before, "tables on trial")
        count = self.store.count()
        self._wait(lambda: self.store.count() > count + 5, "readings with tables on trial")

    def settle(self, seconds: float = 8.0) -> None:
        """Let the watcher look a few times more."""
        time.sleep(seconds)

    def kill_watch(self) -> None:
        """End the watcher as a power failure of its computer does."""
        if self._watch is not None:
            self._watch.kill()
            self._watch.wait(LIMIT_S)
            self._watch = None

    def end_watch(self) -> None:
        """Ctrl-C; its status is kept."""
        if self._watch is not None:
            self._watch.send_signal(signal.SIGINT)
            self.statuses.append(self._watch.wait(LIMIT_S))
            self._watch = None

    def close(self) -> None:
        """End everything."""
        self.kill_watch()
        self.mock.close()

    def _wait(self, condition: Callable[[], bool], what: str) -> None:
        end_s = time.monotonic() + LIMIT_S
        while not condition():
            if self._watch is not None and self._watch.poll() is not None:
                raise RuntimeError(f"the watcher has ended with status {self._watch.returncode}; see {self.said}")
            if time.monotonic() > end_s:
                raise TimeoutError(f"waited {LIMIT_S:.0f} s for {what}; see {self.said}")
            time.sleep(0.2)
