"""How numbers and units are written for people.

Texts are composed in ASCII (um, urad, degC, +-); symbols are put in where they are shown, if they can be shown there.
"""

from __future__ import annotations

import re

from calibration.base.errors import printable

SYMBOLS = "µ°±"
_REPLACEMENTS = (
    (re.compile(r"(?:^|(?<=[\d/] ))u(?=(?:m|rad|s)\b)"), "µ"),  # after a number or "/", or as a whole column
    (re.compile(r"(?:^|(?<=[\d/] ))degC\b"), "°C"),
    (re.compile(r"(?<= )\+-(?= )"), "±"),
)


def with_symbols(text: str, encoding: str = "utf-8") -> str:
    """The text with the symbols of its units, if the encoding has them."""
    try:
        SYMBOLS.encode(encoding)
    except (UnicodeEncodeError, LookupError):
        return text
    for pattern, symbol in _REPLACEMENTS:
        text = pattern.sub(symbol, text)
    return text


def literal(name: str) -> str:
    """A name as matplotlib shows it letter by letter: without mathematics between dollar signs."""
    return printable(name).replace("$", r"\$")


def plain_number(value: float, digits: int = 3) -> str:
    """A number without uncertainty to so many significant digits, never with an exponent below a million."""
    return f"{float(f'{value:.{digits}g}'):.15g}" if abs(value) >= 1e-4 else f"{value:.{digits}g}"
