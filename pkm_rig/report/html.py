"""The report: one self-contained HTML file without external requests."""

from __future__ import annotations

import hashlib
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from calibration.base.rounding import round_result
from calibration.compensation.error_map import error_map
from calibration.identification.fit import Fit
from calibration.identification.observability import observability_of
from calibration.identification.prediction import predict_poses
from calibration.recording.header import SessionEntry
from calibration.reduction.figures import COVERAGE_FACTOR
from pkm_rig.report import diagnosis_json, diagnosis_pictures, diagnosis_text, pictures
from pkm_rig.report.left_out_text import REASONS, size_in_words
from pkm_rig.report.notation import plain_number, with_symbols
from pkm_rig.report.outcome_text import comparison_remark, model_rows
from pkm_rig.results.outcome import CampaignOutcome, VerificationResult
from pkm_rig.store.store import campaign_folder
from pkm_rig.version import __version__

WRONG_READINGS = 50  # the largest, by name; all are in the JSON of `identify`


def report_path(outcome: CampaignOutcome, out: Path) -> Path:
    """Where the report of a campaign is written."""
    return campaign_folder(out, outcome.campaign) / "report.html"


def write_report(outcome: CampaignOutcome, path: Path) -> None:
    """Write the report. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(report_html(outcome), encoding="utf-8")


def report_html(outcome: CampaignOutcome) -> str:
    """The report; pictures are drawn from the outcome alone."""
    environment = Environment(
        loader=PackageLoader("pkm_rig.report", "templates"),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
    )
    environment.filters["plain"] = plain_number
    environment.filters["symbols"] = with_symbols
    environment.filters["result"] = _result_um
    environment.filters["um"] = lambda metres: f"{metres * 1e6:.1f}"
    environment.filters["percent"] = diagnosis_text.percent
    environment.filters["probability"] = diagnosis_text.probability
    environment.filters["sized"] = lambda quantity: with_symbols(diagnosis_text.format_quantity(quantity))
    environment.filters["urad"] = lambda rad: f"{rad * 1e6:.1f}"
    recording = outcome.reduction.recording
    uri = partial(pictures.data_uri, simulated=outcome.simulated)
    sections = [_payload_section(outcome, verified) for verified in outcome.verified]
    return environment.get_template("report.html").render(
        outcome=outcome,
        file=recording.file,
        machine=recording.machine,
        sections=sections,
        k=COVERAGE_FACTOR,
        floor=outcome.floor,
        conditions=_conditions(outcome),
        parameters=_parameters(outcome.calibration.fit),
        unobserved=list(observability_of(outcome.calibration.fit).sentences),
        correlations=_correlations(outcome.calibration.fit),
        pictures={
            "conditions": uri(pictures.conditions(outcome.reduction)),
            "residuals": uri(pictures.residuals(outcome.calibration)),
            "parameters": uri(pictures.parameter_plot(outcome.calibration)),
        },
        fit=outcome.calibration.fit,
        diagnosis_line=with_symbols(diagnosis_text.diagnosis_line(outcome.diagnosis)),
        diagnosis=_diagnosis(outcome),
        version=__version__,
        hashes=_hashes(outcome),
        readings=len(recording),
    )


def _result_um(value_m: float, expanded_m: float) -> str:
    return " ± ".join(round_result(value_m * 1e6, expanded_m * 1e6))


def _payload_section(outcome: CampaignOutcome, verified: VerificationResult) -> dict[str, Any]:
    written = next(w for w in outcome.written if w.payload == verified.payload)
    maps = error_map(outcome.calibration, written.table)
    name = outcome.reduction.recording.file.payloads[verified.payload].name
    rows = outcome.reduction.rows("verification_before", verified.payload)
    visits = outcome.reduction.observations.visits.take(rows)
    predicted = predict_poses(outcome.calibration.fit, outcome.reduction.report, visits)
    title = f"payload: {name}"
    uri = partial(pictures.data_uri, simulated=outcome.simulated)
    return {
        "verified": verified,
        "name": name,
        "rows": model_rows(verified),
        "remark": comparison_remark(verified),
        "map": uri(pictures.error_maps(maps, f"Predicted error of the tool point, {title}")),
        "u_map_um": float(np.sqrt(np.mean(maps.u_m**2))) * 1e6,
        "scatter": uri(
            pictures.verification_scatter(
                outcome.reduction, verified.payload, f"Measured at the verification poses, {title}"
            )
        ),
        "orientation": uri(pictures.orientation_plot(outcome.reduction, predicted, verified.payload)),
        "largest_correction_um": float(np.max(np.abs(written.table.correction_m))) * 1e6,
        "temperature_c": written.table.temperature_c,
        "drives": written.drives,
    }


def _diagnosis(outcome: CampaignOutcome) -> dict[str, Any] | None:
    diagnosis = outcome.diagnosis.diagnosis
    if diagnosis is None:
        return None
    images = diagnosis_pictures.draw_all(diagnosis, outcome.reduction.recording.machine)
    candidates = diagnosis_json.additions_by_gain(diagnosis)
    return {
        "result": diagnosis,
        "shares": diagnosis_json.largest_shares(diagnosis),
        "pictures": [pictures.data_uri(figure, simulated=outcome.simulated) for figure in images.values()],
        "next": candidates[0] if candidates else None,
    }


def _conditions(outcome: CampaignOutcome) -> list[tuple[str, str]]:
    recording = outcome.reduction.recording
    hours = (recording["t_rig_s"].max() - recording["t_rig_s"].min()) / 3600.0
    rows = [("duration (rig time)", f"{hours:.2f} h")]
    for session in recording.file.sessions:
        rows.append((f"session {session.number}", _session(session)))
    for name, values in (("air", recording["air_temperature_c"]), *recording.temperatures_c().items()):
        rows.append((f"temperature, {name}", f"{values.min():.2f} to {values.max():.2f} °C"))
    rows.append(("air pressure", f"{recording['pressure_hpa'].mean():.1f} hPa"))
    rows.append(("relative humidity", f"{recording['humidity_percent'].mean():.0f} %"))
    rows.append(
        (
            "range constant taken off",
            f"{outcome.reduction.range_constant_m * 1e6:.1f} µm, "
            f"u = {outcome.reduction.range_constant_u_m * 1e6:.1f} µm",
        )
    )
    for cause, count in outcome.reduction.dropped.items():
        rows.append((f"readings left out: {cause}", str(count)))
    wrong = sorted((reading.as_dict() for reading in outcome.reduction.left_out), key=lambda entry: -entry["sigmas"])
    for entry in wrong[:WRONG_READINGS]:
        name = f"left out: reading {entry['name']} of {entry['of']}"
        rows.append((name, f"{with_symbols(size_in_words(entry))}; {REASONS[entry['reason']]}"))
    return rows


def _session(session: SessionEntry) -> str:
    parts = [session.command, f"{session.begin_rig_s / 3600.0:.2f} to {session.end_rig_s / 3600.0:.2f} h", session.why]
    if session.begin_utc_s is not None:
        parts.append(f"begun {datetime.fromtimestamp(session.begin_utc_s, UTC):%Y-%m-%d %H:%M} UTC")
    if session.time != "measured":
        parts.append(f"time before it {session.time}")
    return ", ".join(part for part in parts if part)


def _parameters(fit: Fit) -> list[dict[str, Any]]:
    rows = []
    for p, value, u in zip(fit.model.parameters.parameters, fit.theta, fit.theta_u, strict=True):
        factor, unit = {"m": (1e6, "µm"), "rad": (1e6, "µrad")}.get(
            p.unit, (1e6, "ppm") if p.kind == "drive_scale" else (1.0, "1")
        )
        shown_value, shown_u = round_result(value * factor, COVERAGE_FACTOR * u * factor)
        rows.append(
            {
                "name": p.name,
                "value": shown_value,
                "expanded": shown_u,
                "tolerance": plain_number(p.tolerance * factor),
                "unit": unit,
                "share": float(u / p.sigma),
            }
        )
    return rows


def _correlations(fit: Fit, limit: float = 0.9) -> list[str]:
    """Pairs of machine parameters that are known only together."""
    n = len(fit.model.parameters)
    cov = fit.covariance[:n, :n]
    corr = cov / np.sqrt(np.outer(np.diag(cov), np.diag(cov)))
    names = fit.model.parameters.names
    pairs = [(abs(corr[i, j]), i, j) for i in range(n) for j in range(i) if abs(corr[i, j]) > limit]
    return [f"{names[j]} with {names[i]}: {corr[i, j]:+.2f}" for _, i, j in sorted(pairs, reverse=True)[:12]]


def _hashes(outcome: CampaignOutcome) -> list[tuple[str, str]]:
    recording = outcome.reduction.recording
    data = hashlib.sha256()
    for name, column in recording.columns.items():
        data.update(name.encode())
        data.update(np.ascontiguousarray(column).tobytes())
    record = [("head of the campaign in the store (pkm-rig audit --head)", outcome.head)] if outcome.head else []
    return [
        *record,
        ("settings of the campaign", hashlib.sha256(recording.file.model_dump_json().encode()).hexdigest()),
        ("machine file", hashlib.sha256(recording.machine.text.encode()).hexdigest()),
        ("readings used", data.hexdigest()),
    ]
