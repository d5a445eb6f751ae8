"""Writing sections as TOML that reads back as it was."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TypeGuard

from calibration.base.toml_file import Section


def to_toml(section: Section) -> str:
    """TOML of nested sections: scalars first, then tables and arrays of tables."""
    lines: list[str] = []
    _emit(section.model_dump(exclude_none=True), "", lines)
    return "\n".join(lines) + "\n"


def _emit(table: Mapping[str, object], prefix: str, lines: list[str]) -> None:
    for key, value in table.items():
        if not isinstance(value, dict) and not _is_table_array(value):
            lines.append(f"{_key(key)} = {_value(value)}")
    for key, value in table.items():
        path = f"{prefix}{_key(key)}"
        if isinstance(value, dict):
            lines += ["", f"[{path}]"]
            _emit(value, path + ".", lines)
        elif _is_table_array(value):
            for item in value:
                lines += ["", f"[[{path}]]"]
                _emit(item, path + ".", lines)


def _is_table_array(value: object) -> TypeGuard[Sequence[Mapping[str, object]]]:
    return isinstance(value, tuple | list) and bool(value) and all(isinstance(v, dict) for v in value)


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else _quote(key)


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quote(value)
    if isinstance(value, tuple | list):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    return repr(value)


def _quote(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + re.sub(r"[\x00-\x1f\x7f]", lambda c: f"\\u{ord(c[0]):04x}", escaped) + '"'
