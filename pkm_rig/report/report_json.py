"""The data of a report: every number that its page shows, in SI units (docs/reference/json.md)."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from calibration.compensation.error_map import ErrorMap, error_map
from calibration.compensation.tables import CompensationTable
from calibration.identification.fit import Fit
from calibration.identification.observability import observability_of
from calibration.reduction.budget import position_budget
from calibration.reduction.figures import COVERAGE_FACTOR, noise_floor
from calibration.reduction.reduction import Reduction
from pkm_rig.report.diagnosis_json import additions_by_gain, largest_shares
from pkm_rig.report.diagnosis_text import diagnosis_line
from pkm_rig.report.identity_json import identity_json
from pkm_rig.report.left_out_text import SHOWN, left_out_in_words
from pkm_rig.report.outcome_json import campaign_json, coordinates_json, outcome_json
from pkm_rig.report.outcome_text import comparison_remark, model_rows
from pkm_rig.report.residuals_json import residuals_json
from pkm_rig.results.outcome import CampaignOutcome, VerificationResult, WrittenTable
from pkm_rig.results.report_source import ReportSource
from pkm_rig.version import __version__

CORRELATED = 0.9
MOST_CORRELATIONS = 12


def report_json(
    source: ReportSource, report: Path | None = None, maps: dict[int, ErrorMap] | None = None
) -> dict[str, Any]:
    """One object: the result of `calibrate`, as far as the campaign came, and all that the page adds to it."""
    outcome = source.outcome
    found = campaign_json(source) if outcome is None else outcome_json(outcome, report)
    found |= {
        "state": source.state,
        "step": source.step,
        "why": source.why,
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": f"pkm-rig {__version__}",
        "coverage_factor": COVERAGE_FACTOR,
        "identity": identity_json(source),
        "tables_as_found": None if source.tables is None else source.tables.as_found,
        "tables_as_left": None if source.tables is None else source.tables.as_left,
        "reflectors": [{"name": smr.name, "on": smr.on} for smr in source.machine.smrs],
        "conditions": _conditions(source),
        "record": _record(source),
        "not_reduced": source.not_reduced,
        "not_identified": source.not_identified,
        "standard": None if source.standard is None else source.standard.as_dict(),
        "standard_failure": source.standard_failure,
    }
    if source.reduction is not None:
        floor = noise_floor(source.reduction)
        found["noise_floor_of_visits"] = None if floor is None else floor.as_dict()
        found["range_constant_m"] = source.reduction.range_constant_m
        found["u_range_constant_m"] = source.reduction.range_constant_u_m
        found["left_out_in_words"] = left_out_in_words(source.reduction.left_out)
    if source.calibration is not None:
        found |= _identified(source.calibration.fit)
        found["residuals"] = residuals_json(source.calibration)
    if source.diagnosis is not None:
        found |= _diagnosed(source)
    if outcome is not None:
        maps = maps or maps_of(outcome)
        for entry, verified in zip(found["payloads"], outcome.verified, strict=True):
            entry.update(_payload(source, outcome, verified, maps.get(verified.payload)))
    return found


def maps_of(outcome: CampaignOutcome) -> dict[int, ErrorMap]:
    """Predicted errors over the workspace without and with each payload's table; none where the host corrects."""
    return {
        w.payload: error_map(outcome.calibration, w.table)
        for w in outcome.written
        if isinstance(w.table, CompensationTable)
    }


def _conditions(source: ReportSource) -> dict[str, Any]:
    """What it was measured in; ranges are over all readings used."""
    recording = source.recording
    sessions = [s.model_dump(mode="json") for s in source.header.sessions]
    if recording is None:
        return {"readings": 0, "sessions": sessions}
    temperatures = {"air": recording["air_temperature_c"], **recording.temperatures_c()}
    payloads = sorted(set(recording["payload"].astype(int).tolist()))
    return {
        "readings": len(recording),
        "duration_s": float(np.ptp(recording["t_rig_s"])),
        "temperatures": [
            {"name": name, "low_c": float(values.min()), "high_c": float(values.max())}
            for name, values in temperatures.items()
        ],
        "pressure_hpa": float(recording["pressure_hpa"].mean()),
        "humidity_percent": float(recording["humidity_percent"].mean()),
        "payloads": [recording.file.payloads[number].model_dump(mode="json") for number in payloads],
        "sessions": sessions,
    }


def _record(source: ReportSource) -> dict[str, Any]:
    """What was measured with what, and hashes that tell whether it is still that."""
    recording, header = source.recording, source.header
    data = hashlib.sha256()
    for name, column in ({} if recording is None else recording.columns).items():
        data.update(name.encode())
        data.update(np.ascontiguousarray(column).tobytes())
    return {
        "station": header.station.model_dump(mode="json"),
        "nest_length": None if header.nest_length is None else header.nest_length.model_dump(mode="json"),
        "hashes": [
            {"of": "head of the campaign in the store (pkm-rig audit --head)", "sha256": source.head or "not chained"},
            {
                "of": "settings of the campaign",
                "sha256": hashlib.sha256(header.model_dump_json().encode()).hexdigest(),
            },
            {"of": "machine file", "sha256": hashlib.sha256(source.machine.text.encode()).hexdigest()},
            *([] if recording is None else [{"of": "readings used", "sha256": data.hexdigest()}]),
        ],
    }


