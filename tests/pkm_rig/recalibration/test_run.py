"""Runs over the real protocols of the embedded mock rig: gates, a proposal, its approval, and taking it back."""

from __future__ import annotations

import json
import time
from contextlib import closing, contextmanager
from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.compensation.samples import CorrectionSamples
from calibration.identification import from_prior
from calibration.intervals.extent import Measurement
from calibration.machine.description import load_machine, shipped_machine
from pkm_rig.jobs import partial
from pkm_rig.jobs.former_correction import SAMPLES, activated_events
from pkm_rig.jobs.partial_fit import fit_partly, growth_of
from pkm_rig.jobs.partial_verification import AFTER, BEFORE
from pkm_rig.jobs.reference import load_reference
from pkm_rig.jobs.reversals import stored_reversals
from pkm_rig.jobs.tables_in_force import _only_restarted, require_tables, wrong_tables
from pkm_rig.recalibration.decisions import note
from pkm_rig.recalibration.journal import is_automatic, journal_path
from pkm_rig.recalibration.proposals import approve, take_back
from pkm_rig.recalibration.run import Recalibration
from pkm_rig.recalibration.situation import situation_of
from pkm_rig.rig.config import embedded_rig_path, load_rig
from pkm_rig.rig.table_change import switch_off
from pkm_rig.rig.table_recovery import settle_tables
from pkm_rig.store.life import life_rows
from pkm_rig.store.place import store_path
from pkm_rig.store.store import Store
from tests.calibration.diagnosis.campaigns import standing_off
from tests.pkm_rig.conftest import silent
from tests.pkm_rig.recalibration.rigs import ALWAYS, CALIBRATED_S, RIG, connected, keep_store, served, write_rig

PLC = "[recalibration.plc]\nautomatic = 21\nstate = 22\ndays_left = 23\nalarm = 24"
TIGHT = "[recalibration.envelope]\ntable_m = 1e-9"


def job_on(path, out, store, rig, now_s=time.time):
    @contextmanager
    def connect():
        yield rig

    return Recalibration(path, out, store, connect, silent, silent, now_s)


def test_the_plc_has_to_grant_the_automatic_mode(tmp_path):
    out = keep_store(tmp_path)
    path = write_rig(out, ALWAYS, PLC)
    with closing(Store(store_path(out))) as store, connected(path) as (mock, rig):
        mock.plc.state.set_automatic(False)
        assert not is_automatic(rig, rig.file.recalibration.plc)
        result = job_on(path, out, store, rig, lambda: CALIBRATED_S + 8.0 * 86400.0).run(scheduled=True)
        assert (result.done, result.alarm) == ("skipped", False)
        assert result.why.startswith("the PLC does not grant the automatic mode")
        assert life_rows(store, "checks", RIG) == []
        assert mock.plc.state.told == (0, 356, 0)  # fit, 365 days less eight and an hour, no alarm
        mock.plc.state.set_automatic(True)
        assert is_automatic(rig, rig.file.recalibration.plc)


def test_a_station_that_its_certificate_is_not_for_measures_nothing(tmp_path):
    out = keep_store(tmp_path)
    paper = '[[certificates]]\ninstrument = "station"\nnumber = "T-17"\ndue = 2099-01-01\nserial = "another one"'
    path = write_rig(out, ALWAYS, top=paper)
    with closing(Store(store_path(out))) as store, connected(path) as (_, rig):
        result = job_on(path, out, store, rig, lambda: CALIBRATED_S + 8.0 * 86400.0).run(scheduled=False)
        assert (result.done, result.alarm) == ("skipped", True)
        assert f"instrument {rig.station.identity.serial}: has no certificate in the rig file" in result.why
        assert life_rows(store, "checks", RIG) == []


