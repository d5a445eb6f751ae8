"""The sessions of a campaign: their times follow one another, whatever ended them."""

from __future__ import annotations

import time
from contextlib import closing

import numpy as np
import pytest

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.jobs.measure import measure
from pkm_rig.rig.clock import ScaledClock
from pkm_rig.rig.session_record import last_moment, session
from pkm_rig.store.audit import audit
from pkm_rig.store.sessions import Moment
from pkm_rig.store.store import Store
from tests.pkm_rig.conftest import Stopped, mock_and_rig, short_rig_file, silent, stop_after


@pytest.fixture(scope="module")
def broken_off(tmp_path_factory):
    """a campaign in three sessions."""
    file, machine = short_rig_file(seed=4, calibration_poses=6, nest_every_visits=4)
    store = Store(tmp_path_factory.mktemp("sessions") / "store.sqlite")
    after, campaign, drift, warmth, states = None, None, [], [], []

    def note_state(_line):
        states.append(store.campaigns()[0].state)

    for readings in (20, 30, 10_000):
        with mock_and_rig(file, machine, start_s=after.t_rig_s if after else 0.0) as (mock, rig):
            plant = mock.plant
            try:
                measure(rig, store, silent if campaign else note_state, stop_after(readings), campaign)
            except Stopped:
                note_state("stopped")
                campaign = store.campaigns()[0][0]
            if readings == 30:
                last = store.recording(campaign)["t_rig_s"].max()
                drift.append(plant.view.polar((0.5, 0.4, 0.1), last))
                warmth.append(plant.thermal.parts_c(last))
        after = last_moment(store, campaign)
        if readings == 30:
            with mock_and_rig(file, machine) as (mock, _):
                drift.append(mock.plant.view.polar((0.5, 0.4, 0.1), last))
                warmth.append(mock.plant.thermal.parts_c(last))
    yield store, campaign, drift, warmth, states
    store.close()


def test_rig_time_goes_on_in_every_session(broken_off):
    store, campaign, *_ = broken_off
    recording = store.recording(campaign)
    assert np.all(np.diff(recording["t_rig_s"]) > 0.0)
    assert np.all(np.diff(recording["sequence"]) == 1.0)
    begun, ended = (store.events(campaign, kind) for kind in ("session_begun", "session_ended"))
    assert [e.data["session"] for e in begun] == [e.data["session"] for e in ended] == [1, 2, 3]
    assert [e.data["why"] for e in ended] == ["interrupted", "interrupted", "finished"]
    assert {e.data["command"] for e in begun} == {"measure"}
    for former, later in zip(ended, begun[1:], strict=False):
        assert 0.0 <= later.data["t_rig_s"] - former.data["t_rig_s"] < 20.0  # the embedded rig counts no gap


def test_a_campaign_runs_before_its_first_session_has_begun_and_not_after_its_end(broken_off):
    *_, states = broken_off
    assert states == ["running", "interrupted", "interrupted"]  # planned, and each time it was stopped


def test_a_resumed_embedded_mock_is_the_same_machine_at_that_time(broken_off):
    _, _, drift, warmth, _ = broken_off
    assert warmth[0] == warmth[1]
    assert drift[0] == drift[1]


def test_unix_time_of_a_reading_is_that_of_the_computer(broken_off):
    store, campaign, *_ = broken_off
    recording = store.recording(campaign)
    began = store.events(campaign, "session_begun")[0].data["t_utc_s"]
    assert np.all((recording["t_utc_s"] > began) & (recording["t_utc_s"] < time.time()))
    offset = recording["t_utc_s"] - recording["t_host_s"]
    assert np.ptp(offset) < 0.05


def test_after_a_kill_the_last_reading_counts(tmp_path, broken_off):
    store, campaign, *_ = broken_off
    recording = store.recording(campaign)
    killed = Store(tmp_path / "killed.sqlite")
    killed.add_recording(recording)
    moment = last_moment(killed, campaign)
    assert moment.t_rig_s == pytest.approx(recording["t_rig_s"][-1] + recording["t_u_s"][-1])
    assert moment.t_utc_s == recording["t_utc_s"][-1]
    killed.close()


def test_a_gap_counts_and_a_clock_that_was_set_back_counts_as_none():
    ended = Moment(500.0, 1.0e9)
    assert ended.gap_s(1.0e9 + 60.0) == 60.0
    assert ended.set_back_s(1.0e9 + 60.0) == 0.0
    assert ended.gap_s(1.0e9 - 60.0) == 0.0
    assert ended.set_back_s(1.0e9 - 60.0) == 60.0
    assert Moment(500.0, None).gap_s(1.0e9) == 0.0


def test_a_clock_that_was_set_back_is_said_and_stored(tmp_path, broken_off):
    store, campaign, *_ = broken_off
    ended = last_moment(store, campaign)
    file, machine = short_rig_file(seed=4, calibration_poses=6, nest_every_visits=4)
    said = []
    with mock_and_rig(file, machine, start_s=ended.t_rig_s) as (_, rig):
        copy = Store(tmp_path / "copy.sqlite")
        copy.add_recording(store.recording(campaign))
        with session(rig, copy, campaign, "measure", said.append, lambda: ended.t_utc_s - 3600.0):
            pass
    (begun,) = copy.events(campaign, "session_begun")
    assert begun.data["set_back_s"] == pytest.approx(3600.0, abs=60.0)
    assert len(said) == 1
    assert "set back" in said[0]
    copy.close()


def test_a_rig_whose_time_lies_before_the_campaign_is_refused(broken_off):
    store, campaign, *_ = broken_off
    file, machine = short_rig_file(seed=4, calibration_poses=6, nest_every_visits=4)
    before = len(store.events(campaign))
    with mock_and_rig(file, machine) as (_, rig), pytest.raises(InputError, match="before that"):
        measure(rig, store, silent, silent, campaign)
    assert len(store.events(campaign)) == before


def test_a_scaled_clock_goes_on_at_its_scale():
    clock = ScaledClock(60.0, 1000.0)
    try:
        assert 1000.0 <= clock.now_s() < 1600.0
    finally:
        clock.close()


def test_a_session_holds_the_store_and_ends_with_the_head(broken_off):
    store, campaign, *_ = broken_off
    with closing(Store(store.path)) as other, pytest.raises(StoreError, match="in use"):
        other.hold()
    (found,) = audit(store, campaign)
    assert found.state == "whole"
    rows = [found.row_of[event.data["head"]] for event in store.events(campaign, "session_ended")]
    assert len(rows) == 3
    assert rows == sorted(rows)
    assert rows[-1] == found.rows - 1  # the row before the last closing event
