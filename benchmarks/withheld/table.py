"""What a run has reached: the goals of every check, and what this one shows besides."""

from __future__ import annotations

import math
from collections.abc import Sequence

from benchmarks.fit_verdict.folds import WITHOUT_PLANT, settings_without
from benchmarks.scoring import goals
from benchmarks.scoring.goals import ALIKE_SIGMA, class_size
from benchmarks.scoring.measure import Measure, held_to, share
from benchmarks.withheld.cases import INDEX_OF_AIR, MISDECLARED
from benchmarks.withheld.score_rows import (
    Row,
    answerable,
    at_several_places,
    called,
    first_names,
    in_class,
    right,
    with_whole_catalogue,
)
from benchmarks.withheld.scorer import UNKNOWN
from benchmarks.withheld.statistics import paired_difference
from mock_devices.effects import SPECS

MIMIC_SIGMA = 0.5
PLACES = {False: "one place", True: "several places"}
STEP_S, PERIOD = 300.0, 0.01
MOST_PLATFORM_CLASS = 2.0


def measures(rows: Sequence[Row]) -> list[Measure]:
    """All rows of the table, the goals of every check first."""
    visible = [r for r in rows if r["kind"] == "effect" and r["eligible"]]
    return [
        *goals.measures(rows),
        *goals.crosswise(rows, settings_without(WITHOUT_PLANT)),
        *_singles(visible),
        *_platform([r for r in rows if r["kind"] == "platform_only" and r["eligible"]]),
        *_none_and_unknown(rows),
        *_detail_measures(visible),
        *_next([r for r in rows if r["kind"] == "next" and "after_chosen" in r]),
        *_misdeclared([r for r in rows if r["kind"] == "misdeclared" and r["eligible"]]),
        *_with_gross_readings(rows),
        *_costs(rows),
        *_final_measures(visible),
    ]


def whole_measures(rows: Sequence[Row]) -> list[Measure]:
    """What is reached with the whole catalogue, on cases that are diagnosed with and without some of its forms."""
    whole = [with_whole_catalogue(r) for r in rows]
    return [
        *goals.singles([r for r in whole if r["kind"] == "effect" and r["eligible"]]),
        *goals.pairs([r for r in whole if r["kind"] == "pair" and r["eligible"]]),
    ]


def _singles(rows: list[Row]) -> list[Measure]:
    told = [r for r in rows if all(sigma > ALIKE_SIGMA for sigma in r["mimics_sigma"].values())]
    index = [r for r in rows if r["variant"][0] in INDEX_OF_AIR]
    by_places = {name: [right(r) for r in rows if at_several_places(r) == s] for s, name in PLACES.items()}
    return [
        *(share(f"named right: {name}", hits) for name, hits in by_places.items()),
        share("named right where no other effect is within 0.3 sigma", [right(r) for r in told]),
        share("index of air: named right", [right(r) for r in index]),
    ]


def _platform(rows: list[Row]) -> list[Measure]:
    return [
        share("platform only: class right and its members equivalent", [_fair_class(r) for r in rows], 0.90),
        class_size("platform only: mean class size", rows, MOST_PLATFORM_CLASS),
        share("platform only: class holds the truth", [in_class(r) for r in rows]),
        share("platform only: named right", [right(r) for r in rows]),
    ]  # fmt: skip


def _fair_class(row: Row) -> bool:
    others = {row["verdict"], *row["equivalent"]} - {row["true"][0]}
    return in_class(row) and all(row["mimics_sigma"].get(name, math.inf) <= ALIKE_SIGMA for name in others)


