"""Checks `compare` on pairs of recordings whose change is known: one table (docs/explanation/comparison.md).

    python -m benchmarks.comparison.run [--n 1000] [--seed 7001] [--processes 2] [--out DIR] [--table]

Pair k of a seed is the same whatever N is; kinds are mixed, so the first ones are a fair sample of all. Each is written
as two recording folders, and a process that is given nothing but these compares them. Answers lie in runs/comparison;
stopped at any time, the same command goes on. --table prints what is there. Exit status 1 if a goal is missed, 130 if
interrupted.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import lru_cache
from pathlib import Path
from typing import Any

from benchmarks.comparison import planar, spatial
from benchmarks.comparison.cases import DESIGNS, FAMILIES, make_pair
from benchmarks.comparison.change import Change
from benchmarks.comparison.table import measures, printed
from benchmarks.comparison.visible import Campaign, derivatives
from benchmarks.results_file import ROOT, code_digest
from benchmarks.side_by_side import end_with_parent
from calibration.machine.description import Machine
from calibration.recording.folder import write_folder
from mock_devices.settings import DisturbanceLevels
from tests.kept_results import KeptResults, key_of, until_stopped

OUT = ROOT / "runs" / "comparison"
MAKING = tuple(f"benchmarks/comparison/{name}.py" for name in ("cases", "change", "planar", "spatial", "visible"))
CODE = (
    "calibration", "mock_devices", *MAKING, "benchmarks/comparison/comparer.py", "benchmarks/structures/functions.py",
    "tests/calibration/reference_model.py",
)  # fmt: skip


def main(arguments: list[str] | None = None) -> int:
    """Compare the pairs that are missing, then print the table."""
    options = _options(arguments)
    rows = compare_all(options)
    print(printed(rows))
    return 0 if all(measure.ok is not False for measure in measures(rows)) else 1


def compare_all(options: argparse.Namespace) -> list[dict[str, Any]]:
    """Rows of all pairs; each is on disk as soon as it is known."""
    code = code_digest(*CODE)
    results = KeptResults(options.out / f"seed-{options.seed}.jsonl")
    keys = [key_of(code, options.seed, k) for k in range(options.n)]
    missing = [k for k, key in enumerate(keys) if key not in results]
    if options.table:
        return [results[key]["row"] for key in keys if key in results]
    if missing:
        prepare()
    forked = multiprocessing.get_context("fork")
    started, pool = time.monotonic(), ProcessPoolExecutor(options.processes, forked, initializer=end_with_parent)
    try:
        tasks = {pool.submit(row_of, options.seed, k): k for k in missing}
        for done, task in enumerate(as_completed(tasks), start=1):
            results.add({"key": keys[tasks[task]], "row": task.result()})
            left_min = (time.monotonic() - started) / done * (len(missing) - done) / 60.0
            if done % 10 == 0 or done == len(missing):
                print(f"{done} of {len(missing)}; {left_min:.1f} min left", file=sys.stderr, flush=True)
    finally:
        pool.shutdown(cancel_futures=True)
    return [results[key]["row"] for key in keys]


def prepare() -> None:
    """What visible sizes need of each design, computed once for all processes, which inherit it."""
    for family in dict.fromkeys(FAMILIES):
        for number in range(DESIGNS):
            if family == planar.NAME:
                machine: Machine = planar.nominal()[1]
                flat = planar.Circumstances(1, 1, number)
                reference: Campaign = planar.PlanarCampaign(1, flat, DisturbanceLevels(), Change())
            else:
                machine = spatial.machine_of(family)[1]
                spot = spatial.Circumstances(1, 1, number)
                reference = spatial.SpatialCampaign(family, 1, spot, DisturbanceLevels(), Change())
            derivatives((family, number), machine, reference)


def row_of(seed: int, number: int) -> dict[str, Any]:
    """Truth and answer of one pair."""
    pair = make_pair(seed, number)
    with tempfile.TemporaryDirectory() as folder:
        folders = [Path(folder) / name for name in ("first", "second")]
        for recording, place in zip((pair.before, pair.after), folders, strict=True):
            write_folder(recording, place)
        answer = _asked([str(place) for place in folders])
    nothing: dict[str, Any] = {
        "verdict": "", "place": "", "equivalent": [], "ranking": {}, "changes": [], "seconds": 0.0,
    }  # fmt: skip
    answer = nothing | answer
    return pair.truth | answer | {"place": pair.truth["place"], "place_named": answer["place"], "number": number}


@lru_cache(maxsize=1)
def _comparer() -> subprocess.Popen[str]:
    """This process' own comparer; it ends with it, when its stdin does."""
    return subprocess.Popen(
        [sys.executable, "-m", "benchmarks.comparison.comparer"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip


def _asked(folders: list[str]) -> dict[str, Any]:
    process = _comparer()
    assert process.stdin is not None
    assert process.stdout is not None
    process.stdin.write(json.dumps(folders) + "\n")
    process.stdin.flush()
    line = process.stdout.readline()
    if not line:
        raise RuntimeError("comparison: the comparing process has ended")
    answer: dict[str, Any] = json.loads(line)
    return answer


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=1000, help="pairs in all")
    parser.add_argument("--seed", type=int, default=7001)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=OUT, help="folder of all runs")
    parser.add_argument("--table", action="store_true", help="of the pairs that have been compared so far")
    options = parser.parse_args(arguments)
    if options.n < 1 or options.seed < 0 or options.processes < 1:
        parser.error("--n and --processes must be positive, --seed not negative")
    return options


if __name__ == "__main__":
    sys.exit(until_stopped(main))
