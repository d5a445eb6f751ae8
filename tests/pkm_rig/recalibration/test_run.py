"""Runs over the real protocols of the embedded mock rig: gates, a proposal, its approval, and taking it back."""

from __future__ import annotations

import json
import time
from contextlib import closing, contextmanager

import pytest

from calibration.base.errors import InputError
from pkm_rig.jobs.tables_in_force import wrong_tables
from pkm_rig.recalibration.decisions import note
from pkm_rig.recalibration.journal import is_automatic, journal_path
from pkm_rig.recalibration.proposals import approve, take_back
from pkm_rig.recalibration.run import Recalibration
from pkm_rig.recalibration.situation import situation_of
from pkm_rig.store.life import life_rows
from pkm_rig.store.store import Store, store_path
from tests.pkm_rig.conftest import silent
from tests.pkm_rig.recalibration.rigs import ALWAYS, CALIBRATED_S, RIG, connected, keep_store, write_rig

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
    assert "tables would change by" in result.why
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
