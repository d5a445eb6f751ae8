"""A run's figures as plain data, as a printed table and as an entry of the log."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from benchmarks.scoring.lines import effect_lines, measure_lines, number
from benchmarks.withheld.methods import baseline_table, shrink_baseline
from benchmarks.withheld.score_rows import right
from benchmarks.withheld.table import measures, whole_measures
from mock_devices.effects import CATALOGUE

Row = dict[str, Any]


def summary(rows: Sequence[Row]) -> dict[str, Any]:
    """All figures of the rows."""
    left_out = any(row.get("decoys") for row in rows)
    return {
        "measures": [measure.data() for measure in measures(rows)],
        "whole_catalogue": [measure.data() for measure in whole_measures(rows)] if left_out else [],
        "left_out": left_out_forms(rows) if left_out else [],
        "effects": by_effect(rows),
        "baselines": baseline_table(rows),
        "shrink_baseline": shrink_baseline(rows),
    }


def by_effect(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Hits of each visible effect, and the verdict that most often replaces it."""
    visible_effects = [r for r in rows if r["kind"] == "effect" and r["eligible"]]
    out = []
    for name in sorted({r["true"][0] for r in visible_effects}):
        rows_of_effect = [r for r in visible_effects if r["true"][0] == name]
        wrong = [r["verdict"] for r in rows_of_effect if not right(r)]
        out.append(
            {
                "effect": name,
                "cases": len(rows_of_effect),
                "right": len(rows_of_effect) - len(wrong),
                "taken_for": max(set(wrong), key=wrong.count) if wrong else "",
                "variants_missed": sorted({r["variant"][0] for r in rows_of_effect if not right(r)}),
            }
        )
    return out


def left_out_forms(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """By effect: cases, those of which nothing had to be left out, forms left out a case, and how often each was."""
    of_effect: dict[str, list[list[str]]] = {}
    for row in rows:
        if row["kind"] == "removed":
            continue
        for name in row["true"]:
            if name in CATALOGUE:
                forms = [form.partition("/") for form in row["left_out"]]
                of_effect.setdefault(name, []).append([form for effect, _, form in forms if effect == name])
    return [
        {
            "effect": name,
            "cases": len(cases),
            "nothing": sum(not forms for forms in cases),
            "forms_a_case": sum(map(len, cases)) / len(cases),
            "forms": dict(Counter(form for forms in cases for form in forms).most_common()),
        }
        for name, cases in sorted(of_effect.items())
    ]


def printed(summary_data: dict[str, Any]) -> str:
    """The table for people."""
    lines = measure_lines(summary_data["measures"])
    if summary_data["left_out"]:
        title = "leave-form-out: without each effect's forms that explain more than 98 % of its true change"
        lines = [title, *lines, "", "with the whole catalogue", *measure_lines(summary_data["whole_catalogue"])]
        lines += ["", *left_out_lines(summary_data["left_out"])]
    lines += ["", *effect_lines(summary_data["effects"])]
    lines += ["", f"{'right answers of':26} {'effects':>9} {'null':>9} {'outside':>9} {'mean':>9}"]
    for b in summary_data["baselines"]:
        values = [b["effect"]["value"], b["null"]["value"], b["outside"]["value"], b["mean_of_kinds"]]
        cells = " ".join(f"{'-' if v is None else number(v, False):>9}" for v in values)
        lines.append(f"{b['method']:26} {cells}")
    s = summary_data["shrink_baseline"]
    parts = [s[key]["value"] for key in ("within_0.05", "within_0.10")]
    cells = " and ".join("-" if v is None else number(v, False) for v in parts)
    lines.append(f"{s['method']:26} {cells} within 0.05 and 0.10 of what was achieved")
    return "\n".join(line.rstrip() for line in lines)


def left_out_lines(left_out: Sequence[dict[str, Any]]) -> list[str]:
    """What was left out of the catalogue, as a table."""
    cases, nothing = (sum(entry[key] for entry in left_out) for key in ("cases", "nothing"))
    return [
        f"{'left out':26} {'a case':>7}   {'nothing':>10}   forms (cases)",
        *(
            f"{e['effect']:26} {e['forms_a_case']:>7.1f}   {e['nothing']:>3} of {e['cases']:<3}   "
            f"{', '.join(f'{form} ({count})' for form, count in e['forms'].items())}".rstrip()
            for e in left_out
        ),
        f"{'all':26} {'':>7}   {nothing:>3} of {cases:<3}",
    ]


def log_entry(
    run: str, settings: dict[str, Any], batches: Sequence[dict[str, Any]], summary_data: dict[str, Any]
) -> dict[str, Any]:
    """One finished final run, good or bad."""
    return {
        "run": run,
        "ended": datetime.now(UTC).isoformat(timespec="seconds"),
        "n": sum(len(batch["rows"]) for batch in batches),
        "code": settings["code"],
        "answers": [batch["answers_sha256"] for batch in batches],
        "truths": [batch["truth_sha256"] for batch in batches],
        "rows": hashlib.sha256(repr([batch["rows"] for batch in batches]).encode()).hexdigest(),
        "figures": {
            m["name"]: [None if m[k] is None else round(m[k], 4) for k in ("value", "low", "high")] + [m["n"], m["ok"]]
            for m in summary_data["measures"]
        },
        "leave_form_out": bool(summary_data["left_out"]),
        "whole_catalogue": {
            m["name"]: [None if m[k] is None else round(m[k], 4) for k in ("value", "low", "high")] + [m["n"], m["ok"]]
            for m in summary_data["whole_catalogue"]
        },
    }
