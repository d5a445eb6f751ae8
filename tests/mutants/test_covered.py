"""Which tests a mutant has to meet, and that what they said is kept."""

from __future__ import annotations

import pytest

from tests.kept_results import KeptResults
from tests.mutants.covered import Coverage, chosen, lines_of

NEAR, FAR, OTHER = "tests/near/test_a.py", "tests/far/test_b.py", "tests/far/test_c.py"


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ("x = @1", None),
        ("class A:\n    x = @1", None),
        ("def f(a=@1):\n    return a", None),
        ("def f():\n    x = 1\n    return (\n        @x\n    )", range(3, 6)),
        ("def f():\n    if (\n        @x\n    ):\n        return 1", range(2, 5)),
        ("def f():\n    if x: return @1", range(2, 3)),
        ("def f():\n    if x:\n        return 1\n    elif @y:\n        return 2", range(4, 5)),
        ("def f():\n    def g(a=@1):\n        return a", range(2, 3)),
        ("class A:\n    def f(self):\n        @g()", range(3, 4)),
    ],
)
def test_the_lines_of_a_place_are_those_of_its_statement_unless_it_runs_at_import(source, lines):
    assert lines_of(source.replace("@", ""), source.index("@")) == lines


def covered(name, **lines):
    functions = {function: {"a/b.py": executed} for function, executed in lines.items() if function != "shared"}
    seconds = {f"{name}::{function}": 1.0 + 10.0 * at for at, function in enumerate(sorted(functions, reverse=True))}
    own = {f"{name}::{function}": of for function, of in functions.items()}
    return Coverage(name, seconds, {"": {"a/b.py": lines.get("shared", [])}, **own})


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (range(3, 4), [f"{NEAR}::test_y", f"{NEAR}::test_x", f"{FAR}::test_z"]),
        (range(8, 9), [NEAR]),
        (range(4, 8), []),
        (None, [NEAR, OTHER, FAR]),
    ],
)
def test_tests_that_execute_a_line_are_met_nearest_and_cheapest_first(tmp_path, lines, expected):
    for name, text in ((NEAR, "from a.b import c"), (FAR, ""), (OTHER, "")):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    files = [
        covered(FAR, test_z=[3], test_v=[2]),
        covered(NEAR, test_x=[1, 2, 3], test_y=[3], shared=[8]),
        covered(OTHER, test_w=[1]),
    ]
    tests, seconds = chosen(tmp_path, files, "a/b.py", lines)
    assert tests == expected
    assert (seconds > 0.0) == bool(expected)


def test_results_are_kept_as_they_come_and_half_a_line_is_none(tmp_path):
    path = tmp_path / "folder" / "results.jsonl"
    results = KeptResults(path)
    for key in ("a", "b"):
        results.add({"key": key, "ran": "red"})
    path.write_text(path.read_text()[:-5])
    again = KeptResults(path)
    assert list(again) == ["a"]
    again.add({"key": "c", "ran": "green"})
    assert list(KeptResults(path)) == ["a", "c"]
    assert not KeptResults(path, fresh=True)
    assert not path.read_text()
