"""What a run of the study has reached: one table, and what was misjudged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.comparison.cases import NOTHING, STRUCTURE
from benchmarks.scoring.lines import measure_lines
from benchmarks.scoring.measure import Measure, share

Row = Mapping[str, Any]
UNKNOWN = "unknown"
NAMED, FALSE = 0.95, 0.01
QUANTITY = {"drive_offset": "offset", "drive_scale": "scale", "strut_length": "length"}
COVERAGE_FACTOR = 2.0


def is_named(row: Row) -> bool:
    """Whether structure and place are those that have changed."""
    return (row["verdict"], row["place_named"]) == (row["structure"], row["place"])


def is_right(row: Row) -> bool:
    """Whether that which has changed is named, or said not to be told from what is named; or nothing, rightly."""
    if row["structure"] == NOTHING:
        return bool(row["verdict"] == NOTHING)
    return is_named(row) or [row["structure"], row["place"]] in row["equivalent"]


def measures(rows: Sequence[Row]) -> list[Measure]:
    """All rows of the table."""
    changed = [r for r in rows if r["structure"] != NOTHING]
    same = [r for r in rows if r["structure"] == NOTHING]
    weak = [r for r in changed if r["visible"] < 2.0]
    return [
        share("changed: named, or equivalent to what is named", [is_right(r) for r in changed], NAMED),
        share("  structure and place named", [is_named(r) for r in changed]),
        share("  called nothing", [r["verdict"] == NOTHING for r in changed]),
        share("  called unknown", [r["verdict"] == UNKNOWN for r in changed]),
        share("  a further change that is not there", [len(r["changes"]) > 1 for r in changed]),
        _class_size(changed),
        share("nothing called a change", [r["verdict"] != NOTHING for r in same], FALSE, at_most=True),
        share("  called unknown", [r["verdict"] == UNKNOWN for r in same]),
        *_by("nothing called a change", same, "station", lambda r: r["verdict"] != NOTHING),
        *_by("nothing called a change", same, "family", lambda r: r["verdict"] != NOTHING),
        share("nothing called a change, tables on", [r["verdict"] != NOTHING for r in same if r["tables"]]),
        share("changed, visible below 2 sigma: right", [is_right(r) for r in weak]),
        *_by("changed: right", changed, "family", is_right),
        *_by("changed: right", changed, "kind", is_right),
        share("right when p > 0.9", [is_right(r) for r in rows if max(r["ranking"].values(), default=0.0) > 0.9]),
        share("U (k = 2) covers offset, scale or length", [c for r in changed if (c := _covered(r)) is not None]),
        _seconds(rows),
        share("comparisons that failed", [bool(r["error"]) for r in rows], 0.0, at_most=True),
    ]


def _by(name: str, rows: Sequence[Row], key: str, hit: Any) -> list[Measure]:
    values = sorted({r[key] for r in rows}, key=lambda v: list(STRUCTURE).index(v) if v in STRUCTURE else 0)
    return [share(f"{name}, {value}", [bool(hit(r)) for r in rows if r[key] == value]) for value in values]


def _covered(row: Row) -> bool | None:
    """Whether the expanded uncertainty of a change of one number covers the true one; None where it was not stated."""
    name = QUANTITY.get(row["kind"])
    if name is None or not is_named(row) or name not in row["changes"][0]["quantities"]:
        return None
    value, u = row["changes"][0]["quantities"][name]
    return bool(abs(value - row["value"]) <= COVERAGE_FACTOR * u)


def _class_size(rows: Sequence[Row]) -> Measure:
    sizes = [1.0 + len(r["equivalent"]) for r in rows if r["verdict"] not in (NOTHING, UNKNOWN, "")]
    mean = float(np.mean(sizes)) if sizes else None
    low, high = (float(x) for x in np.quantile(sizes, [0.05, 0.95])) if sizes else (0.0, 0.0)
    return Measure("  mean class size (5 to 95 %)", "", mean, low, high, len(sizes), None)


def _seconds(rows: Sequence[Row]) -> Measure:
    seconds = [r["seconds"] for r in rows if not r["error"]]
    middle = float(np.median(seconds)) if seconds else None
    low, high = (float(x) for x in np.quantile(seconds, [0.05, 0.95])) if seconds else (0.0, 0.0)
    return Measure("one comparison, median in s (5 to 95 %)", "", middle, low, high, len(seconds), None)


def printed(rows: Sequence[Row]) -> str:
    """The table for people; below it what is misjudged, by pair."""
    lines = measure_lines([measure.data() for measure in measures(rows)])
    return "\n".join([*lines, "", "misjudged:", *([_line(r) for r in rows if not is_right(r)] or ["none"])])


def _line(row: Row) -> str:
    what = f"{row['kind']} {row['place']}".strip()
    seen = f", visible {row['visible']:.1f}" if row["visible"] else ""
    said = row["error"] or f"{row['verdict']} {row['place_named']}".strip()
    p = sorted(row["ranking"].items(), key=lambda pair: -pair[1])[:3]
    ranked = ", ".join(f"{name} {value:.3f}" for name, value in p)
    return f"{row['number']}: {row['family']}, {what}{seen}, station {row['station']}: {said} ({ranked})"
