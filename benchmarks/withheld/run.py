"""Checks the diagnosis on withheld cases: one table, three pictures (docs/explanation/withheld.md).

    python -m benchmarks.withheld.run (--final | --seed S) [--n N] [--out DIR] [--lanes 2] [--no-leave-form-out]
        [--hours H]
    python -m benchmarks.withheld.run --so-far DIR [DIR ...]
    python -m benchmarks.withheld.run --log-catalogue

--final draws its seed from the operating system, uses all variants of the plant and is appended to log.jsonl whatever
comes out; --seed is for development and leaves the final variants out. Finished batches are kept: stopped at any
time, the same command goes on. --hours makes campaigns last so long by longer rests; those of a final run take one to
two hours. --so-far prints the table of what a stopped or running run has finished, a random part
of its cases, or of several runs of different kinds together, and changes nothing. --log-catalogue appends the hash of
the catalogue to log.jsonl, before new final forms come into the plant. Progress goes to standard error, the table to
standard output; exit status 1 if a goal is missed, 2 if a process fails or the diagnoser cannot be sealed
(sealed_diagnoser), 130 if interrupted.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from benchmarks import results_file
from benchmarks.results_file import MixedSettingsError, ResultsFile, read_only
from benchmarks.timing import in_one_thread
from benchmarks.withheld.cases import BATCH, FULL, plan
from benchmarks.withheld.lane import LaneOptions, RunFailed, run_lane
from benchmarks.withheld.over_the_wire import LARGEST_M, largest_difference_m
from benchmarks.withheld.pictures import draw_all
from benchmarks.withheld.report import log_entry, printed, summary
from benchmarks.withheld.scorer import Tampered
from mock_devices.effects import CATALOGUE
from tests.kept_results import until_stopped

ROOT = Path(__file__).parents[2]
LOG = Path(__file__).parent / "log.jsonl"
LEAST_HOURS, MOST_HOURS = 2.0, 48.0
CODE = ("calibration", "mock_devices", "benchmarks/withheld")


def main(arguments: list[str] | None = None) -> int:
    """Run what is missing, then score all of it."""
    options = _options(arguments)
    if options.so_far:
        return _print_so_far(options.so_far)
    if options.log_catalogue:
        _append(options.log, {"catalogue": catalogue_digest(), "logged": _now()})
        return 0
    settings = {
        "seed": "operating system" if options.final else options.seed,
        "n": options.n, "kinds": sorted(options.kinds), "lanes": options.lanes, "batch": options.batch,
        "diagnose": options.diagnose, "noise": options.noise, "leave_form_out": options.leave_form_out,
        **({} if options.sealed else {"sealed": False}),
        **({"hours": options.hours} if options.hours else {}),
        **({"resembling": sorted(options.resembling)} if options.resembling else {}),
        **({"code": code_digest()} if options.final else {}),
    }  # fmt: skip
    out = (options.out or default_folder(options, settings)).resolve()
    results = ResultsFile(out / "results.jsonl", settings)
    try:
        stored = results.rows()
        if options.n == 0 and not options.kinds:
            _over_the_wire(out)
        run_all(options, out, results, stored)
    except (MixedSettingsError, RunFailed, Tampered) as error:
        print(f"withheld: {error}", file=sys.stderr)
        return 2
    batches = results.rows()
    rows = rows_of(batches)
    summary_data = summary(rows)
    print(printed(summary_data))
    for path in draw_all(rows, out):
        print(f"picture: {path}", file=sys.stderr)
    summary_data |= {"settings": settings, "code": sorted({b["code"] for b in batches}), "cases": len(rows)}
    (out / "results.json").write_text(json.dumps(summary_data, indent=1) + "\n", encoding="utf-8")
    if options.final:
        _append(options.log, log_entry(_run_id(out), settings, batches, summary_data))
    (out / "finished").touch()
    return 0 if all(m["ok"] is not False for m in summary_data["measures"]) else 1


def rows_of(batches: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The rows of all batches by their keys, so that drawn intervals do not depend on where a run was stopped."""
    return sorted((row for batch in batches for row in batch["rows"]), key=lambda row: str(row["key"]))


