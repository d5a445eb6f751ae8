"""What a run has reached: every row of the goals with its interval, simple baselines beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from benchmarks.withheld.cases import DECLARED, MISDECLARED, RIGHT
from benchmarks.withheld.score_rows import (
    Row,
    answerable,
    called,
    first_names,
    in_class,
    overall_right,
    right,
    shrink_covered,
    shrink_off,
    with_whole_catalogue,
)
from benchmarks.withheld.scorer import UNKNOWN
from benchmarks.withheld.statistics import Z95, excess_calibration_error, paired_difference, wilson
from mock_devices.effects import SPECS

ALIKE_SIGMA, MIMIC_SIGMA = 0.3, 0.5
STEP_S, PERIOD = 300.0, 0.01
MOST_CLASS = 2.0


@dataclass(frozen=True)
class Measure:
    """One row: value with its 95 % interval over n cases; ok is None where there is no goal or no case."""

    name: str
    goal: str
    value: float | None
    low: float
    high: float
    n: int
    ok: bool | None

    def data(self) -> dict[str, Any]:
        """For results.json."""
        return asdict(self)


def share(name: str, hits: Sequence[bool], goal: float | None = None, *, at_most: bool = False) -> Measure:
    """A proportion with Wilson's interval."""
    k, n = int(sum(hits)), len(hits)
    value = k / n if n else None
    low, high = wilson(k, n)
    text = "" if goal is None else f"{'at most' if at_most else 'at least'} {100 * goal:g} %"
    ok = None if goal is None or value is None else (value <= goal if at_most else value >= goal)
    return Measure(name, text, value, low, high, n, ok)


def share_between(name: str, hits: Sequence[bool], least: float, most: float) -> Measure:
    """A proportion that shall be neither too small nor too large, as that of intervals that cover."""
    of = share(name, hits)
    ok = None if of.value is None else least <= of.value <= most
    return replace(of, goal=f"{100 * least:g} to {100 * most:g} %", ok=ok)


def measures(rows: Sequence[Row]) -> list[Measure]:
    """All rows of the table, in the order of the goals."""
    rows_of_effects = [r for r in rows if r["kind"] == "effect" and r["eligible"]]
    return [
        *_detection_rows(rows_of_effects),
        *_platform([r for r in rows if r["kind"] == "platform_only" and r["eligible"]]),
        *_none_and_unknown(rows),
        *pairs([r for r in rows if r["kind"] == "pair" and r["eligible"]], 0.90, 0.99),
        *_shrink([r for r in rows if r["kind"] == "effect"]),
        *probabilities(rows),
        *_detail_measures(rows_of_effects),
        *_next([r for r in rows if r["kind"] == "next" and "after_chosen" in r]),
        *_misdeclared([r for r in rows if r["kind"] == "misdeclared" and r["eligible"]]),
        *_with_gross_readings(rows),
        *_costs(rows),
        *_final_measures(rows_of_effects),
    ]


def whole_measures(rows: Sequence[Row]) -> list[Measure]:
    """What is reached with the whole catalogue, on cases that are diagnosed with and without some of its forms."""
    whole = [with_whole_catalogue(r) for r in rows]
    return [
        *_detection_rows([r for r in whole if r["kind"] == "effect" and r["eligible"]]),
        *pairs([r for r in whole if r["kind"] == "pair" and r["eligible"]], 0.90, 0.99),
    ]


def _detection_rows(rows_of_effects: list[Row]) -> list[Measure]:
    by_name: dict[str, list[bool]] = {}
    for row in rows_of_effects:
        by_name.setdefault(row["true"][0], []).append(right(row))
    out = [share("top-1, raw >= 3 and visible >= 0.5 sigma", [right(r) for r in rows_of_effects], 0.95)]
    if by_name:
        worst = min(by_name, key=lambda name: (sum(by_name[name]) / len(by_name[name]), name))
        out.append(share(f"worst effect ({worst})", by_name[worst], 0.80))
    distinguishable = [r for r in rows_of_effects if all(sigma > ALIKE_SIGMA for sigma in r["mimics_sigma"].values())]
    out.append(share("top-1 where no other effect is within 0.3 sigma", [right(r) for r in distinguishable]))
    out.append(share("class holds the truth", [in_class(r) for r in rows_of_effects]))
    out.append(share("truth among the first three", [r["true"][0] in first_names(r, 3) for r in rows_of_effects], 0.99))
    return out


