"""Results as text: value and uncertainty rounded together, by the GUM (JCGM 100:2008, 7.2.6).

The uncertainty has two significant digits and the value ends at the same decimal place. An uncertainty is rounded up
(10.47 to 11) and never down: where the GUM lets 28.05 be 28, it is 29 here, so that no result looks better than it is.
Never an exponent: 123456 is 130000.
"""

from __future__ import annotations

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_EVEN, Context, Decimal

SIGNIFICANT_DIGITS = 2
ROUND_OFF = Decimal("1e-9")  # of the last digit kept: 0.30000000000000004 is 0.30
_EXACT = Context(prec=1100)  # digits between the largest and the smallest float


def round_result(value: float, uncertainty: float) -> tuple[str, str]:
    """Text of a value and of its (expanded) uncertainty, both in one unit.

    With uncertainty zero the value keeps all digits that it has. A number that is not finite is written as Python
    writes it ("nan", "inf"), and the value beside such an uncertainty keeps its digits. Raises ValueError for an
    uncertainty below zero.
    """
    if uncertainty < 0.0:
        raise ValueError(f"uncertainty {uncertainty!r} is negative")
    if uncertainty == 0.0 or not math.isfinite(uncertainty):
        return _plain(value), _plain(uncertainty)
    rounded, quantum = _round_uncertainty(_decimal(uncertainty))
    if not math.isfinite(value):
        return _plain(value), _text(rounded)
    return _text(_decimal(value).quantize(quantum, ROUND_HALF_EVEN, _EXACT)), _text(rounded)


def round_uncertainty(uncertainty: float) -> str:
    """Text of an (expanded) uncertainty alone, to two significant digits."""
    return round_result(math.nan, uncertainty)[1]


def _round_uncertainty(exact: Decimal) -> tuple[Decimal, Decimal]:
    """An uncertainty > 0 to two significant digits, and the decimal place that it ends at."""
    quantum = Decimal((0, (1,), exact.adjusted() + 1 - SIGNIFICANT_DIGITS))
    lower = exact.quantize(quantum, ROUND_FLOOR, _EXACT)
    if _EXACT.subtract(exact, lower) < ROUND_OFF * quantum:
        return lower, quantum
    upper = exact.quantize(quantum, ROUND_CEILING, _EXACT)
    if upper.adjusted() > exact.adjusted():  # 99.6 becomes 100, whose second digit is the one of tens
        quantum = quantum.scaleb(1, _EXACT)
        upper = upper.quantize(quantum, ROUND_HALF_EVEN, _EXACT)
    return upper, quantum


def _decimal(number: float) -> Decimal:
    """The shortest decimal number that is this float."""
    return Decimal(repr(float(number)))


def _plain(number: float) -> str:
    """All digits of a number: 3.0 is 3, 0.25 is 0.25."""
    return _text(_decimal(number).normalize(_EXACT)) if math.isfinite(number) else repr(float(number))


def _text(number: Decimal) -> str:
    """Without an exponent, and without the sign of a zero."""
    return format(number if number else abs(number), "f")
