"""How numbers and units are shown to people."""

from __future__ import annotations

import io

import pytest
from rich.table import Table
from rich.text import Text

from calibration.diagnosis.result import Quantity
from pkm_rig.report.diagnosis_text import format_quantity
from pkm_rig.report.notation import plain_number, with_symbols
from pkm_rig.report.terminal import PeopleConsole


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("fall 24.1 um > U = 4.6 um (k = 2)", "fall 24.1 µm > U = 4.6 µm (k = 2)"),
        ("position / um", "position / µm"),
        ("um", "µm"),
        ("3.0 +- 1.1 urad", "3.0 ± 1.1 µrad"),
        ("20.1 degC", "20.1 °C"),
        ("3.1 um/m", "3.1 µm/m"),
        ("runs/um/report.html, umbrella, drum", "runs/um/report.html, umbrella, drum"),
    ],
)
def test_symbols_where_they_can_be_shown(text, shown):
    assert with_symbols(text) == shown
    assert with_symbols(text, "latin-1") == shown
    assert with_symbols(text, "ascii") == text
    assert with_symbols(text, "no such encoding") == text


@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_a_terminal_shows_what_it_can(encoding):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="strict")
    console = PeopleConsole(file=stream, width=60)
    table = Table(box=None)
    table.add_column("position / um")
    table.add_row("7.1 +- 1.2")
    console.print(table)
    console.print("12.0 um", Text("and 21.0 degC"))
    stream.flush()
    printed = stream.buffer.getvalue().decode(encoding)
    expected = "position / µm 7.1 ± 1.2 12.0 µm and 21.0 °C"
    assert " ".join(printed.split()) == (
        expected if encoding == "utf-8" else "position / um 7.1 +- 1.2 12.0 um and 21.0 degC"
    )


@pytest.mark.parametrize(
    ("value", "text"), [(100.0, "100"), (1234.0, "1230"), (98765.4, "98800"), (0.0123, "0.0123"), (0.0, "0")]
)
def test_a_plain_number_has_no_exponent(value, text):
    assert plain_number(value) == text


def test_a_quantity_is_rounded_by_its_uncertainty():
    assert format_quantity(Quantity("width_m", 1.2345e-4, 6.1e-5, "m")) == "120 +- 130 um"
    assert format_quantity(Quantity("width_m", 3.0412e-5, 5.2e-8, "m")) == "30.41 +- 0.11 um"
