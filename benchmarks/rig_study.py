"""Random rigs of two machines, identified every way and scored against the noise-free truth: one table, one picture.

    python -m benchmarks.rig_study [--rigs 200] [--processes 2] [--out runs/rig-study] [--picture FILE]

Each rig is a machine with errors drawn from the priors (`rig_truth`), measured with noise, identified and scored
(`rig_scores`). A finished rig is on disk before it counts: stop at any time, the same command goes on. Progress goes to
standard error, the table to standard output; exit status 1 if a criterion is missed. The criteria hold for
the default estimator, maximum a posteriori: see docs/explanation/rig-study.md.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from concurrent.futures import as_completed
from itertools import zip_longest
from pathlib import Path
from typing import Any

from benchmarks.results_file import MixedSettingsError, ResultsFile, code_digest
from benchmarks.rig_picture import draw
from benchmarks.rig_scores import run_rig
from benchmarks.rig_settings import STUDIES, Study
from benchmarks.rig_table import summarise
from benchmarks.side_by_side import side_by_side
from tests.kept_results import until_stopped

CODE = ("calibration", "mock_devices/plant/structure.py", "tests/calibration/reference_model.py")


def main() -> int:
    """Run what is missing, then print the table and draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=200, help="rigs of each machine, seeds 1 to this")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/rig-study"))
    parser.add_argument("--picture", type=Path, help="where to draw it; a PNG in the folder of the results if left out")
    options = parser.parse_args()
    code = code_digest(*CODE)  # results of two versions are told apart, not refused
    files = {s.machine: ResultsFile(options.out / f"{s.machine}.jsonl", s.settings()) for s in STUDIES}
    try:
        stored = {name: file.rows() for name, file in files.items()}
    except MixedSettingsError as error:
        print(f"rig study: {error}", file=sys.stderr)
        return 2
    seeds = range(1, options.rigs + 1)
    todo = [
        [(study, seed) for seed in seeds if seed not in {row["seed"] for row in stored[study.machine]}]
        for study in STUDIES
    ]
    queue = [job for jobs in zip_longest(*todo) for job in jobs if job is not None]
    _run(queue, files, code, options.processes)

    good = True
    rows_by_machine: dict[str, list[dict[str, Any]]] = {}
    for study in STUDIES:
        rows = sorted((row for row in files[study.machine].rows() if row["seed"] in seeds), key=lambda r: r["seed"])
        rows_by_machine[study.machine] = rows
        lines, kept = summarise(study, rows)
        versions = {row["code"] for row in rows}
        if versions != {code}:
            lines.append(
                f"note: results of {len(versions)} version(s) of the code ({', '.join(sorted(versions))}), now {code}"
            )
        print("\n".join(lines), end="\n\n")
        good = good and kept
    picture = options.picture or options.out / "estimators.png"
    draw(rows_by_machine, picture)
    print(f"picture: {picture}", file=sys.stderr)
    return 0 if good else 1


def _run(queue: list[tuple[Study, int]], files: dict[str, ResultsFile], code: str, processes: int) -> None:
    """Run rigs side by side; each result is stored as soon as it is there."""
    if not queue:
        return
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"  # taken up by the spawned processes, which load numpy anew
    started = time.monotonic()
    with side_by_side(run_rig, queue, processes) as running:
        jobs = dict(zip(running, queue, strict=True))
        for done, future in enumerate(as_completed(running), start=1):
            study, seed = jobs[future]
            files[study.machine].append({**future.result(), "code": code})
            passed = time.monotonic() - started
            left_min = passed / 60.0 / done * (len(queue) - done)
            print(
                f"{done} of {len(queue)}: {study.machine} {seed}; {passed / 60:.1f} min, {left_min:.1f} left",
                file=sys.stderr,
                flush=True,
            )


if __name__ == "__main__":
    sys.exit(until_stopped(main))
