"""Checks the diagnosis on recordings of another simulator: one table (docs/explanation/independent.md).

    python -m benchmarks.independent.run [--data FOLDER] [--n N] [--jobs 1] [--gross] [--far] [--fresh] [--totals]
                                         [--final]

Reads the even-numbered recordings of FOLDER/recordings.tar.xz (else of INDEPENDENT_RECORDINGS, else of
../shared/independent beside the checkout) and says which are misjudged. Answers lie in runs/independent, one folder for
each state of the code that they depend on; stopped at any time, the same command goes on. --final scores the odd ones
instead, without saying which: at most five times, each a line in log.jsonl. --gross diagnoses again what was sure, with
gross readings planted (a final run always does); --far the same with one in twenty readings off by 5 to 12 standard
deviations. --totals says nothing of a single recording, for those that are only
to be scored. Exit status 1 if a goal is missed, 2 if there are no recordings or a process failed, 130 if interrupted.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from benchmarks.independent import final_runs
from benchmarks.independent.final_runs import FinalRun, NoFinalRun
from benchmarks.independent.planted_readings import PLANTED
from benchmarks.independent.recordings import NoRecordings, copy_recordings, digest_of, find_archive, names_of
from benchmarks.independent.scorer import reached_with_truth, score
from benchmarks.independent.table import figures, misjudged, printed, without_cases
from benchmarks.independent.truths import OddTruth, read_truths
from benchmarks.results_file import ResultsFile
from benchmarks.timing import in_one_thread
from benchmarks.withheld.lane import RunFailed, diagnose, finite, sure_of
from benchmarks.withheld.score_rows import Row
from benchmarks.withheld.scorer import WORTH_ADDING, Tampered, verdict
from benchmarks.withheld.sealed_diagnoser import HELPERS
from tests.kept_results import until_stopped

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "independent"
OUT = ROOT / "runs" / "independent"
CODE = ("calibration", *(f"benchmarks/withheld/{name}.py" for name in (*HELPERS, "sealed_diagnoser")))
BATCH = 5


def main(arguments: list[str] | None = None) -> int:
    """Diagnose what is missing, then score."""
    options = _options(arguments)
    try:
        archive = find_archive(options.data)
        return _run(options, archive)
    except (NoRecordings, NoFinalRun, OddTruth, RunFailed, Tampered) as error:
        print(f"independent: {error}", file=sys.stderr)
        return 2


def _run(options: argparse.Namespace, archive: Path) -> int:
    code = code_digest(options.diagnose)
    final_run = final_runs.begin(code, options.log) if options.final else None
    names = names_of(archive, even=final_run is None)
    chosen = spread(names, options.n)
    out = options.out / f"{code}-{digest_of(archive)}" / ("even" if final_run is None else "odd")
    if options.fresh:
        shutil.rmtree(out, ignore_errors=True)
    answers = answer(archive, chosen, out, options.diagnose, options.jobs, sealed=options.sealed)
    wanted = {"gross": options.gross or final_run is not None, "far": options.far}
    held = {kind: hold_against(kind, archive, out, answers, options) for kind in wanted if wanted[kind]}
    rows = score_all(archive, out, answers, final_run)
    for row in rows:
        row |= {f"held_against_{kind}": of[row["key"]] for kind, of in held.items() if row["key"] in of}
    data = figures(rows)
    if final_run is not None or options.totals:
        data = without_cases(data)
    if final_run is not None:
        final_runs.append(final_run, _digest_of_answers(answers), _for_log(data))
    print(printed(data))
    if final_run is None and not options.totals:  # else nothing is shown or written that belongs to a single recording
        print("", "misjudged:", *(misjudged(rows) or ["none"]), sep="\n")
        (out / "results.json").write_text(json.dumps(finite(data | {"rows": rows}), indent=1) + "\n", encoding="utf-8")
        print(f"details: {out / 'results.json'}", file=sys.stderr)
    return 0 if all(m["ok"] is not False for m in data["measures"]) else 1


def spread(names: Sequence[str], n: int) -> list[str]:
    """About n names spread evenly; all of them for n = 0."""
    return list(names) if not 0 < n < len(names) else [names[k * len(names) // n] for k in range(n)]


def hold_against(
    kind: str, archive: Path, out: Path, answers: dict[str, dict[str, Any]], options: argparse.Namespace
) -> dict[str, bool]:
    """Whether the verdicts that were sure are the same with wrong readings of a kind planted, by recording."""
    sure = [name for name, of_name in answers.items() if sure_of(of_name)]
    planting = hashlib.sha256((Path(__file__).parent / "planted_readings.py").read_bytes()).hexdigest()[:12]
    print(f"{len(sure)} of {len(answers)} verdicts are sure; with {kind} readings:", file=sys.stderr)
    out = out / f"{kind}-{planting}"
    again = answer(archive, sure, out, options.diagnose, options.jobs, prepare=PLANTED[kind], sealed=options.sealed)
    return {name: verdict(again[name]) == verdict(answers[name]) for name in sure}


def answer(
    archive: Path,
    names: Sequence[str],
    out: Path,
    function: str,
    jobs: int,
    prepare: Callable[[Path], None] | None = None,
    *,
    sealed: bool = True,
) -> dict[str, dict[str, Any]]:
    """Answers by recording, those on disk and those that were missing; each batch is on disk before the next.

    `prepare` is given each copy of a recording before it is diagnosed.
    """
    code = code_digest(function)
    results = ResultsFile(out / "answers.jsonl", {"diagnose": function})
    answers = {row["recording"]: row["answer"] for row in results.rows()}
    left = [name for name in names if name not in answers]
    if left:
        copy_recordings(archive, names, out / "recordings")
    lock, started, done = threading.Lock(), time.monotonic(), 0

    def work(batch: Sequence[str]) -> None:
        nonlocal done
        given = diagnose_batch(out, batch, function, prepare, sealed=sealed)
        if code_digest(function) != code:
            raise RunFailed("the code was changed during the run; run again")
        with lock:
            for name, of_name in given.items():
                answers[name] = of_name
                results.append({"recording": name, "answer": of_name})
            done += len(given)
            passed = time.monotonic() - started
            print(
                f"{done} of {len(left)}; {passed / 60:.1f} min, {passed / done * (len(left) - done) / 60:.1f} left",
                file=sys.stderr, flush=True,
            )  # fmt: skip

    with ThreadPoolExecutor(jobs) as pool:
        running = [pool.submit(work, left[k : k + BATCH]) for k in range(0, len(left), BATCH)]
        try:
            for future in running:
                future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return {name: answers[name] for name in names}


def diagnose_batch(
    out: Path,
    names: Sequence[str],
    function: str,
    prepare: Callable[[Path], None] | None = None,
    *,
    sealed: bool = True,
) -> dict[str, dict[str, Any]]:
    """Answers of some recordings, by a process that is given copies of them and nothing else."""
    folder = out / "batches" / names[0]
    shutil.rmtree(folder, ignore_errors=True)
    for name in names:
        shutil.copytree(out / "recordings" / name, folder / "recordings" / name)
        if prepare is not None:
            prepare(folder / "recordings" / name)
    table = {name: {"without": [], "without_forms": []} for name in names}
    (folder / "recordings" / "options.json").write_text(json.dumps(table), encoding="utf-8")
    diagnose(folder / "recordings", folder / "answers", function, sealed=sealed, baselines=False)
    given = json.loads((folder / "answers" / "answers.json").read_text(encoding="utf-8"))
    (out / "predictions").mkdir(exist_ok=True)
    for file in (folder / "answers").glob("*.npz"):
        file.replace(out / "predictions" / file.name)
    shutil.rmtree(folder)
    return finite(given)


def score_all(archive: Path, out: Path, answers: dict[str, dict[str, Any]], final_run: FinalRun | None) -> list[Row]:
    """Rows of all answered recordings; the truth is read here for the first time."""
    copy_recordings(archive, answers.keys(), out / "recordings")
    truths = read_truths(archive, answers.keys(), final_run)
    rows = []
    for name, of_name in answers.items():
        file = out / "predictions" / f"{name}.npz"
        predictions = file.read_bytes() if "withheld_sha256" in of_name else None
        row = score(out / "recordings", name, of_name, predictions, truths[name])
        if row["kind"] == "effect" and row["visible"] >= WORTH_ADDING and "achieved" in row:
            row["reached_with_truth"] = reached_with_truth(out / "recordings", name, truths[name])
        rows.append(row)
    return rows


def code_digest(function: str = "") -> str:
    """Hash of the programs that an answer depends on."""
    digest = hashlib.sha256(function.encode())
    for name in CODE:
        path = ROOT / name
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def _digest_of_answers(answers: dict[str, dict[str, Any]]) -> str:
    return hashlib.sha256(json.dumps(answers, sort_keys=True).encode()).hexdigest()


def _for_log(data: dict[str, Any]) -> dict[str, Any]:
    return {
        m["name"].strip(): [round(m[k], 4) for k in ("value", "low", "high")] + [m["n"], m["ok"]]
        for m in data["measures"]
        if m["n"]
    }


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(os.environ.get("INDEPENDENT_RECORDINGS") or DATA)
    parser.add_argument("--data", type=Path, default=default, help="folder of the archive")
    parser.add_argument("--n", type=int, default=0, help="so many recordings only, for a first look")
    parser.add_argument("--jobs", type=int, default=1, help="diagnosers at work side by side")
    parser.add_argument(
        "--gross", action="store_true", help="diagnose again what was sure, with gross readings planted"
    )
    parser.add_argument("--far", action="store_true", help="the same with one reading in twenty far off")
    parser.add_argument("--fresh", action="store_true", help="forget the answers that this code has given")
    parser.add_argument("--totals", action="store_true", help="say nothing of a single recording")
    parser.add_argument("--final", action="store_true", help="score all odd recordings and log it; at most five times")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of all runs")
    parser.add_argument(
        "--unsealed", dest="sealed", action="store_false",
        help="development where the system can shut no process in: the diagnoser could open truths",
    )  # fmt: skip
    parser.add_argument("--diagnose", default="", help=argparse.SUPPRESS)
    parser.add_argument("--log", type=Path, default=final_runs.LOG, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.n < 0 or options.jobs < 1:
        parser.error("--n must not be negative, --jobs not below 1")
    if options.final and not options.sealed:
        parser.error("--unsealed is no final run")
    if options.final and options.n:
        parser.error("a final run scores all odd recordings; leave --n out")
    options.out = options.out.resolve()
    return options


if __name__ == "__main__":
    in_one_thread()  # as benchmarks.withheld.run
    sys.exit(until_stopped(main))
