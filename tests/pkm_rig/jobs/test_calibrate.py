"""The main job on a short campaign, over the real protocols of the embedded mock rig."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import jsonschema
import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.machine.description import load_machine, shipped_machine
from calibration.recording.folder import read_folder, write_folder
from calibration.reduction.left_out import LeftOutReading
from drivers.drives.table_image import encode_table
from pkm_rig.jobs.acceptance import stored_outcome
from pkm_rig.jobs.calibrate import calibrate
from pkm_rig.jobs.certificate import Wanted, issue
from pkm_rig.jobs.identify import identify_with_checks
from pkm_rig.jobs.measure import measure
from pkm_rig.jobs.report import report_source
from pkm_rig.jobs.verify import verify
from pkm_rig.report.diagnosis_text import diagnosis_line
from pkm_rig.report.html import make_report, write_report
from pkm_rig.report.notation import with_symbols
from pkm_rig.report.outcome_json import outcome_json
from pkm_rig.report.outcome_text import print_outcome, short_table
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt
from pkm_rig.rig.certificate_section import CertificateSection
from pkm_rig.store.audit import audit
from pkm_rig.store.store import Store
from tests.pkm_rig.conftest import FEWER, mock_and_rig, short_rig_file, silent
from tests.pkm_rig.report.page_numbers import complaints
from tests.pkm_rig.rig.test_rig import flat_table


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """One short calibration and what it left behind."""
    out = tmp_path_factory.mktemp("short")
    file, machine = short_rig_file(seed=4)
    store = Store(out / "store.sqlite")
    phases = set()
    with mock_and_rig(file, machine) as (mock, rig):
        outcome = calibrate(rig, store, silent, lambda _advance, _total, phase: phases.add(phase))
        states = [bank.state() for bank in rig.banks]
        trip = rig.supervisor.trip
        drives = [(drive.compensation.mode, drive.compensation.active_bank) for drive in mock.drives]
    assert {"payload exchange", "identifying", "diagnosing"} < phases  # what takes long without a reading
    yield outcome, store, out, states, trip, drives
    store.close()


@pytest.fixture(scope="module")
def report(run):
    """Its report with pictures and the data beside it, as written; reading it changes nothing."""
    outcome, store, out, *_ = run
    path = out / "report.html"
    write_report(report_source(store, outcome.campaign, outcome), path)
    return path.read_text(encoding="utf-8"), path.with_suffix(".json").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def rebuilt(run):
    """The outcome once more, from the store alone."""
    outcome, store, *_ = run
    return stored_outcome(store, outcome.campaign)


@pytest.fixture(scope="module")
def identified(run):
    """What is identified in the store's recording."""
    outcome, store, *_ = run
    return identify_with_checks(store.recording(outcome.campaign), "map")


def test_error_falls_and_the_tables_stay(run):
    outcome, _, _, states, _, drives = run
    assert outcome.accepted
    for verified in outcome.verified:
        assert verified.after.position_rms_m < 0.6 * verified.before.position_rms_m
        assert "the tables stay" in verified.decision.rule
    assert [v.payload_kg for v in outcome.verified] == [0.0, 200.0]
    assert all(state.on and state.valid and state.payload_kg == 200.0 for state in states)
    assert all(mode == 1 and bank in (1, 2) for mode, bank in drives)


def test_a_clean_campaign_trips_nothing(run):
    assert run[4] is None


def test_every_planned_reading_is_in_the_store_once(run):
    outcome, store, *_ = run
    recording = store.recording(outcome.campaign)
    assert len(set(recording["uid"].tolist())) == len(recording)
    np.testing.assert_array_equal(recording["sequence"], np.arange(len(recording)))
    kinds = [event.kind for event in store.events(outcome.campaign)]
    assert kinds.count("finished") == kinds.count("started")
    assert {"identified", "activated", "accepted"} <= set(kinds)
    phases = set(np.asarray(recording["phase"]).tolist())
    assert phases == {"repeatability", "nests", "calibration", "verification_before", "verification_after"}
    assert set(np.unique(recording["left_direction"])) == {-1.0, 1.0}


def test_each_payload_is_asked_for_and_acknowledged_in_the_record(run):
    outcome, store, *_ = run
    exchanges = [event for event in store.events(outcome.campaign) if event.kind.startswith("payload_")]
    asked, on = exchanges[::2], exchanges[1::2]
    assert [event.data["payload"] for event in asked] == [event.data["payload"] for event in on] == [2, 0, 1]
    assert [(event.data["name"], event.data["mass_kg"]) for event in asked][2] == ("plate 200 kg", 200.0)
    for event in on:
        assert event.data["acknowledged_by"].startswith("PLC (")
        assert event.data["simulated"]
    (found,) = audit(store, outcome.campaign)
    assert found.state == "whole"