@pytest.fixture(scope="module")
def proposed(tmp_path_factory):
    """A calibration that was due after a collision, beyond its envelope; then what was decided about it."""
    out = keep_store(tmp_path_factory.mktemp("run"))
    path = write_rig(out, ALWAYS, "alone = true", PLC, TIGHT)
    seen = {}
    with closing(Store(store_path(out))) as store, connected(path) as (mock, rig):
        calibrated = situation_of(store, rig.file, rig.machine, CALIBRATED_S)
        note(store, calibrated, "collision", "left", "tester", "a pallet")
        seen["result"] = job_on(path, out, store, rig).run(scheduled=True)
        seen["told"] = mock.plc.state.told
        before = situation_of(store, rig.file, rig.machine, time.time())
        seen["former kept"] = wrong_tables(rig, before.history.last_calibration.tables)
        seen["waiting"] = before.proposal.campaign
        seen["again"] = job_on(path, out, store, rig).run(scheduled=True)
        seen["approved"] = approve(rig, store, before.proposal, "tester", "looked at", time.time)
        after = situation_of(store, rig.file, rig.machine, time.time())
        last = after.history.last_calibration
        seen["in force"], seen["new kept"] = last.id, wrong_tables(rig, last.tables)
        seen["nothing waits"], seen["state"] = after.proposal, after.state
        seen["back to"] = take_back(rig, store, after.key, last.id, last.tables, "tester", "vibrates")
        back = situation_of(store, rig.file, rig.machine, time.time())
        seen["former"], seen["former back"] = (
            back.history.last_calibration,
            wrong_tables(rig, back.history.last_calibration.tables),
        )
        with pytest.raises(InputError, match="is not that of calibration"):
            take_back(rig, store, back.key, "c", "left:99:1/right:99:1", "tester", "again")
    lines = journal_path(out, RIG).read_text(encoding="utf-8").splitlines()
    seen["lines"] = [json.loads(line) for line in lines]
    return seen


def test_beyond_the_envelope_the_former_tables_stay_and_a_proposal_waits(proposed):
    result = proposed["result"]
    assert (result.done, result.campaign) == ("proposal", proposed["waiting"])
    assert "a drive's correction would change by" in result.why
    assert result.alarm
    assert proposed["told"] == (1, 0, 1)  # due, now, somebody is asked for
    assert proposed["former kept"] is None
    assert proposed["again"].done == "skipped"
    assert "waits for approval" in proposed["again"].why


def test_an_approved_calibration_is_in_force(proposed):
    assert proposed["in force"] == proposed["waiting"]
    assert proposed["new kept"] is None
    assert set(proposed["approved"]) == {"left", "right"}
    assert (proposed["nothing waits"], proposed["state"]) == (None, "fit")


def test_what_is_taken_back_is_out_of_force(proposed):
    assert proposed["back to"] == "the former tables"
    assert proposed["former"].id != proposed["waiting"]
    assert proposed["former back"] is None


def test_every_run_leaves_a_line(proposed):
    assert [line["done"] for line in proposed["lines"]] == ["proposal", "skipped"]
    assert all(line["rig"] == RIG and line["command"] == "run" for line in proposed["lines"])


LOST_M = 100e-6
REVERSAL_M = np.array([4e-6, -3e-6])  # of payload 1, with which it is measured
LOOSE = "[recalibration.envelope]\ntable_m = 1e-3\nerror_m = 1e-3"


def lose_reference(mock, store, rig):
    """The left drive counts more than before, and nothing else has changed; somebody enters that."""

    def lose(axis):
        t_s = mock.plant.clock.now_s()
        axis.motion.recount(t_s, axis.encoder_inc(t_s) + LOST_M / 1e-8)

    mock.drives[0].with_axis(lose)
    note(store, situation_of(store, rig.file, rig.machine, CALIBRATED_S), "reference lost", "left", "tester", "off")


def tried_by_direction(store, rig):
    """What is known of corrections that were tried, as if the calibration in force had tables by direction.

    The kept store is a small one: the events of that campaign were removed.
    """
    machine = rig.machine
    in_force = situation_of(store, rig.file, machine, CALIBRATED_S).history.last_calibration.id
    samples = CorrectionSamples.of(machine, machine.commanded_limits, lambda pose: np.zeros((len(pose), 2)))
    tried = {n: {SAMPLES: replace(samples, reversal=n * REVERSAL_M).as_json()} for n in range(len(rig.file.payloads))}
    return lambda store, campaign: tried if campaign == in_force else activated_events(store, campaign)


def poses_of(store, campaign, phase):
    return set(store.recording(campaign).rows(phase)["visit"].tolist())


