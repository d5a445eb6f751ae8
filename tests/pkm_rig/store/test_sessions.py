"""Campaigns of version 0.1, whose rig time began anew in every process, are handed out with times that rise."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibration.recording.folder import read_folder
from calibration.recording.sessions import repaired_text
from pkm_rig.store.sessions import BEGUN, ENDED, with_sessions
from pkm_rig.store.stored_rows import StoredEvent

FOLDER = Path(__file__).parents[2] / "data" / "version_0_1" / "recording"
FIRSTS, SCALE, UTC_S, BOOT_S = (200, 450), 60.0, 1.7e9, 5.0e4


def event(t_s: float, kind: str, **data: Any) -> StoredEvent:
    return StoredEvent(datetime.fromtimestamp(UTC_S + t_s, UTC).isoformat(timespec="milliseconds"), kind, data)


@pytest.fixture(scope="module")
def whole():
    recording = read_folder(FOLDER)
    host = BOOT_S + recording["t_rig_s"] / SCALE  # as a served mock has it
    return replace(recording, columns={**recording.columns, "t_host_s": host})


def begin_anew(recording, firsts=FIRSTS):
    t = recording["t_rig_s"].copy()
    for first, end in zip(firsts, (*firsts[1:], len(t)), strict=True):
        t[first:end] -= t[first] - 600.0  # after ten minutes of warming up
    return replace(recording, columns={**recording.columns, "t_rig_s": t})


def events_of(recording, firsts=FIRSTS, interface="socketcand", plans=("calibration", "calibration", "verify")):
    settings = event(0.0, "settings", rig_file={"can": {"interface": interface}, "time_scale": SCALE})
    events = [settings]
    for first, plan in zip((0, *firsts), plans, strict=True):
        at_s = recording["t_host_s"][first] - BOOT_S - 10.0
        events.append(event(at_s, "verifying") if plan == "verify" else event(at_s, "started", plan=plan))
    return events


def test_the_computers_clock_says_when_each_process_measured(whole):
    risen = with_sessions(begin_anew(whole), events_of(whole))
    np.testing.assert_allclose(np.diff(risen["t_rig_s"]), np.diff(whole["t_rig_s"]), atol=1e-6)
    sessions = risen.file.sessions
    assert [(s.number, s.first_sequence, s.time) for s in sessions] == [
        (1, 0, "measured"), (2, 200, "repaired"), (3, 450, "repaired"),
    ]  # fmt: skip
    assert [s.command for s in sessions] == ["measure", "measure", "verify"]
    assert "2 by the computer's clock" in repaired_text(risen)


def test_a_process_whose_time_does_not_fall_is_found_all_the_same(whole):
    """It warmed up for longer than the one before it had measured."""
    firsts = (20,)
    late = begin_anew(whole, firsts)
    shift = whole["t_rig_s"][19] + 5.0 - late["t_rig_s"][20]
    t = late["t_rig_s"].copy()
    t[20:] += shift
    host = late["t_host_s"].copy()
    host[20:] += 3600.0 / SCALE
    late = replace(late, columns={**late.columns, "t_rig_s": t, "t_host_s": host})
    assert np.all(np.diff(late["t_rig_s"]) > 0.0)
    risen = with_sessions(late, events_of(whole, firsts, plans=("calibration", "calibration")))
    assert risen["t_rig_s"][20] - risen["t_rig_s"][19] == pytest.approx(SCALE * (host[20] - host[19]))


@pytest.mark.parametrize("off_s", [0.0, 3600.0])
def test_after_a_restart_of_the_computer_the_events_say_it(whole, off_s):
    anew = begin_anew(whole)
    host = anew["t_host_s"].copy()
    host[200:] -= host[200] - 30.0
    anew = replace(anew, columns={**anew.columns, "t_host_s": host})
    later = replace(
        whole, columns={**whole.columns, "t_host_s": whole["t_host_s"] + off_s * (whole["sequence"] >= 200)}
    )
    risen = with_sessions(anew, events_of(later))
    expected_s = np.diff(whole["t_rig_s"])[199] + SCALE * off_s
    assert np.diff(risen["t_rig_s"])[199] == pytest.approx(expected_s, abs=2.0 * SCALE)
    assert {s.time for s in risen.file.sessions[1:]} == {"repaired"}


def test_where_no_clock_says_it_the_time_is_unknown(whole):
    """The embedded rig of version 0.1 began with another drift in every process; a folder has no events."""
    for events in (events_of(whole, interface="embedded"), [event(0.0, "imported")]):
        risen = with_sessions(begin_anew(whole), events)
        assert [s.time for s in risen.file.sessions] == ["measured", "unknown", "unknown"]
        assert np.all(np.diff(risen["t_rig_s"]) > 0.0)


def test_a_campaign_whose_time_rises_keeps_it(whole):
    kept = with_sessions(whole, events_of(whole, (), plans=("calibration",)))
    np.testing.assert_array_equal(kept["t_rig_s"], whole["t_rig_s"])
    assert [s.time for s in kept.file.sessions] == ["measured"]
    assert repaired_text(kept) is None


def test_a_former_campaign_that_goes_on_with_this_version(whole):
    """Times of its first processes are repaired, those of the later session stay."""
    former = begin_anew(whole, (200, 450))
    t = former["t_rig_s"].copy()
    t[450:] = whole["t_rig_s"][450:]  # the third session began where the repaired second one ended
    mixed = replace(former, columns={**former.columns, "t_rig_s": t})
    begun_s = float(whole["t_rig_s"][449]) + 1.0
    events = [
        *events_of(whole, (200,), plans=("calibration", "calibration")),
        event(9000.0, BEGUN, session=1, command="measure", t_rig_s=begun_s, t_utc_s=UTC_S, time_scale=SCALE),
    ]
    risen = with_sessions(mixed, events)
    np.testing.assert_allclose(np.diff(risen["t_rig_s"]), np.diff(whole["t_rig_s"]), atol=1e-6)
    assert [(s.number, s.command, s.why) for s in risen.file.sessions] == [
        (1, "measure", ""), (2, "measure", ""), (3, "measure", "killed"),
    ]  # fmt: skip


def test_sessions_have_begin_end_and_why(whole):
    t = whole["t_rig_s"]
    begins = (0.0, float(t[200]) - 1.0)
    events = [
        event(0.0, BEGUN, session=1, command="measure", t_rig_s=begins[0], t_utc_s=UTC_S, time_scale=1.0),
        event(5.0, ENDED, session=1, t_rig_s=float(t[199]) + 0.5, t_utc_s=UTC_S + 5.0, why="interrupted"),
        event(9.0, BEGUN, session=2, command="verify", t_rig_s=begins[1], t_utc_s=UTC_S + 9.0, time_scale=1.0),
    ]
    first, second = with_sessions(whole, events).file.sessions
    assert (first.why, first.first_sequence, first.end_rig_s) == ("interrupted", 0, float(t[199]) + 0.5)
    assert (second.why, second.first_sequence, second.end_rig_s) == ("killed", 200, float(t[-1]))
    assert (first.begin_utc_s, second.end_utc_s) == (UTC_S, None)
