"""A machine that the host corrects, over the wire: calibrated, checked, its correction shown, off, and back again; then
one of its drives loses its reference, which is measured, proposed, approved and taken back.
"""

from __future__ import annotations

import re
import time
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.compensation.free_part import MOST_GROWTH
from calibration.machine.inverse import nominal_closure, nominal_drives
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.calibrate import calibrate
from pkm_rig.jobs.former_correction import SAMPLES, former_correction, partial_data, verified_correction
from pkm_rig.jobs.health import PHASE, health
from pkm_rig.jobs.life_record import DRIVE_REPLACED, note_event
from pkm_rig.jobs.partial_verification import AFTER
from pkm_rig.jobs.tables import change_to_off, last_change, roll_back, show_tables
from pkm_rig.recalibration.decisions import note
from pkm_rig.recalibration.proposals import approve, take_back
from pkm_rig.recalibration.run import Recalibration
from pkm_rig.recalibration.situation import situation_of
from pkm_rig.report.outcome_json import coordinates_json
from pkm_rig.rig.config import demo_rig_path, load_rig
from pkm_rig.rig.connection import connect_rig
from pkm_rig.rig.drive_tables import tables_line
from pkm_rig.rig.host_state import host_in_use
from pkm_rig.store.store import open_store
from pkm_rig.virtual.mock_rig import embedded_mock_rig
from tests.pkm_rig.conftest import SHORT, silent

SETTINGS = {
    **SHORT,
    "calibration_poses": 8,
    "verification_poses": 12,  # of fewer the fall is not always shown
    "verification_payloads": (0,),
    "readings_per_smr": 1,
}


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory):
    """Four cranks for three coordinates: its rig, still connected, its store, and the outcome of a short campaign."""
    path = demo_rig_path("rrr4")
    file, machine = load_rig(path)
    campaign = file.campaign.model_copy(update=SETTINGS)
    recalibration = file.recalibration.model_copy(update={"tolerance_m": 4e-5})
    file = file.model_copy(update={"campaign": campaign, "recalibration": recalibration})
    with (
        embedded_mock_rig(file, path) as mock,
        mock.clock.activity(),
        connect_rig(mock.file, machine, mock.clock, mock.bus_factory, rig_path=path) as rig,
        open_store(tmp_path_factory.mktemp("host"), hold=True) as store,
    ):
        rig.mock = mock.mock
        yield rig, store, calibrate(rig, store, silent, silent)


def test_the_correction_of_an_accepted_campaign_is_in_force(calibrated):
    rig, store, outcome = calibrated
    assert outcome.accepted
    assert outcome.back_end == "host"
    state = host_in_use(store, rig.file.rig, rig.machine.name)
    assert (state.generation, state.campaign, state.on) == (1, outcome.campaign, True)
    assert f"the host corrects by generation 1 of campaign {outcome.campaign}" in tables_line(rig, store)
    (activated,) = store.events(outcome.campaign, "activated")
    assert activated.data["largest_change"] is None
    assert len(activated.data[SAMPLES]["correction"]) == 32
    assert show_tables(rig, store)["host"]["payloads"][0]["payload_kg"] == 0.0


def test_the_machine_was_led_to_corrected_places(calibrated):
    """What was commanded after is the identified model's, before it is the nominal machine's."""
    rig, store, outcome = calibrated
    recording = store.recording(outcome.campaign)
    correction = verified_correction(store, outcome.campaign, 0)
    for phase, wanted in (("before", nominal_drives), ("after", lambda _, target: correction.drives(target))):
        rows = recording.rows(f"verification_{phase}")
        drives = wanted(rig.machine, rows.targets_m())
        assert rows.drives("commanded_m") == pytest.approx(drives, abs=3e-8)


def test_what_the_model_predicts_of_each_coordinate_is_told(calibrated):
    """Before, what was measured but for noise; after, nothing of what the drives command."""
    _, _, outcome = calibrated
    for figures in coordinates_json(outcome, 0).values():
        assert figures["commanded"]
        assert figures["predicted_before"] == pytest.approx(figures["before"], rel=0.6)
        assert figures["predicted_after"] < 0.2 * figures["predicted_before"]


def test_a_correction_that_changes_much_needs_to_be_accepted(calibrated):
    rig, store, outcome = calibrated
    samples, source = former_correction(rig, store, "another", 0)
    assert source == f"campaign {outcome.campaign}"
    assert former_correction(rig, store, outcome.campaign, 0) is None
    assert samples.largest_difference(outcome.written[0].table.corrections) < 1e-9


def test_switched_off_it_is_not_checked_and_comes_back(calibrated):
    rig, store, outcome = calibrated
    change_to_off(rig, store)
    assert rig.host is None
    with pytest.raises(CampaignRefused, match=re.escape(f"the correction of calibration {outcome.campaign}")):
        health(rig, store, silent, silent)
    roll_back(rig, store, last_change(rig, store))
    assert host_in_use(store, rig.file.rig, rig.machine.name).on


def test_targets_beyond_what_was_measured_have_no_correction(calibrated):
    rig, _, outcome = calibrated
    correction = outcome.written[0].table
    beyond = np.zeros((1, 6))
    beyond[0, 0] = rig.machine.commanded_limits[0, 1] * 1.5
    with pytest.raises(InputError, match="were measured, beyond them there is none"):
        correction.drives(beyond)


