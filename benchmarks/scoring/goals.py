"""The measures that every check of the diagnosis is held to, with their goals: the same on cases of whatever maker.

Rows are those of `benchmarks.withheld.scorer`. What a check has further is its own table's.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.fit_verdict.folds import judged_by
from benchmarks.scoring.measure import Measure, held_to, mean, median, plain, quantiles, share, share_between, worst
from benchmarks.withheld.cases import DECLARED, RIGHT
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
    true_answer,
)
from benchmarks.withheld.scorer import LEAST_P, NONE, UNKNOWN
from benchmarks.withheld.statistics import excess_calibration_error
from calibration.diagnosis.settings import VerdictSettings

ALIKE_SIGMA = 0.3  # an effect so near to the true one equals it
MOST_CLASS = 1.4
WORST_OF = 25  # an effect of fewer cases is not judged by itself
SURE, GROSS_SURE = 0.99, 0.9
SURE_OF_EFFECT = 0.85  # which form it has is never known better than to 0.95 or so
USUAL_S, LONG_S, LONGEST_S = 1.0, 3.0, 8.0  # of a diagnosis: median, most of them, all
WORTH = 1.0  # sigma, visible: where a shrink says something


def measures(rows: Sequence[Row]) -> list[Measure]:
    """All of them, in the order of the goals."""
    visible = [r for r in rows if r["kind"] == "effect" and r["eligible"]]
    return [
        *singles(visible),
        *nulls([r for r in rows if r["kind"] == "null"]),
        *outside([r for r in rows if r["kind"] == "outside"]),
        *pairs([r for r in rows if r["kind"] == "pair" and r["eligible"]]),
        *probabilities([r for r in rows if r["verdict"] and answerable(r)]),
        *shrink([r for r in rows if r["kind"] == "effect" and r["visible"] >= WORTH]),
        *sizes([r for r in visible if right(r)]),
        *gross(rows),
    ]


def singles(rows: Sequence[Row]) -> list[Measure]:
    """Of visible single effects, at one place or several."""
    counts = Counter(r["true"][0] for r in rows)
    often = [name for name, count in sorted(counts.items()) if count >= WORST_OF]
    by_name = {name: [right(r) for r in rows if r["true"][0] == name] for name in often}
    return [
        share("visible single effects named right", [right(r) for r in rows], 0.90),
        *(
            worst(lambda name: f"  worst effect of {WORST_OF} cases or more ({name})", by_name, 0.70)
            or [share(f"  worst effect: none has {WORST_OF} cases", [])]
        ),
        share("  class holds the truth", [in_class(r) for r in rows]),
        class_size("  mean class size", rows),
        share("  truth among the first three", [r["true"][0] in first_names(r, 3) for r in rows], 0.97),
        share("  another effect named", [called(r) and not right(r) for r in rows]),
        share(
            "  named right, with another effect beside it",
            [right(r) and set(r["named"]) != set(r["true"]) for r in rows],
        ),
        share("  called unknown", [r["verdict"] == UNKNOWN for r in rows]),
        share("  called none", [r["verdict"] == NONE for r in rows]),
    ]


def class_size(name: str, rows: Sequence[Row], most: float = MOST_CLASS) -> Measure:
    """Mean number of names that an answer leaves open, where it names an effect."""
    return mean(name, [1.0 + len(r["equivalent"]) for r in rows if called(r)], most)


def nulls(rows: Sequence[Row]) -> list[Measure]:
    """Of cases without an effect, by what they declare of their disturbances."""
    by_state = {name: [called(r) for r in rows if r.get("declared", RIGHT) == name] for name in DECLARED}
    return [
        *(
            share(f"null cases called an effect, declared {name}", hits, 0.01, at_most=True)
            for name, hits in by_state.items()
        ),
        share("  null cases called unknown", [r["verdict"] == UNKNOWN for r in rows]),
    ]


def outside(rows: Sequence[Row]) -> list[Measure]:
    """Of effects that no catalogue has; a mimic is one of the catalogue that equals them, where that was looked for."""
    visible = [r for r in rows if r["eligible"]]
    return [
        share("effect of no catalogue called unknown, or its mimic", [outside_right(r) for r in visible], 0.85),
        share("  unknown itself", [r["verdict"] == UNKNOWN for r in visible]),
        share("  of any size, unknown", [r["verdict"] == UNKNOWN for r in rows]),
        share("  of any size, called an effect", [called(r) for r in rows]),
    ]


def outside_right(row: Row) -> bool:
    """Whether the verdict is `unknown`, or an effect that does the same to all readings."""
    equal = {name for name, sigma in row.get("mimics_sigma", {}).items() if sigma <= ALIKE_SIGMA}
    return row["verdict"] == UNKNOWN or row["verdict"] in equal


def pairs(rows: Sequence[Row]) -> list[Measure]:
    """Of cases with two effects."""
    return [
        share("two effects: exact pair", [set(r["named"]) == set(r["true"]) for r in rows], 0.75),
        share("two effects: at least one", [bool(set(r["named"]) & set(r["true"])) for r in rows], 0.95),
        share("  none that is not there", [not set(r["named"]) - set(r["true"]) for r in rows]),
    ]


def probabilities(rows: Sequence[Row]) -> list[Measure]:
    """Whether stated probabilities are those of being right, over all cases with one right answer."""
    stated, hits = [float(r["p"]) for r in rows], [overall_right(r) for r in rows]
    sure_of_effect = [overall_right(r) for r in rows if called(r) and r["p"] > SURE_OF_EFFECT]
    return [
        *stated_and_right(stated, hits),
        share("  of these called none", [r["verdict"] == NONE for r in rows if r["p"] > SURE]),
        share(f"  right when an effect is named with p > {SURE_OF_EFFECT}", sure_of_effect),
        share(
            f"  right when called unknown with p > {SURE}",
            [overall_right(r) for r in rows if r["verdict"] == UNKNOWN and r["p"] > SURE],
        ),
        log_score([r["p_true"] for r in rows if "p_true" in r]),
    ]


def crosswise(rows: Sequence[Row], settings: VerdictSettings) -> list[Measure]:
    """The same over the same cases by constants that were fitted without such cases."""
    judged = judged_by(settings, [r for r in rows if r["verdict"] and answerable(r)])
    hits = [overall_right(r) for r in judged]
    excess, low, high = excess_calibration_error(np.array([r["p"] for r in judged]), np.array(hits, dtype=np.float64))
    return [
        share("by constants fitted without such cases: right", hits),
        share(
            "  visible single effects named right by these",
            [hit for r, hit in zip(judged, hits, strict=True) if r["kind"] == "effect"],
        ),
        plain("  calibration error beyond chance by these", (excess if hits else None, low, high, len(hits))),
        mean(
            "  log score by these",
            [-float(np.log(max(r["p_by_name"].get(true_answer(r), 0.0), LEAST_P))) for r in judged],
        ),
    ]


def stated_and_right(stated: Sequence[float], hits: Sequence[bool]) -> list[Measure]:
    """How often sure answers are right, and the calibration error; of probabilities and whether each came true."""
    excess, low, high = excess_calibration_error(np.array(stated), np.array(hits, dtype=np.float64))
    found = (excess if hits else None, low, high, len(hits))
    return [
        share(f"right when p > {SURE}", [hit for p, hit in zip(stated, hits, strict=True) if p > SURE], 0.97),
        held_to("calibration error beyond chance", found, "at most 0.03", -np.inf, 0.03),
    ]


def log_score(p_true: Sequence[float]) -> Measure:
    """Of the probabilities that right answers were given."""
    return mean("  log score (mean -ln p of the truth)", [-float(np.log(p)) for p in p_true])


def shrink(rows: Sequence[Row]) -> list[Measure]:
    """Of single effects that are worth it."""
    named = [r for r in rows if called(r)]
    reached = [(r["achieved"] if called(r) else 0.0, r["reached_with_truth"]) for r in rows if _with_truth(r)]
    found, true = np.array(reached, dtype=np.float64).reshape(-1, 2).T
    nothing = np.zeros_like(true)
    return [
        share("predicted minus achieved shrink within 0.05, where named", [shrink_off(r) <= 0.05 for r in named], 0.90),
        share("  where named right", [shrink_off(r) <= 0.05 for r in rows if right(r)]),
        share("  within 0.10, where named", [shrink_off(r) <= 0.10 for r in named]),
        share("  within 0.05, any verdict", [shrink_off(r) <= 0.05 for r in rows]),
        share_between("95 % shrink interval covers, where named", [shrink_covered(r) for r in named], 0.90, 0.98),
        median("left on the table (median shrink with the truth, less)", true, found, 0.05),
        median("  median shrink reached with what was found", found, nothing),
        median("  with the true effect added", true, nothing),
    ]


def _with_truth(row: Row) -> bool:
    return row.get("reached_with_truth") is not None and row.get("achieved") is not None


def sizes(rows: Sequence[Row]) -> list[Measure]:
    """Of single effects that are named right: raw sizes, and where their maker states these, the effect's own size and
    what it does at its channels."""
    raw = [abs(r["raw_named"] - r["raw_true"]) <= 2.0 * r["raw_u"] for r in rows if "raw_u" in r]
    own = [abs(r["size_error_u"]) <= 2.0 for r in rows if "size_error_u" in r]
    out = [share_between("raw size within its U (k = 2), where named right", raw, 0.90, 0.98)]
    if own:
        out.append(share_between("effect's own size within its U (k = 2)", own, 0.90, 0.98))
    amounts = [abs(q["stated"] - q["true"]) <= 2.0 * q["u"] for r in rows for q in r.get("at_channels", [])]
    if amounts:
        out.append(share_between("size at its channel within its U (k = 2)", amounts, 0.90, 0.98))
    return out


def gross(rows: Sequence[Row]) -> list[Measure]:
    """Of verdicts that were sure, and were asked for again with wrong readings: six gross ones, or many."""
    changed = [not r["held_against_gross"] for r in rows if "held_against_gross" in r]
    of_far = [not r["held_against_far"] for r in rows if "held_against_far" in r]
    out = [share(f"verdicts of p > {GROSS_SURE} that six gross readings change", changed, 0.02, at_most=True)]
    return out + ([share("  that one far reading in twenty changes", of_far)] if of_far else [])


def reached(figures: Sequence[dict[str, Any]]) -> bool:
    """Whether no goal is missed."""
    return all(m["ok"] is not False for m in figures)


def times(seconds: Sequence[float]) -> list[Measure]:
    """Of diagnoses, each on one core, files read."""
    return [
        quantiles("one diagnosis, median on its core in s (5 to 95 %)", seconds, USUAL_S),
        share(f"  within {LONG_S:g} s", [s < LONG_S for s in seconds], 0.95),
        share(f"  within {LONGEST_S:g} s", [s < LONGEST_S for s in seconds], 1.0),
    ]