def _print_so_far(folders: Sequence[Path]) -> int:
    """The table of the finished batches of runs, whatever program made them; nothing is written."""
    batches: list[dict[str, Any]] = []
    planned = 0
    for out in folders:
        try:
            header, finished = read_only(out / "results.jsonl")
        except (OSError, ValueError) as error:
            print(f"withheld: no results of a run in {out} ({error}); name its folder", file=sys.stderr)
            return 2
        batches += finished
        planned += len(plan(header["n"], header["kinds"], final="code" in header))
    rows = rows_of(batches)
    if len({row["key"] for row in rows}) < len(rows):
        print("withheld: these runs have cases of the same kinds; name runs of different kinds", file=sys.stderr)
        return 2
    print(f"{len(rows)} of {planned} cases")
    if not rows:
        return 1
    summary_data = summary(rows)
    print(printed(summary_data))
    return 0 if len(rows) == planned and all(m["ok"] is not False for m in summary_data["measures"]) else 1


def run_all(options: argparse.Namespace, out: Path, results: ResultsFile, stored: list[dict[str, Any]]) -> None:
    """Run the lanes side by side; every finished batch is on disk before the next."""
    slots = plan(options.n, options.kinds, final=options.final)
    done = {row["key"] for batch in stored for row in batch["rows"]}
    lock, started, code = threading.Lock(), time.monotonic(), code_digest()
    count = [len(done)]
    if len(done) == len(slots):
        return

    def keep(batch: dict[str, Any]) -> None:
        with lock:
            results.append({**batch, "code": code})
            count[0] += len(batch["rows"])
            passed = time.monotonic() - started
            left_s = passed / max(count[0] - len(done), 1) * (len(slots) - count[0])
            print(
                f"{count[0]} of {len(slots)}: batch {batch['batch']}, {batch['seconds']:.0f} s; "
                f"{passed / 60:.1f} min, {left_s / 60:.1f} left",
                file=sys.stderr, flush=True,
            )  # fmt: skip

    def begun(commitment: str) -> None:
        if options.final:
            with lock:
                _append(
                    options.log,
                    {
                        "run": _run_id(out),
                        "begun": _now(),
                        "n": len(slots),
                        "after": len(done),
                        "seed": commitment,
                        "catalogue": catalogue_digest(),
                    },
                )

    lane = LaneOptions(
        seed=None if options.final else options.seed,
        final=options.final,
        n=options.n,
        kinds=options.kinds,
        lane=0,
        lanes=options.lanes,
        batch=options.batch,
        diagnose=options.diagnose,
        noise=options.noise,
        leave_form_out=options.leave_form_out,
        sealed=options.sealed,
        out=out,
        done=tuple(sorted(done)),
        finished=0,
        resembling=options.resembling,
        hours=options.hours,
    )
    lanes = [replace(lane, lane=k, finished=sum(batch["lane"] == k for batch in stored)) for k in range(options.lanes)]
    with ThreadPoolExecutor(options.lanes) as pool:
        for future in [pool.submit(run_lane, each, keep, begun) for each in lanes]:
            future.result()