@pytest.fixture(scope="module")
def partly(tmp_path_factory):
    """A lost reference; the power fails while the new tables are on trial, and then it is done again."""
    out = keep_store(tmp_path_factory.mktemp("partly"))
    path = write_rig(out, ALWAYS, "alone = true", LOOSE)
    now_s, seen = CALIBRATED_S + 60.0, {}
    with (
        closing(Store(store_path(out))) as store,
        served(path) as (mock, connect),
        pytest.MonkeyPatch.context() as patch,
    ):
        with connect() as rig:
            lose_reference(mock, store, rig)
            patch.setattr(partial, "activated_events", tried_by_direction(store, rig))
        cut = []

        def cut_power(_number, _total, what):
            if what == AFTER and not cut:
                cut.append(what)
                for drive in mock.drives:
                    drive.power_cycle()

        job = Recalibration(path, out, store, connect, silent, cut_power, lambda: now_s)
        seen["failed"] = job.run(scheduled=True)
        with connect() as rig:
            former = situation_of(store, rig.file, rig.machine, now_s).history.last_calibration
            settle_tables(rig, store, silent)
            seen["former back"] = wrong_tables(rig, former.tables)
        result = job.run(scheduled=True)
        with connect() as rig:
            after = situation_of(store, rig.file, rig.machine, now_s)
            wrong = wrong_tables(rig, after.history.last_calibration.tables)
            seen["images"] = [bank.read_image(bank.state().active) for bank in rig.banks]
        reference = load_reference(store, RIG, former.id, rig.machine, rig.file.payloads)
        offset = growth_of(reference, Measurement("drive offset", ("left",), 10, ""))
        seen["fitted"] = reference, store.recording(result.campaign).rows("calibration"), offset
        seen["kept"] = [stored_reversals(tried, 2) for tried in activated_events(store, result.campaign).values()]
        for drive in mock.drives:
            drive.power_cycle()
        with connect() as rig:
            last, said = after.history.last_calibration, []
            seen["off"] = wrong_tables(rig, last.tables)
            require_tables(rig, store, last.id, last.tables, said.append)
            seen["on again"], seen["said"] = wrong_tables(rig, last.tables), said
            switch_off(rig, store, "off")
            seen["by hand"] = _only_restarted(rig, store, last.tables)
        visits = {phase: poses_of(store, result.campaign, phase) for phase in ("calibration", BEFORE, AFTER)}
    return result, after, wrong, visits, seen


def test_power_that_fails_in_the_middle_leaves_the_former_tables(partly):
    seen = partly[-1]
    assert (seen["failed"].done, seen["failed"].alarm) == ("failed", True)
    assert seen["former back"] is None


def test_drives_that_were_without_power_are_told_to_use_their_tables_again(partly):
    seen = partly[-1]
    assert seen["off"].endswith("uses no table")
    assert seen["on again"] is None
    assert len(seen["said"]) == 1
    assert seen["said"][0].startswith("the drives were without power")
    assert seen["by hand"] is False  # what somebody has switched off stays off


def test_the_values_by_direction_are_those_of_the_calibration_that_is_brought_up_to_date(partly):
    """Its own few visits tell none: the drives have those, and so does what the next one will look up."""
    seen = partly[-1]
    by_direction_m = [(image.up_m, image.down_m) for image in seen["images"]]
    np.testing.assert_allclose(by_direction_m, 0.5 * np.outer(REVERSAL_M, [1.0, -1.0]), atol=1e-8)
    np.testing.assert_allclose(seen["kept"], [REVERSAL_M], atol=1e-12)


@pytest.fixture(scope="module")
def warmer(tmp_path_factory):
    """All of the machine is 6 K warmer than its calibration: what that does is known before, and no change of it."""
    out = keep_store(tmp_path_factory.mktemp("warmer"))
    path = write_rig(out, ALWAYS, "alone = true", LOOSE)
    path.write_text(
        path.read_text().replace("tolerance_m = 60e-6", "tolerance_m = 61e-6")
    )  # it is checked all the same
    now_s = CALIBRATED_S + 8.0 * 86400.0
    with closing(Store(store_path(out))) as store, connected(path) as (mock, rig):
        for part in ("struts", "columns", "base", "platform"):
            mock.plant.thermal.heat(part, 6.0)
        result = job_on(path, out, store, rig, lambda: now_s).run(scheduled=True)
        after = situation_of(store, rig.file, rig.machine, now_s)
        wrong = wrong_tables(rig, after.history.last_calibration.tables)
        visits = {phase: poses_of(store, result.campaign, phase) for phase in ("calibration", BEFORE, AFTER)}
    return result, after, wrong, visits


