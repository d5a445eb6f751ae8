"""Probabilities by constants that were fitted without such cases (docs/explanation/verdict-constants.md).

`make fit-verdict WRITE=1` writes the constants of each fold beside this module. A check states its calibration by the
release's constants, which development cases of all sources have seen, and by those of its own fold.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks.fit_verdict.fit import BY_EVIDENCE
from calibration.diagnosis.settings import VERDICT, VerdictSettings
from calibration.diagnosis.verdict import verdict_probabilities

FILE = Path(__file__).with_name("folds.json")
WITHOUT_RECORDINGS, WITHOUT_PLANT = "recordings", "plant"  # folds, by the source that they have not seen
SIGNIFICANT = 4  # digits of a constant


def written(by_source: Mapping[str, VerdictSettings]) -> str:
    """The file's text, from the settings by the source that they have not seen."""
    every = {
        source: {name: float(f"{getattr(settings, name):.{SIGNIFICANT}g}") for name in BY_EVIDENCE}
        for source, settings in by_source.items()
    }
    return json.dumps(every, indent=2) + "\n"


def settings_without(source: str, text: str | None = None) -> VerdictSettings:
    """The release's settings with the constants that were fitted without a source's cases."""
    kept = json.loads(FILE.read_text(encoding="utf-8") if text is None else text)[source]
    constants: dict[str, Any] = {name: float(kept[name]) for name in BY_EVIDENCE}
    return replace(VERDICT, **constants)


def judged_by(settings: VerdictSettings, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Rows with the verdict and its probability by other constants, `p_by_name` of all answers; those whose evidence
    was not kept are left out."""
    out = []
    for row in rows:
        if not (evidence := row.get("evidence")):
            continue
        p = verdict_probabilities(
            evidence["log_evidence"],
            evidence["explained"],
            evidence["excess"],
            settings,
            none_elsewhere=evidence["none_elsewhere"],
            departure_gain=evidence["departure_gain"],
        )
        verdict = max(p, key=lambda name: p[name])
        out.append({**row, "verdict": verdict, "p": p[verdict], "p_by_name": p})
    return out
