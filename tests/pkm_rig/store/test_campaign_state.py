"""Where a campaign stands, from its events."""

from __future__ import annotations

import fcntl
import os

import pytest

from pkm_rig.store.campaign_state import campaign_state, is_measured
from pkm_rig.store.lock import is_held
from pkm_rig.store.sessions import BEGUN, ENDED
from pkm_rig.store.stored_rows import StoredEvent


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
    (("settings", "begun"), True, ("running", "connecting")),
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


@pytest.mark.parametrize(("kinds", "in_use", "expected"), CASES)
def test_state_and_step(kinds, in_use, expected):
    assert campaign_state(happened(*kinds), store_in_use=in_use) == expected


def test_only_a_calibration_that_has_finished_is_measured():
    assert is_measured(happened(*MEASURED))
    assert not is_measured(happened("settings", "begun", "started calibration"))
    assert not is_measured(happened(*MEASURED, "started calibration"))  # visits were added
    assert not is_measured(happened("started verification before", "finished verification before"))


def test_a_lock_is_held_only_while_somebody_has_it(tmp_path):
    path = tmp_path / "store.lock"
    assert not is_held(path)
    file = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    assert not is_held(path)
    fcntl.flock(file, fcntl.LOCK_EX)
    assert is_held(path)
    os.close(file)
    assert not is_held(path)
