"""What a run has reached, with the goals of this check and the definitions of the check on withheld cases."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.independent.scorer import ONE_PLACE, SEVERAL_PLACES
from benchmarks.withheld.report import by_effect, effect_lines, measure_lines
from benchmarks.withheld.score_rows import (
    Row,
    called,
    first_names,
    in_class,
    overall_right,
    right,
    shrink_covered,
    shrink_off,
)
from benchmarks.withheld.scorer import NONE, UNKNOWN
from benchmarks.withheld.statistics import Z95
from benchmarks.withheld.table import PERIOD, STEP_S, Measure, class_size, pairs, probabilities, share, share_between

Array = NDArray[np.float64]

MOST_CLASS = 1.4
BOOTSTRAPS, BOOTSTRAP_SEED = 1000, 5
WORST_OF = 25  # an effect of fewer cases is not judged by itself


def measures(rows: Sequence[Row]) -> list[Measure]:
    """All rows of the table."""
    singles = [r for r in rows if r["kind"] == "effect" and r["eligible"]]
    return [
        *_singles(singles),
        *_others(rows),
        *pairs([r for r in rows if r["kind"] == "pair" and r["eligible"]], 0.75, 0.95),
        *_probability_rows(rows),
        *_shrink([r for r in rows if r["kind"] == "effect" and r["visible"] >= 1.0]),
        *_details(singles),
        *_groups(singles),
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


def _singles(rows: list[Row]) -> list[Measure]:
    out = [
        share("visible single effects named right", [right(r) for r in rows], 0.90),
        share("  class holds the truth", [in_class(r) for r in rows]),
        class_size("  mean class size", rows, MOST_CLASS),
        share("  truth among the first three", [r["true"][0] in first_names(r, 3) for r in rows], 0.97),
        share("  another effect named", [called(r) and not right(r) for r in rows]),
        share(
            "  named right, with another effect beside it",
            [right(r) and set(r["named"]) != set(r["true"]) for r in rows],
        ),
        share("  called unknown", [r["verdict"] == UNKNOWN for r in rows]),
        share("  called none", [r["verdict"] == NONE for r in rows]),
    ]
    often = [name for name, count in Counter(r["true"][0] for r in rows).items() if count >= WORST_OF]
    by_name = {name: [right(r) for r in rows if r["true"][0] == name] for name in sorted(often)}
    if by_name:
        worst = min(by_name, key=lambda name: sum(by_name[name]) / len(by_name[name]))
        out.insert(1, share(f"  worst effect of {WORST_OF} cases ({worst})", by_name[worst], 0.70))
    return out


def _others(rows: Sequence[Row]) -> list[Measure]:
    null = [r for r in rows if r["kind"] == "null"]
    outside = [r for r in rows if r["kind"] == "outside"]
    small = [r for r in rows if r["kind"] == "effect" and not r["eligible"]]
    return [
        share("null cases called an effect", [called(r) for r in null], 0.01, at_most=True),
        share("null cases called unknown", [r["verdict"] == UNKNOWN for r in null]),
        share(
            "effect of no catalogue called unknown", [r["verdict"] == UNKNOWN for r in outside if r["eligible"]], 0.85
        ),
        share("  of any size", [r["verdict"] == UNKNOWN for r in outside]),
        share("  of any size, called an effect", [called(r) for r in outside]),
        share("smaller single effects called another one", [called(r) and not right(r) for r in small]),
    ]


def _probability_rows(rows: Sequence[Row]) -> list[Measure]:
    logs = [-float(np.log(r["p_true"])) for r in rows if "p_true" in r]
    mean = float(np.mean(logs)) if logs else None
    spread = Z95 * float(np.std(logs)) / np.sqrt(len(logs)) if logs else 0.0
    low, high = (mean or 0.0) - spread, (mean or 0.0) + spread
    unknown = [overall_right(r) for r in rows if "p_true" in r and r["verdict"] == UNKNOWN and r["p"] > 0.99]
    changed = [not r["held_against_gross"] for r in rows if "held_against_gross" in r]
    return [
        *probabilities(rows),
        share("  right when called unknown with p > 0.99", unknown),
        share("verdicts of p > 0.9 that six gross readings change", changed, 0.02, at_most=True),
        Measure("log score (mean -ln p of the truth)", "", mean, low, high, len(logs), None),
    ]


def _shrink(rows: list[Row]) -> list[Measure]:
    named = [r for r in rows if called(r)]
    hit = [r for r in rows if right(r)]
    return [
        share("predicted minus achieved shrink within 0.05, where named", [shrink_off(r) <= 0.05 for r in named], 0.90),
        share("  where named right", [shrink_off(r) <= 0.05 for r in hit]),
        share("  within 0.10, where named", [shrink_off(r) <= 0.10 for r in named]),
        share_between("95 % shrink interval covers, where named", [shrink_covered(r) for r in named], 0.90, 0.98),
        share("predicted minus achieved shrink within 0.05, any verdict", [shrink_off(r) <= 0.05 for r in rows]),
        *_left_on_the_table(rows),
    ]


def _left_on_the_table(rows: list[Row]) -> list[Measure]:
    """Shrink reached with what was found, and with the true effect in the model; nothing found reaches nothing."""
    pairs = [
        (r["achieved"] if called(r) else 0.0, r["reached_with_truth"])
        for r in rows
        if r.get("reached_with_truth") is not None
    ]
    found, true = np.array(pairs).reshape(-1, 2).T
    nothing = np.zeros_like(true)
    return [
        _median("median shrink reached with what was found", found, nothing),
        _median("  with the true effect added", true, nothing),
        _median("  difference of the two", true, found, 0.05),
    ]


def _median(name: str, x: Array, less: Array, most: float | None = None) -> Measure:
    """Median of x (n,) less that of others (n,) of the same cases, with a bootstrap interval."""
    goal = "" if most is None else f"at most {most:g}"
    if not x.size:
        return Measure(name, goal, None, 0.0, 0.0, 0, None)
    drawn = np.random.default_rng(BOOTSTRAP_SEED).integers(0, x.size, (BOOTSTRAPS, x.size))
    spread = np.median(x[drawn], axis=1) - np.median(less[drawn], axis=1)
    low, high = (float(end) for end in np.quantile(spread, [0.025, 0.975]))
    value = float(np.median(x) - np.median(less))
    return Measure(name, goal, value, low, high, x.size, None if most is None else value <= most)


def _details(rows: list[Row]) -> list[Measure]:
    def within(key: str, limit: float) -> list[bool]:
        return [r[key] is not None and abs(r[key]) <= limit for r in rows if key in r]

    def places(key: str, variant: str) -> list[bool]:
        return [r[key] for r in rows if key in r and r["variant"][0] == variant]

    sized = [abs(r["raw_named"] - r["raw_true"]) <= 2.0 * r["raw_u"] for r in rows if "raw_u" in r and right(r)]
    return [
        share("place right, where there is one", places("places_right", ONE_PLACE)),
        share("named place is one of several", places("place_right", SEVERAL_PLACES)),
        share("all of several places named", places("places_right", SEVERAL_PLACES)),
        share("step time within 5 min", within("step_error_s", STEP_S)),
        share("period within 1 %", within("period_error", PERIOD)),
        share_between("raw size within its U (k = 2), where named right", sized, 0.90, 0.98),
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
    seconds = [r["seconds"] for r in rows]
    middle = float(np.median(seconds)) if seconds else None
    low, high = (float(x) for x in np.quantile(seconds, [0.05, 0.95])) if seconds else (0.0, 0.0)
    return [
        Measure("one diagnosis, median on its core in s (5 to 95 %)", "", middle, low, high, len(seconds), None),
        share("diagnoses that failed", [bool(r["error"]) for r in rows], 0.0, at_most=True),
    ]
