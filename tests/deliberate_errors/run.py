"""Applies the errors of errors.toml one by one to a copy of the tree and runs the tests that must find each.

`make deliberate-errors`, or `python -m tests.deliberate_errors.run [--only WORDS] [--jobs N]`. The status is 1 if an
error survived, could not be applied, or the test that fails does so without it as well.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from tests.copied_tree import copied_tree, nearest_first, run_tests, spoilt

ERRORS = Path(__file__).with_name("errors.toml")
LIMIT_S = 1200.0


@dataclass(frozen=True)
class DeliberateError:
    """One error: `old` in `file` becomes `new`, and one of `tests` (of pytest) must fail."""

    name: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]

    def apply(self, text: str) -> str:
        """The spoilt text. Raises ValueError unless `old` occurs exactly once."""
        if text.count(self.old) != 1:
            raise ValueError(f"{self.file}: {text.count(self.old)} times, not once: {self.old.strip()}")
        return text.replace(self.old, self.new)


def read_errors() -> list[DeliberateError]:
    """All errors of the file."""
    entries = tomllib.loads(ERRORS.read_text(encoding="utf-8"))["error"]
    return [DeliberateError(**{**entry, "tests": tuple(entry["tests"])}) for entry in entries]


def main() -> int:
    """Run all, or those whose names contain the words; prints each result as it comes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", metavar="WORDS")
    parser.add_argument("--jobs", type=int, default=1)
    arguments = parser.parse_args()
    errors = [error for error in read_errors() if arguments.only in error.name]
    survived = 0
    with ExitStack() as stack:
        trees: SimpleQueue[Path] = SimpleQueue()
        for _ in range(arguments.jobs):
            trees.put(stack.enter_context(copied_tree()))
        pool = stack.enter_context(ThreadPoolExecutor(arguments.jobs))
        for error, (killed, said) in zip(errors, pool.map(lambda error: _run(trees, error), errors), strict=True):
            survived += not killed
            print(f"{'killed  ' if killed else 'SURVIVED'}  {error.name}: {said}", flush=True)
    print(f"{len(errors) - survived} of {len(errors)} killed")
    return 1 if survived else 0


def _run(trees: SimpleQueue[Path], error: DeliberateError) -> tuple[bool, str]:
    """Run an error's tests in one of the copies: whether it was killed, and what pytest said last."""
    tree = trees.get()
    try:
        path = tree / error.file
        try:
            text = error.apply(path.read_text(encoding="utf-8"))
        except (ValueError, OSError) as failure:
            return False, f"cannot be applied: {failure}"
        with spoilt(path, text):
            ran, said = run_tests(tree, nearest_first(tree, error.tests, error.file), LIMIT_S)
            if ran != "red":
                return ran == "time-out", said
            failed = said.split(" - ")[0].partition(" ")[2]
            if run_tests(tree, [failed], LIMIT_S)[0] != "red":  # a test that fails now and then finds nothing
                return False, f"{failed} does not fail again"
        if run_tests(tree, [failed], LIMIT_S)[0] != "green":
            return False, f"{failed} fails without it as well"
        return True, said
    finally:
        trees.put(tree)


if __name__ == "__main__":
    sys.exit(main())