def _platform(rows: list[Row]) -> list[Measure]:
    return [
        share("platform only: class right and its members equivalent", [_fair_class(r) for r in rows], 0.90),
        class_size("platform only: mean class size", rows, MOST_CLASS),
        share("platform only: class holds the truth", [in_class(r) for r in rows]),
        share("platform only: top-1", [right(r) for r in rows]),
    ]  # fmt: skip


def class_size(name: str, rows: Sequence[Row], most: float) -> Measure:
    """Mean number of names that an answer leaves open, where it names an effect."""
    sizes = [1.0 + len(r["equivalent"]) for r in rows if called(r)]
    mean = float(np.mean(sizes)) if sizes else None
    spread = Z95 * float(np.std(sizes)) / np.sqrt(len(sizes)) if sizes else 0.0
    low, high = (mean or 0.0) - spread, (mean or 0.0) + spread
    return Measure(name, f"at most {most:g}", mean, low, high, len(sizes), None if mean is None else mean <= most)


def _fair_class(row: Row) -> bool:
    others = {row["verdict"], *row["equivalent"]} - {row["true"][0]}
    return in_class(row) and all(row["mimics_sigma"].get(name, np.inf) <= ALIKE_SIGMA for name in others)


def _none_and_unknown(rows: Sequence[Row]) -> list[Measure]:
    null = [r for r in rows if r["kind"] == "null"]
    out = []
    for declared in DECLARED:
        of_state = [called(r) for r in null if r.get("declared", RIGHT) == declared]
        out.append(share(f"null cases called an effect, declared {declared}", of_state, 0.01, at_most=True))
    for profile in sorted({r["profile"] for r in null}):
        of_profile = [called(r) for r in null if r["profile"] == profile]
        out.append(share(f"null cases called an effect, profile {profile}", of_profile))
    out.append(share("null cases called unknown", [r["verdict"] == UNKNOWN for r in null]))
    outside = [r for r in rows if r["kind"] == "outside" and min(r["wanted_raw"]) >= 3.0]
    visible = [r for r in outside if r["eligible"]]
    out.append(share("outside effect called unknown", [r["verdict"] == UNKNOWN for r in visible], 0.90))
    reserved = [r["verdict"] == UNKNOWN for r in visible if SPECS[r["true"][0]].final_only]
    out.append(share("outside effect called unknown, members of final runs only", reserved))
    for name in sorted({r["true"][0] for r in visible}):
        of_profile = [r["verdict"] == UNKNOWN for r in visible if r["true"][0] == name]
        out.append(share(f"outside effect called unknown, {name}", of_profile))
    removed = [r for r in rows if r["kind"] == "removed" and r["eligible"]]
    alone = [r for r in removed if not _mimics(r)]
    out.append(share("true class removed: unknown, or its mimic", [_removed_right(r) for r in removed], 0.80))
    out.append(share("true class removed, no mimic: unknown", [r["verdict"] == UNKNOWN for r in alone]))
    return out


def _mimics(row: Row) -> set[str]:
    return {name for name, sigma in row["mimics_sigma"].items() if sigma <= MIMIC_SIGMA}


def _removed_right(row: Row) -> bool:
    return row["verdict"] == UNKNOWN or bool(_mimics(row) & {row["verdict"]})


def pairs(rows: list[Row], exact: float, at_least_one: float) -> list[Measure]:
    """Of cases with two effects, with the goals of the first two."""
    return [
        share("two effects: exact pair", [set(r["named"]) == set(r["true"]) for r in rows], exact),
        share("two effects: at least one", [bool(set(r["named"]) & set(r["true"])) for r in rows], at_least_one),
        share("two effects: none that is not there", [not set(r["named"]) - set(r["true"]) for r in rows]),
    ]


