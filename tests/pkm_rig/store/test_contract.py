"""What a store does, be it in a file or on a PostgreSQL server: one contract for both."""

from __future__ import annotations

import subprocess
import sys
import threading
from contextlib import closing
from dataclasses import replace

import pytest
import sqlalchemy as sa
from sqlalchemy import event

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.jobs.history import histories, rigs_of
from pkm_rig.store.append import append_event
from pkm_rig.store.audit import audit
from pkm_rig.store.life import add_to_life, life_rows
from pkm_rig.store.place import SERVER_FILE, store_place
from pkm_rig.store.removal import archive_campaign, delete_campaign
from pkm_rig.store.sessions import BEGUN
from pkm_rig.store.store import Store
from tests.either import either
from tests.pkm_rig.store.stores import small_recording
from tests.postgres_server import LIMIT_S

TOP = "2026-01-01T00:00:00+00:00"


@pytest.fixture(params=["file", "server"])
def out(request, tmp_path):
    """A folder whose store is new: a file in it, or a database."""
    if request.param == "server":
        server = request.getfixturevalue("server")
        address = server.address(server.new_store())
        (tmp_path / SERVER_FILE).write_text(f'store = "{address}"\n')
    return tmp_path


@pytest.fixture
def place(out):
    return store_place(out)


@pytest.fixture
def store(place):
    with closing(Store(place)) as store:
        yield store


def filled(store, *names):
    for name in names:
        store.add_recording(small_recording(name))
        store.add_event(name, "noted", {"µ": [True, None, -0.0, 0.30000000000000004]})
    return store


class Counting:
    """The statements that are sent to any database meanwhile."""

    def __enter__(self):
        self._seen = []
        event.listen(sa.Engine, "before_cursor_execute", self._see)
        return self._seen

    def __exit__(self, *_):
        event.remove(sa.Engine, "before_cursor_execute", self._see)

    def _see(self, _connection, _cursor, statement, *_):
        self._seen.append(statement)


def test_what_goes_in_comes_out(store):
    recording = small_recording("first")
    filled(store, "first")
    again = store.recording("first")
    assert again.file == recording.file
    assert again.machine.text == recording.machine.text
    assert all((again.columns[n] == recording.columns[n]).all() for n in recording.columns)
    assert [e.kind for e in store.events("first")] == ["imported", "noted"]
    assert store.events("first", "noted")[0].data == {"µ": [True, None, -0.0, 0.30000000000000004]}
    assert store.count_readings("first") == 6
    assert store.header("first").rig == store.rig_of("first") == "plant"
    assert store.rig_of("nothing") is None
    assert store.newest(5) == ["first"]
    (row,) = store.campaigns()
    assert (row.campaign, row.created, row.rig, row.readings, row.last_event) == ("first", TOP, "plant", 6, "noted")


def test_both_kinds_of_store_compute_the_same_chain(store, tmp_path, monkeypatch):
    monkeypatch.setattr("pkm_rig.store.append.now_text", lambda: TOP)
    with closing(Store(tmp_path / "other.sqlite")) as other:
        heads = [filled(one, "first").head("first") for one in (store, other)]
    assert heads[0] == heads[1]
    (found,) = audit(store)
    assert (found.state, found.rows, found.readings, found.head) == ("whole", 8, 6, heads[0])


def test_nothing_is_changed_or_deleted(store):
    filled(store, "first")
    store.add_table_change(rig="r", machine="m", campaign=None, change="c", kind="begun", data={})
    add_to_life(store, "checks", rig="r", machine="m", kind="fit", data={"id": "1"}, campaign="first")
    statements = [
        "UPDATE readings SET data = '{}'", "DELETE FROM readings", "DELETE FROM events", "DELETE FROM campaigns",
        "UPDATE table_changes SET kind = 'x'", "DELETE FROM table_changes", "UPDATE checks SET kind = 'x'",
        "DELETE FROM checks",
    ]  # fmt: skip
    for statement in statements:
        _, line = either(lambda: _execute(store, statement), InputError, StoreError)  # noqa: B023
        assert "append-only" in str(line), statement
    assert [one.state for one in audit(store)] == ["whole"]


def _execute(store, statement):
    with store.writing() as connection:
        connection.execute(sa.text(statement))


def test_who_only_reads_cannot_write(store, place):
    filled(store, "first")
    with closing(Store(place, read_only=True)) as reader:
        assert len(reader.recording("first")) == 6
        with reader.reading() as connection, pytest.raises(sa.exc.SQLAlchemyError, match=r"read-?only"):
            connection.execute(sa.text("INSERT INTO heads VALUES ('x', 0, NULL)"))


def test_ids_and_uids_are_unique(store):
    filled(store, "first")
    with pytest.raises(InputError, match="'first' is there already"):
        store.add_recording(small_recording("first"))
    with pytest.raises(InputError, match="uid must be unique"):
        store.add_reading("first", str(small_recording("first").row(0)["uid"]), 9, {"value": 1.0})
    with pytest.raises(InputError, match="no campaign 'nothing'"):
        store.recording("nothing")
    for name in ("\udcff", "\0", "'", "[/b]"):
        assert either(lambda: store.recording(name), InputError, StoreError)[1], name  # noqa: B023
    assert [one.state for one in audit(store)] == ["whole"]


