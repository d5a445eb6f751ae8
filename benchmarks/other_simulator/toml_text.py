"""Writes plain data as TOML."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


def toml_text(table: Mapping[str, Any], prefix: str = "") -> str:
    """Plain values first, then sections, each in the order that they have; prefix: of the sections' names."""
    lines: list[str] = []
    sections: list[str] = []
    for key, value in table.items():
        if isinstance(value, dict):
            sections += ["", f"[{prefix}{key}]", toml_text(value, f"{prefix}{key}.")]
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for entry in value:
                sections += ["", f"[[{prefix}{key}]]", toml_text(entry, f"{prefix}{key}.")]
        else:
            lines.append(f"{key} = {_value(value)}")
    return "\n".join(lines + sections)


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    return repr(float(value))
