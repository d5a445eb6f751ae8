"""Makes an archive of recordings of another simulator (docs/explanation/other-simulator.md).

    python -m benchmarks.other_simulator --archive first|second|space|third|fourth|fifth|sixth|seventh|eighth|ninth|
        tenth --out FOLDER [--n N] [--processes 1]

Writes FOLDER/recordings.tar.xz in the form that `make independent DATA=FOLDER` reads, of the first N recordings or of
all. Each recording is the same whatever N is. What is made stays in FOLDER/cases, in one folder for each state of this
package's code: stopped at any time, the same command goes on. Exit status 2 if something is wrong with what was given
or a recording cannot be made, 130 if interrupted.
"""

from __future__ import annotations

import argparse
import shutil
import sys
import time
from collections.abc import Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import NoReturn

from benchmarks.independent.pack import pack
from benchmarks.other_simulator.archives import Case, cases_of
from benchmarks.other_simulator.forms.catalogue import ARCHIVES
from benchmarks.other_simulator.making import NoRecording, make_case
from benchmarks.results_file import code_digest
from benchmarks.side_by_side import side_by_side
from benchmarks.timing import in_one_thread
from tests.kept_results import until_stopped

CODE = "benchmarks/other_simulator"


class BadInput(ValueError):
    """What was given is of no use; one line."""


def main(arguments: list[str] | None = None) -> int:
    """Make what is missing, then pack."""
    try:
        options = _options(arguments)
        cases = cases_of(options.archive)
        if options.n > len(cases):
            raise BadInput(f"--n {options.n}: archive {options.archive} has {len(cases)} recordings")
        chosen = cases[: options.n or None]  # they are mixed: the first ones are a fair sample
        folder = options.out / "cases" / f"{options.archive}-{code_digest(CODE)}"
        make_all(chosen, folder, options.processes)
        print(pack(folder, options.out, [case.name for case in chosen]))
    except (BadInput, NoRecording, OSError) as error:
        print(f"other_simulator: {error}", file=sys.stderr)
        return 2
    return 0


def make_all(chosen: Sequence[Case], folder: Path, processes: int) -> None:
    """Make the recordings that are not there; each is whole or not there."""
    folder.mkdir(parents=True, exist_ok=True)
    missing = [case for case in chosen if not (folder / case.name).exists()]
    for part in folder.glob("*.part"):
        shutil.rmtree(part)
    started = time.monotonic()
    with side_by_side(make_case, [(case, folder) for case in missing], processes) as running:
        for done, future in enumerate(as_completed(running), 1):
            name, passed_min = future.result(), (time.monotonic() - started) / 60.0
            left_min = passed_min / done * (len(missing) - done)
            print(
                f"{name} made; {done} of {len(missing)}; {passed_min:.1f} min, {left_min:.1f} left",
                file=sys.stderr, flush=True,
            )  # fmt: skip


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        raise BadInput(message)


def _options(arguments: list[str] | None) -> argparse.Namespace:
    parser = _Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--archive", required=True, choices=ARCHIVES)
    parser.add_argument("--out", type=Path, required=True, help="folder of the archive")
    parser.add_argument("--n", type=int, default=0, help="so many recordings only, for a first look")
    parser.add_argument("--processes", type=int, default=1, help="recordings made side by side")
    options = parser.parse_args(arguments)
    if options.n < 0 or options.processes < 1:
        parser.error("--n must not be negative, --processes not below 1")
    return options


if __name__ == "__main__":
    in_one_thread()  # as benchmarks.withheld.run
    sys.exit(until_stopped(main))
