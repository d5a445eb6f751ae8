"""The report: one self-contained HTML file without external requests, of a campaign whatever it came to."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup
from matplotlib.figure import Figure

from calibration.compensation.error_map import ErrorMap
from calibration.diagnosis.result import Quantity
from calibration.identification.prediction import predict_poses
from calibration.machine.description import COORDINATES
from calibration.reduction.figures import free_axes
from pkm_rig.report import diagnosis_pictures, diagnosis_text, maps, pictures
from pkm_rig.report.left_out_text import SHOWN
from pkm_rig.report.notation import with_symbols
from pkm_rig.report.page import Page
from pkm_rig.report.report_json import maps_of, report_json
from pkm_rig.report.words import Language, said
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.results.report_source import ReportSource
from pkm_rig.store.place import campaign_folder

NARROW_IN = 6.0  # a picture of one panel
WRONG_READINGS = 50  # the largest, by name; all are in the JSON of `identify`


class Report(NamedTuple):
    """A report as a page and as its data."""

    html: str
    data: dict[str, Any]


def report_path(campaign: str, out: Path) -> Path:
    """Where the report of a campaign is written; its data beside it, as report.json."""
    return campaign_folder(out, campaign) / "report.html"


def write_report(source: ReportSource, path: Path, language: Language | None = None) -> Report:
    """Write the report, and its data as JSON beside it. Raises OSError."""
    report = make_report(source, path, language)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(report.html, encoding="utf-8")
    path.with_suffix(".json").write_text(json.dumps(report.data, allow_nan=False, indent=1), encoding="utf-8")
    return report


def make_report(
    source: ReportSource, path: Path | None = None, language: Language | None = None, *, draw: bool = True
) -> Report:
    """The report; numbers come from its data, pictures from the source (`draw`: else empty ones, which is faster).

    Language: the rig file's, where none is said.
    """
    predicted = {} if source.outcome is None else maps_of(source.outcome)
    data = json.loads(json.dumps(report_json(source, path, predicted), allow_nan=False))
    said = "en" if source.certificate is None else source.certificate.language
    environment = Environment(
        loader=PackageLoader("pkm_rig.report", "templates"),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    page = Page(data, language or said)
    html = environment.get_template("report.html").render(
        page=page,
        data=data,
        style=Markup(_style(environment)),
        verdict=_verdict(source, page),
        sections=[] if source.outcome is None else _sections(source.outcome, data, predicted, draw=draw),
        pictures=_pictures(source, draw=draw),
        diagnosis=_diagnosis_pictures(source, draw=draw),
        parameters=[_parameter_unit(entry) for entry in data.get("parameters", ())],
        effect_units=[_effect_unit(entry) for entry in (data["diagnosis"] or {}).get("effects", ())],
        kinds=list(dict.fromkeys(entry["name"].partition(".")[0] for entry in data.get("parameters", ()))),
        most_wrong=WRONG_READINGS,
        most_wrong_of_diagnosis=SHOWN,
    )
    return Report(html, data)


def _style(environment: Environment) -> str:
    assert environment.loader is not None
    return environment.loader.get_source(environment, "style.css")[0]


def _verdict(source: ReportSource, page: Page) -> str:
    if source.outcome is None:
        return page.word(source.state)
    if source.outcome.accepted:
        return page.word("accepted_host" if source.outcome.back_end == "host" else "accepted")
    restored = said(source.outcome.restored or "nothing was activated", page.language)
    return f"{page.word(source.outcome.decision)}: {restored}"


def _parameter_unit(entry: dict[str, Any]) -> dict[str, Any]:
    factor, unit = {"m": (1e6, "µm"), "rad": (1e6, "µrad")}.get(
        entry["unit"], (1e6, "ppm") if entry["ppm"] else (1.0, "")
    )
    return {"factor": factor, "unit": unit}


def _effect_unit(entry: dict[str, Any]) -> tuple[float, str]:
    """The factor and the unit in which `diagnose` shows the size of an effect."""
    if entry["value"] is None or entry["u"] is None:
        return 1.0, entry["unit"]
    divisor, unit = diagnosis_text.unit_that_suits(Quantity("", entry["value"], entry["u"], entry["unit"]))
    return 1.0 / divisor, with_symbols(f"1 {unit}").removeprefix("1 ")


def _sections(
    outcome: CampaignOutcome, data: dict[str, Any], predicted: dict[int, ErrorMap], *, draw: bool
) -> list[dict[str, Any]]:
    reduction, simulated = outcome.reduction, outcome.simulated
    machine = reduction.recording.machine
    moves = free_axes(machine)[0].tolist()
    said = {
        "commanded": ", ".join(COORDINATES[c] for c in machine.commanded),
        "kept": ", ".join(COORDINATES[c] for c in machine.dof if c not in machine.commanded),
        "turns": bool((machine.commanded > 2).any()),
    }
    sections = []
    for entry, verified in zip(data["payloads"], outcome.verified, strict=True):
        figures = _payload_figures(outcome, verified.payload, entry["name"], predicted) if draw else {}
        uris = {name: pictures.data_uri(figure, simulated=simulated) for name, figure in figures.items()}
        blank = dict.fromkeys(("maps", "side_maps", "scatter", "orientation"), "")
        axes = [COORDINATES[c] for c in moves]
        sections.append({"entry": entry, "columns": moves, "axes": axes, **said, **blank, **uris})
    return sections


def _payload_figures(
    outcome: CampaignOutcome, payload: int, name: str, predicted: dict[int, ErrorMap]
) -> dict[str, Figure]:
    reduction, title = outcome.reduction, f"payload: {name}"
    rows = reduction.rows("verification_before", payload)
    pose = predict_poses(outcome.calibration.fit, reduction.report, reduction.observations.visits.take(rows))
    measured = f"Measured at the verification poses, {title}"
    drawn = {"orientation": pictures.orientation_plot(reduction, pose, payload)}
    if payload not in predicted:
        moves = free_axes(reduction.recording.machine)[0].tolist()
        found = maps.pose_fields(outcome.calibration.fit, reduction, payload)
        seen = maps.pose_maps(found, moves, f"Errors of the tool point, {title}")
        return drawn | {
            "scatter": pictures.coordinate_bars(reduction, payload, measured),
            **dict(zip(("maps", "side_maps"), seen, strict=False)),
        }
    fields = maps.error_fields(predicted[payload], reduction, payload)
    return drawn | {
        "maps": maps.error_maps(fields, f"Errors of the tool point, {title}"),
        "scatter": pictures.verification_scatter(reduction, payload, measured),
    }


def _pictures(source: ReportSource, *, draw: bool) -> dict[str, str]:
    figures = {}
    if draw and source.reduction is not None:
        figures["conditions"] = pictures.conditions(source.reduction)
    if draw and source.calibration is not None:
        figures["residuals"] = pictures.residuals(source.calibration)
        figures["parameters"] = pictures.parameter_plot(source.calibration)
    drawn = {name: pictures.data_uri(figure, simulated=source.header.simulated) for name, figure in figures.items()}
    return {"conditions": "", "residuals": "", "parameters": "", **drawn}


def _diagnosis_pictures(source: ReportSource, *, draw: bool) -> list[tuple[str, bool]]:
    """Pictures of the diagnosis, and whether each is a narrow one."""
    diagnosis = None if source.diagnosis is None else source.diagnosis.diagnosis
    if diagnosis is None or not draw:
        return []
    images = diagnosis_pictures.draw_all(diagnosis, source.machine)
    return [
        (pictures.data_uri(figure, simulated=source.header.simulated), figure.get_figwidth() < NARROW_IN)
        for figure in images.values()
    ]
