"""Looking at a store changes nothing, and needs no permission to write."""

from __future__ import annotations

import os
import shutil
import sqlite3
import tempfile
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.store.audit import audit
from pkm_rig.store.store import Store, open_existing_store
from tests.pkm_rig.store.stores import small_store, version_0_1_store

OLD = "embedded-mock-20261122-035604-9d78"
NOBODY = 65534


@pytest.fixture
def folder():
    """A folder that everybody may look into."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        yield folder
        for path in (folder, *folder.rglob("*")):
            path.chmod(0o755)


@contextmanager
def read_only(folder):
    """No file in the folder, nor the folder, can be written: a superuser, who always can, becomes nobody."""
    for path in (*folder.rglob("*"), folder):
        path.chmod(0o555 if path.is_dir() else 0o444)
    former = os.geteuid()
    if former == 0:
        os.seteuid(NOBODY)
    try:
        assert not os.access(folder, os.W_OK, effective_ids=True)
        yield
    finally:
        os.seteuid(former)


def content(folder):
    return {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.iterdir()}


def test_an_archive_that_cannot_be_written_is_used(folder):
    small_store(folder / "pkm-rig.sqlite", "first")
    before = content(folder)
    with read_only(folder), open_existing_store(folder) as store:
        assert store.campaigns()[0].campaign == "first"
        assert len(store.recording("first")) == 7
        assert [one.state for one in audit(store)] == ["whole"]
    assert content(folder) == before


def test_an_archive_of_version_0_1_that_cannot_be_written_is_used(folder):
    with closing(Store(Path(folder) / "warm.sqlite")):  # loads what migrates, from where nobody may read
        pass
    (folder / "warm.sqlite").unlink()
    version_0_1_store(folder / "pkm-rig.sqlite")
    before = content(folder)
    with read_only(folder), open_existing_store(folder) as store:
        assert len(store.recording(OLD)) == 667
        assert store.events(OLD)[-1].kind == "refused"
        assert [one.state for one in audit(store)] == ["not chained"]
    assert content(folder) == before


def test_what_is_left_in_the_log_of_a_killed_writer_is_read(folder, tmp_path):
    """The copy of a store that was being written: its last rows are in the log beside it."""
    with closing(Store(small_store(tmp_path / "pkm-rig.sqlite", "first"))) as store:
        store.add_event("first", "noted", {"last": True})
        for file in tmp_path.glob("pkm-rig.sqlite*"):
            if not file.name.endswith("-shm"):
                shutil.copy(file, folder)
    assert (folder / "pkm-rig.sqlite-wal").stat().st_size > 0
    before = content(folder)
    with read_only(folder), open_existing_store(folder) as store:
        assert store.events("first")[-1].data == {"last": True}
    assert content(folder) == before


def test_an_empty_log_is_none(folder):
    small_store(folder / "pkm-rig.sqlite", "first")
    (folder / "pkm-rig.sqlite-wal").touch()
    with read_only(folder), open_existing_store(folder) as store:
        assert len(store.recording("first")) == 7


def test_it_cannot_be_written_to_and_that_is_one_line(folder):
    small_store(folder / "pkm-rig.sqlite", "first")
    with (
        read_only(folder),
        pytest.raises(StoreError, match=r"pkm-rig.sqlite: .*(readonly|read-only|unable)"),
    ):
        Store(folder / "pkm-rig.sqlite").add_event("first", "noted", {})


def test_looking_leaves_nothing_behind_and_migrates_nothing(tmp_path):
    for make in (version_0_1_store, lambda path: small_store(path, "first")):
        path = make(tmp_path / "pkm-rig.sqlite")
        before = path.read_bytes()
        with open_existing_store(tmp_path) as store:
            store.campaigns()
            with pytest.raises(StoreError, match="readonly"):
                store.add_table_change(rig="r", machine="m", campaign=None, change="c", kind="k", data={})
        assert path.read_bytes() == before
        assert [file.name for file in tmp_path.iterdir()] == ["pkm-rig.sqlite"]
        path.unlink()


def test_a_store_is_read_while_it_is_written(tmp_path):
    path = small_store(tmp_path / "pkm-rig.sqlite", "first")
    with closing(Store(path)) as writer, open_existing_store(tmp_path) as reader:
        for number in range(5):
            writer.add_event("first", "noted", {"number": number})
            assert reader.events("first")[-1].data == {"number": number}
        with writer.writing() as connection:
            connection.exec_driver_sql("UPDATE heads SET position = position")
            assert len(reader.events("first")) == 8


def test_a_file_is_a_store(tmp_path):
    path = small_store(tmp_path / "copy of a store #1?.sqlite", "first")
    with open_existing_store(path) as store:
        assert len(store.recording("first")) == 7


def test_an_empty_file_is_said_to_be_empty(tmp_path):
    (tmp_path / "pkm-rig.sqlite").touch()
    with pytest.raises(InputError, match="empty; nothing was stored"):
        Store(tmp_path / "pkm-rig.sqlite", read_only=True)


def test_a_lock_that_another_program_keeps_is_not_taken_for_a_read_only_file(tmp_path, monkeypatch):
    path = small_store(tmp_path / "pkm-rig.sqlite", "first")
    connect = sqlite3.connect
    monkeypatch.setattr("sqlite3.connect", lambda *a, **k: connect(*a, **{**k, "timeout": 0.01}))
    with closing(connect(path, isolation_level=None)) as other:
        other.execute("PRAGMA locking_mode=EXCLUSIVE")
        other.execute("BEGIN EXCLUSIVE")
        other.execute("UPDATE heads SET position = position")
        with pytest.raises(StoreError, match="locked"):
            Store(path, read_only=True)
