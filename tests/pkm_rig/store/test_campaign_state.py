"""Where a campaign stands, from its events."""

from __future__ import annotations

import os
from contextlib import closing

import pytest

from pkm_rig.store.campaign_state import campaign_state, is_measured
from pkm_rig.store.lock import Lock, campaign_worked_on
from pkm_rig.store.sessions import BEGUN, ENDED
from pkm_rig.store.store import Store
from pkm_rig.store.stored_rows import StoredEvent
from tests.pkm_rig.store.stores import small_store


def happened(*kinds):
    """Events: a kind, a session's end as `ended WHY`, a plan as `started PLAN` or `finished PLAN`."""
    events = []
    for text in kinds:
        kind, _, rest = text.partition(" ")
        data = {"ended": {"why": rest}, "started": {"plan": rest}, "finished": {"plan": rest}, "failed": {"plan": rest}}
        name = {"begun": BEGUN, "ended": ENDED}.get(kind, kind)
        events.append(StoredEvent("2026-11-22T08:00:00+00:00", name, data.get(kind, {})))
    return events


MEASURED = ("settings", "begun", "started calibration", "finished calibration")
CASES = [
    ((), True, ("running", "connecting")),
    (("settings",), True, ("running", "connecting")),
    (("settings", "begun"), True, ("running", "connecting")),
    (("settings", "begun", "started calibration", "ended failed"), True, ("running", "connecting")),
    (("settings", "begun", "started calibration"), True, ("running", "measuring")),
    (("settings", "begun", "started calibration"), False, ("interrupted", "measuring")),
    (
        ("settings", "begun", "started calibration", "failed calibration", "ended failed"),
        False,
        ("failed", "measuring"),
    ),
    (("settings", "begun", "started calibration", "ended refused"), False, ("refused", "measuring")),
    ((*MEASURED, "ended finished"), False, ("measured", "")),
    ((*MEASURED, "identified"), False, ("interrupted", "identifying")),
    ((*MEASURED, "verifying", "started verification before"), False, ("interrupted", "verifying")),
    ((*MEASURED, "verifying", "finished verification before"), False, ("interrupted", "writing")),
    ((*MEASURED, "activated", "ended interrupted"), False, ("interrupted", "verifying")),
    ((*MEASURED, "accepted", "ended finished"), False, ("accepted", "")),
    ((*MEASURED, "refused", "ended finished"), False, ("refused", "")),
    (("imported",), False, ("imported", "")),
    (("settings", "started calibration"), False, ("interrupted", "measuring")),
    (("settings", "started calibration", "failed calibration"), False, ("failed", "measuring")),
    (("settings", "started calibration", "finished calibration"), False, ("measured", "")),
]


@pytest.mark.parametrize(("kinds", "is_worked_on", "expected"), CASES)
def test_state_and_step(kinds, is_worked_on, expected):
    assert campaign_state(happened(*kinds), is_worked_on=is_worked_on) == expected


def test_only_a_calibration_that_has_finished_is_measured():
    assert is_measured(happened(*MEASURED))
    assert not is_measured(happened("settings", "begun", "started calibration"))
    assert not is_measured(happened(*MEASURED, "started calibration"))  # visits were added
    assert not is_measured(happened("started verification before", "finished verification before"))


def test_what_an_owner_says_counts_only_while_he_has_the_lock(tmp_path):
    path = tmp_path / "store.lock"
    assert campaign_worked_on(path) is None
    lock = Lock(path, "the store")
    assert campaign_worked_on(path) is None
    for campaign in ("a" * 80, "b"):
        lock.say_campaign(campaign)
        assert campaign_worked_on(path) == campaign
    for text in (b"", b"[1]", b"[" * 9000, b'{"campaign": 3}', b"\xff"):
        os.truncate(path, 0)
        path.write_bytes(text)
        assert campaign_worked_on(path) is None
    lock.say_campaign("c")
    lock.release()
    assert campaign_worked_on(path) is None
    assert '"c"' in path.read_text()


def test_only_the_campaign_that_somebody_works_on_is_running(tmp_path):
    """The others may have been killed long ago, also those whose session has no end."""
    path = small_store(tmp_path / "store.sqlite", "killed", "running")
    with closing(Store(path)) as store:
        for campaign in ("killed", "running"):
            store.add_event(campaign, BEGUN, {"session": 1})
        store.work_on("running")
        assert {row.campaign: row.state for row in store.campaigns()} == {"killed": "interrupted", "running": "running"}
        store.work_on(None)
        assert {row.state for row in store.campaigns()} == {"interrupted"}
