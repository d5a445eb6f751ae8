"""What a diagnosis made of the cases: one table, and what is misjudged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.scoring import goals
from benchmarks.scoring.lines import measure_lines
from benchmarks.scoring.measure import Measure, share, worst
from benchmarks.structures.structure import KNOWN_CASE, NULL_CASE, OUTSIDE_CASE
from benchmarks.withheld.score_rows import called
from benchmarks.withheld.scorer import LEAST_P, MOST_RANKED, NONE, UNKNOWN

Row = dict[str, Any]


def row_of(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> Row:
    """Truth and answer of a case; a diagnosis that failed has the empty verdict, which is never right."""
    diagnosis = answer.get("diagnosis")
    if diagnosis is None:
        return {**truth, "verdict": "", "p": 0.0, "ranked": [], "seconds": answer["seconds"], "error": answer["error"]}
    ranked = sorted(diagnosis["ranking"].items(), key=lambda pair: -pair[1])
    return {
        **truth,
        "verdict": diagnosis["verdict"],
        "p_true": min(max(sum(diagnosis["ranking"].get(name, 0.0) for name in right_answers(truth)), LEAST_P), 1.0),
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
    answered = [r for r in rows if r["verdict"]]
    return [
        share("structure of a known effect: named right", [is_right(r) for r in known], 0.90),
        *worst(lambda name: f"  worst effect of {goals.WORST_OF} cases or more ({name})", _often(known), 0.70),
        share("  one right name among the first three", [_among_first(r, 3) for r in known], 0.97),
        share("  another effect named", [called(r) and not is_right(r) for r in known]),
        share("  called unknown", [r["verdict"] == UNKNOWN for r in known]),
        share("structure of none called unknown", [is_right(r) for r in outside], 0.85),
        share("  called an effect", [called(r) for r in outside]),
        share("null cases called an effect", [called(r) for r in null], 0.01, at_most=True),
        *goals.stated_and_right([r["p"] for r in answered], [is_right(r) for r in answered]),
        goals.log_score([r["p_true"] for r in answered if "p_true" in r]),
        *(
            share(f"known, {key} {value}: named right", [is_right(r) for r in known if r[key] == value])
            for key in ("coordinate", "memory", "raw")
            for value in sorted({r[key] for r in known})
        ),
        share("diagnoses that failed", [bool(r["error"]) for r in rows]),
    ]  # fmt: skip


def _often(known: Sequence[Row]) -> dict[str, list[bool]]:
    """Hits of each effect that has cases enough; a structure may be a form of several."""
    by_name: dict[str, list[bool]] = {}
    for row in known:
        for name in row["names"]:
            by_name.setdefault(name, []).append(is_right(row))
    return {name: hits for name, hits in by_name.items() if len(hits) >= goals.WORST_OF}


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
