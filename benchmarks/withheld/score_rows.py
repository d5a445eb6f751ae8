"""Which answers are right: what every table and picture counts by."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.withheld.cases import RIGHT
from benchmarks.withheld.scorer import NONE, UNKNOWN, WHOLE

Row = dict[str, Any]


def right(row: Row) -> bool:
    """Verdict is the one true effect."""
    return [row["verdict"]] == row["true"]


def at_several_places(row: Row) -> bool:
    """Whether the one true effect is at more than one place."""
    return len(row["places"][0]) > 1


def in_class(row: Row) -> bool:
    """Verdict or its equivalents hold the one true effect."""
    return row["true"][0] in (row["verdict"], *row["equivalent"])


def with_whole_catalogue(row: Row) -> Row:
    """The row with the answer given with the whole catalogue. It is the same where no form of the true effect was left
    out; forms of other effects, which are left out as decoys, are none that the answer could need."""
    return {**row, **row.get(WHOLE, {})}


def answerable(row: Row) -> bool:
    """Cases with one right answer that can be seen: effects, null that declares its disturbances right, outside."""
    if row["kind"] == "null":
        return bool(row.get("declared", RIGHT) == RIGHT)
    return row["kind"] in ("effect", "outside") and row["eligible"]


def true_answer(row: Row) -> str:
    """The right verdict of an answerable case."""
    return {"null": NONE, "outside": UNKNOWN}.get(row["kind"]) or str(row["true"][0])


def overall_right(row: Row) -> bool:
    """Whether the verdict of an answerable case is right."""
    return bool(row["verdict"] == true_answer(row))


def called(row: Row) -> bool:
    """Whether the verdict names an effect."""
    return row["verdict"] not in (NONE, UNKNOWN, "")


def first_names(row: Row, count: int) -> list[str]:
    """The first names of the ranking."""
    return [name for name, _ in row["ranked"][:count]]


def shrink_off(row: Row) -> float:
    """Distance of the stated from the achieved shrink; infinite where either is missing."""
    stated, true = row.get("shrink"), row.get("achieved")
    return float("inf") if stated is None or true is None else abs(stated - true)


def shrink_covered(row: Row) -> bool:
    """Whether the achieved shrink lies within the stated interval."""
    if not np.isfinite(shrink_off(row)):
        return False
    low, high = row["shrink_interval"]
    return low is not None and high is not None and bool(low <= row["achieved"] <= high)