def test_a_chain_does_not_fork_whoever_writes_at_once(store, place):
    """Two processes' worth of connections, and several threads of each."""
    filled(store, "first")
    failures = []

    def write(target):
        for _ in range(5):
            line = either(lambda: target.add_event("first", "noted", {}), StoreError, InputError)[1]
            failures.extend([] if line is None else [line])

    with closing(Store(place)) as other:
        threads = [threading.Thread(target=write, args=(one,), daemon=True) for one in (store, other, store, other)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(LIMIT_S)
    assert not any(thread.is_alive() for thread in threads)
    assert failures == []
    (found,) = audit(store)
    assert (found.state, found.rows) == ("whole", 28)


def test_a_transaction_is_whole_or_not_at_all(store):
    filled(store, "first")

    def fail():
        with store.writing() as connection:
            append_event(connection, "first", "accepted", {})
            raise KeyError("after the event")

    with pytest.raises(KeyError):
        fail()
    assert store.events("first")[-1].kind == "noted"
    assert [one.state for one in audit(store)] == ["whole"]


def test_a_machines_life_is_kept_by_rig(store):
    for rig in ("a", "b", "a"):
        add_to_life(store, "machine_events", rig=rig, machine="m", kind="collision", data={"part": rig}, campaign=None)
        store.add_table_change(rig=rig, machine="m", campaign=None, change=rig, kind="begun", data={"left": 0.1})
    assert [row.data["part"] for row in life_rows(store, "machine_events", "a")] == ["a", "a"]
    assert [change.data for change in store.table_changes("a")] == [{"left": 0.1}] * 2
    assert [change.change for change in store.table_changes()] == ["a", "b", "a"]


def test_a_campaign_is_archived_into_a_file_or_deleted(store, tmp_path):
    filled(store, "first", "second")
    head = store.head("first")
    gone = archive_campaign(store, "first", tmp_path / "archive.sqlite", "machine sold")
    assert (gone.head, gone.readings, gone.rows) == (head, 6, 8)
    delete_campaign(store, "second", "wrong reflector")
    assert store.campaigns() == []
    assert [one.campaign for one in store.removed()] == ["first", "second"]
    with closing(Store(tmp_path / "archive.sqlite", read_only=True)) as archive:
        assert archive.head("first") == head
        assert [one.state for one in audit(archive)] == ["whole"]
    with pytest.raises(InputError, match="was removed on"):
        store.add_recording(small_recording("first"))


def test_the_list_asks_as_often_for_many_campaigns_as_for_one(store):
    counted = []
    for names in (("first",), ("second", "third", "fourth", "fifth")):
        filled(store, *names)
        with Counting() as seen:
            assert {row.state for row in store.campaigns()} == {"interrupted"}
        counted.append(len(seen))
    assert counted[0] == counted[1] <= 8


def test_histories_ask_as_often_for_many_rigs_as_for_one(store):
    """Also where older campaigns tell of calibrations that have no row."""
    former = {"parameters": {"drive_scale.left": {"value": 1e-5, "u": 1e-6, "unit": "1"}}, "chi2_per_dof": 1.0}
    counted = []
    for names in (("a",), ("b", "c", "d", "e")):
        for name in names:
            recording = small_recording(name)
            file = recording.file.model_copy(update={"rig": f"rig {name}"})
            store.add_recording(replace(recording, file=file))
            store.add_event(name, "identified", former)
            add_to_life(store, "machines", rig=f"saw {name}", machine="m/1", kind="history begins", data={})
        with Counting() as seen:
            lives = histories(store, rigs_of(store))
        counted.append(len(seen))
    assert [life["rig"] for life in lives] == [f"{kind} {name}" for kind in ("rig", "saw") for name in "abcde"]
    assert [life["calibrations"][0]["campaign"] for life in lives[:5]] == list("abcde")
    assert counted[0] == counted[1] <= 20


def test_a_rig_on_which_nothing_was_calibrated_has_no_history_and_hides_no_other(store):
    filled(store, "first")
    with pytest.raises(InputError, match="nothing was calibrated or checked on rig plant yet"):
        histories(store, rigs_of(store))
    add_to_life(store, "machines", rig="saw", machine="m/1", kind="history begins", data={})
    assert [life["rig"] for life in histories(store, rigs_of(store))] == ["saw"]


HOLDS = """
import sys
from pathlib import Path
from pkm_rig.store.store import open_store
with open_store(Path(sys.argv[1]), hold=True, rig=sys.argv[2], campaign="first"):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_a_rig_has_one_owner_who_is_named_and_freed_however_he_ends(store, place, out):
    filled(store, "first")
    store.add_event("first", BEGUN, {"session": 1})
    words = [sys.executable, "-c", HOLDS, str(out), "saw"]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout.readline() == "held\n"
            with pytest.raises(StoreError, match=rf"in use by '-c {out} saw', process {process.pid} of .* since 20"):
                store.hold("saw")
            with pytest.raises(StoreError, match=f"process {process.pid} of"):
                store.hold()
            assert [row.state for row in store.campaigns()] == ["running"]
        finally:
            process.kill()
    with closing(Store(place)) as other:
        other.work_on("first", "saw")
        assert store.worked_on() == {"first"}
        other.add_event("first", "noted", {})
        other.work_on(None, "saw")
        assert store.worked_on() == set()
    store.hold("saw")
    assert [row.state for row in store.campaigns()] == ["interrupted"]
