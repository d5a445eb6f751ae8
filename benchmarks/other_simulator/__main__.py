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
import sys
from pathlib import Path
from typing import NoReturn

from benchmarks.independent.make_all import make_all
from benchmarks.independent.pack import pack
from benchmarks.other_simulator.archives import cases_of
from benchmarks.other_simulator.forms.catalogue import ARCHIVES
from benchmarks.other_simulator.making import NoRecording, make_case
from benchmarks.results_file import code_digest
from benchmarks.timing import in_one_thread
from tests.kept_results import CannotBeKept, until_stopped

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
        make_all(make_case, chosen, folder, options.processes)
        print(pack(folder, options.out, [case.name for case in chosen]))
    except (BadInput, CannotBeKept, NoRecording, OSError) as error:
        print(f"other_simulator: {error}", file=sys.stderr)
        return 2
    return 0


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
