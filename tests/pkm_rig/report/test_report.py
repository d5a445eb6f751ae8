"""Reports of campaigns that came to an end, or not: numbers, figures, sentences."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from datetime import date

import jsonschema
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.quiver import Quiver
from matplotlib.text import Text

from calibration.compensation.error_map import ErrorMap
from calibration.compensation.tables import table_for_payload
from calibration.identification.calibration import identify_recording
from calibration.reduction.reduction import reduce
from pkm_rig.jobs.acceptance import evaluate_campaign
from pkm_rig.jobs.standard_figures import standard_result
from pkm_rig.report import maps, pictures
from pkm_rig.report.html import make_report
from pkm_rig.report.identity_json import identity_json
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt
from pkm_rig.results.outcome import WrittenTable
from pkm_rig.results.report_source import DriveTables, ReportSource
from pkm_rig.rig.certificate_section import CertificateSection
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.recalibration_sections import CertificateEntry
from pkm_rig.rig.standard_visits import axis_visits, pose_visits
from tests.pkm_rig.diagnosis_example import example, wrong_readings
from tests.pkm_rig.plant_recording import record
from tests.pkm_rig.report.page_numbers import complaint, complaints

TEMPERATURES = {"struts": 21.0, "columns": 21.5, "base": 22.0, "platform": 22.0}


def with_verification_after(recording, share):
    """The recording with its verification once more, as after compensation: errors are `share` of what they were."""
    phase = np.asarray(recording["phase"])
    before = np.flatnonzero(phase == "verification_before")
    again = recording.take(np.concatenate([np.arange(len(recording)), before]))
    columns = {name: column.copy() for name, column in again.columns.items()}
    count, added = len(recording), slice(len(recording), None)
    columns["phase"] = columns["phase"].astype("U20")
    columns["phase"][added] = "verification_after"
    columns["uid"] = columns["uid"].astype("U20")
    columns["uid"][added] = [f"after-{i}" for i in range(len(before))]
    columns["visit"][added] += columns["visit"].max() + 1.0
    columns["sequence"][added] = np.arange(count, count + len(before))
    reduction = reduce(recording)
    for payload in (0, 1):
        rows = reduction.rows("verification_before", payload)
        shift = reduction.report.frame.rotation @ (reduction.errors(rows)[0] * (1.0 - share)).T
        of_pose = dict(zip(reduction.info.pose[rows].tolist(), shift.T, strict=True))
        for i in range(count, count + len(before)):
            if columns["payload"][i] == payload:
                off = of_pose[int(columns["pose"][i])]
                for axis, name in enumerate(("x_m", "y_m", "z_m")):
                    columns[name][i] -= off[axis]
    return replace(again, columns=columns)


@pytest.fixture(scope="module")
def recording():
    return with_verification_after(record(4, calibration_poses=12), 0.3)


@pytest.fixture(scope="module")
def outcome(recording):
    identification = identify_recording(recording)
    drives = {
        "left": {"generation": 3, "crc": 0x00AB12CD, "active": True},
        "right": {"generation": 3, "crc": 7, "active": True},
    }
    written = tuple(WrittenTable(table_for_payload(identification, n, TEMPERATURES), n, drives) for n in (0, 1))
    return evaluate_campaign(
        recording.file.campaign, identification, recording, written, DiagnosisAttempt(None, "left out here"),
        previous_tables="the former tables", limits_m={0: 60e-6},
    )  # fmt: skip


def source_of(outcome, **changes):
    changes |= {"outcome": changes.pop("verdict")} if "verdict" in changes else {}
    recording = outcome.reduction.recording
    return ReportSource(**{
        "campaign": outcome.campaign, "header": recording.file, "machine": recording.machine, "head": "ab" * 32,
        "state": "accepted", "step": "", "recording": recording, "reduction": outcome.reduction,
        "calibration": outcome.calibration, "diagnosis": outcome.diagnosis, "outcome": outcome,
        "tables": DriveTables("no table in use on all drives", "left: generation 3"), "limits_m": {0: 60e-6},
    } | changes)  # fmt: skip


@pytest.fixture(scope="module")
def accepted(outcome):
    assert outcome.accepted
    return make_report(source_of(outcome))


def test_every_number_of_the_page_is_the_data_s(accepted):
    wrong, count = complaints(*accepted)
    assert not wrong, wrong[:10]
    assert count > 600


@pytest.mark.parametrize("key", ["payloads.0.after.position_rms_m", "payloads.0.fall_m", "parameters.0.u"])
def test_the_check_of_numbers_notices_a_wrong_one(accepted, key):
    html, data = accepted
    spoilt = json.loads(json.dumps(data))
    entry = spoilt
    *path, last = key.split(".")
    for part in path:
        entry = entry[int(part)] if isinstance(entry, list) else entry[part]
    entry[last] *= 1.5
    assert bool(complaints(html, spoilt)[0]) == (f'data-key="{key}"' in html)
    assert complaints(html.replace("<p>", "<p>12.3 ", 1), data)[0]


@pytest.mark.parametrize(("text", "good"), [("0.79", True), ("0.78", False), ("0.790", False), ("0.8", False)])
def test_an_uncertainty_is_rounded_up_to_two_digits(text, good):
    attributes = {"data-key": "u", "data-round": "U", "data-factor": "1.0"}
    assert (not complaint(attributes, text, {"u": 0.7801})) == good


def test_the_json_beside_the_page_fits_the_schema(accepted, request):
    schema = json.loads((request.config.rootpath / "docs" / "reference" / "result.schema.json").read_text())
    jsonschema.validate(accepted.data, {**schema, "anyOf": [{"$ref": "#/$defs/report"}]})


def test_refused_and_without_tables(outcome):
    verdict = replace(outcome.verified[1], decision=replace(outcome.verified[1].decision, verdict="refused"))
    refused = replace(outcome, verified=(outcome.verified[0], verdict), restored="the former tables")
    html, data = make_report(source_of(refused, state="refused", tables=None), draw=False)
    assert not complaints(html, data)[0]
    assert "Refused: the former tables" in html
    assert "Accepted" not in html


def test_measured_and_interrupted_and_nothing_measured(outcome):
    without = {"limits_m": {}, "verdict": None}
    measured = make_report(source_of(outcome, **without, state="measured"), draw=False)
    stopped = make_report(
        source_of(outcome, **without, state="interrupted", calibration=None, why="interrupted 3 times"), draw=False
    )
    empty = make_report(source_of(
        outcome, **without, state="failed", why="drive 'left': no answer", recording=None, reduction=None,
        calibration=None, diagnosis=None, not_reduced="nothing was measured",
    ))  # fmt: skip
    for html, data in (measured, stopped, empty):
        assert not complaints(html, data)[0]
        assert data["accepted"] is False
    assert "Measured, not verified" in measured.html
    assert 'data-key="parameters.0.value"' in measured.html
    assert "Interrupted" in stopped.html
    assert "interrupted 3 times" in stopped.html
    assert "Nothing was measured." in empty.html


def sections(**station):
    first = {"instrument": "station", "model": "AT", "serial": "17", "number": "K-1", "due": "2027-01-01"}
    length = first | {"instrument": "nest_length", "serial": "3", "calibrated": "2025-01-01"}
    return {
        "certificate": CertificateSection.model_validate({
            "customer": {"name": "A & B <GmbH>", "city": "Ulm", "country": "DE"}, "operator": "N. N.",
            "machine": {"serial": "0042"}, "language": "de",
        }),
        "certificates": tuple(CertificateEntry.model_validate(entry) for entry in (first | station, length)),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("instrument", "state", "reason"),
    [
        ({}, "valid", None),
        ({"due": "2025-12-31"}, "lapsed", "due on 2025-12-31"),
        ({"calibrated": "2026-01-02"}, "unknown", "calibrated on 2026-01-02"),
        ({"serial": None}, "unknown", "no serial number is stated"),
        ({"serial": "18"}, "unknown", "serial number 17, stated is 18"),
        ({"instrument": "thermometer"}, "valid", "no certificate of the station"),
    ],
)
def test_traceable_only_with_valid_certificates_of_what_answered(outcome, instrument, state, reason):
    answered = {"station": {"name": "AT", "serial": 17}, "drives": {"left": 1, "right": 2}}
    identity = identity_json(source_of(outcome, **sections(**instrument), answered=answered))
    assert identity["measured"] == [date(2026, 1, 1).isoformat()] * 2
    assert identity["instruments"][0]["state"] == state
    assert identity["traceable"] == (reason is None)
    if reason is not None:
        assert reason in " ".join(identity["not_traceable"])


def test_a_simulated_one_in_german_with_names_that_html_would_read(outcome):
    header = outcome.reduction.recording.file.model_copy(update={"simulated": True})
    html, data = make_report(source_of(outcome, verdict=None, header=header, **sections()), draw=False)
    assert not data["identity"]["traceable"]
    assert "SIMULATED (simuliert)" in html
    assert "Kalibrierbericht" in html
    assert "A &amp; B &lt;GmbH&gt;" in html
    assert not complaints(html, data)[0]


def test_what_the_diagnosis_left_out_is_listed_the_largest_first(outcome):
    diagnosed = replace(outcome, diagnosis=DiagnosisAttempt(replace(example(), left_out=wrong_readings(7))))
    html, data = make_report(source_of(diagnosed), draw=False)
    assert not complaints(html, data)[0]
    assert [r["name"] for r in data["diagnosis_left_out_in_words"]] == [f"r{i}" for i in range(6, -1, -1)]
    shown = re.findall(r'data-key="diagnosis_left_out_in_words\.\d\.(?:name|visit)"[^>]*>(\w+)<', html)
    assert shown == ["r6", "60", "r5", "50", "r4", "40", "r3", "30", "r2", "20"]
    assert re.search(r'data-key="diagnosis_left_out_more"[^>]*>2</span> more wrong readings', html)
    german = make_report(source_of(diagnosed), language="de", draw=False).html
    assert "weitere falsche Messwerte" in german
    assert "whatever an effect" not in german


def test_terms_are_explained_once(accepted):
    terms = re.findall(r"<dfn>(.*?)</dfn>", accepted.html)
    assert len(terms) == len(set(terms))
    for term in ("innovation gate", "Directions", "Reflectors", "Noise floor"):
        assert sum(term in text for text in terms) == 1, term


# --- figures of standards


@pytest.fixture(scope="module")
def rig():
    return load_rig(embedded_rig_path())


def test_figures_along_a_virtual_axis_and_a_reversal_error_that_is_put_in(rig):
    file, machine = rig
    visits = axis_visits(machine, file.campaign, "x").visits
    assert len(visits) == 110
    up = visits[0].direction

    def reversal(row):
        side = tuple(int(row.get(f"{drive}_direction", 0.0)) for drive in ("left", "right"))
        if row["phase"] == "calibration" and side != up:
            row["x_m"] -= 30e-6

    plain, spoilt = (
        standard_result(reduce(record(4, visits=visits, nest_every_visits=22, spoil=spoil)), "ISO 230-2 x")
        for spoil in (None, reversal)
    )
    assert (plain.figures.targets, plain.figures.runs) == (11, 5)
    assert plain.figures.reversal_m < 15e-6
    assert spoilt.figures.reversal_m == pytest.approx(30e-6, abs=plain.figures.reversal_m)
    assert spoilt.figures.repeatability_m - plain.figures.repeatability_m == pytest.approx(30e-6, abs=12e-6)
    assert plain.span_m[0] < -0.3 < 0.3 < plain.span_m[1]


def test_the_page_names_the_formulae_and_only_where_the_campaign_was_made_for_them(rig, accepted):
    _, machine = rig
    recording = record(4, visits=pose_visits(machine).visits, nest_every_visits=30)
    reduction = reduce(recording)
    found = standard_result(reduction, "ISO 9283")
    assert len(found.poses) == 5
    assert found.poses[0][0] == (0.0, 0.0, 0.0)
    assert all(5e-6 < figures.repeatability_m < 40e-6 for _, figures in found.poses)
    source = ReportSource(
        "plant-4", recording.file, machine, "", "measured", "", recording=recording, reduction=reduction,
        not_identified="made for a standard", standard=found,
    )  # fmt: skip
    html, data = make_report(source)
    assert "evaluated with the formulae of <cite>ISO 9283</cite>" in html
    assert not complaints(html, data)[0]
    assert "formulae of" not in accepted.html


# --- pictures


def drawn(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return canvas.get_renderer()


def overlapping(figure):
    """Pairs of texts whose boxes overlap by more than a point."""
    renderer = drawn(figure)
    hidden = {
        id(label)
        for axes in figure.axes
        for axis in (axes.xaxis, axes.yaxis)
        for tick in axis.get_major_ticks() + axis.get_minor_ticks()
        if not axis.get_view_interval()[0] <= tick.get_loc() <= axis.get_view_interval()[1]
        for label in (tick.label1, tick.label2)
    }
    texts = [
        t
        for t in figure.findobj(Text)
        if t.get_visible() and t.get_text().strip() and t.get_text() != "SIMULATED" and id(t) not in hidden
    ]
    boxes = [(t.get_text(), t.get_window_extent(renderer).padded(-1.0)) for t in texts]
    inside = [(text, box) for text, box in boxes if box.width > 0 and box.height > 0]
    return [(a, b) for i, (a, one) in enumerate(inside) for b, two in inside[:i] if one.overlaps(two)]


def test_errors_predicted_at_the_poses_are_those_measured_there_but_for_noise(outcome):
    fields = {name: error for name, _, error in maps.pose_fields(outcome.calibration.fit, outcome.reduction, 0)}
    measured, predicted = fields["measured, before"][:, :2], fields["predicted, before"][:, :2]
    rms, rest = (float(np.sqrt(np.mean(np.sum(x**2, axis=1)))) for x in (measured, measured - predicted))
    assert rms == pytest.approx(outcome.verified[0].before.position_rms_m, rel=1e-6)
    assert rest < 0.4 * rms


def test_maps_over_two_pairs_of_coordinates_have_one_scale():
    at = np.random.default_rng(1).uniform(-0.1, 0.1, (8, 3))
    fields = [(f"{what}, before", at, 1e-5 * at) for what in ("measured", "predicted")]
    figures = maps.pose_maps(fields, (0, 1, 2), "t")
    assert len(figures) == 2
    keys = {figure.get_suptitle().split("; ")[1] for figure in figures}
    assert len(keys) == 1
    assert maps.pose_maps(fields, (2,), "t") == []


def all_figures(outcome):
    reduction = outcome.reduction
    grid = np.stack(np.meshgrid(np.linspace(-0.35, 0.35, 7), np.linspace(-0.3, 0.3, 7)), axis=-1).reshape(-1, 2)
    predicted = ErrorMap(grid, 1e-4 * grid[:, ::-1], 1e-6 * grid, np.full(len(grid), 1e-6))
    return {
        "maps": maps.error_maps(maps.error_fields(predicted, reduction, 1), "payload: plate 200 kg"),
        "pose maps": maps.pose_maps(maps.pose_fields(outcome.calibration.fit, reduction, 1), (0, 1), "title")[0],
        "bars": pictures.coordinate_bars(reduction, 1, "title"),
        "scatter": pictures.verification_scatter(reduction, 1, "title"),
        "conditions": pictures.conditions(reduction),
        "residuals": pictures.residuals(outcome.calibration),
        "parameters": pictures.parameter_plot(outcome.calibration),
    }


def test_no_label_lies_on_another_and_no_legend_on_a_curve(outcome):
    for name, figure in all_figures(outcome).items():
        assert not overlapping(figure), name
        renderer = figure.canvas.get_renderer()
        for axes in figure.axes:
            if axes.get_legend() is not None:
                box = axes.get_legend().get_window_extent(renderer).padded(-1.0)
                assert not box.overlaps(axes.get_window_extent(renderer)), name


def test_all_maps_have_one_scale_and_no_arrow_is_clipped(outcome):
    figure = all_figures(outcome)["maps"]
    quivers = [(axes, arrows) for axes in figure.axes for arrows in axes.findobj(Quiver)]
    assert len(quivers) == 4
    assert len({arrows.scale for _, arrows in quivers}) == 1
    for axes, arrows in quivers:
        tips = arrows.XY + np.stack([arrows.U, arrows.V], axis=1) / arrows.scale
        (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
        assert np.all((tips > (left, low)) & (tips < (right, high)))


DICHROMATS = {  # Machado, Oliveira and Fernandes 2009, severity 1, on linear RGB
    "protan": ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216), (-0.003882, -0.048116, 1.051998)),
    "deutan": ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413), (-0.011820, 0.042940, 0.968881)),
    "tritan": ((1.255528, -0.076749, -0.178779), (-0.078411, 0.930809, 0.147602), (0.004733, 0.691367, 0.303900)),
}


def lab(colour, sight):
    rgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    linear = np.clip(np.array(DICHROMATS[sight]) @ linear, 0.0, 1.0)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = to_xyz @ linear / np.array([0.9505, 1.0, 1.089])
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("sight", DICHROMATS)
def test_colours_that_the_colour_blind_can_tell(sight):
    assert np.linalg.norm(lab(pictures.BEFORE, sight) - lab(pictures.AFTER, sight)) > 40.0
    used = pictures.SERIES[:5]
    apart = [np.linalg.norm(lab(a, sight) - lab(b, sight)) for i, a in enumerate(used) for b in used[:i]]
    assert min(apart) > 10.0
