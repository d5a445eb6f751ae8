"""Final runs, which score the odd-numbered recordings: at most five, each one line of the committed log."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

LOG = Path(__file__).parent / "log.jsonl"
MOST = 5


class NoFinalRun(RuntimeError):
    """A final run is not possible; one line."""


@dataclass(frozen=True)
class FinalRun:
    """The right to read the odd truths once; made by `begin` only. number: from 1."""

    log: Path
    number: int
    code: str


def logged(log: Path = LOG) -> list[dict[str, Any]]:
    """Final runs so far; the first line of the log says what it is."""
    lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
    return [entry for entry in map(json.loads, lines) if "run" in entry]


def begin(code: str, log: Path = LOG) -> FinalRun:
    """The next final run of the code with this hash; raises NoFinalRun if there is none left, or none needed."""
    runs = logged(log)
    if len(runs) >= MOST:
        raise NoFinalRun(f"{log} has {len(runs)} final runs, which is the most there may be; run without --final")
    for run in runs:
        if run["code"] == code:
            raise NoFinalRun(f"final run {run['run']} in {log} has scored this very code; its figures stand there")
    return FinalRun(log, len(runs) + 1, code)


def append(run: FinalRun, answers_sha256: str, figures: dict[str, Any]) -> None:
    """Write the run's line; on disk when this returns, so that nothing is shown that is not logged."""
    entry = {
        "run": run.number, "ended": datetime.now(UTC).isoformat(timespec="seconds"), "code": run.code,
        "answers": answers_sha256, "figures": figures,
    }  # fmt: skip
    with run.log.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry, allow_nan=False) + "\n")
        file.flush()
        os.fsync(file.fileno())
