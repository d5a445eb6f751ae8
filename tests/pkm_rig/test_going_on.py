"""What the last line of a command says that did not come to the end of its campaign, and what others see meanwhile."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest

from calibration.base.errors import InputError
from drivers.errors import NoAnswer
from pkm_rig.cli import going_on
from pkm_rig.cli.entry import Interrupted
from pkm_rig.cli.going_on import GO_ON, resumable
from pkm_rig.errors import CAMPAIGN_NOTE, CampaignRefused, StationMoved
from pkm_rig.jobs import session
from pkm_rig.rig.runner import NEW_SETUP
from pkm_rig.store.store import open_existing_store, open_store
from tests.pkm_rig.store.stores import small_store


def silent():
    return NoAnswer("PLC", "line", "silent", "switch it on")


def line_after(error, *, noted=(), before=lambda: None, **options):
    """The command that the last line names; None if it names none."""

    @resumable("measure", Path("my rig.toml"), Path("runs"), **options)
    def command():
        before()
        raise error

    for note in noted:
        error.add_note(note)
    with pytest.raises(type(error)):
        command()
    named = [note for note in getattr(error, "__notes__", ()) if note.startswith(GO_ON)]
    return shlex.split(named[-1].removeprefix(GO_ON)) if named else None


@pytest.mark.parametrize(
    ("error", "words"),
    [(Interrupted, ("demo", "--resume", "first")), (silent, ("calibrate", "--rig", "embedded", "--resume", "first")),
     (Interrupted, ("measure", "--rig", "embedded", "--resume", "first")),
     (silent, ("verify", "first", "--rig", "embedded"))],
    ids=["demo", "calibrate", "measure", "verify"],
)  # fmt: skip
def test_where_devices_do_not_answer_the_campaign_is_named_and_was_running(run, words, error, tmp_path, monkeypatch):
    states = []

    def look(*_, **__):
        with open_existing_store(tmp_path) as store:
            states.extend((row.campaign, row.state, row.step) for row in store.campaigns())
        raise error()

    small_store(tmp_path / "pkm-rig.sqlite", "first", "second")
    monkeypatch.setattr(session, "open_rig", look)
    words = (*words, "--new-setup")
    done = run(*words, "--out", tmp_path)
    assert done.returncode == 3
    assert states == [("first", "running", "connecting"), ("second", "measured", "")]
    said, _, line = done.stderr.strip().splitlines()[-1].partition(f"; {GO_ON}")
    assert said.endswith(f"; {CAMPAIGN_NOTE}first")
    assert sorted(shlex.split(line)) == sorted(["pkm-rig", *words, "--out", str(tmp_path)])


def test_a_station_that_has_moved_goes_on_in_a_new_set_up():
    measure = ["pkm-rig", "measure", "--rig", "my rig.toml", "--out", "runs", "--resume", "a"]
    noted = [CAMPAIGN_NOTE + "a"]
    assert line_after(StationMoved("nest check"), noted=noted) == [*measure, "--new-setup"]
    assert line_after(CampaignRefused("warm-up"), noted=noted) == measure


def test_where_nothing_can_be_tied_a_new_campaign_is_measured(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small_store(Path("runs") / "pkm-rig.sqlite", "a")
    error = StationMoved("nest check")
    assert line_after(error, noted=[CAMPAIGN_NOTE + "a"]) is None
    assert error.__notes__[-1].endswith(", measure anew with: pkm-rig measure --rig 'my rig.toml' --out runs")


def test_a_set_up_that_was_begun_is_not_begun_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small_store(Path("runs") / "pkm-rig.sqlite", "a")

    def begin():
        with open_store(Path("runs")) as store:
            store.add_event("a", NEW_SETUP, {"setup": 2})

    asked = {"campaign": "a", "new_setup": True}
    assert line_after(InputError("a wrong file"), **asked) is None
    assert "--new-setup" in line_after(silent(), **asked)
    assert "--new-setup" not in line_after(silent(), before=begin, **asked)
    monkeypatch.setattr(going_on, "_can_be_tied", lambda *_: True)
    assert "--new-setup" in line_after(StationMoved("nest check"), before=begin, **asked)


def test_without_a_campaign_there_is_nothing_to_go_on_with():
    assert line_after(silent()) is None
