"""`make kill-sweep`: kills host, mock and drives in short campaigns, takes them up again, and says what was lost.

    python -m benchmarks.kill_sweep.run [--out FOLDER] [--jobs N] [--seed S] [--chains N] [--only NAME] [--fresh]

A mock serves in a process of its own; hosts are killed (SIGKILL) at seeded store commits and CAN writes. Results are
kept in FOLDER/results.jsonl as they come: a second call goes on where the first was ended. The status is 1 if anything
was wrong.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from benchmarks.kill_sweep.chain import ChainRun, Untouched
from benchmarks.kill_sweep.silent import CASES, run_case
from benchmarks.kill_sweep.strikes import Chain, plan
from benchmarks.side_by_side import end_with_parent


def main() -> int:
    """Run what is missing, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("runs/kill-sweep"))
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--seed", type=int, default=12)
    parser.add_argument("--chains", type=int, default=10_000, help="at most so many campaigns of the plan")
    parser.add_argument("--only", default="", help="chains and cases whose names contain this")
    parser.add_argument("--fresh", action="store_true", help="forget former results")
    arguments = parser.parse_args()
    out = arguments.out.resolve()
    if arguments.fresh and out.exists():
        shutil.rmtree(out)
    out.mkdir(parents=True, exist_ok=True)
    reference = _reference(out)
    path = out / "results.jsonl"
    results = _read(path)
    done = {result["chain"] for result in results}
    chains = [chain for chain in plan(arguments.seed) if arguments.only in chain.name][: arguments.chains]
    cases = [case for case in CASES if arguments.only in case]
    with (
        path.open("a", encoding="utf-8") as file,
        ProcessPoolExecutor(arguments.jobs, initializer=end_with_parent) as pool,
    ):
        for case in cases:  # alone, because they are about time
            if case not in done:
                _keep(file, results, pool.submit(run_case, case, _emptied(out / case)).result())
        missing = [chain for chain in chains if chain.name not in done]
        running = {pool.submit(_run, chain, out, reference): chain for chain in missing}
        for future in as_completed(running):
            _keep(file, results, future.result())
    wanted = {chain.name for chain in chains} | set(cases)
    return _table([result for result in results if result["chain"] in wanted])


def _run(chain: Chain, out: Path, reference: dict[str, Any]) -> list[dict[str, Any]]:
    from benchmarks.kill_sweep.checks import measured  # noqa: PLC0415  # takes seconds, in each process once

    begin_s = time.monotonic()
    run = ChainRun(chain, _emptied(out / chain.name), reference["counts"], reference["readings"])
    try:
        results = run.run(measured(Path(reference["out"]), reference["campaign"]))
    except Exception as error:  # the sweep goes on; this chain has failed
        results = [
            *run.results,
            {"chain": chain.name, "struck": None, "problems": [f"{type(error).__name__}: {error}"]},
        ]
    results[-1]["chain_seconds"] = round(time.monotonic() - begin_s, 1)
    if not any(result["problems"] for result in results):
        shutil.rmtree(out / chain.name)
    return results


def _reference(out: Path) -> dict[str, Any]:
    """The untouched run, made once."""
    path = out / "reference.json"
    if not path.exists():
        untouched = Untouched(_emptied(out / "untouched"))
        if untouched.problems:
            raise RuntimeError(f"the untouched campaign: {untouched.problems}")
        found = {
            "out": str(untouched.out),
            "campaign": untouched.campaign,
            "readings": untouched.readings,
            "counts": untouched.counts,
        }
        path.write_text(json.dumps(found), encoding="utf-8")
    reference: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return reference


def _emptied(folder: Path) -> Path:
    if folder.exists():
        shutil.rmtree(folder)
    folder.mkdir(parents=True)
    return folder


def _read(path: Path) -> list[dict[str, Any]]:
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line.endswith("}")]


def _keep(file: Any, results: list[dict[str, Any]], new: list[dict[str, Any]]) -> None:
    """Keep the results of a chain, all or none: a chain that was cut short is run again."""
    file.write("".join(json.dumps(result) + "\n" for result in new))
    file.flush()
    results += new
    for result in new:
        verdict = "; ".join(result["problems"]) or "good"
        print(f"{result['chain']:10} {result.get('struck') or 'not struck':34} {verdict}", flush=True)


def _table(results: list[dict[str, Any]]) -> int:
    struck: Counter[str] = Counter()
    wrong: Counter[str] = Counter()
    for result in results:
        strike = result.get("strike")
        name = f"{strike['victim']}, {strike['window']}" if strike else result["chain"]
        struck[name] += result["struck"] is not None
        wrong[name] += bool(result["problems"])
    print(f"\n{'':28} struck  wrong")
    for name in sorted(struck):
        print(f"{name:28} {struck[name]:6} {wrong[name]:6}")
    print(f"{'all':28} {struck.total():6} {wrong.total():6}")
    return int(wrong.total() > 0)


if __name__ == "__main__":
    sys.exit(main())
