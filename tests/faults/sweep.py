"""Every fault at every operation of the short campaign, SQLite style: N = 1, 2, ... until a run passes untouched.

`make faults`, or `python -m tests.faults.sweep [--out FOLDER] [--jobs N] [--only NAME ...]`. Results are kept in
FOLDER/results.jsonl as they come; a second call goes on where the first one was ended. `--fresh` begins anew.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import asdict
from pathlib import Path

from benchmarks.side_by_side import end_with_parent
from mock_devices.faults import FAULTS, Fault
from pkm_rig.jobs.session import pin_to_one_core
from tests.faults.attempt import ENDED_RIGHT, STOPPED, UNTOUCHED, WRONG, Result, attempt, reference
from tests.faults.short_campaign import Key

MOST_OPERATIONS = 20_000
_wanted: Mapping[Key, Mapping[str, float]] = {}


def main() -> int:
    """Run what is missing, print the table; the exit status is 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/faults"))
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--only", nargs="*", default=list(FAULTS), choices=tuple(FAULTS), metavar="NAME")
    parser.add_argument("--fresh", action="store_true", help="forget former results")
    parser.add_argument("--minutes", type=float, default=60.0, help="end after so long; call again to go on")
    given = parser.parse_args()
    path = given.out / "results.jsonl"
    if given.fresh:
        path.unlink(missing_ok=True)
    given.out.mkdir(parents=True, exist_ok=True)
    results = _read(path)
    began_s = time.monotonic()
    complete = _sweep(given.only, given.jobs, results, path, began_s + 60.0 * given.minutes)
    _print(results, given.only, complete, time.monotonic() - began_s)
    return 1 if any(result.outcome == WRONG for result in results.values()) else 0


def _sweep(names: list[str], jobs: int, results: dict[tuple[str, int], Result], path: Path, end_s: float) -> bool:
    """Run what is missing; whether every fault has come to an untouched run."""
    ended = {name for name, _ in results if any(r.fault == name and r.outcome == UNTOUCHED for r in results.values())}
    missing = _missing([name for name in names if name not in ended], results, ended)
    context = multiprocessing.get_context("spawn")
    running: set[Future[Result]] = set()
    with (
        ProcessPoolExecutor(jobs, mp_context=context, initializer=_prepare) as pool,
        path.open("a", encoding="utf-8") as log,
    ):
        while True:
            while len(running) < 2 * jobs and time.monotonic() < end_s and (fault := next(missing, None)):
                running.add(pool.submit(_one, fault))
            if not running:
                return next(missing, None) is None
            done, running = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                result = future.result()
                results[result.fault, result.at] = result
                if result.outcome == UNTOUCHED:
                    ended.add(result.fault)
                log.write(json.dumps(asdict(result)) + "\n")
                log.flush()


def _missing(names: list[str], results: Mapping[tuple[str, int], Result], ended: set[str]) -> Iterator[Fault]:
    for name in names:
        for at in range(1, MOST_OPERATIONS):
            if name in ended:
                break
            if (name, at) not in results:
                yield Fault(name, at)


def _prepare() -> None:
    global _wanted  # noqa: PLW0603  one reference a process
    end_with_parent()
    _wanted = reference()


def _one(fault: Fault) -> Result:
    with pin_to_one_core(os.getpid()):
        return attempt(fault, _wanted)


def _read(path: Path) -> dict[tuple[str, int], Result]:
    if not path.is_file():
        return {}
    rows = [Result(**json.loads(line)) for line in path.read_text(encoding="utf-8").splitlines() if line.endswith("}")]
    return {(row.fault, row.at): row for row in rows}


def _print(results: Mapping[tuple[str, int], Result], names: list[str], complete: bool, took_s: float) -> None:
    print(f"{'fault':24}{'operations':>11}{ENDED_RIGHT:>13}{STOPPED:>16}{WRONG:>7}")
    total: Counter[str] = Counter()
    for name in names:
        rows = [result for result in results.values() if result.fault == name]
        count = Counter(result.outcome for result in rows)
        total += count
        more = "" if count[UNTOUCHED] else "  not at its end yet"
        tried = len(rows) - count[UNTOUCHED]
        print(f"{name:24}{tried:>11}{count[ENDED_RIGHT]:>13}{count[STOPPED]:>16}{count[WRONG]:>7}{more}")
    tried = sum(total.values()) - total[UNTOUCHED]
    print(f"{'all':24}{tried:>11}{total[ENDED_RIGHT]:>13}{total[STOPPED]:>16}{total[WRONG]:>7}")
    errors = Counter(
        f"{result.fault}: {result.detail.partition(':')[0]}" for result in results.values() if result.outcome == STOPPED
    )
    print("stopped by: " + ", ".join(f"{what} x{number}" for what, number in sorted(errors.items())))
    for result in sorted(results.values(), key=lambda r: (r.fault, r.at)):
        if result.outcome == WRONG:
            print(f"WRONG {result.fault}@{result.at}: {result.detail}")
    print(f"{took_s / 60.0:.1f} min" + ("" if complete else ", not complete: call again to go on"))


if __name__ == "__main__":
    raise SystemExit(main())
