"""Which tests of a room a mutant has to meet: those that execute its line, nearest and cheapest first.

What each test executes comes from one run of each test file without mutants, in a process of its own, so that nothing a
former file left behind spares a test a line. Where that does not say it, all tests of the room are run: for what is
executed at import. Where a line is executed by a fixture that tests share, all tests of their file are.
"""

from __future__ import annotations

import ast
import hashlib
import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.copied_tree import CopiedTree, names_module
from tests.kept_results import key_of

LIMIT_S = 1800.0
_OF_NO_ROOM = ("benchmarks/", "docs/", "tests/mutants/", "tests/deliberate_errors/", "tests/pkm_rig/")


@dataclass(frozen=True)
class Coverage:
    """What a file of tests executes: seconds of each of its functions, and the lines of each file of code.

    Those of the function "" are executed for the file as a whole.
    """

    name: str
    seconds: dict[str, float]
    lines: dict[str, dict[str, list[int]]]

    @classmethod
    def of(cls, result: dict[str, Any]) -> Coverage:
        """From a kept result of `run_without_mutants`."""
        return cls(result["name"], result["seconds"], result["lines"])

    def meets(self, file: str, lines: range) -> list[str]:
        """What pytest has to run of it so that everything is that executes one of some lines, cheapest first."""
        executing = [name for name, of in self.lines.items() if not set(of.get(file, [])).isdisjoint(lines)]
        return [self.name] if "" in executing else sorted(executing, key=lambda name: self.seconds[name])

    def seconds_of(self, test: str) -> float:
        """How long it takes, or one of its functions."""
        return sum(self.seconds.values()) if test == self.name else self.seconds[test]


def chosen(tree: Path, files: Sequence[Coverage], file: str, lines: range | None) -> tuple[list[str], float]:
    """The tests that a mutant in some lines of a file has to meet, in order, and how long they take without it.

    All of the room where the lines are None; none where no test executes them.
    """
    met = [(one, one.meets(file, lines) if lines is not None else [one.name]) for one in files]
    told = [(one, tests, sum(map(one.seconds_of, tests))) for one, tests in met if tests]
    told.sort(key=lambda entry: (not names_module(tree, entry[0].name, file), entry[2]))
    return [test for _, tests, _ in told for test in tests], sum(seconds for *_, seconds in told)


def lines_of(text: str, place: int) -> range | None:
    """The lines of the innermost statement at a place, without the statements in it; None if it runs at import."""
    line = text.count("\n", 0, place) + 1
    statements = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.stmt))  # outer ones first
    around = [node for node in statements if node.lineno <= line <= (node.end_lineno or node.lineno)]
    if not any(isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) for node in around[:-1]):
        return None
    body = getattr(around[-1], "body", None)
    last = body[0].lineno - 1 if body else around[-1].end_lineno
    return range(around[-1].lineno, max(around[-1].lineno, last) + 1)


def state_of(tree: Path, files: Sequence[str]) -> str:
    """Of all that a test file may depend on: the code and what it has in common with other test files."""
    of_code = [one for one in files if one.endswith((".py", ".toml")) and not one.startswith(_OF_NO_ROOM)]
    common = sorted(one for one in of_code if "/test_" not in one)
    return key_of(*(part for one in common for part in (one, _hash(tree / one))))


def key_of_test_file(tree: Path, name: str, state: str) -> str:
    """By which the result of its run without mutants is kept."""
    return key_of(name, _hash(tree / name), state)


def run_without_mutants(copy: CopiedTree, name: str) -> dict[str, Any]:
    """Run a test file and see what its functions execute. Raises RuntimeError unless they are green."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "lines.json"
        ran, said = copy.run([name], LIMIT_S, "-p", "tests.mutants.lines_by_test", "--lines-to", str(path))
        if ran != "green":
            raise RuntimeError(f"{name} is not green without any mutant: {said}")
        return {"name": name, **json.loads(path.read_text(encoding="utf-8"))}


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
