"""Checks the diagnosis on a plant in MuJoCo in which errors emerge: one table (docs/explanation/emergent.md).

    python -m benchmarks.emergent.run [--n N] [--seed S] [--processes 2] [--out runs/emergent] [--make-only]
        [--unsealed]

Makes the cases that are missing, packs them in the form of the other simulator's recordings, and has
`benchmarks.independent.run` diagnose and score them. A finished case is kept as long as the plant's code is the same:
stopped at any time, the same command goes on; --make-only leaves the diagnosis for later. Another seed makes 200 other
cases of the same plant, which nobody has seen. What is scored with which
catalogue is a line of log.jsonl, written before. Exit status 1 if a goal is missed, 2 if a process failed.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import mujoco  # type: ignore[import-untyped]

from benchmarks.emergent.cases import SEED, Plan, plan
from benchmarks.emergent.making import make_case
from benchmarks.independent import run as independent
from benchmarks.independent.make_all import make_all
from benchmarks.independent.pack import pack
from benchmarks.independent.recordings import digest_of
from benchmarks.results_file import ROOT, code_digest
from benchmarks.timing import in_one_thread
from benchmarks.withheld.score_rows import Row, called, overall_right
from tests.kept_results import until_stopped

HERE = Path(__file__).parent
LOG = HERE / "log.jsonl"
OUT = ROOT / "runs" / "emergent"
PLANT = tuple(f"benchmarks/emergent/{file.name}" for file in sorted(HERE.glob("*.py")) if file.name != "run.py")
CATALOGUE = ("calibration/effects",)


def main(arguments: list[str] | None = None) -> int:
    """Make what is missing, log what is about to be scored, score."""
    options = _options(arguments)
    plans = plan(options.seed)
    chosen = plans[: options.n]  # they are mixed: the first ones are a fair sample
    plant = f"{code_digest(*PLANT)}-mujoco-{mujoco.__version__}"
    folder = options.out / f"{plant}-seed-{options.seed}"
    make_all(make_case, chosen, folder / "cases", options.processes)
    if options.make_only:
        print(f"{len(chosen)} cases: {folder / 'cases'}")
        return 0
    data = folder / f"{len(chosen)}-of-{len(plans)}"
    archive = pack(folder / "cases", data, [one.name for one in chosen])
    append_once(options.log, plant, options.seed, len(chosen))
    given = ["--data", str(data), "--out", str(folder / "scores"), "--jobs", str(options.processes), "--gross"]
    status = independent.main([*given, *(["--unsealed"] if options.unsealed else [])])
    details = folder / "scores" / f"{independent.code_digest('')}-{digest_of(archive)}" / "even" / "results.json"
    if status != 2:
        print("", *by_cause(json.loads(details.read_text(encoding="utf-8"))["rows"], chosen), sep="\n")
    return status


def append_once(log: Path, plant: str, seed: int, n: int) -> None:
    """A line for each catalogue and plant that is scored together, on disk before anything is scored."""
    code = {"catalogue": code_digest(*CATALOGUE), "calibration": code_digest("calibration"), "plant": plant}
    line = {"seed": seed, **code, "n": n}
    former = [json.loads(text) for text in log.read_text(encoding="utf-8").splitlines()] if log.exists() else []
    if any(line.items() <= entry.items() for entry in former):
        return
    entry = {"begun": datetime.now(UTC).isoformat(timespec="seconds"), **line}
    with log.open("a", encoding="utf-8") as file:
        file.write(json.dumps(entry) + "\n")
        file.flush()
        os.fsync(file.fileno())


def by_cause(rows: Sequence[Row], chosen: Sequence[Plan]) -> list[str]:
    """A line for each cause in the plant's words: the catalogue has one name for several of them."""
    causes = {one.name: one.causes[0] for one in chosen if len(one.causes) == 1}
    out = ["cause          counted  right  called an effect  of any size  called an effect"]
    for cause in dict.fromkeys(causes.values()):
        of: list[dict[str, Any]] = [row for row in rows if causes.get(row["key"]) == cause]
        large = [row for row in of if row["eligible"]]
        out.append(
            f"{cause:14s} {len(large):7d} {sum(map(overall_right, large)):6d} {sum(map(called, large)):17d} "
            f"{len(of):12d} {sum(map(called, of)):17d}"
        )
    return out


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, help="so many cases only, for a first look; all if left out")
    parser.add_argument("--seed", type=int, default=SEED, help="of all cases; another one makes others")
    parser.add_argument("--processes", type=int, default=2, help="cases made, and diagnosed, side by side")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of all runs")
    parser.add_argument("--make-only", action="store_true", help="make cases, and diagnose nothing")
    parser.add_argument("--unsealed", action="store_true", help="development where the system can shut no process in")
    parser.add_argument("--log", type=Path, default=LOG, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.n is not None and options.n < 1:
        parser.error(f"--n is {options.n}; give the number of cases, 1 or more, or leave it out for all")
    if options.seed < 0 or options.processes < 1:
        parser.error("--seed must not be negative, --processes not below 1")
    options.out = options.out.resolve()
    return options


if __name__ == "__main__":
    in_one_thread()  # as benchmarks.withheld.run
    sys.exit(until_stopped(main))
