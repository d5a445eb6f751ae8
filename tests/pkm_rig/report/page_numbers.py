"""Reads a report back: every number of its text must be the one in its data, rounded as it says.

Independent of what writes the page: its own reading of HTML and its own rounding, with decimal numbers.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime
from decimal import ROUND_CEILING, Decimal
from html.parser import HTMLParser

UNCHECKED = {"style", "title", "code", "cite"}  # names of files, commands and standards
NUMBER = r"\d[\w.-]*"  # and dates, and names that begin with a digit
VOID = {"img", "br", "meta", "hr", "link"}


class _Reader(HTMLParser):
    def __init__(self):
        super().__init__()
        self.open, self.shown, self.loose = [], [], []

    def handle_starttag(self, tag, attrs):
        if tag not in VOID:
            attributes = dict(attrs)
            self.open.append((tag, attributes))
            if "data-key" in attributes:
                self.shown.append([attributes, ""])

    def handle_endtag(self, tag):
        while self.open and self.open.pop()[0] != tag:
            pass

    def handle_data(self, text):
        if any("data-key" in attributes for _, attributes in self.open):
            self.shown[-1][1] += text
        elif re.search(r"\d", text) and not any(tag in UNCHECKED for tag, _ in self.open):
            self.loose.append(" ".join(text.split()))


def value_at(data, key):
    for part in key.split("."):
        data = data[int(part)] if isinstance(data, list) else data[part]
    return data


def place_of(text):
    """The decimal place that a number of two significant digits ends at: 0.79 ends at 0.01, 130 at 10."""
    number = Decimal(text)
    return Decimal((0, (1,), number.adjusted() - 1))


def _ends_at(text, place):
    """Whether a text ends at a decimal place, 130 at 10 as well as at 1."""
    shown = Decimal(text)
    return shown % place == 0 and shown.as_tuple().exponent == min(0, place.adjusted())


def complaint(attributes, text, data):  # noqa: PLR0911
    """What is wrong with a number or text that is shown; empty if it is the data's."""
    key, rounding = attributes["data-key"], attributes["data-round"]
    value = value_at(data, key)
    where = f"{key}: {value!r} is shown as {text!r} ({rounding})"
    if rounding == "text":
        shown = text.replace("µ", "u").replace("°C", "degC").replace("±", "+-")
        said = str(value).replace("µ", "u").replace("°C", "degC").replace("±", "+-")
        return "" if shown == said else where
    if rounding == "said":
        return "" if re.findall(NUMBER, text) == re.findall(NUMBER, str(value)) else where
    if rounding == "hex":
        return "" if int(text, 16) == value and len(text) == 8 else where
    if rounding == "iso":
        return "" if f"{value[:10]} {value[11:16]} UTC" == text and value.endswith("+00:00") else where
    if rounding == "utc":
        return "" if datetime.fromtimestamp(value, UTC).strftime("%Y-%m-%d %H:%M") == text else where
    exact = Decimal(repr(float(value))) * Decimal(repr(float(attributes["data-factor"])))
    shown = Decimal(text)
    slack = abs(exact) * Decimal("1e-12") + Decimal("1e-18")
    if rounding == "U":
        place = place_of(text)
        good = exact * (1 - Decimal("1e-9")) <= shown <= exact + place and _ends_at(text, place)
        return "" if good else where
    if rounding.startswith("U:"):
        u = Decimal(repr(float(value_at(data, rounding[2:])))) * 2 * Decimal(repr(float(attributes["data-factor"])))
        place = Decimal((0, (1,), u.adjusted() - 1))
        while (u / place - Decimal("1e-9")).to_integral_value(
            ROUND_CEILING
        ) > 99:  # 99.6 becomes 100, whose second digit is that of tens
            place *= 10
        return "" if _ends_at(text, place) and abs(shown - exact) <= place / 2 + slack else where
    if rounding.endswith("g"):
        digits = int(rounding[:-1])
        place = Decimal((0, (1,), exact.adjusted() - digits + 1)) if exact else Decimal(1)
        return "" if abs(shown - exact) <= place / 2 + slack else where
    place = Decimal(rounding)
    ends = shown.as_tuple().exponent == place.as_tuple().exponent
    return "" if ends and abs(shown - exact) <= place / 2 + slack else where


def complaints(html, data):
    """All that is wrong with a page's numbers, and how many it shows."""
    reader = _Reader()
    reader.feed(html)
    wrong = [line for attributes, text in reader.shown if (line := complaint(attributes, text, data))]
    return wrong + [f"a number without a key: {text!r}" for text in reader.loose], len(reader.shown)
