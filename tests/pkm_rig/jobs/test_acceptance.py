"""The decision on tables, against the probabilities of JCGM 106 computed by scipy, and at its exact boundaries."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats

from calibration.base.errors import InputError
from calibration.identification.calibration import identify_recording
from calibration.reduction.figures import Figures, noise_floor
from calibration.reduction.reduction import reduce
from pkm_rig.cli.rig_commands import _report_outcome
from pkm_rig.errors import CampaignRefused
from pkm_rig.jobs import report
from pkm_rig.jobs.acceptance import (
    decide,
    evaluate_campaign,
    require_possible_limits,
    stored_limits_m,
    stored_outcome,
)
from pkm_rig.jobs.added_visits import is_same_rig
from pkm_rig.report.html import report_path
from pkm_rig.results.outcome import WrittenTable
from pkm_rig.rig.campaign_sections import CampaignSettings
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.schedule import verification_block
from pkm_rig.store.place import STORE_NAME
from pkm_rig.store.store import open_store
from tests.pkm_rig.plant_recording import record

OLD_STORE = Path(__file__).parents[2] / "data" / "version_0_1" / "store.db.gz"
MICRO = st.floats(min_value=0.01, max_value=100.0).map(lambda um: um * 1e-6)


def made(rms, u):
    return Figures(rms, 2 * rms, 0.0, u, 0.0, 30)


@pytest.mark.parametrize(
    ("before", "after", "accepted"),
    [
        (made(40e-6, 2e-6), made(6e-6, 0.5e-6), True),
        (made(8e-6, 1e-6), made(6e-6, 0.5e-6), False),
        (made(20e-6, 0.1e-6), made(12e-6, 4.1e-6), False),  # U comes from after
        (made(20e-6, 4.1e-6), made(12e-6, 0.1e-6), False),  # and from before
        (made(20e-6, 0.1e-6), made(12e-6, 3.9e-6), True),
    ],
)
def test_tables_stay_only_if_the_error_falls_by_more_than_its_uncertainty(before, after, accepted):
    decision = decide(before, after)
    assert decision.accepted is accepted
    assert decision.verdict == ("accepted" if accepted else "refused")
    assert ("the tables stay" in decision.rule) is accepted


def test_a_rise_is_never_accepted():
    assert not decide(made(6e-6, 0.0), made(6e-6, 0.0)).accepted
    assert not decide(made(6e-6, 1e-7), made(60e-6, 1e-7)).accepted
    assert not decide(made(6e-6, 1e-7), made(60e-6, 1e-7), 1.0).accepted


@given(before=MICRO, after=MICRO, u_before=MICRO, u_after=MICRO, limit=MICRO)
def test_the_decision_is_that_of_the_probabilities_of_conformity(before, after, u_before, u_after, limit):
    """JCGM 106: accepted from a probability of 97.7 % that the error is below its limit, refused below 2.3 %."""
    conformity = stats.norm.cdf(limit, loc=after, scale=u_after)
    fell = stats.norm.sf(0.0, loc=before - after, scale=np.sqrt(u_before**2 + u_after**2))
    enough = stats.norm.cdf(2.0)
    assume(min(abs(conformity - enough), abs(conformity - 1.0 + enough), abs(fell - enough)) > 1e-9)
    if fell < enough or conformity < 1.0 - enough:
        expected = "refused"
    else:
        expected = "accepted" if conformity > enough else "not decided"
    decision = decide(made(before, u_before), made(after, u_after), limit)
    assert decision.verdict == expected
    assert ("the tables stay" in decision.rule) is (expected == "accepted")
    assert ("not decided" in decision.rule) is (expected == "not decided")


@pytest.mark.parametrize(
    ("quarters", "verdict"),
    [(11, "accepted"), (12, "accepted"), (13, "not decided"), (20, "not decided"), (21, "refused")],
)
def test_the_limits_of_the_guard_band_belong_to_it(quarters, verdict):
    """Limit 4, w = 2 u = 1, in units of 2^-18 m: all exact in binary."""
    unit = 2.0**-18
    assert decide(made(64 * unit, unit / 2), made(quarters / 4 * unit, unit / 2), 4 * unit).verdict == verdict


def test_a_small_error_that_did_not_fall_is_refused_and_not_undecided():
    assert decide(made(7e-6, 1e-6), made(6e-6, 1e-6), 6e-6).verdict == "refused"
    assert decide(made(7e-6, 1e-6), made(6e-6, 1e-6), 60e-6).verdict == "refused"


@pytest.fixture(scope="module")
def recording():
    return record(4)


def test_a_limit_below_the_uncertainty_of_the_scale_is_refused_before_any_table_is_written(recording):
    identification = identify_recording(recording, baselines=False)
    _, machine = load_rig(embedded_rig_path())
    blocks = [verification_block(machine, CampaignSettings(), payload) for payload in (0, 1)]
    require_possible_limits({}, identification, blocks)
    require_possible_limits({0: 1e-5, 1: 1e-5}, identification, blocks)
    with pytest.raises(InputError, match=r"payload 1: 0\.05 um is below its guard band U = [0-9.]+ um"):
        require_possible_limits({0: 1e-5, 1: 5e-8}, identification, blocks)


def test_the_noise_floor_is_that_of_the_averaging_of_the_verification(recording):
    def average_four(row):
        if row["phase"].startswith("verification"):
            row["samples"] = 4.0

    floor, floor_of_four = (noise_floor(reduce(r)) for r in (recording, record(4, spoil=average_four)))
    assert floor_of_four.position_rms_m == pytest.approx(0.5 * floor.position_rms_m, rel=1e-12)
    assert floor_of_four.orientation_rms_rad == pytest.approx(0.5 * floor.orientation_rms_rad, rel=1e-12)
    assert floor_of_four.u_position_rms_m == pytest.approx(0.5 * floor.u_position_rms_m, rel=1e-12)


@pytest.fixture
def old_store(tmp_path):
    (tmp_path / STORE_NAME).write_bytes(gzip.decompress(OLD_STORE.read_bytes()))
    with open_store(tmp_path) as store:
        yield store


def test_a_refused_result_ends_as_refused_whatever_is_printed(old_store, tmp_path, monkeypatch):
    (campaign, *_) = next(iter(old_store.campaigns()))
    outcome = stored_outcome(old_store, campaign)
    assert outcome.decision == "refused"
    assert outcome.restored
    for json in (False, True):
        with pytest.raises(CampaignRefused, match="the tables were refused"):
            _report_outcome(outcome, tmp_path, json)
        assert report_path(campaign, tmp_path).exists()
        # What is printed changes nothing of the report, and its pictures take seconds.
        monkeypatch.setattr(report, "write_outcome_report", lambda _outcome, _out: None)


def test_the_verdict_of_a_campaign_with_a_limit(old_store):
    (campaign, *_) = next(iter(old_store.campaigns()))
    outcome = stored_outcome(old_store, campaign)
    verified = outcome.verified[0]

    def judge(limits_m):
        return evaluate_campaign(
            campaign,
            outcome.calibration,
            outcome.reduction.recording,
            (WrittenTable(outcome.written[0].table, verified.payload, {}),),
            outcome.diagnosis,
            previous_tables="the former tables",
            limits_m=limits_m,
        )

    assert judge({}).verified[0].decision == verified.decision
    guard_m = 2.0 * verified.after.u_position_rms_m
    with pytest.raises(InputError, match="below its guard band"):
        judge({verified.payload: 0.999 * guard_m})
    assert "limit" in judge({verified.payload: 1.001 * guard_m}).verified[0].decision.rule
    assert judge({verified.payload + 7: 1e-12}).verified[0].decision == verified.decision


def test_report_judges_by_the_limit_that_was_stored_before_the_verification(old_store):
    (campaign, *_) = next(iter(old_store.campaigns()))
    assert stored_limits_m(old_store, campaign) == {}
    old_store.add_event(campaign, "verifying", {"first_sequence": 10**6, "accept_below_m": {0: 3e-5}})
    assert stored_limits_m(old_store, campaign) == {0: 3e-5}


def test_a_campaign_of_before_there_were_limits_goes_on_and_one_with_another_limit_does_not():
    old = {"machine": "m", "station": {}, "campaign": {"seed": 3}, "drives": [], "payloads": [], "nest_length": None}
    now = {**old, "campaign": CampaignSettings(seed=3).model_dump(mode="json")}
    assert is_same_rig(old, now, adds=False)
    limited = CampaignSettings(seed=3, accept_below_m={0: 3e-5}).model_dump(mode="json")
    assert not is_same_rig(old, {**now, "campaign": limited}, adds=False)


def turned(position, rotation, u=1e-6):
    return Figures(position, 2 * position, rotation, u, u, 30)


@pytest.mark.parametrize(
    ("after", "verdict"),
    [((2e-6, 5e-6), "accepted"), ((2e-6, 59e-6), "refused"), ((29e-6, 5e-6), "refused"), ((2e-6, 80e-6), "refused")],
)
def test_where_rotations_are_commanded_both_must_fall(after, verdict):
    """By more than their U: a rotation that falls by 1 urad with U = 2.8 urad shows nothing."""
    decision = decide(turned(30e-6, 60e-6), turned(*after), rotation=True, what="the correction stays")
    assert decision.verdict == verdict
    assert ("the correction stays" in decision.rule) == (verdict == "accepted")
    assert "urad" in decision.rule


def test_a_rotation_that_is_not_commanded_does_not_count():
    assert decide(turned(30e-6, 60e-6), turned(2e-6, 90e-6)).verdict == "accepted"
