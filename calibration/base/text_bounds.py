"""What a parser of TOML or JSON is not asked to take: checked on the text, in one pass, before it is parsed.

Python's parsers follow nesting by recursion, dotted keys in quadratic time, and refuse long integers by an error of its
own kind; a file of ours comes nowhere near these bounds.
"""

from __future__ import annotations

import json
import re
from typing import Any

from calibration.base.errors import InputError

MOST_LEVELS = 30
MOST_PARTS = 15  # of a dotted key
MOST_DIGITS = 400

_TOML_STRING = r'"""(?:[^\\]|\\.)*?"""|' + r"'''.*?'''|" + r'"(?:[^"\\\n]|\\.)*"|' + r"'[^'\n]*'|#[^\n]*"
_JSON_STRING = r'"(?:[^"\\]|\\.)*"'
_LONG_NUMBER = re.compile(rf"(?<![0-9A-Za-z_])(?:0[xob]|[0-9])[0-9A-Fa-f_]{{{MOST_DIGITS},}}")
_LONG_KEY = re.compile(rf'(?<![A-Za-z0-9_"-])(?:(?:[A-Za-z0-9_-]++|"")[ \t]*+\.[ \t]*+){{{MOST_PARTS},}}')
_BRACKET = re.compile(r"[\[\]{}]")


def check_toml_text(text: str, name: str) -> None:
    """Raise InputError for nesting, dotted keys or numbers that no file of ours has."""
    bare = re.sub(_TOML_STRING, '""', text, flags=re.DOTALL)
    _check_bounds(bare, name)
    if _LONG_KEY.search(bare):
        raise InputError(f"{name}: a key of more than {MOST_PARTS} dotted parts; not a file of pkm-rig")


def parse_json(text: str, name: str) -> Any:
    """A JSON document; InputError in one line for NaN, infinities, nesting or numbers that no file of ours has."""

    def refuse(word: str) -> float:
        raise InputError(f"{name}: holds {word}; not a file of pkm-rig")

    _check_bounds(re.sub(_JSON_STRING, '""', text, flags=re.DOTALL), name)
    try:
        return json.loads(text, parse_constant=refuse)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{name}: not JSON: {error}") from error


def _check_bounds(bare: str, name: str) -> None:
    if _LONG_NUMBER.search(bare):
        raise InputError(f"{name}: a number of more than {MOST_DIGITS} digits; not a file of pkm-rig")
    level = 0
    for bracket in _BRACKET.finditer(bare):
        level += 1 if bracket[0] in "[{" else -1
        if level > MOST_LEVELS:
            raise InputError(f"{name}: nested more than {MOST_LEVELS} levels deep; not a file of pkm-rig")
