"""Writes the table of columns in docs/reference/recording.md from the table that checks them.

python -m tests.docs.column_table
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from calibration.recording.columns import (
    COLUMNS,
    DRIVE_COLUMNS,
    OPTIONAL_COLUMNS,
    SENSOR_COLUMNS,
    UNITS,
    Column,
)
from tests.docs.pages import ROOT

PAGE = ROOT / "docs" / "reference" / "recording.md"
BEGIN, END = "<!-- columns: python -m tests.docs.column_table -->", "<!-- end of columns -->"
KINDS = {"text": "text", "count": "whole number", "number": "number"}


def write(page: str) -> str:
    """The page with the table as the code has it."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{table()}\n\n{units()}\n{END}{after}"


def table() -> str:
    """All columns in order, one row each."""
    lines = ["| column | value | unit | limits | meaning |", "|---|---|---|---|---|"]
    families: Sequence[tuple[str, Sequence[Column]]] = (
        ("", COLUMNS),
        ("D_", DRIVE_COLUMNS),
        ("S_", SENSOR_COLUMNS),
        ("", OPTIONAL_COLUMNS),
    )
    return "\n".join([*lines, *(_row(prefix, column) for prefix, columns in families for column in columns)])


def units() -> str:
    """The units in which the name of a further column may end."""
    ends = (f"`_{end}` ({unit.symbol})" for end, unit in UNITS.items())
    return f"Units of further columns: {', '.join(ends)}."


def _row(prefix: str, column: Column) -> str:
    value = KINDS[column.kind] + ("" if column.required else ", optional")
    return f"| `{prefix}{column.name}` | {value} | {column.unit} | {_limits(column)} | {column.meaning} |"


def _limits(column: Column) -> str:
    if math.isinf(column.largest):
        return ""
    largest = f"{column.largest:g}".replace("e+0", "e").replace("e+", "e")
    return f"±{largest}" if column.lowest == -column.largest else f"{column.lowest:g} to {largest}"


if __name__ == "__main__":
    PAGE.write_text(write(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
