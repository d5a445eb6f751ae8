"""Property tests say what holds where an input is accepted and where it is refused."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
FILES = [path for path in TESTS.rglob("test_*.py") if "\n@given" in path.read_text(encoding="utf-8")]


def property_tests(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef) and any("given" in ast.unparse(d) for d in node.decorator_list):
            yield node


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(TESTS)))
def test_no_property_is_asserted_within_suppress(path):
    """An assertion there is not made where the input is refused, and nobody sees that it never is."""
    found = list(property_tests(path))
    assert found
    for function in found:
        used = {ast.unparse(call.func) for call in ast.walk(function) if isinstance(call, ast.Call)}
        assert not used & {"contextlib.suppress", "suppress"}, function.name
