"""The symbols that the page of changes names exist."""

from __future__ import annotations

import ast
import re

import pytest

from tests.docs.pages import ROOT

PAGE = ROOT / "docs" / "reference" / "where-to-change.md"
NAMED = sorted(set(re.findall(r"`([\w/]+\.py): ([\w.]+)`", PAGE.read_text(encoding="utf-8"))))


def symbols(body: list[ast.stmt], prefix: str = "") -> set[str]:
    """Names that statements define, those in classes with the name of their class before a dot."""
    names: set[str] = set()
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.add(prefix + node.name)
        if isinstance(node, ast.ClassDef):
            names |= symbols(node.body, f"{prefix}{node.name}.")
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(prefix + node.target.id)
        if isinstance(node, ast.Assign):
            names |= {prefix + t.id for target in node.targets for t in ast.walk(target) if isinstance(t, ast.Name)}
    return names


def test_the_page_names_symbols():
    assert len(NAMED) > 20


@pytest.mark.parametrize(("path", "symbol"), NAMED, ids=lambda part: part)
def test_the_symbol_exists(path, symbol):
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    assert symbol in symbols(tree.body), f"{path} has no {symbol}"
