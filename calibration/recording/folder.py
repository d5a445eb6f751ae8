"""Recording folders: recording.toml, machine.toml and readings.csv, written to round-trip and read with care.

docs/reference/recording.md defines the format. A folder is untrusted input: data only, bounded in size, checked.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from pydantic import Field

from calibration.base.csv_table import MAX_CSV_BYTES, MAX_ROWS, check_length, read_header
from calibration.base.errors import InputError
from calibration.base.plain_file import bounded_lines, open_text, read_text
from calibration.base.toml_file import Section, parse_toml
from calibration.base.toml_text import to_toml
from calibration.machine.description import parse_machine
from calibration.recording.columns import Column
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording, make_recording
from calibration.recording.sessions import falls_of_time, sessions_from_sequence


def write_folder(recording: Recording, folder: Path) -> None:
    """Write recording.toml, machine.toml and readings.csv; floats round-trip. The folder must not exist."""
    if folder.exists():
        raise InputError(f"{folder}: exists already; choose another folder")
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise InputError(f"{folder}: {error.strerror}; choose another folder") from error
    names = list(recording.columns)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    for row in range(len(recording)):
        writer.writerow([_cell(recording.columns[name][row]) for name in names])
    for name, content in (
        ("recording.toml", to_toml(recording.file)),
        ("machine.toml", recording.machine.text),
        ("readings.csv", text.getvalue()),
    ):
        with (folder / name).open("w", encoding="utf-8") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())


def read_folder(folder: Path, *, by_sequence: bool = False) -> Recording:
    """Read and check a recording folder. Raises InputError, in one line, if it is invalid.

    Rig time must rise with the sequence; `by_sequence`, each fall begins a session, an unknown time after the last one.
    """
    file = parse_toml(read_text(folder / "recording.toml"), RecordingFile, str(folder / "recording.toml"))
    machine = parse_machine(read_text(folder / "machine.toml"), str(folder / "machine.toml"))
    path = folder / "readings.csv"
    with open_text(path, MAX_CSV_BYTES) as stream:
        rows = _parse_rows(stream, path, file)
    _check_record(folder, rows)
    recording = make_recording(file, machine, rows)
    if by_sequence:
        return sessions_from_sequence(recording)
    falls = falls_of_time(recording)
    if falls.size:
        raise InputError(
            f"{path}: row {falls[0] + 1}: t_rig_s falls, though sequence rises; if another session began there, "
            "give --sessions-from-sequence"
        )
    return recording


class RecordFile(Section):
    """record.toml of an export: the campaign's head in its store, and how many readings it had."""

    campaign: str
    head: str
    readings: int = Field(ge=0)


def write_record(folder: Path, record: RecordFile) -> None:
    """Write record.toml. A file of its own, so that versions without a chain can read the recording."""
    (folder / "record.toml").write_text(to_toml(record), encoding="utf-8")


def _check_record(folder: Path, rows: Sequence[object]) -> None:
    """Refuse an export that was cut short; without record.toml nothing says how long it was."""
    path = folder / "record.toml"
    if not path.exists():
        return
    record = parse_toml(read_text(path), RecordFile, str(path))
    if len(rows) != record.readings:
        raise InputError(
            f"{folder / 'readings.csv'}: {len(rows)} readings, where {path.name} says {record.readings}; copy it "
            "again, or remove that file if you took readings out"
        )


def _parse_rows(stream: io.TextIOWrapper, path: Path, file: RecordingFile) -> list[dict[str, float | str]]:
    reader = csv.reader(bounded_lines(stream, path))
    try:
        table = {column.name: column for column in file.column_table()}
        required = [name for name, column in table.items() if column.required]
        header = read_header(path, reader, required, "docs/reference/recording.md")
        rows: list[dict[str, float | str]] = []
        for number, cells in enumerate(reader, start=2):
            check_length(path, number, cells, header)
            if len(rows) >= MAX_ROWS:
                raise InputError(f"{path}: more than {MAX_ROWS} rows")
            rows.append(_row(table, header, cells, path, number))
    except csv.Error as error:
        raise InputError(f"{path}: not CSV: {error}") from error
    return rows


def _row(
    table: Mapping[str, Column], header: list[str], cells: list[str], path: Path, number: int
) -> dict[str, float | str]:
    """The cells of a line by column. Columns that the table does not have are checked to be numbers, and not kept."""
    row: dict[str, float | str] = {}
    for name, cell in zip(header, cells, strict=True):
        try:
            value = table[name].parse(cell) if name in table else float(cell)
        except ValueError:
            raise InputError(f"{path}: line {number}, column '{name}': '{cell[:40]}' is not a number") from None
        if name in table:
            row[name] = value
    return row


def _cell(value: object) -> str:
    if isinstance(value, np.str_ | str):
        return str(value)
    number = float(value)  # type: ignore[arg-type]
    if math.isnan(number):  # an optional number that this reading lacks
        return ""
    return str(int(number)) if number.is_integer() and abs(number) < 1e15 else repr(number)
