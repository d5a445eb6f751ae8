"""Programs beside one another on recordings whose cause is known: one table (docs/how-to/enter-gapbench.md).

    python -m benchmarks.gapbench.run [--structures 40] [--named 20] [--seed 1] [--entries ours,greedy_bic,classifier]
                                      [--program "NAME=COMMAND {folder}"] [--show PATH]

A program is given the folder of a recording and prints one JSON object. It is shut in, and sees the recording under a
random name. Answers lie in runs/gapbench; stopped at any time, the same command goes on. Exit status 2 if a program
cannot be started or shut in, 130 if interrupted; a program that answers wrongly or not at all is only scored.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import time
from pathlib import Path

from benchmarks.gapbench import entries
from benchmarks.gapbench.cases import CaseSet
from benchmarks.gapbench.program import Entry, Trial, entry_of
from benchmarks.gapbench.score import Row, printed, row_of
from benchmarks.gapbench.train import OTHER_SEED, NotInstalled, train
from benchmarks.results_file import ROOT, code_digest
from benchmarks.structures.run import MAKING_CODE
from benchmarks.structures.structure import NoCase
from benchmarks.withheld.designs import MACHINE
from benchmarks.withheld.jail import UNSEALED
from benchmarks.withheld.sealed_diagnoser import NotSealed
from tests.kept_results import KeptResults, key_of, until_stopped

OUT = ROOT / "runs" / "gapbench"
CODE = (*MAKING_CODE, "benchmarks/withheld/making.py", "benchmarks/gapbench/cases.py")


def main(arguments: list[str] | None = None) -> int:
    """Run what is missing, then print the table."""
    options = _options(arguments)
    try:
        print(printed(compare(options)))
    except (NotSealed, NotInstalled, NoCase) as error:
        print(f"gapbench: {error}", file=sys.stderr)
        return 2
    return 0


def compare(options: argparse.Namespace) -> dict[str, list[Row]]:
    """Rows of every program, by its name; each answer is on disk before the next case."""
    trial = Trial(UNSEALED if not options.sealed else "", options.limit_s)
    options.out.mkdir(parents=True, exist_ok=True)
    tried = [*_shipped(options), *options.program]
    for entry in tried:
        trial.prove(entry)
    cases = CaseSet(options.seed, options.structures, options.named)
    code, started = code_digest(*CODE), time.monotonic()
    results = KeptResults(options.out / f"seed-{options.seed}.jsonl", fresh=options.fresh)
    keys = {(e.name, k): _key(e, cases.key(k), code, options) for e in tried for k in range(cases.count)}
    left = sorted({k for (_, k), key in keys.items() if key not in results})
    for done, k in enumerate(left, start=1):
        case = cases.case(k)
        for entry in tried:
            if keys[entry.name, k] not in results:
                row = row_of(case.truth, trial.run(entry, case.files))
                results.add({"key": keys[entry.name, k], "row": row})
        left_min = (time.monotonic() - started) / done * (len(left) - done) / 60.0
        print(f"{done} of {len(left)} cases; {left_min:.1f} min left", file=sys.stderr, flush=True)
    return {e.name: [results[keys[e.name, k]]["row"] for k in range(cases.count)] for e in tried}


def _shipped(options: argparse.Namespace) -> list[Entry]:
    return entries.shipped(
        options.entries, options.out / "programs", lambda: train(options.training, options.out, MACHINE)
    )


def _key(entry: Entry, case: str, code: str, options: argparse.Namespace) -> str:
    """What an answer is found again by: what the program is and sees as files, and what the case is."""
    seen = hashlib.sha256()
    for path in entry.show:
        seen.update(str(path).encode() + (path.read_bytes() if path.is_file() else b""))
    return key_of(code, case, *entry.command, str(entry.home), seen.hexdigest(), str(options.limit_s))


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--structures", type=int, default=40, help="cases of drawn structure")
    parser.add_argument("--named", type=int, default=20, help="cases with the mock's named effects")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--entries", default=",".join(entries.NAMES), help="shipped programs, separated by commas")
    parser.add_argument("--program", action="append", default=[], help="NAME=COMMAND with {folder}; again for more")
    parser.add_argument(
        "--show", type=Path, action="append", default=[], help="what programs see besides; again for more"
    )
    parser.add_argument("--limit-s", type=float, default=120.0, help="time on its core for one recording")
    parser.add_argument("--training", type=int, default=420, help="cases that the classifier is trained on")
    parser.add_argument("--fresh", action="store_true", help="forget all answers of this seed")
    parser.add_argument("--out", type=Path, default=OUT, help="folder of all runs")
    parser.add_argument(
        "--unsealed", dest="sealed", action="store_false", help="where the system can shut no process in"
    )
    options = parser.parse_args(arguments)
    options.out = options.out.resolve()
    options.entries = [name for name in options.entries.split(",") if name]
    if unknown := set(options.entries) - set(entries.NAMES):
        parser.error(f"--entries: there is no '{min(unknown)}'; there are {', '.join(entries.NAMES)}")
    try:
        options.program = [entry_of(text, tuple(options.show)) for text in options.program]
    except ValueError as error:
        parser.error(str(error))
    names = [*options.entries, *(entry.name for entry in options.program)]
    if not names or len(set(names)) < len(names):
        parser.error("give each program a name of its own, and at least one program")
    if options.structures < 0 or options.named < 0 or options.structures + options.named < 1:
        parser.error("--structures and --named must not be negative, and not both zero")
    if not 0 <= options.seed < OTHER_SEED:
        parser.error(f"--seed must lie in 0 to {OTHER_SEED - 1}; the others are those of the training")
    if options.limit_s <= 0.0:
        parser.error("--limit-s must be positive")
    return options


if __name__ == "__main__":
    sys.exit(until_stopped(main))
