"""Rounding of results: the examples of GUM 7.2.6, limits of the format, and properties over all floats."""

from __future__ import annotations

import math
from decimal import Decimal, localcontext

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.base.rounding import round_result, round_uncertainty

UNCERTAINTIES = st.floats(min_value=5e-324, allow_infinity=False, allow_nan=False)
VALUES = st.floats(allow_infinity=False, allow_nan=False)


@pytest.mark.parametrize(
    ("value", "uncertainty", "expected"),
    [
        (10.05762, 0.027, ("10.058", "0.027")),  # GUM 7.2.6, y and u_c in ohm
        (99.0, 10.47, ("99", "11")),  # GUM 7.2.6: rounded up
        (99.0, 28.05, ("99", "29")),  # GUM 7.2.6 would let it be 28
        (123.4, 100.0, ("120", "100")),  # no "1e+02"
        (1234567.0, 123456.0, ("1230000", "130000")),
        (5.0, 99.6, ("0", "100")),  # rounded up to three digits, of which two are significant
        (-0.004, 0.31, ("0.00", "0.31")),  # no sign of a zero
        (-17.26, 0.996, ("-17.3", "1.0")),
        (17.25, 3.1, ("17.2", "3.1")),  # half to even
        (0.0, 2.5e-7, ("0.00000000", "0.00000025")),
        (1.0, 0.1 + 0.2, ("1.00", "0.30")),  # 0.30000000000000004 is 0.30
    ],
)
def test_hand_made_cases(value: float, uncertainty: float, expected: tuple[str, str]) -> None:
    assert round_result(value, uncertainty) == expected
    assert round_uncertainty(uncertainty) == expected[1]


@pytest.mark.parametrize(
    ("value", "uncertainty", "expected"),
    [
        (3.0, 0.0, ("3", "0")),
        (1e22, 0.0, ("10000000000000000000000", "0")),
        (0.25, math.inf, ("0.25", "inf")),
        (0.25, math.nan, ("0.25", "nan")),
        (math.nan, 0.25, ("nan", "0.25")),
        (-math.inf, 25.0, ("-inf", "25")),
        (1e308, 5e-324, ("1" + "0" * 308 + "." + "0" * 325, "0." + "0" * 323 + "50")),
    ],
)
def test_zero_infinite_and_extreme_numbers(value: float, uncertainty: float, expected: tuple[str, str]) -> None:
    assert round_result(value, uncertainty) == expected


def test_a_negative_uncertainty_is_refused() -> None:
    with pytest.raises(ValueError, match="negative"):
        round_result(1.0, -0.1)


@given(VALUES, UNCERTAINTIES)
def test_both_end_at_one_decimal_place_without_an_exponent(value: float, uncertainty: float) -> None:
    texts = round_result(value, uncertainty)
    assert not any("e" in text.lower() for text in texts)
    assert len(texts[0].partition(".")[2]) == len(texts[1].partition(".")[2])


@given(VALUES, UNCERTAINTIES)
def test_what_rounding_moves_stays_within_its_limits(value: float, uncertainty: float) -> None:
    number, rounded = map(Decimal, round_result(value, uncertainty))
    with localcontext() as context:
        context.prec = 1100
        place = Decimal((0, (1,), rounded.adjusted() - 1))
        assert rounded % place == number % place == 0
        assert 10 <= rounded / place <= 99
        assert -place / 10**9 < rounded - Decimal(repr(uncertainty)) < place
        assert abs(number - Decimal(repr(value))) <= place / 2


@given(st.integers(10, 99), st.integers(-12, 12))
def test_two_digits_are_kept_as_they_are(digits: int, exponent: int) -> None:
    assert Decimal(round_uncertainty(float(f"{digits}e{exponent}"))) == Decimal(f"{digits}e{exponent}")
