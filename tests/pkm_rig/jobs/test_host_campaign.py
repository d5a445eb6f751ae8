"""A machine that the host corrects, over the wire: calibrated, checked, its correction shown, off, and back again."""

from __future__ import annotations

import re

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.machine.inverse import nominal_drives
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs.calibrate import calibrate
from pkm_rig.jobs.former_correction import SAMPLES, former_correction, verified_correction
from pkm_rig.jobs.health import PHASE, health
from pkm_rig.jobs.tables import change_to_off, last_change, roll_back, show_tables
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
    "verification_poses": 4,
    "verification_payloads": (0,),
    "readings_per_smr": 1,
    "speeds_m_per_s": (0.4, 0.2),
    "dwells_s": (1.0, 1.5),
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


def test_health_leads_the_machine_with_the_correction(calibrated):
    rig, store, outcome = calibrated
    result = health(rig, store, silent, silent)
    assert result.verdict.state == "fit"
    rows = store.recording(result.fact.id).rows(PHASE)
    assert len(np.unique(rows["pose"])) >= 4
    wanted = verified_correction(store, outcome.campaign, 0).drives(rows.targets_m())
    assert rows.drives("commanded_m") == pytest.approx(wanted, abs=3e-8)
    assert result.fact.error.position_m < 2e-5


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
