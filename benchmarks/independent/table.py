"""What a run has reached: the goals of every check, and what this one shows besides."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from benchmarks.fit_verdict.folds import WITHOUT_RECORDINGS, settings_without
from benchmarks.independent.scorer import ONE_PLACE, SEVERAL_PLACES
from benchmarks.scoring import goals
from benchmarks.scoring.lines import effect_lines, measure_lines
from benchmarks.scoring.measure import Measure, share
from benchmarks.withheld.report import by_effect
from benchmarks.withheld.score_rows import Row, called, overall_right, right
from benchmarks.withheld.table import PERIOD, STEP_S


def measures(rows: Sequence[Row]) -> list[Measure]:
    """All rows of the table."""
    visible = [r for r in rows if r["kind"] == "effect" and r["eligible"]]
    small = [r for r in rows if r["kind"] == "effect" and not r["eligible"]]
    return [
        *goals.measures(rows),
        *goals.crosswise(rows, settings_without(WITHOUT_RECORDINGS)),
        share("smaller single effects called another one", [called(r) and not right(r) for r in small]),
        *_details(visible),
        *_groups(visible),
        *_costs(rows),
    ]


def figures(rows: Sequence[Row]) -> dict[str, Any]:
    """All figures as plain data."""
    return {"measures": [m.data() for m in measures(rows)], "effects": by_effect(rows)}


def without_cases(figures_data: dict[str, Any]) -> dict[str, Any]:
    """The figures without what so few cases of an effect would tell of each: what was named instead, and where."""
    blank = {"taken_for": "", "variants_missed": []}
    return {**figures_data, "effects": [{**effect, **blank} for effect in figures_data["effects"]]}


def printed(figures_data: dict[str, Any]) -> str:
    """The table for people; measures without a case are left out."""
    found = [m for m in figures_data["measures"] if m["n"]]
    return "\n".join([*measure_lines(found), "", *effect_lines(figures_data["effects"])])


def misjudged(rows: Sequence[Row]) -> list[str]:
    """A line for each recording whose verdict is not the truth: what is to be looked into."""
    out = []
    for row in sorted(rows, key=lambda r: r["key"]):
        if is_right(row):
            continue
        true = " + ".join(
            f"{name} at {','.join(places) or 'the rig'}"
            for name, places in zip(row["true"], row["places"], strict=True)
        )
        named = " + ".join(
            f"{name} at {','.join(places) or 'the rig'}"
            for name, places in zip(row["named"], row.get("named_places", []), strict=True)
        )
        ranked = ", ".join(f"{name} {p:.3f}" for name, p in row["ranked"][:3])
        seen = "" if row["eligible"] or row["kind"] == "null" else ", below the sizes that count"
        out.append(
            f"{row['key']} {row['campaign']}, {row['profile']}: {true or 'nothing'} "
            f"(raw {row['raw']:.1f}, visible {row['visible']:.1f}{seen}): "
            f"{row['error'] or named or row['verdict']} ({ranked})"
        )
    return out


def is_right(row: Row) -> bool:
    """Whether everything that is there is named, and nothing else."""
    if row["kind"] == "pair":
        return set(row["named"]) == set(row["true"])
    return overall_right(row)


def _details(rows: list[Row]) -> list[Measure]:
    def within(key: str, limit: float) -> list[bool]:
        return [r[key] is not None and abs(r[key]) <= limit for r in rows if key in r]

    def places(key: str, variant: str) -> list[bool]:
        return [r[key] for r in rows if key in r and r["variant"][0] == variant]

    return [
        share("place right, where there is one", places("places_right", ONE_PLACE)),
        share("named place is one of several", places("place_right", SEVERAL_PLACES)),
        share("all of several places named", places("places_right", SEVERAL_PLACES)),
        share("step time within 5 min", within("step_error_s", STEP_S)),
        share("period within 1 %", within("period_error", PERIOD)),
    ]


def _groups(rows: list[Row]) -> list[Measure]:
    groups: tuple[Callable[[Row], str], ...] = (
        lambda r: str(r["variant"][0]),
        lambda r: f"campaign {r['campaign']}",
        lambda r: f"disturbances {r['profile']}",
    )
    return [
        share(f"named right: {name}", [right(r) for r in rows if group(r) == name])
        for group in groups
        for name in sorted({group(r) for r in rows})
    ]


def _costs(rows: Sequence[Row]) -> list[Measure]:
    return [
        *goals.times([r["seconds"] for r in rows]),
        share("diagnoses that failed", [bool(r["error"]) for r in rows], 0.0, at_most=True),
    ]
