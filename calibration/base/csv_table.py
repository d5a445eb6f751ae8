"""Tables of numbers as CSV: bounded, every cell checked, written to round-trip."""

from __future__ import annotations

import csv
import difflib
import io
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.plain_file import bounded_lines, open_text

MAX_ROWS = 200_000
MAX_CSV_BYTES = 100_000_000
OTHER_SEPARATORS = {";": "semicolons", "\t": "tabulators"}
SHOWN = 40  # characters of a name in a message


def read_table(
    path: Path,
    needed: Collection[str],
    optional: Collection[str] = (),
    may_be_empty: Collection[str] = (),
    page: str = "docs/reference/measurements.md",
) -> dict[str, Array]:
    """Columns (n,) of a CSV file by name; an empty cell of a column that may be empty is NaN, all else is finite.

    page: where the format is described, for messages.

    Raises InputError in one line for a missing, unknown or doubled column, a cell that is no finite number, a row of
    the wrong length, no row at all, and too large a file.
    """
    with open_text(path, MAX_CSV_BYTES) as stream:
        return parse_table(stream, path, needed, optional, may_be_empty, page)


def parse_table(
    stream: io.TextIOBase,
    path: Path,
    needed: Collection[str],
    optional: Collection[str] = (),
    may_be_empty: Collection[str] = (),
    page: str = "docs/reference/measurements.md",
) -> dict[str, Array]:
    """The same of an open file, or of a text; `path` is what messages name."""
    try:
        reader = csv.reader(bounded_lines(stream, path))
        header = read_header(path, reader, needed, page)
        if unknown := [name for name in header if name not in needed and name not in optional]:
            raise InputError(f"{path}: unknown column '{unknown[0][:SHOWN]}'; remove it or correct its spelling")
        rows = list(_rows(path, reader, header, may_be_empty))
    except csv.Error as error:
        raise InputError(f"{path}: not CSV: {error}") from error
    if not rows:
        raise InputError(f"{path}: no rows; it needs at least one")
    table = np.array(rows, dtype=np.float64)
    return {name: table[:, i] for i, name in enumerate(header)}


def read_header(path: Path, reader: Iterator[list[str]], needed: Collection[str], page: str) -> list[str]:
    """Names of the columns, from the first line; raises InputError in one line."""
    header = next(reader, [])
    if not header:
        raise InputError(f"{path}: nothing in it; it needs a header and rows, see {page}")
    if len(header) == 1 and (other := next((mark for mark in OTHER_SEPARATORS if mark in header[0]), None)):
        raise InputError(f"{path}: cells are separated by {OTHER_SEPARATORS[other]}; separate them by commas")
    if len(set(header)) != len(header):
        raise InputError(f"{path}: a column occurs twice in the header; remove one")
    if missing := [name for name in needed if name not in header]:
        near = difflib.get_close_matches(missing[0], [name for name in header if name not in needed], n=1)
        instead = f", but '{near[0][:SHOWN]}'" if near else ""
        raise InputError(f"{path}: no column '{missing[0]}'{instead}; see {page}")
    return header


def check_length(path: Path, number: int, cells: Sequence[str], header: Sequence[str]) -> None:
    """Raise InputError for a line that has not as many cells as the header."""
    if len(cells) != len(header):
        raise InputError(
            f"{path}: line {number} has {len(cells)} cells, the header {len(header)}; copy the file again, or repair "
            "the line"
        )


def write_table(columns: Mapping[str, Array]) -> str:
    """The text of a CSV file; NaN becomes an empty cell."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow([_cell(float(value)) for value in row])
    return text.getvalue()


def require_counts(path: Path, name: str, column: Array) -> Array:
    """The same column if it holds counts (0, 1, 2 ... 1e9) only."""
    wrong = np.flatnonzero((column != np.floor(column)) | (column < 0) | (column > 1e9))
    if wrong.size:
        raise InputError(f"{path}: line {wrong[0] + 2}, column '{name}': {column[wrong[0]]:g} is not a count")
    return column


def _rows(path: Path, reader: Iterator[list[str]], header: list[str], empty: Collection[str]) -> Iterator[list[float]]:
    for number, cells in enumerate(reader, start=2):
        check_length(path, number, cells, header)
        if number > MAX_ROWS + 1:
            raise InputError(f"{path}: more than {MAX_ROWS} rows; split it")
        yield [
            math.nan if not cell.strip() and name in empty else _number(cell, f"{path}: line {number}, column '{name}'")
            for name, cell in zip(header, cells, strict=True)
        ]


def _number(cell: str, where: str) -> float:
    try:
        number = float(cell)
    except ValueError:
        raise InputError(f"{where}: {cell[:40]!r} is not a number") from None
    if not math.isfinite(number):
        raise InputError(f"{where}: {cell[:40]!r} is not finite; repair or remove the row")
    return number


def _cell(number: float) -> str:
    if math.isnan(number):
        return ""
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)