def test_another_temperature_alone_asks_for_expansion_alone(warmer):
    result, after, wrong, _ = warmer
    assert (result.done, after.state, wrong) == ("calibration", "fit", None)
    former, new = after.history.calibrations
    assert (new.extent, after.history.checks[-1].calibration) == ("expansion", former.id)
    assert new.temperature_c - former.temperature_c == pytest.approx(6.0, abs=0.6)
    change = np.subtract(new.parameters, former.parameters) / np.sqrt(np.diag(former.covariance))
    assert np.max(np.abs(change)) < 3.0  # the geometry is what it was
    assert after.history.checks[-1].known_error_m > 10e-6
    assert len(after.history.checks[-1].known_alignment) == len(after.history.checks[-1].watched)


def test_a_verification_goes_on_with_both_tables_until_it_is_decided(warmer):
    result, _, _, visits = warmer
    assert len(visits["calibration"]) == 12
    assert len(visits[BEFORE]) == len(visits[AFTER]) in (12, 18, 24, 30)
    assert f"at {len(visits[AFTER])} poses: the tables stay" in result.why


def test_after_a_lost_reference_that_drive_s_offset_alone_is_measured(partly):
    result, after, wrong, visits, _ = partly
    assert (result.done, after.state, wrong) == ("calibration", "fit", None)
    assert len(visits["calibration"]) == 10
    assert len(visits[BEFORE]) == len(visits[AFTER]) == 12
    former, new = after.history.calibrations
    assert (new.extent, new.id) == ("drive offset", result.campaign)
    change = dict(zip(new.parameter_names, np.subtract(new.parameters, former.parameters), strict=True))
    u = np.sqrt(np.diag(new.covariance))
    for strut in ("upper", "lower"):
        row = new.parameter_names.index(f"base_joint.left_{strut}.y")
        former_u = np.sqrt(former.covariance[row][row])
        assert change[f"base_joint.left_{strut}.y"] == pytest.approx(-LOST_M, abs=3.0 * (u[row] + former_u))
    assert abs(change["base_joint.right_upper.y"]) < 0.2 * LOST_M
    assert new.as_found.position_m > 3.0 * new.as_left.position_m


def test_only_what_may_have_changed_is_let_loose(tmp_path):
    machine = load_machine(shipped_machine("planar4"))
    with closing(Store(store_path(keep_store(tmp_path)))) as store:
        campaign = life_rows(store, "calibrations", RIG)[0].campaign
        file, _ = load_rig(embedded_rig_path())
        reference = load_reference(store, RIG, campaign, machine, file.payloads)
    names = np.array(reference.names)
    offset = growth_of(reference, Measurement("drive offset", ("left",), 10, ""))
    moved = {"base_joint.left_upper.y", "base_joint.left_lower.y", "mounting.SL.y"}
    assert set(names[np.diag(offset) > 0.0]) == moved
    assert np.linalg.matrix_rank(offset) == 1
    warmth = growth_of(reference, Measurement("expansion", (), 12, ""))
    assert all(name.startswith("expansion.") for name in names[np.diag(warmth) > 0.0])
    with pytest.raises(InputError, match="its offset is no change of this machine"):
        growth_of(reference, Measurement("drive offset", ("third",), 10, ""))


def test_its_uncertainty_knows_of_drives_that_stand_off_anew(partly):
    """Of 20 um beside readings of some 10 um; the machine that was measured repeats itself."""
    reference, recording, growth = partly[-1]["fitted"]
    as_measured = fit_partly(reference, recording, growth)
    anew = fit_partly(reference, standing_off(recording, 2e-5, 1), growth)
    assert as_measured.positioning_sd_m < 5e-6
    assert anew.positioning_sd_m == pytest.approx(2e-5, rel=0.4)


def test_few_readings_that_do_not_settle_are_refused(partly, monkeypatch):
    reference, recording, growth = partly[-1]["fitted"]
    assert fit_partly(reference, recording, growth).converged
    monkeypatch.setattr(from_prior, "MOST_STEPS", 1)
    with pytest.raises(InputError, match=r"settle on no machine together.*; calibrate anew"):
        fit_partly(reference, recording, growth)
