"""One maker and its diagnosers, batch after batch: make, diagnose, measure further, fix the answers, score."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.withheld.answers import proposed_visits
from benchmarks.withheld.line_process import exchange
from benchmarks.withheld.noise import replace_all
from benchmarks.withheld.scorer import fixed_answers, score_batch, verdict
from benchmarks.withheld.sealed_diagnoser import ONE_CORE, NotSealed, answer_folder

ROOT = Path(__file__).parents[2]
SURE = 0.9


class RunFailed(RuntimeError):
    """A process of the run ended where it should not; one line."""


@dataclass(frozen=True)
class LaneOptions:
    """The settings of a lane. done: keys of finished cases; finished: number of batches of this lane.

    resembling: effects among which the maker looks for what resembles the true one; none: all. hours: as of `Maker`.
    """

    seed: int | None
    final: bool
    n: int
    kinds: tuple[str, ...]
    lane: int
    lanes: int
    batch: int
    diagnose: str
    noise: bool
    leave_form_out: bool
    sealed: bool
    out: Path
    done: tuple[str, ...]
    finished: int
    resembling: tuple[str, ...]
    hours: float


def run_lane(options: LaneOptions, keep: Callable[[dict[str, Any]], None], begun: Callable[[str], None]) -> None:
    """Run batches until none is left; `keep` gets each finished one, `begun` the maker's commitment."""
    with MakerProcess() as maker:
        begun(maker.start(options))
        number = options.finished
        while True:
            started = time.monotonic()
            folder = options.out / "batches" / f"{options.lane}-{number:03d}"
            if folder.exists():
                shutil.rmtree(folder)
            made = maker.ask(do="make", folder=str(folder / "recordings"))["made"]
            if not made:
                return
            if options.noise:
                replace_all(folder / "recordings", number)
            diagnose(folder / "recordings", folder / "answers", options.diagnose, sealed=options.sealed)
            answers = json.loads((folder / "answers" / "answers.json").read_text(encoding="utf-8"))
            proposals = {name: proposed_visits(a.get("diagnosis", {})) for name, a in answers.items()}
            sure = [name for name, answer in answers.items() if sure_of(answer)]
            if maker.ask(do="more", folder=str(folder / "longer"), proposals=proposals, sure=sure)["made"]:
                if options.noise:
                    replace_all(folder / "longer", number)
                longer, answered = folder / "longer", folder / "longer_answers"
                diagnose(longer, answered, options.diagnose, sealed=options.sealed, baselines=False)
            answers_hash = fixed_answers(folder)
            sealed = maker.ask(do="seal", file=str(folder / "truth.json"), answers_sha256=answers_hash)
            rows = score_batch(folder)
            tidy(folder)
            keep(
                {
                    "batch": f"{options.lane}-{number:03d}",
                    "lane": options.lane,
                    "answers_sha256": answers_hash,
                    "truth_sha256": sealed["truth_sha256"],
                    "seconds": round(time.monotonic() - started, 1),
                    "rows": finite(rows),
                }
            )
            number += 1


class MakerProcess:
    """The process that holds the truth."""

    def __enter__(self) -> MakerProcess:
        """Start it."""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.withheld.maker"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT, env=environment(),
        )  # fmt: skip
        return self

    def __exit__(self, *_: object) -> None:
        """End it; what it holds is gone."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait()

    def start(self, options: LaneOptions) -> str:
        """Tell it what to make; its commitment."""
        answer = self.ask(
            do="start", seed=options.seed, final=options.final, n=options.n, kinds=options.kinds,
            lane=options.lane, lanes=options.lanes, batch=options.batch, done=options.done, finished=options.finished,
            leave_form_out=options.leave_form_out, resembling=options.resembling,
            hours=options.hours,
        )  # fmt: skip
        return str(answer["commitment"])

    def ask(self, **order: Any) -> dict[str, Any]:
        """One order, one answer."""
        answer = exchange(self._process, order)
        if answer is None:
            raise RunFailed(f"withheld: the maker ended at '{order['do']}'; see its message above")
        return answer


def sure_of(answer: dict[str, Any]) -> bool:
    """Whether an answer is so sure of its verdict that gross readings shall not change it."""
    return bool("diagnosis" in answer and answer["diagnosis"]["ranking"].get(verdict(answer), 0.0) > SURE)


def diagnose(recordings: Path, answers: Path, function: str, *, sealed: bool = True, baselines: bool = True) -> None:
    """Run the diagnoser on a folder of recordings; raises RunFailed if it is not sealed, touched the plant or broke."""
    file = recordings.parent / "diagnoser.log"
    with file.open("a", encoding="utf-8") as log:
        try:
            answer_folder(recordings, answers, log, function, sealed=sealed, baselines=baselines)
        except NotSealed as error:
            print(error, file=log)
            raise RunFailed(f"{error} ({file})") from error


def environment() -> dict[str, str]:
    """One core for each process, and our modules on its path."""
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    return {**os.environ, **dict.fromkeys(ONE_CORE, "1"), "PYTHONPATH": path}


def tidy(folder: Path) -> None:
    """Keep what was said and what is true; recordings and arrays of a scored batch go."""
    for name in ("recordings", "longer"):
        shutil.rmtree(folder / name, ignore_errors=True)
    for file in folder.rglob("*.npz"):
        file.unlink()


def finite(value: Any) -> Any:
    """Plain data without numbers that JSON does not have."""
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
