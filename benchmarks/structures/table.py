"""What a diagnosis made of the cases: one table, and what is misjudged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.structures.structure import KNOWN_CASE, NULL_CASE, OUTSIDE_CASE
from benchmarks.withheld.report import measure_lines
from benchmarks.withheld.score_rows import called
from benchmarks.withheld.scorer import MOST_RANKED, NONE, UNKNOWN
from benchmarks.withheld.table import Measure, share

Row = dict[str, Any]
SURE = 0.99


def row_of(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> Row:
    """Truth and answer of a case; a diagnosis that failed has the empty verdict, which is never right."""
    diagnosis = answer.get("diagnosis")
    if diagnosis is None:
        return {**truth, "verdict": "", "p": 0.0, "ranked": [], "seconds": answer["seconds"], "error": answer["error"]}
    ranked = sorted(diagnosis["ranking"].items(), key=lambda pair: -pair[1])
    return {
        **truth,
        "verdict": diagnosis["verdict"],
        "p": min(max(diagnosis["ranking"].get(diagnosis["verdict"], 0.0), 0.0), 1.0),
        "ranked": [[name, p] for name, p in ranked[:MOST_RANKED]],
        "named": [[effect["effect"], effect["place"]] for effect in diagnosis["effects"]],
        "clues": [[clue["channel"], clue["coordinate"]] for clue in diagnosis["clues"]],
        "seconds": answer["seconds"],
        "error": "",
    }


def right_answers(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Verdicts that are right."""
    return {NULL_CASE: (NONE,), OUTSIDE_CASE: (UNKNOWN,)}.get(row["kind"]) or tuple(row["names"])


def is_right(row: Mapping[str, Any]) -> bool:
    """Whether the verdict is one of them."""
    return row["verdict"] in right_answers(row)


def measures(rows: Sequence[Row]) -> list[Measure]:
    """All rows of the table."""
    known = [r for r in rows if r["kind"] == KNOWN_CASE]
    outside = [r for r in rows if r["kind"] == OUTSIDE_CASE]
    null = [r for r in rows if r["kind"] == NULL_CASE]
    return [
        share("structure of a known effect: named right", [is_right(r) for r in known]),
        share("  one right name among the first three", [_among_first(r, 3) for r in known]),
        share("  another effect named", [called(r) and not is_right(r) for r in known]),
        share("  called unknown", [r["verdict"] == UNKNOWN for r in known]),
        share("structure of none called unknown", [is_right(r) for r in outside]),
        share("  called an effect", [called(r) for r in outside]),
        share("null cases called an effect", [called(r) for r in null]),
        share("right when p > 0.99", [is_right(r) for r in rows if r["p"] > SURE]),
        *(
            share(f"known, {key} {value}: named right", [is_right(r) for r in known if r[key] == value])
            for key in ("coordinate", "memory", "raw")
            for value in sorted({r[key] for r in known})
        ),
        share("diagnoses that failed", [bool(r["error"]) for r in rows]),
    ]  # fmt: skip


def printed(rows: Sequence[Row]) -> str:
    """The table for people; below it what is misjudged, by case."""
    lines = measure_lines([measure.data() for measure in measures(rows)])
    return "\n".join([*lines, "", "misjudged:", *([_line(r) for r in rows if not is_right(r)] or ["none"])])


def in_words(row: Mapping[str, Any]) -> str:
    """What a case is."""
    if row["kind"] == NULL_CASE:
        return f"nothing, {row['profile']} disturbances"
    memory = "" if row["memory"] == "none" else f", {row['memory']}"
    names = " or ".join(row["names"]) or "outside"
    where = f"{row['channel']} {row['place']}".strip()
    return (
        f"{where} by {row['coordinate']}{memory} ({names}; raw {row['raw']:g}, visible {row['visible']:.1f}, "
        f"{row['profile']} disturbances)"
    )


def _among_first(row: Row, count: int) -> bool:
    return bool({name for name, _ in row["ranked"][:count]} & {*row["names"]})


def _line(row: Row) -> str:
    ranked = ", ".join(f"{name} {p:.3f}" for name, p in row["ranked"][:3])
    said = row["error"] or f"{row['verdict']} ({ranked})"
    return f"{row['key']}: {in_words(row)}: {said}"