def code_digest() -> str:
    """Hash of the programs that a result depends on."""
    digest = hashlib.sha256()
    for name in CODE:
        for file in sorted((ROOT / name).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def catalogue_digest() -> str:
    """Hash of the effects that the diagnosis knows, logged before a plant's final forms meet them."""
    return results_file.code_digest("calibration/effects")


def default_folder(options: argparse.Namespace, settings: dict[str, Any]) -> Path:
    """The folder of the run that was stopped, or a new one; a development run has one by its seed."""
    base = ROOT / "runs" / "withheld"
    if not options.final:
        marks = {"-noise": options.noise, "-whole": not options.leave_form_out, "-unsealed": not options.sealed}
        marks |= {f"-{options.hours:g}h": options.hours > 0.0}
        kind = "".join(mark for mark, is_so in marks.items() if is_so)
        return base / f"seed-{options.seed}-n{options.n}{kind}"
    number = 1
    while (base / f"final-{number}").exists():
        folder = base / f"final-{number}"
        try:
            ResultsFile(folder / "results.jsonl", settings).rows()
            if not (folder / "finished").exists():
                return folder
        except MixedSettingsError:
            pass
        number += 1
    return base / f"final-{number}"


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--final", action="store_true", help="seed of the operating system, final variants, logged")
    which.add_argument("--seed", type=int, help="development: no final variants, not logged")
    which.add_argument(
        "--so-far", type=Path, nargs="+", metavar="DIR", help="the table of what the runs of some folders have finished"
    )
    which.add_argument(
        "--log-catalogue",
        action="store_true",
        help="append the catalogue's hash to the log, before new final forms come",
    )
    parser.add_argument("--n", type=int, help=f"cases in all; {sum(FULL.values())} if left out")
    parser.add_argument("--kinds", default="", help=f"some of {', '.join(FULL)}, separated by commas")
    parser.add_argument("--out", type=Path, help="folder of the run")
    parser.add_argument("--lanes", type=int, default=2, help="makers and diagnosers at work side by side")
    parser.add_argument("--noise", action="store_true", help="replace readings by noise: scores must fall to chance")
    parser.add_argument(
        "--leave-form-out", action=argparse.BooleanOptionalAction, default=True,
        help="leave forms out of the catalogue that explain a case's change by themselves (left_out_forms)",
    )  # fmt: skip
    parser.add_argument(
        "--unsealed", dest="sealed", action="store_false",
        help="development where the system can shut no process in: the diagnoser could open plant and truths",
    )  # fmt: skip
    parser.add_argument(
        "--hours", type=float, default=0.0, help=f"that a campaign lasts, {LEAST_HOURS:g} or more: a development run"
    )
    parser.add_argument("--batch", type=int, default=0, help=argparse.SUPPRESS)
    parser.add_argument("--diagnose", default="", help=argparse.SUPPRESS)
    parser.add_argument("--resembling", default="", help=argparse.SUPPRESS)  # a library of all takes a small run's time
    parser.add_argument("--log", type=Path, default=LOG, help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    options.kinds = tuple(kind for kind in options.kinds.split(",") if kind)
    options.resembling = tuple(name for name in options.resembling.split(",") if name)
    if unknown := set(options.kinds) - set(FULL):
        parser.error(f"unknown kind '{min(unknown)}'; known: {', '.join(FULL)}")
    if unknown := set(options.resembling) - set(CATALOGUE):
        parser.error(f"unknown effect '{min(unknown)}'; known: {', '.join(CATALOGUE)}")
    if options.n is not None and options.n < 1:
        parser.error(f"--n is {options.n}; give the number of cases, 1 or more, or leave it out for all")
    options.n = options.n or 0  # all
    if options.lanes < 1 or (options.seed or 0) < 0:
        parser.error("--seed must not be negative, --lanes not below 1")
    if options.noise and options.final:
        parser.error("--noise is no final run; give a --seed")
    if options.final and not options.sealed:
        parser.error("--unsealed is no final run; give a --seed")
    if options.hours and (options.final or not LEAST_HOURS <= options.hours <= MOST_HOURS):
        parser.error(f"--hours is of a run with a --seed, from {LEAST_HOURS:g} to {MOST_HOURS:g}")
    if options.final and options.resembling:
        parser.error("--resembling is no final run; give a --seed")
    # Small runs have small batches, so that both lanes end together.
    cases = len(plan(options.n, options.kinds, final=options.final))
    options.batch = options.batch or max(1, min(BATCH, -(-cases // (2 * options.lanes))))
    return options


def _over_the_wire(out: Path) -> None:
    if (out / "over_the_wire").exists():
        return
    apart_m = largest_difference_m()
    print(f"over the wire: ten rigs within {apart_m:.1e} m of the recordings", file=sys.stderr)
    if apart_m > LARGEST_M:
        raise RunFailed(f"over the wire: readings differ by {apart_m:.1e} m from the plant's own; no run")
    (out / "over_the_wire").touch()


def _run_id(out: Path) -> str:
    """A name for a run that stays when it is stopped."""
    file = out / "run"
    if not file.exists():
        file.write_text(hashlib.sha256(f"{_now()} {out}".encode()).hexdigest()[:12], encoding="utf-8")
    return file.read_text(encoding="utf-8")


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _append(file: Path, entry: dict[str, Any]) -> None:
    with file.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(entry) + "\n")


if __name__ == "__main__":
    in_one_thread()  # the scorer's matrices are small: further threads would only wait, on the cores of the lanes
    sys.exit(until_stopped(main))
