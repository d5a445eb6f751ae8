"""Tables by direction: from what a diagnosis has found to what the drives add, and back out of the store."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.compensation.samples import CorrectionSamples
from calibration.diagnosis.result import FoundEffect, FoundPlace, Quantity
from calibration.machine.description import load_machine, shipped_machine
from pkm_rig.jobs import acceptance
from pkm_rig.jobs import calibrate as calibrate_job
from pkm_rig.jobs import verify as verify_job
from pkm_rig.jobs.acceptance import stored_outcome
from pkm_rig.jobs.former_correction import SAMPLES
from pkm_rig.jobs.report import report_source
from pkm_rig.jobs.reversals import diagnosed_reversals, stored_reversals
from pkm_rig.jobs.tables import change_to_off, last_change, roll_back
from pkm_rig.recalibration.envelope import largest_difference_m
from pkm_rig.report.html import make_report
from pkm_rig.results.diagnosis_attempt import DiagnosisAttempt
from pkm_rig.rig.back_end import DriveTables
from pkm_rig.store.store import Store
from tests.drivers.drives.test_table_image import make_image
from tests.pkm_rig.conftest import mock_and_rig, short_rig_file, silent
from tests.pkm_rig.tables_bench import table

MACHINE = load_machine(shipped_machine("planar4"))


def found(effect, places):
    """An effect at places: name, size and its standard uncertainty in m."""
    at = tuple(FoundPlace(name, Quantity("width_m", size, u, "m"), 0.9, 1.0, 1.0) for name, size, u in places)
    return FoundEffect(effect, at[0].place, at[0].size, 0.9, 0.9, 1.0, 1.0, places=at)


def diagnosed(*effects):
    return DiagnosisAttempt(SimpleNamespace(effects=effects))


def test_only_what_exceeds_its_u_is_compensated():
    backlash = found("backlash", [("right", 2.4e-5, 1e-6), ("left", 3e-6, 1.6e-6)])
    windup = found("friction_windup", [("left", 2e-8, 1e-9)])
    np.testing.assert_array_equal(diagnosed_reversals(diagnosed(backlash, windup), MACHINE), [0.0, 2.4e-5])
    for none in (diagnosed(windup), diagnosed(), DiagnosisAttempt(None, "it failed")):
        np.testing.assert_array_equal(diagnosed_reversals(none, MACHINE), [0.0, 0.0])


def test_half_of_the_value_is_added_either_side_and_the_size_is_limited():
    made = table().with_reversals(MACHINE, np.array([3e-5, 0.0]))
    np.testing.assert_allclose(made.by_direction_m, [[1.5e-5, -1.5e-5], [0.0, 0.0]])
    with pytest.raises(InputError, match="drive left: a correction of 2020 um"):
        table().with_reversals(MACHINE, np.array([4e-3, 0.0]))


@pytest.fixture
def back_end():
    """The back end of drives that read tables by direction, or, told so, of others."""

    def make(*by_direction):
        banks = [SimpleNamespace(objects=SimpleNamespace(by_direction=can)) for can in by_direction]
        return DriveTables(SimpleNamespace(machine=MACHINE, banks=banks), SimpleNamespace())

    return make


def test_a_make_that_reads_none_gets_the_single_table(back_end):
    reversal_m = np.array([3e-5, 0.0])
    np.testing.assert_allclose(
        back_end(True, True).against_reversals(table(), reversal_m).by_direction_m[0], [1.5e-5, -1.5e-5]
    )
    assert not np.any(back_end(True, False).against_reversals(table(), reversal_m).by_direction_m)


def test_it_is_stored_found_again_and_compared_with_the_former_one(back_end):
    whole = replace(table(), start_m=np.array([0.3, 0.3]), step_m=np.array([0.75, 0.75]))  # over all of the workspace
    end, plain = back_end(True, True), whole
    turned = plain.with_reversals(MACHINE, np.array([3e-5, 0.0]))
    stored = {SAMPLES: end.samples(turned).as_json()}
    np.testing.assert_allclose(stored_reversals(stored, 2), [3e-5, 0.0])
    assert "reversal" not in end.samples(plain).as_json()
    np.testing.assert_array_equal(stored_reversals({SAMPLES: end.samples(plain).as_json()}, 2), [0.0, 0.0])
    former = CorrectionSamples.of_json(stored[SAMPLES])
    assert np.max(np.abs(end.changes_since(plain, former))) == pytest.approx(1.5e-5, abs=1e-9)
    assert np.max(np.abs(end.changes_since(turned, former))) == pytest.approx(0.0, abs=1e-9)
    with pytest.raises(InputError, match="damaged"):
        CorrectionSamples.of_json(stored[SAMPLES] | {"reversal": [1.0]})


def test_the_envelope_of_recalibration_sees_it():
    assert largest_difference_m(make_image(), make_image(up_m=2e-5, down_m=-1e-5)) == pytest.approx(2e-5)


def test_a_campaign_verifies_keeps_and_finds_again_a_table_by_direction(tmp_path, monkeypatch):
    """The diagnosis is left out, it costs most time: what it would have found is said in its place."""
    reversal_m = np.array([3e-5, 2.4e-5])
    for module in (calibrate_job, acceptance):
        monkeypatch.setattr(module, "try_diagnosis", lambda _recording: DiagnosisAttempt(None, "left out here"))
    monkeypatch.setattr(verify_job, "diagnosed_reversals", lambda _attempt, _machine: reversal_m)
    file, machine = short_rig_file(seed=4, calibration_poses=6, verification_poses=12, verification_payloads=(0,))
    effects = ("backlash=3e-5,place=left", "backlash=2.4e-5,place=right")
    file = file.model_copy(update={"mock": file.mock.model_copy(update={"effects": effects})})
    store = Store(tmp_path / "store.sqlite")
    said = []
    with mock_and_rig(file, machine) as (mock, rig):
        outcome = calibrate_job.calibrate(rig, store, said.append, silent)
        assert outcome.accepted
        images = [bank.read_image(bank.state().active) for bank in rig.banks]
        change_to_off(rig, store)
        assert [drive.compensation.mode for drive in mock.drives] == [0, 0]
        roll_back(rig, store, last_change(rig, store))
        assert [drive.compensation.mode for drive in mock.drives] == [1, 1]
        for bank, image in zip(rig.banks, images, strict=True):
            assert bank.read_image(bank.state().active).generation == image.generation
    np.testing.assert_allclose([image.up_m for image in images], 0.5 * reversal_m, atol=1e-8)
    np.testing.assert_allclose([image.down_m for image in images], -0.5 * reversal_m, atol=1e-8)
    assert any("by direction, against reversal values: left 30.0 um, right 24.0 um" in line for line in said)
    again = stored_outcome(store, outcome.campaign)
    np.testing.assert_allclose(again.written[0].table.by_direction_m, 0.5 * np.outer(reversal_m, [1.0, -1.0]))
    assert again.written[0].drives["left"]["reversal_m"] == pytest.approx(3e-5)
    page = make_report(report_source(store, outcome.campaign, outcome), draw=False).html
    assert "reversal value\N{NO-BREAK SPACE}/\N{NO-BREAK SPACE}µm" in page