def test_200_kg_was_never_calibrated(run):
    recording = run[0].reduction.recording
    calibrated = np.asarray(recording["phase"]) == "calibration"
    assert set(recording["payload_mass_kg"][calibrated].tolist()) == {0.0, 400.0}


def test_json_fits_the_schema(run, identified, request):
    schema = json.loads((request.config.rootpath / "docs" / "reference" / "result.schema.json").read_text())
    outcome, _, out, *_ = run
    result = json.loads(json.dumps(outcome_json(outcome, out / "report.html"), allow_nan=False))
    jsonschema.validate(result, {**schema, "anyOf": [{"$ref": "#/$defs/calibration"}]})
    wrong = LeftOutReading("a-reading", "P1", 1.2e-3, "m", 9.0, "model gate")
    reduction = replace(outcome.reduction, left_out=(wrong,), dropped={"model gate": 1})
    result = json.loads(json.dumps(outcome_json(replace(outcome, reduction=reduction), None), allow_nan=False))
    jsonschema.validate(result, {**schema, "anyOf": [{"$ref": "#/$defs/calibration"}]})
    assert result["left_out"] == [wrong.as_dict()]
    assert result["dropped"] == {"model gate": 1}
    jsonschema.validate(
        json.loads(json.dumps(identified, allow_nan=False)),
        {**schema, "anyOf": [{"$ref": "#/$defs/identification"}]},
    )


def test_the_diagnosis_is_told_stored_and_reported(run, rebuilt, report, request):
    outcome, store, *_ = run
    schema = json.loads((request.config.rootpath / "docs" / "reference" / "diagnosis.schema.json").read_text())
    assert outcome.diagnosis.failure == ""
    told = outcome_json(outcome, None)["diagnosis"]
    jsonschema.validate(json.loads(json.dumps(told, allow_nan=False)), schema)
    (event,) = store.events(outcome.campaign, "diagnosed")
    assert event.data["verdict"] == told["verdict"] == rebuilt.diagnosis.diagnosis.verdict
    line = with_symbols(diagnosis_line(outcome.diagnosis))
    assert line.split(";")[0] in report[0]


def test_a_diagnosis_that_fails_costs_one_line(run):
    outcome, store, *_ = run
    failed = replace(outcome, diagnosis=DiagnosisAttempt(None, "too few readings"))
    assert outcome_json(failed, None)["diagnosis"] == {"failure": "too few readings"}
    page = make_report(report_source(store, outcome.campaign, failed), draw=False)
    assert "diagnosis: too few readings" in page.html


def test_a_campaign_on_the_mock_says_that_it_is_simulated(run, identified, report, capsys):
    outcome, store, *_ = run
    assert store.recording(outcome.campaign).file.simulated
    assert outcome_json(outcome, None)["simulated"]
    assert identified["simulated"]
    print_outcome(outcome, None)
    assert capsys.readouterr().out.startswith("SIMULATED")
    assert "SIMULATED: by simulated devices" in report[0]


def test_a_certificate_s_number_is_used_once_and_a_mock_s_is_never_signed(run, tmp_path):
    pytest.importorskip("dcclib")
    outcome, store, *_ = run
    file = short_rig_file()[0]
    party = {"name": "A", "city": "B", "country": "DE"}
    section = CertificateSection.model_validate({
        "laboratory": party, "customer": party, "machine": {"manufacturer": "M", "serial": "1"},
        "operator": "O", "procedure": "P",
    })  # fmt: skip
    file = file.model_copy(update={"certificate": section})

    def issued(**wanted):
        return issue(store, outcome.campaign, tmp_path, Wanted(**wanted), file, outcome=outcome)

    with pytest.raises(InputError, match="never signed"):
        issued(key=lambda: pytest.fail("the key was opened"))
    with pytest.raises(InputError, match=r"not stated: laboratory\.name"):
        issue(store, outcome.campaign, tmp_path, Wanted(), outcome=outcome)
    assert not store.events(outcome.campaign, "certificate")
    first, second = issued(), issued()
    assert (first["number"], second["number"]) == (f"PKM-{outcome.campaign}-1", f"PKM-{outcome.campaign}-2")
    with pytest.raises(InputError, match="issued: PKM"):
        issued(replaces=("amended", "PKM-other", "wrong place"))
    third = issued(replaces=("substituted", second["number"], "wrong place"))
    with pytest.raises(InputError, match=f"was replaced by {third['number']}"):
        issued(replaces=("amended", second["number"], "once more"))
    paths = [Path(one[kind]) for one in (first, second, third) for kind in ("certificate", "page")]
    assert all(path.is_file() for path in paths)
    assert "SIMULATED" in paths[1].read_text(encoding="utf-8")
    assert sha256(paths[4].read_bytes()).hexdigest() == third["sha256"]
    paths[0].unlink()
    assert issued()["number"].endswith("-4")
    assert audit(store, outcome.campaign)[0].state == "whole"