def _none_and_unknown(rows: Sequence[Row]) -> list[Measure]:
    null = [r for r in rows if r["kind"] == "null"]
    out = []
    for profile in sorted({r["profile"] for r in null}):
        of_profile = [called(r) for r in null if r["profile"] == profile]
        out.append(share(f"null cases called an effect, profile {profile}", of_profile))
    visible = [r for r in rows if r["kind"] == "outside" and r["eligible"]]
    reserved = [r["verdict"] == UNKNOWN for r in visible if SPECS[r["true"][0]].final_only]
    out.append(share("outside effect called unknown, members of final runs only", reserved))
    for name in sorted({r["true"][0] for r in visible}):
        of_name = [r["verdict"] == UNKNOWN for r in visible if r["true"][0] == name]
        out.append(share(f"outside effect called unknown, {name}", of_name))
    removed = [r for r in rows if r["kind"] == "removed" and r["eligible"]]
    alone = [r for r in removed if not _mimics(r)]
    out.append(share("true class removed: unknown, or its mimic", [_removed_right(r) for r in removed], 0.80))
    out.append(share("true class removed, no mimic: unknown", [r["verdict"] == UNKNOWN for r in alone]))
    return out


def _mimics(row: Row) -> set[str]:
    return {name for name, sigma in row["mimics_sigma"].items() if sigma <= MIMIC_SIGMA}


def _removed_right(row: Row) -> bool:
    return row["verdict"] == UNKNOWN or bool(_mimics(row) & {row["verdict"]})


def _detail_measures(rows_of_effects: list[Row]) -> list[Measure]:
    def within(key: str, limit: float) -> list[bool]:
        return [r[key] is not None and abs(r[key]) <= limit for r in rows_of_effects if key in r]

    coordinate = [r["first_kind"] in r["true_kinds"] for r in rows_of_effects if "true_kinds" in r]

    def places(key: str, *, several: bool) -> list[bool]:
        return [r[key] for r in rows_of_effects if key in r and at_several_places(r) == several]

    return [
        share("place right, where the effect is named", places("place_right", several=False), 0.95),
        share("named place is one of several", places("place_right", several=True)),
        share("all of several places named", places("places_right", several=True)),
        share("step time within 5 min", within("step_error_s", STEP_S), 0.95),
        share("period within 1 %", within("period_error", PERIOD), 0.95),
        share("true coordinate first by share", coordinate, 0.90),
    ]


def _next(rows: list[Row]) -> list[Measure]:
    chosen, at_random = [r["after_chosen"] for r in rows], [r["after_random"] for r in rows]
    difference, low, high = paired_difference(chosen, at_random)
    found = (difference if rows else None, low, high, len(rows))
    return [
        share("further poses: right before", [in_class(r) for r in rows]),
        share("further poses: right after 60 chosen ones", chosen),
        share("further poses: right after 60 random ones", at_random),
        held_to("further poses: chosen better by", found, "at least 10 points", 0.10, float("inf")),
    ]


def _misdeclared(rows: list[Row]) -> list[Measure]:
    by_state = {name: [right(r) for r in rows if r["declared"] == name] for name in MISDECLARED}
    return [share(f"disturbances declared {name}: named right", hits) for name, hits in by_state.items()]


def _with_gross_readings(rows: Sequence[Row]) -> list[Measure]:
    gross = [r for r in rows if r.get("gross") and answerable(r)]
    effects = [right(r) for r in gross if r["kind"] == "effect"]
    null = [called(r) for r in gross if r["kind"] == "null"]
    return [share("gross readings: named right", effects), share("gross readings: null cases called an effect", null)]


def _costs(rows: Sequence[Row]) -> list[Measure]:
    return [
        *goals.times([r["seconds"] for r in rows]),
        share("diagnoses that failed", [bool(r["error"]) for r in rows], 0.0, at_most=True),
    ]


def _final_measures(rows_of_effects: list[Row]) -> list[Measure]:
    final = [r for r in rows_of_effects if r["final"]]
    if not final:
        return []
    return [
        share("final variants only: named right", [right(r) for r in final]),
        share("final variants only: truth among the first three", [r["true"][0] in first_names(r, 3) for r in final]),
    ]
