"""Checks the diagnosis on structures without a named formula: one table (docs/explanation/structures.md).

    python -m benchmarks.structures.run [--n 100] [--seed 1] [--out DIR] [--unsealed]

Case k of a seed is the same whatever N is. Each recording is diagnosed by the sealed diagnoser of the check on withheld
cases. Answers lie in runs/structures; stopped at any time, the same command goes on, and a larger N adds cases. Exit
status 2 if the diagnoser cannot be sealed or a case cannot be made, 130 if interrupted.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks.results_file import ROOT, code_digest
from benchmarks.structures.structure import Generator, NoCase
from benchmarks.structures.table import Row, printed, row_of
from benchmarks.withheld.jail import UNSEALED
from benchmarks.withheld.lane import finite
from benchmarks.withheld.sealed_diagnoser import HELPERS, NotSealed, SealedDiagnoser
from mock_devices.recordings.files import write_recording
from tests.kept_results import KeptResults, key_of, until_stopped

OUT = ROOT / "runs" / "structures"
# What makes and diagnoses a case; the table is printed anew.
MAKING = tuple(
    f"benchmarks/structures/{name}.py" for name in ("acting", "coordinates", "functions", "kinds", "structure")
)
RIGS = tuple(f"benchmarks/withheld/{name}.py" for name in ("cases", "designs", "sizes"))
DIAGNOSER = tuple(f"benchmarks/withheld/{name}.py" for name in (*HELPERS, "sealed_diagnoser"))
MAKING_CODE = ("mock_devices", *MAKING, *RIGS)
CODE = ("calibration", *MAKING_CODE, *DIAGNOSER)


def main(arguments: list[str] | None = None) -> int:
    """Diagnose the cases that are missing, then print the table."""
    options = _options(arguments)
    try:
        rows = answer(options)
    except (NotSealed, NoCase) as error:
        print(f"structures: {error}", file=sys.stderr)
        return 2
    print(printed(rows))
    return 0


def answer(options: argparse.Namespace) -> list[Row]:
    """Rows of all cases; each is on disk before the next is made."""
    code = code_digest(*CODE)
    results = KeptResults(options.out / f"seed-{options.seed}.jsonl")
    keys = [key_of(code, options.seed, k, options.diagnose) for k in range(options.n)]
    missing = [k for k, key in enumerate(keys) if key not in results]
    if missing:
        generator, started = Generator(options.seed), time.monotonic()
        with (
            (options.out / "diagnoser.log").open("a", encoding="utf-8") as log,
            SealedDiagnoser(
                log, options.diagnose, way="" if options.sealed else UNSEALED, baselines=False
            ) as diagnoser,
        ):
            for done, k in enumerate(missing, start=1):
                row = _case(generator, diagnoser, k)
                results.add({"key": keys[k], "row": row})
                left_min = (time.monotonic() - started) / done * (len(missing) - done) / 60.0
                print(f"{k + 1} of {options.n}; {left_min:.1f} min left", file=sys.stderr, flush=True)
    return [results[key]["row"] for key in keys]


def _case(generator: Generator, diagnoser: SealedDiagnoser, number: int) -> Row:
    case = generator.case(number)
    with tempfile.TemporaryDirectory() as folder:
        write_recording(case.recording, Path(folder) / "recording")
        given: dict[str, Any] = diagnoser.diagnose(Path(folder) / "recording")
    return finite(row_of(case.truth, given))


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=100, help="cases in all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=OUT, help="folder of all runs")
    parser.add_argument(
        "--unsealed", dest="sealed", action="store_false",
        help="where the system can shut no process in: the diagnoser could open the plant",
    )  # fmt: skip
    parser.add_argument("--diagnose", default="", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.n < 1 or options.seed < 0:
        parser.error("--n must be positive, --seed not negative")
    return options


if __name__ == "__main__":
    sys.exit(until_stopped(main))