LOST_RAD = 3e-4
LIFE = """[recalibration]
tolerance_m = 9e-5
alone = true
windows = [{ begin = "00:00", end = "00:00" }]
[recalibration.envelope]
table_m = 1e-9
"""


@pytest.fixture(scope="module")
def proposed(calibrated, tmp_path_factory):
    """The first crank counts from elsewhere, which somebody enters: what a scheduled run does, and what follows."""
    rig, store, _ = calibrated
    path = tmp_path_factory.mktemp("proposed") / "rig.toml"
    path.write_text(demo_rig_path("rrr4").read_text(encoding="utf-8") + LIFE, encoding="utf-8")
    file, _ = load_rig(path)
    campaign = file.campaign.model_copy(update=SETTINGS)
    rig.file = rig.file.model_copy(update={"campaign": campaign, "recalibration": file.recalibration})
    rig.mock.drives[0].recount(LOST_RAD)

    def now():
        return situation_of(store, rig.file, rig.machine, time.time())

    @contextmanager
    def connect():
        yield rig

    note(store, now(), "reference lost", "a", "tester", "the battery was empty")
    result = Recalibration(path, path.parent, store, connect, silent, silent).run(scheduled=True)
    return result, now, host_in_use(store, rig.file.rig, rig.machine.name)


def test_beyond_the_envelope_the_former_correction_stays_and_a_proposal_waits(calibrated, proposed):
    _, store, outcome = calibrated
    result, now, in_use = proposed
    assert (result.done, result.alarm, now().proposal.campaign) == ("proposal", True, result.campaign)
    assert "a drive's correction would change by" in result.why
    assert (in_use.campaign, in_use.on) == (outcome.campaign, True)
    phases = {
        phase: len(set(store.recording(result.campaign).rows(phase)["visit"])) for phase in ("calibration", AFTER)
    }
    assert phases == {"calibration": 10, AFTER: 12}


def test_what_was_brought_up_to_date_is_the_same_when_it_is_fitted_anew(calibrated, proposed):
    """It takes the tool by what the crank has lost."""
    _, store, outcome = calibrated
    campaign = proposed[0].campaign
    assert partial_data(store, "embedded-rrr4", campaign)["prior"] == outcome.campaign
    assert partial_data(store, "embedded-rrr4", outcome.campaign) is None
    rows = store.recording(campaign).rows(AFTER)
    corrections = [verified_correction(store, name, 0) for name in (outcome.campaign, campaign)]
    former, new = (correction.drives(rows.targets_m()) for correction in corrections)
    assert rows.drives("commanded_m") == pytest.approx(new, abs=3e-8)
    constants = [correction.fit.value("range.constant")[0] for correction in corrections]
    assert constants[0] != 0.0
    assert constants[1] == 0.0  # the few readings of its nests would leave a scale of some ppm in the tool's error
    _, jac = nominal_closure(rows.machine, rows.targets_m())
    jac = jac[:, rows.machine.commanded]
    lost = LOST_RAD * jac[:, :, 0]
    assert np.einsum("nkd,nd->nk", jac, new - former) == pytest.approx(lost, abs=0.2 * np.abs(lost).max())


def test_internal_force_is_taken_away_as_by_a_whole_calibration(calibrated, proposed):
    """By its own model: less than without a free part, and the tool's uncertainty within what that may cost."""
    _, store, outcome = calibrated
    for campaign in (outcome.campaign, proposed[0].campaign):
        correction, target_m = (
            verified_correction(store, campaign, 0),
            store.recording(campaign).rows(AFTER).targets_m(),
        )
        assert correction.free is not None
        assert 0.0 < correction.free.u_growth <= MOST_GROWTH
        with_free, without = (
            np.sqrt(np.mean(each.forces_n(each.drives(target_m), target_m) ** 2))
            for each in (correction, replace(correction, free=None))
        )
        assert with_free < without


def test_a_proposal_is_approved_checked_with_and_taken_back(calibrated, proposed):
    rig, store, outcome = calibrated
    result, now, _ = proposed
    proposal = now().proposal
    approved = approve(rig, store, proposal, "tester", "looked at", time.time)
    state = host_in_use(store, rig.file.rig, rig.machine.name)
    assert (state.campaign, approved) == (result.campaign, {"host": f"generation {state.generation}"})
    last = now().history.last_calibration
    assert (last.id, last.extent, now().state) == (result.campaign, "drive offset", "fit")
    assert last.as_found.position_m > 3.0 * last.as_left.position_m
    check = health(rig, store, silent, silent)
    rows = store.recording(check.fact.id).rows(PHASE)
    wanted = verified_correction(store, last.id, 0).drives(rows.targets_m())
    assert rows.drives("commanded_m") == pytest.approx(wanted, abs=3e-8)
    assert (check.verdict.state, check.fact.calibration) == ("fit", last.id)
    assert len(np.unique(rows["pose"])) >= 4
    assert check.fact.error.position_m < 2e-5
    with pytest.raises(InputError, match="is not that of calibration"):
        take_back(rig, store, now().key, "another", last.tables, "tester", "worse")
    use = take_back(rig, store, now().key, last.id, last.tables, "tester", "worse")
    state = host_in_use(store, rig.file.rig, rig.machine.name)
    assert (state.campaign, use) == (outcome.campaign, state.in_words())
    assert now().history.last_calibration.id == outcome.campaign
    note_event(rig, store, DRIVE_REPLACED, {"part": "b"})
    with pytest.raises(InputError, match="drive b was replaced since"):
        approve(rig, store, proposal, "tester", "again", time.time)