def _identified(fit: Fit) -> dict[str, Any]:
    """Parameters, those that matter most first, and what the readings leave open."""
    parameters = [
        {
            "name": p.name,
            "value": float(value),
            "u": float(u),
            "tolerance": p.tolerance,
            "unit": p.unit,
            "ppm": p.kind == "drive_scale",
            "in_tolerances": float(abs(value) / p.tolerance),
            "left": float(u / p.sigma),
        }
        for p, value, u in zip(fit.model.parameters.parameters, fit.theta, fit.theta_u, strict=True)
    ]
    return {
        "parameters": sorted(parameters, key=lambda entry: -entry["in_tolerances"]),
        "chi2_per_dof": fit.chi2_per_dof,
        "directions_decided": int(np.count_nonzero(fit.spectrum > 1.0)),
        "directions": fit.layout.size,
        "left_open": list(observability_of(fit).sentences),
        "correlations": _correlations(fit),
    }


def _correlations(fit: Fit) -> list[dict[str, Any]]:
    """Pairs of machine parameters that are known only together, the strongest first."""
    n = len(fit.model.parameters)
    cov = fit.covariance[:n, :n]
    corr = cov / np.sqrt(np.outer(np.diag(cov), np.diag(cov)))
    names = fit.model.parameters.names
    pairs = [(abs(corr[i, j]), i, j) for i in range(n) for j in range(i) if abs(corr[i, j]) > CORRELATED]
    return [
        {"first": names[j], "second": names[i], "correlation": float(corr[i, j])}
        for _, i, j in sorted(pairs, reverse=True)[:MOST_CORRELATIONS]
    ]


def _diagnosed(source: ReportSource) -> dict[str, Any]:
    assert source.diagnosis is not None
    found = {"diagnosis_line": diagnosis_line(source.diagnosis)}
    diagnosis = source.diagnosis.diagnosis
    if diagnosis is None:
        return found
    additions = additions_by_gain(diagnosis)
    return found | {
        "largest_shares": [
            {"kind": s.kind, "name": s.name, "share": s.share, "low": s.low, "high": s.high}
            for s in largest_shares(diagnosis)
        ],
        "diagnosis_left_out_in_words": left_out_in_words(diagnosis.left_out),
        "diagnosis_left_out_more": max(0, len(diagnosis.left_out) - SHOWN),
        "measure_next": {"adds": additions[0].adds, "minutes": additions[0].minutes} if additions else None,
    }


def _payload(
    source: ReportSource, outcome: CampaignOutcome, verified: VerificationResult, predicted: ErrorMap | None
) -> dict[str, Any]:
    """What the page says of a payload beyond the result itself."""
    written = next(w for w in outcome.written if w.payload == verified.payload)
    entry = outcome.reduction.recording.file.payloads[verified.payload]
    before, after = verified.before, verified.after
    expanded = COVERAGE_FACTOR * after.u_position_rms_m
    return {
        "name": entry.name,
        "u_mass_kg": entry.u_mass_kg,
        "fall_m": before.position_rms_m - after.position_rms_m,
        "u_fall_m": float(np.hypot(before.u_position_rms_m, after.u_position_rms_m)),
        "limit_m": source.limits_m.get(verified.payload),
        "guard_band_m": expanded if verified.payload in source.limits_m else None,
        "budget_before": position_budget(outcome.reduction, "verification_before", verified.payload).as_dict(),
        "budget_after": position_budget(outcome.reduction, "verification_after", verified.payload).as_dict(),
        "table_temperature_c": written.table.temperature_c,
        "largest_correction_m": _largest_correction(outcome, written),
        "drives": [{"drive": drive, **state} for drive, state in written.drives.items()],
        "u_prediction_m": None if predicted is None else float(np.sqrt(np.mean(predicted.u_m**2))),
        "verification_poses": _poses(outcome.reduction, verified.payload),
        "comparison": [row.__dict__ for row in model_rows(verified)],
        "comparison_remark": comparison_remark(verified),
        "coordinates_rms": [
            {"coordinate": name, **errors} for name, errors in coordinates_json(outcome, verified.payload).items()
        ],
    }


def _largest_correction(outcome: CampaignOutcome, written: WrittenTable) -> float:
    """Largest correction of a drive (m, of a crank rad): in the table, or by the host at the verification poses."""
    if isinstance(written.table, CompensationTable):
        return float(np.max(np.abs(written.table.correction_m)))
    reduction = outcome.reduction
    target_m = reduction.observations.visits.target_m[reduction.rows("verification_before", written.payload)]
    return float(np.max(np.abs(written.table.corrections(target_m))))


def _poses(reduction: Reduction, payload: int) -> list[dict[str, Any]]:
    """Verification poses: target and measured error of the tool before and after; null where one was not measured."""
    errors = {}
    targets: dict[int, list[float]] = {}
    for phase in ("verification_before", "verification_after"):
        rows = reduction.rows(phase, payload)
        error = reduction.errors(rows)[0]
        target = reduction.observations.visits.target_m[rows, :3]
        for number, at, off in zip(reduction.info.pose[rows].tolist(), target, error, strict=True):
            targets[number] = at.tolist()
            errors[phase, number] = off.tolist()
    return [
        {
            "pose": number,
            "target_m": targets[number],
            "before_m": errors.get(("verification_before", number)),
            "after_m": errors.get(("verification_after", number)),
        }
        for number in sorted(targets)
    ]
