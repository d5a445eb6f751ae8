"""Writes a mock recording as the three files of docs/reference/recording.md."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mock_devices.recordings.maker import MockRecording


def write_recording(recording: MockRecording, folder: str | Path) -> None:
    """Write recording.toml, machine.toml and readings.csv into a new folder; floats round-trip."""
    folder = Path(folder)
    folder.mkdir(parents=True)
    cells = [_cells(column.tolist()) for column in recording.columns.values()]
    lines = [",".join(recording.columns), *(",".join(row) for row in zip(*cells, strict=True))]
    (folder / "recording.toml").write_text(to_toml(recording.header), encoding="utf-8")
    (folder / "machine.toml").write_text(recording.machine_text, encoding="utf-8")
    (folder / "readings.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


def to_toml(table: dict[str, Any]) -> str:
    """Plain data as TOML: values first, then tables and arrays of tables."""
    return "\n".join(_lines(table, "")) + "\n"


def _lines(table: dict[str, Any], prefix: str) -> list[str]:
    lines = [f"{key} = {_value(value)}" for key, value in table.items() if not _is_table(value)]
    for key, value in table.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            lines += [f"\n[{name}]", *_lines(value, f"{name}.")]
        elif _is_table(value):
            for entry in value:
                lines += [f"\n[[{name}]]", *_lines(entry, f"{name}.")]
    return lines


def _is_table(value: Any) -> bool:
    return isinstance(value, dict) or (isinstance(value, list) and bool(value) and isinstance(value[0], dict))


def _value(value: Any) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_value(entry) for entry in value)}]"
    return json.dumps(value) if isinstance(value, str | bool) else repr(value)


def _cells(values: list[Any]) -> list[str]:
    return values if values and isinstance(values[0], str) else [repr(value) for value in values]
