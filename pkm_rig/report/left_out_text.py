"""Wrong readings that were left out, one line each, for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

REASONS = {
    "nest outlier": "does not fit the other readings of the nests",
    "innovation gate": "does not fit the other reflectors of its visit",
    "model gate": "does not fit the model that fits all others",
}
LONGEST_NAME = 60


def left_out_lines(left_out: Sequence[Mapping[str, Any]], most: int) -> list[str]:
    """The largest first, and how many others there are; of the objects in JSON (docs/reference/json.md)."""
    ordered = sorted(left_out, key=lambda entry: -entry["sigmas"])
    lines = [
        f"left out: {_plain(entry['name'])} ({_plain(entry['of'])}), {size_in_words(entry)}: {REASONS[entry['reason']]}"
        for entry in ordered[:most]
    ]
    others = len(ordered) - len(lines)
    return [*lines, f"left out: {others} more wrong readings"] if others else lines


def size_in_words(entry: Mapping[str, Any]) -> str:
    """How far a reading is off."""
    unit = {"m": "um", "rad": "urad"}[entry["unit"]]
    return f"{entry['size'] * 1e6:.0f} {unit} off, {entry['sigmas']:.0f} of its standard deviations"


def _plain(name: str) -> str:
    """A name from a file without what a terminal would act on."""
    return "".join(c if c.isprintable() else "?" for c in name[:LONGEST_NAME])
