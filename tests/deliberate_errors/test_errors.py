"""The file of deliberate errors fits the code: each can be applied, and is still Python."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from tests.deliberate_errors.run import DeliberateError, read_errors

ROOT = Path(__file__).parents[2]
ERRORS = read_errors()


@pytest.mark.parametrize("error", ERRORS, ids=lambda error: error.name)
def test_an_error_can_be_applied_and_its_tests_are_there(error):
    text = (ROOT / error.file).read_text(encoding="utf-8")
    spoilt = error.apply(text)
    assert ast.dump(ast.parse(spoilt)) != ast.dump(ast.parse(text))
    for test in error.tests:
        assert (ROOT / test.partition("::")[0]).exists()


def test_names_are_unique():
    assert len({error.name for error in ERRORS}) == len(ERRORS)


@pytest.mark.parametrize("old", ["not there", "x"])
def test_what_occurs_not_once_cannot_be_applied(old):
    with pytest.raises(ValueError, match="times, not once"):
        DeliberateError("n", "f.py", old, "y", ()).apply("x = x\n")
