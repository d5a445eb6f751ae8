"""One campaign that is struck again and again and taken up again after each strike."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.kill_sweep.checks import Measured, changed_readings, drive_problems, measured, problems
from benchmarks.kill_sweep.processes import Ended, HostProcess, MockProcess, StoreView, wait_until
from benchmarks.kill_sweep.strikes import RECOVERY_OPERATIONS, Chain, Strike

KILLED = -9
DEVICE = 3
MOST_SESSIONS = 25
READINGS_ON_TRIAL = 90  # from the activation to the verdict: poses of the verification and reflectors of the platform
SESSION_LIMIT_S = 60.0  # after a device was struck


class Untouched:
    """The reference: the same campaign, nobody killed."""

    def __init__(self, folder: Path) -> None:
        self.out = folder / "runs"
        mock = MockProcess(folder)
        try:
            ended = HostProcess(["calibrate", "--rig", str(mock.rig), "--out", str(self.out)], folder).wait()
            self.problems = [] if ended.status == 0 else [f"status {ended.status}: {ended.last_line}"]
            self.problems += drive_problems(mock.status())
        finally:
            mock.close()
        view = StoreView(self.out)
        self.campaign = view.campaign() or ""
        self.readings = view.count()
        self.counts: dict[str, int] = ended.log.get("counts", {})

    def measured(self) -> Measured:
        """Its readings and fit."""
        return measured(self.out, self.campaign)


class ChainRun:
    """One chain in a folder of its own. `operations` and `readings` are those of the untouched run."""

    def __init__(self, chain: Chain, folder: Path, operations: dict[str, int], readings: int) -> None:
        self.chain, self.folder, self.out = chain, folder, folder / "runs"
        self.view = StoreView(self.out)
        self._operations, self._readings = operations, readings
        self.results: list[dict[str, Any]] = []
        self._in_tables = False

    def run(self, reference: Measured) -> list[dict[str, Any]]:
        """All strikes, then to the end; one result a strike."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self.mock = MockProcess(self.folder)
        try:
            before: dict[str, str] = {}
            ended = None
            for strike in self.chain.strikes:
                ended, after = self._session(strike, before)
                before = after
                if ended is not None and ended.status == 0:
                    break
            final = self._go_on() if ended is None or ended.status != 0 else ended
            wrong = self._final_problems(final, before, reference)
        finally:
            self.mock.close()
        if self.results:
            self.results[-1]["problems"] += wrong
        return self.results

    def _session(self, strike: Strike, before: dict[str, str]) -> tuple[Ended | None, dict[str, str]]:
        wrong: list[str] = []
        if strike.victim == "host":
            kill = self._kill_of(strike)
            ended = self._go_on(kill)
            struck = ended.log.get("struck")
            if struck is None and ended.status != 0:
                wrong.append(f"before the strike: status {ended.status}: {ended.last_line}")
            if struck is not None and ended.status != KILLED:
                wrong.append(f"killed, yet the status is {ended.status}")
            self._in_tables = self._in_tables or bool(ended.log.get("tables"))
        else:
            struck, ended, wrong = self._strike_device(strike)
        after = self.view.readings()
        wrong += changed_readings(before, after)
        self.results.append(
            {
                "chain": self.chain.name,
                "strike": asdict(strike),
                "struck": struck,
                "status": ended.status,
                "said": ended.last_line,
                "readings": len(after),
                "seconds": round(ended.seconds, 1),
                "problems": wrong,
            }
        )
        return ended, after

    def _kill_of(self, strike: Strike) -> str:
        if strike.window == "recovery":
            return f"start:{strike.kind}:{1 + int(strike.share * RECOVERY_OPERATIONS)}"
        if strike.window == "tables":
            number = self._operations.get(f"tables:{strike.kind}", 100)
            window = "start" if self._in_tables else "tables"
            return f"{window}:{strike.kind}:{1 + int(0.9 * strike.share * number)}"
        number = self._operations.get(f"start:{strike.kind}", 100) - self._operations.get(f"tables:{strike.kind}", 0)
        left = max(0.05, 1.0 - self.view.count() / max(1, self._readings))
        return f"start:{strike.kind}:{1 + int(0.8 * strike.share * left * number)}"

    def _strike_device(self, strike: Strike) -> tuple[str | None, Ended, list[str]]:
        """Kill the mock or restart a drive when so many readings more are there; the host has to notice and end."""
        at_start = self.view.count()
        wanted = at_start + 1 + int(0.8 * strike.share * max(10, self._readings - at_start))
        activations = self.view.kinds().count("activated")
        host = HostProcess(self._arguments(), self.folder)
        if strike.window == "tables":
            came = wait_until(lambda: self.view.kinds().count("activated") > activations, host.process)
            wanted = self.view.count() + int(0.8 * strike.share * READINGS_ON_TRIAL)
            came = came and wait_until(lambda: self.view.count() >= wanted, host.process)
        else:
            came = wait_until(lambda: self.view.count() >= wanted, host.process)
        struck = None
        if came and host.process.poll() is None:
            struck = f"{strike.victim} at reading {self.view.count()}"
            if strike.victim == "mock":
                self.mock.kill()
            else:
                drive = random.Random(str(strike)).choice(["left", "right"])
                struck += f": {self.mock.tell(f'drive restart {drive}')}"
        ended = host.wait(SESSION_LIMIT_S if struck else 900.0)
        wrong = []
        if struck is None and ended.status != 0:
            wrong.append(f"before the strike: status {ended.status}: {ended.last_line}")
        if strike.victim == "mock" and struck is not None:
            self.mock.start()
        if struck is not None and ended.status not in (0, DEVICE):
            wrong.append(f"status {ended.status}, not {DEVICE}: {ended.last_line}")
        if strike.victim == "drive" and struck is not None and ended.status == 0:
            wrong.append("a drive restarted and nobody noticed")
        return struck, ended, wrong

    def _go_on(self, kill: str = "none") -> Ended:
        """Go on to the end, or until the host is killed."""
        return HostProcess(self._arguments(), self.folder, kill).wait()

    def _arguments(self) -> list[str]:
        """The command that goes on with what is there."""
        common = ["--rig", str(self.mock.rig), "--out", str(self.out)]
        campaign = self.view.campaign()
        return ["calibrate", *common, *(["--resume", campaign] if campaign else [])]

    def _final_problems(self, ended: Ended, before: dict[str, str], reference: Measured) -> list[str]:
        campaign = self.view.campaign()
        if ended.status != 0 or campaign is None:
            return [f"the end: status {ended.status}: {ended.last_line}"]
        wrong = drive_problems(self.mock.status())
        audit = subprocess.run(
            [sys.executable, "-m", "pkm_rig.cli", "audit", campaign, "--out", str(self.out)],
            check=False, capture_output=True, text=True, env=os.environ,
        )  # fmt: skip
        if audit.returncode != 0:
            wrong.append(f"audit: {(audit.stderr.strip() or audit.stdout.strip()).splitlines()[-1]}")
        return wrong + problems(before, self.view.readings(), measured(self.out, campaign), reference)
