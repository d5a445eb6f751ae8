"""The result of a calibration for programs (docs/reference/json.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from calibration.identification.model_comparison import predicted_errors
from calibration.machine.description import COORDINATES
from calibration.recording.sessions import repaired_text
from calibration.reduction.figures import Figures, coordinate_errors
from pkm_rig.report.diagnosis_json import diagnosis_attempt_json
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.results.report_source import ReportSource


def pool_figures(several: list[Figures]) -> dict[str, float]:
    """The figures of several sets of poses as one."""
    n = np.array([f.n for f in several], dtype=float)
    position = np.array([f.position_rms_m for f in several])
    turn = np.array([f.orientation_rms_rad for f in several])
    return {
        "position_rms_m": float(np.sqrt(np.sum(n * position**2) / n.sum())),
        "position_max_m": max(f.position_max_m for f in several),
        "orientation_rms_rad": float(np.sqrt(np.sum(n * turn**2) / n.sum())),
    }


def campaign_json(source: ReportSource) -> dict[str, Any]:
    """The same of a campaign without a verdict: what there is of it."""
    reduction = source.reduction
    attempt = source.diagnosis
    return {
        "campaign": source.campaign,
        "simulated": source.header.simulated,
        "head": source.head or None,
        "accepted": False,
        "decision": None,
        "report": None,
        "payloads": [],
        "dropped": {} if reduction is None else reduction.dropped,
        "left_out": [] if reduction is None else [reading.as_dict() for reading in reduction.left_out],
        "diagnosis": None if attempt is None else diagnosis_attempt_json(attempt),
        "sessions": [session.model_dump(mode="json") for session in source.header.sessions],
    }


def coordinates_json(outcome: CampaignOutcome, payload: int) -> dict[str, dict[str, float | bool]]:
    """RMS error (m, rad) by free coordinate, before and after, and whether the drives command it.

    Where the host corrects also what the model predicts of both.
    """
    machine = outcome.reduction.recording.machine
    before, after = (
        coordinate_errors(outcome.reduction, f"verification_{phase}", payload) for phase in ("before", "after")
    )
    found: dict[str, dict[str, float | bool]] = {
        COORDINATES[c]: {"before": before[c], "after": after[c], "commanded": c in machine.commanded} for c in before
    }
    if outcome.back_end == "host":
        for phase in ("before", "after"):
            predicted = predicted_errors(outcome.calibration, outcome.reduction, f"verification_{phase}", payload)
            for c, value in predicted.items():
                found[COORDINATES[c]][f"predicted_{phase}"] = value
    return found


def outcome_json(outcome: CampaignOutcome, report: Path | None) -> dict[str, Any]:
    """The result of `calibrate` and `verify`."""
    last, recording = outcome.verified[-1], outcome.reduction.recording
    repaired = repaired_text(recording)
    return {
        "campaign": outcome.campaign,
        "simulated": outcome.simulated,
        "head": outcome.head or None,
        "accepted": outcome.accepted,
        "decision": outcome.decision,
        "before": pool_figures([v.before for v in outcome.verified]),
        "after": pool_figures([v.after for v in outcome.verified]),
        "noise_floor": pool_figures([outcome.floor]),
        "baselines": {name: pool_figures([f]) for name, f in last.models.items()},
        "back_end": outcome.back_end,
        "tables": {
            drive: {**state, "active": bool(state["active"] and outcome.accepted)}
            for drive, state in outcome.written[-1].drives.items()
        },
        "report": None if report is None else str(report),
        "payloads": [
            {
                "payload_kg": v.payload_kg,
                "before": v.before.as_dict(),
                "after": v.after.as_dict(),
                "orientation_prediction_rad": v.orientation_prediction_rad,
                "decision": v.decision.verdict,
                "rule": v.decision.rule,
                "models": {name: f.as_dict() for name, f in v.models.items()},
                "coordinates": coordinates_json(outcome, v.payload),
            }
            for v in outcome.verified
        ],
        "dropped": outcome.reduction.dropped,
        "left_out": [reading.as_dict() for reading in outcome.reduction.left_out],
        "diagnosis": diagnosis_attempt_json(outcome.diagnosis),
        "sessions": [session.model_dump(mode="json") for session in recording.file.sessions],
        **({} if repaired is None else {"repaired": repaired}),
    }
