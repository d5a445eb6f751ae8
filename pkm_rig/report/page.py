"""Numbers of a page: each is taken from the page's data by its key and says by which rounding it is shown.

A number is written as `<span data-key="payloads.0.fall_m" data-factor="1000000.0" data-round="0.1">24.1</span>`: the
value at that key of the JSON object, times the factor, rounded to the place; `U` is an expanded uncertainty, to two
digits and never down, `U:KEY` a value that ends at the place of the uncertainty at KEY, `3g` three significant digits,
`text` a text as it is, `said` one in another language with its numbers as they are. A test reads all of them back.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from markupsafe import Markup, escape

from calibration.base.rounding import round_result, round_uncertainty
from calibration.reduction.figures import COVERAGE_FACTOR
from pkm_rig.report.notation import plain_number, with_symbols
from pkm_rig.report.sentences import SENTENCES
from pkm_rig.report.words import Language, named, said, word

NOTHING = "–"


def at_key(data: Mapping[str, Any], key: str) -> Any:
    """The value at a dotted key; numbers are places in lists. KeyError or IndexError where there is none."""
    value: Any = data
    for part in key.split("."):
        value = value[int(part)] if isinstance(value, list) else value[part]
    return value


class Page:
    """Writes values of one object by their keys."""

    def __init__(self, data: Mapping[str, Any], language: Language) -> None:
        self.data, self.language = data, language

    def word(self, key: str) -> str:
        """A word of the catalogue in the page's language."""
        return word(key, self.language)

    def sentence(self, key: str, **parts: object) -> Markup:
        """What is explained, in the page's language, with its parts, which are escaped unless they are markup."""
        return Markup(getattr(SENTENCES[key], self.language)).format(**parts)

    def at(self, key: str) -> Any:
        """The bare value at a key."""
        return at_key(self.data, key)

    def num(self, key: str, places: int = 1, factor: float = 1.0) -> Markup:
        """A number to so many decimal places after multiplication."""
        value = self.at(key)
        if value is None:
            return Markup(NOTHING)
        place = "1" if places == 0 else f"0.{'0' * (places - 1)}1"
        return _span(key, factor, place, f"{value * factor + 0.0:.{places}f}")

    def um(self, key: str, places: int = 1) -> Markup:
        """Metres in micrometres, or radians in microradians."""
        return self.num(key, places, 1e6)

    def percent(self, key: str) -> Markup:
        """A share in percent."""
        return self.num(key, 0, 100.0)

    def significant(self, key: str, digits: int, factor: float = 1.0) -> Markup:
        """A number to exactly so many significant digits, zeros at its end too; zero as it is."""
        value = self.at(key) * factor
        places = (
            0 if value == 0.0 else max(0, digits - 1 - math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}")))))
        )
        return _span(key, factor, f"{digits}g", f"{float(f'{value:.{digits - 1}e}'):.{places}f}")

    def digits(self, key: str, digits: int = 3, factor: float = 1.0) -> Markup:
        """A number to so many significant digits."""
        value = self.at(key)
        if value is None:
            return Markup(NOTHING)
        return _span(key, factor, f"{digits}g", plain_number(value * factor, digits))

    def with_u(self, key: str, u_key: str, factor: float = 1e6) -> Markup:
        """A value and its expanded uncertainty (k times the standard one at `u_key`), rounded together."""
        value, _ = round_result(self.at(key) * factor, self.at(u_key) * factor * COVERAGE_FACTOR)
        return Markup("{} ± {}").format(_span(key, factor, f"U:{u_key}", value), self.expanded(u_key, factor))

    def value_of_u(self, key: str, u_key: str, factor: float = 1e6) -> Markup:
        """A value that ends where its expanded uncertainty does."""
        value, _ = round_result(self.at(key) * factor, self.at(u_key) * factor * COVERAGE_FACTOR)
        return _span(key, factor, f"U:{u_key}", value)

    def expanded(self, u_key: str, factor: float = 1e6) -> Markup:
        """An expanded uncertainty from the standard one."""
        text = round_uncertainty(self.at(u_key) * factor * COVERAGE_FACTOR)
        return _span(u_key, factor * COVERAGE_FACTOR, "U", text)

    def text(self, key: str) -> Markup:
        """A text as it is; a dash, or "not stated" for one that is missing."""
        value = self.at(key)
        if value is None or value == "":
            return Markup('<span class="missing">{}</span>').format(self.word("not_stated"))
        return Markup('<span data-key="{}" data-round="text">{}</span>').format(key, with_symbols(str(value)))

    def said(self, key: str) -> Markup:
        """A verdict or a field that the program has filled in words, in the page's language (`data-round="said"`)."""
        value = self.at(key)
        if self.language == "en" or value is None or value == "":
            return self.text(key)
        shown = with_symbols(said(str(value), self.language))
        return Markup('<span data-key="{}" data-round="said">{}</span>').format(key, shown)

    def of_catalogue(self, key: str, kind: str) -> Markup:
        """A name that the catalogue has under `kind` in the page's language; as it is where the catalogue lacks it."""
        shown = named(kind, str(self.at(key)), self.language)
        return Markup('<span data-key="{}" data-round="said">{}</span>').format(key, shown)

    def code(self, key: str) -> Markup:
        """A name or a hash as it is, in letters of one width."""
        return Markup("<code>{}</code>").format(self.text(key))

    def moment(self, key: str) -> Markup:
        """Unix time as a date and a time of day, UTC."""
        value = self.at(key)
        if value is None:
            return Markup(NOTHING)
        shown = f"{datetime.fromtimestamp(value, UTC):%Y-%m-%d %H:%M}"
        return Markup('<span data-key="{}" data-round="utc">{}</span>').format(key, shown)

    def time_of_day(self, key: str) -> Markup:
        """A moment in ISO 8601 as a date and a time of day, UTC."""
        shown = f"{datetime.fromisoformat(self.at(key)).astimezone(UTC):%Y-%m-%d %H:%M} UTC"
        return Markup('<span data-key="{}" data-round="iso">{}</span>').format(key, shown)

    def crc(self, key: str) -> Markup:
        """A CRC in eight hexadecimal digits."""
        return Markup('<code class="whole" data-key="{}" data-round="hex">{}</code>').format(key, f"{self.at(key):08X}")


def _span(key: str, factor: float, rounding: str, text: str) -> Markup:
    return Markup('<span data-key="{}" data-factor="{}" data-round="{}">{}</span>').format(
        key, repr(factor), rounding, escape(text)
    )
