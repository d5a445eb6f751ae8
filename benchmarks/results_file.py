"""Results of a long study: a JSON-lines file that survives being stopped and refuses to mix settings."""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]


class MixedSettingsError(RuntimeError):
    """The file holds results of other settings."""


def digest(settings: dict[str, Any]) -> str:
    """Hash of settings that is the same on every machine."""
    return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:16]


def code_digest(*names: str) -> str:
    """Hash of the programs that a result depends on: files, and folders with all that is in them."""
    found = hashlib.sha256()
    for name in names:
        place = ROOT / name
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            found.update(file.read_bytes())
    return found.hexdigest()[:12]


def read_only(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Settings and results of a file that another process may be writing; a last line that is not whole is passed over.

    Raises OSError if it cannot be read, ValueError if it is no such file.
    """
    data = path.read_bytes()
    lines = [json.loads(line) for line in data[: data.rfind(b"\n") + 1].splitlines()]
    if not lines or not isinstance(lines[0].get("settings"), dict):
        raise ValueError("its first line has no settings")
    return lines[0]["settings"], lines[1:]


@dataclass(frozen=True)
class ResultsFile:
    """A header line with the settings, then one line a result, each on disk before the next is computed."""

    path: Path
    settings: dict[str, Any]

    def rows(self) -> list[dict[str, Any]]:
        """Results so far; a new file gets its header. A last line that was cut off is dropped.

        Raises MixedSettingsError if the file is of other settings.
        """
        if not self.path.exists() or self.path.stat().st_size == 0:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._append({"settings": self.settings, "hash": digest(self.settings)})
            return []
        data = self.path.read_bytes()
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):
            with self.path.open("r+b") as file:
                file.truncate(len(whole))
        if not whole:
            return self.rows()
        header, *rows = (json.loads(line) for line in whole.splitlines())
        if header.get("hash") != digest(self.settings):
            raise MixedSettingsError(
                f"{self.path} holds results of other settings ({header.get('hash')}, now {digest(self.settings)}); "
                "move it away or choose another folder"
            )
        return rows

    def append(self, row: dict[str, Any]) -> None:
        """Add a result; ValueError if a number in it is not finite."""
        self._append(row)

    def _append(self, entry: dict[str, Any]) -> None:
        line = json.dumps(entry, allow_nan=False) + "\n"
        with self.path.open("a", encoding="utf-8") as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