def _shrink(rows: list[Row]) -> list[Measure]:
    visible = [r for r in rows if r["visible"] >= 1.0]
    off = [shrink_off(r) for r in visible]
    return [
        share("predicted minus achieved shrink within 0.05", [x <= 0.05 for x in off], 0.90),
        share("predicted minus achieved shrink within 0.10", [x <= 0.10 for x in off], 0.98),
        share_between("95 % shrink interval covers", [shrink_covered(r) for r in visible], 0.90, 0.98),
    ]


def probabilities(rows: Sequence[Row]) -> list[Measure]:
    """Whether stated probabilities are those of being right, over all answerable cases."""
    answered = [r for r in rows if r["verdict"] and answerable(r)]
    stated = np.array([r["p"] for r in answered])
    hits = np.array([overall_right(r) for r in answered], dtype=np.float64)
    excess, low, high = excess_calibration_error(stated, hits)
    sure = [overall_right(r) for r in answered if r["p"] > 0.99]
    return [
        Measure(
            "calibration error beyond chance", "at most 0.03", excess if answered else None, low, high, len(answered),
            excess <= 0.03 if answered else None,
        ),
        share("right when p > 0.99", sure, 0.97),
    ]  # fmt: skip


def _detail_measures(rows_of_effects: list[Row]) -> list[Measure]:
    def within(key: str, limit: float) -> list[bool]:
        return [r[key] is not None and abs(r[key]) <= limit for r in rows_of_effects if key in r]

    coordinate = [r["first_kind"] in r["true_kinds"] for r in rows_of_effects if "true_kinds" in r]
    return [
        share(
            "place right, where the effect is named",
            [r["place_right"] for r in rows_of_effects if "place_right" in r],
            0.95,
        ),
        share("step time within 5 min", within("step_error_s", STEP_S), 0.95),
        share("period within 1 %", within("period_error", PERIOD), 0.95),
        share("true coordinate first by share", coordinate, 0.90),
    ]


def _next(rows: list[Row]) -> list[Measure]:
    chosen, at_random = [r["after_chosen"] for r in rows], [r["after_random"] for r in rows]
    difference, low, high = paired_difference(chosen, at_random)
    return [
        share("further poses: right before", [in_class(r) for r in rows]),
        share("further poses: right after 60 chosen ones", chosen),
        share("further poses: right after 60 random ones", at_random),
        Measure(
            "further poses: chosen better by", "at least 10 points", difference if rows else None, low, high, len(rows),
            difference >= 0.10 if rows else None,
        ),
    ]  # fmt: skip


def _misdeclared(rows: list[Row]) -> list[Measure]:
    by_state = {name: [right(r) for r in rows if r["declared"] == name] for name in MISDECLARED}
    return [share(f"disturbances declared {name}: top-1", hits) for name, hits in by_state.items()]


def _with_gross_readings(rows: Sequence[Row]) -> list[Measure]:
    gross = [r for r in rows if r.get("gross") and answerable(r)]
    effects = [right(r) for r in gross if r["kind"] == "effect"]
    null = [called(r) for r in gross if r["kind"] == "null"]
    return [share("gross readings: top-1", effects), share("gross readings: null cases called an effect", null)]


def _costs(rows: Sequence[Row]) -> list[Measure]:
    seconds = [r["seconds"] for r in rows]
    middle = float(np.median(seconds)) if seconds else None
    low, high = (float(x) for x in np.quantile(seconds, [0.05, 0.95])) if seconds else (0.0, 0.0)
    return [
        Measure(
            "one diagnosis, median on its core in s (5 to 95 %)", "at most 1 s", middle, low, high, len(seconds),
            None if middle is None else middle <= 1.0,
        ),
        share("diagnoses that failed", [bool(r["error"]) for r in rows], 0.0, at_most=True),
    ]  # fmt: skip


def _final_measures(rows_of_effects: list[Row]) -> list[Measure]:
    final = [r for r in rows_of_effects if r["final"]]
    if not final:
        return []
    return [
        share("final variants only: top-1", [right(r) for r in final]),
        share("final variants only: truth among the first three", [r["true"][0] in first_names(r, 3) for r in final]),
        *(Measure(f"final variants only: {m.name}", "", m.value, m.low, m.high, m.n, None) for m in _shrink(final)),
    ]
