"""Applies the errors of errors.toml one by one to a copy of the tree and runs the tests that must find each.

`make deliberate-errors`, or `python -m tests.deliberate_errors.run [--only WORDS] [--jobs N] [--out FOLDER] [--fresh]`.
Results are kept in FOLDER as they come, and hold until the error, its file or its tests change: a second call goes on
where the first was ended, and tries again what survived. The status is 1 if an error survived, could not be applied, or
the test that fails does so without it as well.
"""

from __future__ import annotations

import argparse
import sys
import tomllib
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from tests.copied_tree import ROOT, CopiedTree, nearest_first, over_copies, spoilt, test_files
from tests.kept_results import KeptResults, key_of, until_stopped

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

    def key(self, tree: Path) -> str:
        """Of the error and the contents of its file and its tests."""
        files = [self.file, *test_files(tree, self.tests)]
        texts = [(tree / name).read_text(encoding="utf-8") if (tree / name).exists() else "" for name in files]
        return key_of(self.name, self.old, self.new, *files, *texts)


def read_errors() -> list[DeliberateError]:
    """All errors of the file."""
    entries = tomllib.loads(ERRORS.read_text(encoding="utf-8"))["error"]
    return [DeliberateError(**{**entry, "tests": tuple(entry["tests"])}) for entry in entries]


def main() -> int:
    """Run all, or those whose names contain the words; prints each result as it comes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", metavar="WORDS")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("runs/deliberate-errors"))
    parser.add_argument("--fresh", action="store_true", help="forget former results")
    arguments = parser.parse_args()
    errors = {error.key(ROOT): error for error in read_errors() if arguments.only in error.name}
    results = KeptResults(arguments.out / "results.jsonl", fresh=arguments.fresh)
    missing = [key for key in errors if key not in results or not results[key]["killed"]]
    print(f"{len(errors)} errors, {len(errors) - len(missing)} of them not tried again", flush=True)
    with closing(over_copies(arguments.jobs, missing, lambda copy, key: _run(copy, errors[key]))) as tried:
        for key, (killed, said) in tried:
            results.add({"key": key, "killed": killed, "said": said})
            print(f"{'killed  ' if killed else 'SURVIVED'}  {errors[key].name}: {said}", flush=True)
    survived = sum(not results[key]["killed"] for key in errors)
    print(f"{len(errors) - survived} of {len(errors)} killed")
    return 1 if survived else 0


def _run(copy: CopiedTree, error: DeliberateError) -> tuple[bool, str]:
    """Run an error's tests in a copy: whether it was killed, and what pytest said last."""
    path = copy.path / error.file
    try:
        text = error.apply(path.read_text(encoding="utf-8"))
    except (ValueError, OSError) as failure:
        return False, f"cannot be applied: {failure}"
    with spoilt(path, text):
        ran, said = copy.run(nearest_first(copy.path, error.tests, error.file), LIMIT_S)
        if ran != "red":
            return ran == "time-out", said
        failed = said.split(" - ")[0].partition(" ")[2]
        if copy.run([failed], LIMIT_S)[0] != "red":  # a test that fails now and then finds nothing
            return False, f"{failed} does not fail again"
    if copy.run([failed], LIMIT_S)[0] != "green":
        return False, f"{failed} fails without it as well"
    return True, said


if __name__ == "__main__":
    sys.exit(until_stopped(main))
