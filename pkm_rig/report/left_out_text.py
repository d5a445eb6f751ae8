"""Wrong readings that were left out, one line each, for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from calibration.reduction.left_out import LeftOutReading

REASONS = {
    "nest outlier": "does not fit the other readings of the nests",
    "innovation gate": "does not fit the other reflectors of its visit",
    "model gate": "does not fit the model that fits all others",
    "giant": "is farther off the fit of all others than any effect",
    "diagnosis gate": "does not fit what all others say, whatever an effect has changed",
    "beside the causes": "does not fit what all others say together with the causes that were found",
}
LONGEST_NAME = 60
SHOWN = 5  # of them in a terminal; a report may have more


def left_out_in_words(left_out: Sequence[LeftOutReading]) -> list[dict[str, Any]]:
    """All of them for a page, the largest first, each with its reason as a sentence."""
    return [{**r.as_dict(), "why": REASONS[r.reason]} for r in sorted(left_out, key=lambda r: -r.sigmas)]


def left_out_lines(left_out: Sequence[Mapping[str, Any]], most: int) -> list[str]:
    """The largest first, and how many others there are; of the objects in JSON (docs/reference/json.md)."""
    ordered = sorted(left_out, key=lambda entry: -entry["sigmas"])
    lines = [
        f"left out: {_plain(entry['name'])} ({_where(entry)}), {size_in_words(entry)}: {REASONS[entry['reason']]}"
        for entry in ordered[:most]
    ]
    others = len(ordered) - len(lines)
    return [*lines, f"left out: {others} more wrong readings (--json has all)"] if others else lines


def _where(entry: Mapping[str, Any]) -> str:
    """Of what a reading is, and at which visit and when as far as that is known and not said by its name."""
    visit, t_s, of = entry.get("visit"), entry.get("t_rig_s"), _plain(entry["of"])
    of = of if visit is None or of == f"visit {visit}" else f"{of}, visit {visit}"
    return of if t_s is None else f"{of}, {t_s / 3600.0:.2f} h"


def size_in_words(entry: Mapping[str, Any]) -> str:
    """How far a reading is off."""
    unit = {"m": "um", "rad": "urad"}[entry["unit"]]
    return f"{entry['size'] * 1e6:.0f} {unit} off, {entry['sigmas']:.0f} of its standard deviations"


def _plain(name: str) -> str:
    """A name from a file without what a terminal would act on."""
    return "".join(c if c.isprintable() else "?" for c in name[:LONGEST_NAME])
