from __future__ import annotations

import sqlite3
import threading
from dataclasses import replace

import pytest
import sqlalchemy as sa
from sqlalchemy import event

from calibration.base.errors import InputError
from calibration.recording.header import DeclaredLevels
from pkm_rig.errors import StoreError
from pkm_rig.store.store import Store
from tests.pkm_rig.plant_recording import record


@pytest.fixture(scope="module")
def recording():
    return record(3, calibration_poses=6)


@pytest.fixture
def store(tmp_path):
    store = Store(tmp_path / "deep" / "store.sqlite")
    yield store
    store.close()


def test_what_goes_in_comes_out(store, recording):
    store.add_recording(recording)
    again = store.recording(recording.file.campaign)
    assert again.file == recording.file
    assert all((again.columns[n] == recording.columns[n]).all() for n in recording.columns)
    assert store.campaigns()[0][3] == len(recording)


def test_levels_that_are_not_declared_stay_so(store, recording):
    levels = DeclaredLevels(drift_m=3e-6)  # its default, but declared
    store.add_recording(replace(recording, file=recording.file.model_copy(update={"nuisance": levels})))
    found = store.recording(recording.file.campaign).file.nuisance
    assert (found.model_fields_set, found) == ({"drift_m"}, levels)


def test_one_phase_comes_out_alone(store, recording):
    store.add_recording(recording)
    name, nests = recording.file.campaign, recording.rows("nests")
    again = store.recording(name, phase="nests")
    assert 0 < len(again) < len(recording)
    assert all((again.columns[n] == nests.columns[n]).all() for n in nests.columns)
    with pytest.raises(InputError, match="no readings"):
        store.recording(name, phase="nest_")


def test_a_reading_is_on_disk_when_the_call_returns(store, recording):
    store.add_campaign(recording.file, recording.machine.text)
    store.add_reading(recording.file.campaign, "a", 0, {"value": 0.1})
    other = sqlite3.connect(store.path)
    assert other.execute("SELECT data FROM readings").fetchall() == [('{"value":0.1}',)]
    assert other.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    other.close()


def test_the_record_is_append_only(store, recording):
    store.add_campaign(recording.file, recording.machine.text)
    store.add_reading(recording.file.campaign, "a", 0, {"value": 0.1})
    other = sqlite3.connect(store.path)
    for statement in ("UPDATE readings SET data = '{}'", "DELETE FROM readings", "DELETE FROM campaigns"):
        with pytest.raises(sqlite3.IntegrityError, match="append-only"):
            other.execute(statement)
    other.close()


def test_an_import_is_whole_or_not_at_all(store, recording):
    store.add_recording(recording)
    with pytest.raises(InputError, match="already"):
        store.add_recording(recording)
    assert store.campaigns()[0][3] == len(recording)


def test_nan_is_refused(store, recording):
    store.add_campaign(recording.file, recording.machine.text)
    with pytest.raises(ValueError, match="not JSON compliant"):
        store.add_reading(recording.file.campaign, "a", 0, {"value": float("nan")})


def test_a_full_disk_is_one_line_and_keeps_what_was_written(tmp_path, recording):
    store = Store(tmp_path / "store.sqlite")
    store.add_campaign(recording.file, recording.machine.text)
    store.limit_pages(40)
    written = 0

    def fill():
        nonlocal written
        for written in range(10_000):
            store.add_reading(recording.file.campaign, f"u{written}", written, {"filler": "x" * 500})

    with pytest.raises(StoreError, match="full") as caught:
        fill()
    assert "\n" not in str(caught.value)
    assert written > 10
    assert store.campaigns()[0][3] == written
    store.close()


def test_unknown_campaigns_and_unwritable_places_are_named(store, tmp_path):
    with pytest.raises(InputError, match="pkm-rig list"):
        store.recording("nothing")
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="choose a place"):
        Store(tmp_path / "file" / "store.sqlite")


def test_every_connection_synchronises_to_the_disk(store, recording):
    """Also those of further threads: read back from SQLite on each connection that is used."""
    seen = []

    def read_back(connection, _record, _proxy):
        pragmas = ("synchronous", "journal_mode", "foreign_keys")
        seen.append(tuple(connection.execute(f"PRAGMA {name}").fetchone()[0] for name in pragmas))

    event.listen(sa.pool.Pool, "checkout", read_back)
    try:
        store.add_recording(recording)

        def write():
            with store.reading(), store.reading():  # two at once, so that further connections are made
                store.add_event(recording.file.campaign, "noted", {})

        threads = [threading.Thread(target=write) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        store.campaigns()
    finally:
        event.remove(sa.pool.Pool, "checkout", read_back)
    assert len(seen) > 10
    assert set(seen) == {(2, "wal", 1)}  # 2 is FULL: a commit returns when it is on the disk
