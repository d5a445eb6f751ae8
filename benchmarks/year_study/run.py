"""`make year-study`: simulates machine-years and prints what the decisions of calibration intervals are worth.

Status 1 if a goal is missed. Stopped, it goes on where it ended.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

from benchmarks.results_file import MixedSettingsError, ResultsFile, code_digest
from benchmarks.side_by_side import side_by_side
from tests.kept_results import until_stopped

OUT = Path("runs/year-study")
HERE = ("life", "lost_reference", "plant_machine", "policies", "special", "tasks", "truths", "workshop")
CODE = (*(f"benchmarks/year_study/{name}.py" for name in HERE), "calibration/intervals", "mock_devices/plant")


def main() -> int:
    """The command."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"
    options = _options()
    from benchmarks.year_study import special, tasks, truths  # noqa: PLC0415  after the threads are set
    from benchmarks.year_study.measures import of, table  # noqa: PLC0415

    offset = tasks.DEVELOPMENT if options.development else 0
    settings = {**truths.settings(), **special.settings(), "offset": offset}
    settings |= {"code": code_digest(*CODE)}
    file = ResultsFile(options.out / "results.jsonl", settings)
    try:
        rows = file.rows()
    except MixedSettingsError as error:
        print(error, file=sys.stderr)
        return 2
    rows = [row for row in rows if row["limit"] == tasks.LIMITS.get(row["kind"])]
    done = {(row["kind"], row["number"]) for row in rows}
    rivals = 0 if options.without_rivals else min(options.years, options.rivals)
    others, lost = (min(options.years, n) for n in (options.others, options.lost))
    counts = (options.years, rivals, others, options.steps, options.ramps, lost)
    if not options.table:
        queue = [(*task, offset) for task in tasks.tasks(*counts) if task not in done]
        rows += _run(queue, file, options.processes)
    lines, policies = table(rows)
    print(f"{'':62s} {'goal':>14s} {'figure':>8s}   {'95 % interval':20s} {'of':>5s}")
    for line in lines:
        print(line)
    print()
    print("\n".join(policies))
    steps = of(rows, "step")
    if steps:
        from benchmarks.year_study.picture import draw  # noqa: PLC0415

        picture = options.picture or options.out / "power.png"
        draw(steps, picture)
        print(f"picture: {picture}", file=sys.stderr)
    return 1 if any(line.ok is False for line in lines) else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--years", type=int, default=1000, help="years under the project's own rules")
    parser.add_argument("--rivals", type=int, default=200, help="of these years also under each rival")
    parser.add_argument("--others", type=int, default=200, help="years of each population with other rates")
    parser.add_argument("--steps", type=int, default=400, help="machines for the power curve")
    parser.add_argument("--ramps", type=int, default=400, help="machines that wear")
    parser.add_argument("--lost", type=int, default=200, help="machines of which a drive loses its reference")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--picture", type=Path, help="where to draw the power curve; power.png in --out")
    parser.add_argument("--development", action="store_true", help="other seeds, to set limits with")
    parser.add_argument("--without-rivals", action="store_true", help="while their limits are not set yet")
    parser.add_argument("--table", action="store_true", help="print what is there and simulate nothing more")
    return parser.parse_args()


def _run(queue: list[tuple[str, int, int]], file: ResultsFile, processes: int) -> list[dict[str, Any]]:
    """Lives side by side; each is on disk before it counts."""
    from benchmarks.year_study.tasks import run_task  # noqa: PLC0415

    rows: list[dict[str, Any]] = []
    started = shown = time.monotonic()
    if not queue:
        return rows
    with side_by_side(run_task, queue, processes) as running:
        for done, future in enumerate(as_completed(running), start=1):
            row = future.result()
            file.append(row)
            rows.append(row)
            now = time.monotonic()
            if now - shown > 60.0 or done == len(queue):
                shown, left = now, (now - started) / done * (len(queue) - done) / 60.0
                print(f"{done} of {len(queue)} lives, {left:.0f} min left", file=sys.stderr, flush=True)
    return rows


if __name__ == "__main__":
    sys.exit(until_stopped(main))
