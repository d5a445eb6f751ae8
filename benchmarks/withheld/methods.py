"""Simple methods on the same cases: they must lose."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.scoring.measure import share
from benchmarks.withheld.score_rows import Row, answerable, true_answer
from benchmarks.withheld.scorer import NONE

METHODS = ("nearest_residual", "greedy_bic", "form_free")


def baseline_table(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The same cases by simple methods: shares of right answers, and of shrinks within 0.10."""
    answered = [r for r in rows if answerable(r)]
    counts = Counter(true_answer(r) for r in answered)
    commonest = counts.most_common(1)[0][0] if counts else NONE
    named = Counter(true_answer(r) for r in answered if r["kind"] == "effect")
    commonest_effect = named.most_common(1)[0][0] if named else NONE

    def by(method: str) -> Callable[[Row], str]:
        return lambda row: str(row["baselines"].get(method, ""))

    methods: dict[str, Callable[[Row], str]] = {
        "diagnosis": lambda row: str(row["verdict"]),
        **{method: by(method) for method in METHODS},
        "always_commonest": lambda _: commonest,
        "always_commonest_effect": lambda _: commonest_effect,
    }
    out = []
    for name, verdict in methods.items():
        line: dict[str, Any] = {"method": name}
        for kind in ("effect", "null", "outside"):
            hits = [verdict(r) == true_answer(r) for r in answered if r["kind"] == kind]
            line[kind] = share(kind, hits).data()
        parts = [line[k]["value"] for k in ("effect", "null", "outside") if line[k]["value"] is not None]
        line["mean_of_kinds"] = float(np.mean(parts)) if parts else None
        out.append(line)
    return out


def shrink_baseline(rows: Sequence[Row]) -> dict[str, Any]:
    """Always the mean shrink, against what was achieved."""
    visible = [r for r in rows if r["kind"] == "effect" and r["visible"] >= 1.0 and "achieved" in r]
    true = np.array([r["achieved"] for r in visible])
    off = np.abs(true - true.mean()) if len(true) else true
    return {
        "method": "always_mean_shrink",
        "within_0.05": share("within 0.05", [bool(x <= 0.05) for x in off]).data(),
        "within_0.10": share("within 0.10", [bool(x <= 0.10) for x in off]).data(),
    }