def test_report_is_one_file_without_outside_requests(run, report):
    outcome, (text, data) = run[0], report
    wrong, count = complaints(text, json.loads(data))
    assert not wrong, wrong[:10]
    assert count > 600
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:|#)""", text)
    assert "@import" not in text
    assert "url(" not in text
    assert text.count('src="data:image/png;base64,') >= 9
    for verified in outcome.verified:
        assert with_symbols(verified.decision.rule).replace(">", "&gt;") in text
    assert "not an accredited certificate" in text.lower()


def test_a_recording_folder_gives_the_same_result_as_the_store(run, identified):
    outcome, store, out, *_ = run
    recording = store.recording(outcome.campaign)
    write_folder(recording, out / "export")
    again = read_folder(out / "export")
    for name, column in recording.columns.items():
        np.testing.assert_array_equal(column, again.columns[name], err_msg=name)
    assert identify_with_checks(again, "map") == identified
    other = Store(out / "other.sqlite")
    other.add_recording(again)
    assert identify_with_checks(other.recording(outcome.campaign), "map") == identified
    other.close()


def test_the_outcome_can_be_rebuilt_from_the_store(run, rebuilt):
    assert short_table(rebuilt) == short_table(run[0])


def test_a_machine_without_errors_is_refused_and_the_former_tables_come_back(tmp_path):
    # No geometric errors, no expansion, no payload at the verification: next to nothing to correct.
    text = shipped_machine("planar4").read_text(encoding="utf-8")
    (tmp_path / "cold.toml").write_text(re.sub(r"(coefficient_per_k|u_per_k) = \S+", r"\1 = 0.0", text))
    file, _ = short_rig_file(seed=6, verification_payloads=(0,))
    mock_section = file.mock.model_copy(update={"error_scale": 0.0})
    file = file.model_copy(update={"mock": mock_section, "machine": str(tmp_path / "cold.toml")})
    machine = load_machine(tmp_path / "cold.toml")
    store = Store(tmp_path / "store.sqlite")
    with mock_and_rig(file, machine) as (_, rig):
        rig.enable()
        images = [encode_table(image) for image in rig.images(flat_table(0.0, 0.0), 7)]
        rig.bring_tables_to(images, on=True)
        former = [bank.state() for bank in rig.banks]
        outcome = calibrate(rig, store, silent, silent)
        after = [bank.state() for bank in rig.banks]
    assert not outcome.accepted
    assert "former tables come back" in outcome.verified[0].decision.rule
    assert [(s.on, s.generation, s.crc) for s in after] == [(True, 7, s.crc) for s in former]
    assert store.events(outcome.campaign, "refused")
    store.close()


def test_measure_then_verify_continues_the_campaign_even_after_a_broken_attempt(tmp_path):
    file, machine = short_rig_file(seed=4, verification_payloads=(0,))
    store = Store(tmp_path / "store.sqlite")
    with mock_and_rig(file, machine) as (_, rig):
        campaign = measure(rig, store, silent, silent)
        measured = len(store.recording(campaign))

        def breaks(advance, total, what):
            if what == "verification_after":
                raise KeyError("somebody pulled a plug")

        with pytest.raises(KeyError):
            verify(rig, store, campaign, silent, breaks)
        assert not any(bank.state().on for bank in rig.banks)
        broken = len(store.recording(campaign))
        assert broken > measured
        rig.drives.clear_stop()
        outcome = verify(rig, store, campaign, silent, silent)
    recording = store.recording(campaign)
    np.testing.assert_array_equal(recording["sequence"], np.arange(len(recording)))
    assert outcome.accepted
    assert outcome.verified[0].before.n == FEWER["verification_poses"]
    assert outcome.verified[0].after.n == FEWER["verification_poses"]
    assert short_table(stored_outcome(store, campaign)) == short_table(outcome)
    store.close()
