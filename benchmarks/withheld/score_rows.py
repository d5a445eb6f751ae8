"""Which answers are right: what every table and picture counts by."""

from __future__ import annotations

from typing import Any

from benchmarks.withheld.scorer import NONE, UNKNOWN

Row = dict[str, Any]


def right(row: Row) -> bool:
    """Verdict is the one true effect."""
    return [row["verdict"]] == row["true"]


def in_class(row: Row) -> bool:
    """Verdict or its equivalents hold the one true effect."""
    return row["true"][0] in (row["verdict"], *row["equivalent"])


def answerable(row: Row) -> bool:
    """Cases with one right answer that can be seen: effects, null and outside."""
    return row["kind"] == "null" or (row["kind"] in ("effect", "outside") and row["eligible"])


def true_answer(row: Row) -> str:
    """The right verdict of an answerable case."""
    return {"null": NONE, "outside": UNKNOWN}.get(row["kind"]) or str(row["true"][0])


def overall_right(row: Row) -> bool:
    """Whether the verdict of an answerable case is right."""
    return bool(row["verdict"] == true_answer(row))
