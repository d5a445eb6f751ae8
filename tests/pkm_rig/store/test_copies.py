"""Backups: of a store that is being written, complete or not there at all, and as good as the store."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import closing

import pytest

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.store.audit import audit
from pkm_rig.store.copies import back_up
from pkm_rig.store.store import Store
from tests.pkm_rig.store.stores import change, rows, small_store, version_0_1_store

WRITES = """
import sys
from pathlib import Path
from pkm_rig.store.store import open_store
with open_store(Path(sys.argv[1]), hold=True) as store:
    for number in range(100_000):
        store.add_event("first", "noted", {"number": number})
        if number == 5:
            print("writing", flush=True)
"""


@pytest.fixture
def path(tmp_path):
    return small_store(tmp_path / "pkm-rig.sqlite", "first", "second")


def test_a_backup_while_a_campaign_is_written_is_whole(path, tmp_path):
    with subprocess.Popen([sys.executable, "-c", WRITES, tmp_path], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "writing\n"
        counts = []
        for number in range(3):
            back_up(path, tmp_path / f"copy-{number}.sqlite")
            with closing(Store(tmp_path / f"copy-{number}.sqlite", read_only=True)) as store:
                assert [one.state for one in audit(store)] == ["whole", "whole"]
                counts.append(len(store.events("first")))
        assert process.poll() is None  # it was writing all the time
        process.kill()
    assert counts[0] >= 3 + 6
    assert sorted(counts) == counts


def test_a_backup_is_one_file_and_replaces_none(path, tmp_path, run):
    out = ["--out", tmp_path]
    file = tmp_path / "deep" / "copy.sqlite"
    status, printed, _ = run("backup", file, "--json", *out)
    assert (status, json.loads(printed)) == (0, {"file": str(file), "campaigns": 2, "broken": []})
    assert [found.name for found in file.parent.iterdir()] == ["copy.sqlite"]
    assert rows(file, "PRAGMA journal_mode") == [("delete",)]
    before = file.read_bytes()
    status, _, err = run("backup", file, *out)
    assert (status, "exists already" in err) == (2, True)
    assert file.read_bytes() == before
    assert run("backup", tmp_path / "other.sqlite", "--out", tmp_path / "nowhere")[0] == 2
    assert not (tmp_path / "other.sqlite").exists()


def test_a_backup_of_a_damaged_store_is_made_and_says_so(path, tmp_path, run):
    change(path, "UPDATE readings SET sequence = 99 WHERE campaign = 'first' AND position = 3")
    status, _, err = run("backup", tmp_path / "copy.sqlite", "--out", tmp_path)
    assert status == 1
    assert "the copy is as the store, and that is damaged" in err
    assert "row 3" in err
    assert (tmp_path / "copy.sqlite").is_file()


def test_a_store_of_version_0_1_is_copied_as_it_is(tmp_path):
    path = version_0_1_store(tmp_path / "pkm-rig.sqlite")
    back_up(path, tmp_path / "copy.sqlite")
    tables = "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name"
    assert rows(tmp_path / "copy.sqlite", tables) == [("campaigns",), ("events",), ("readings",)]


def test_what_was_left_of_a_killed_backup_does_not_matter(path, tmp_path):
    (tmp_path / "copy.sqlite.part").write_bytes(b"half")
    back_up(path, tmp_path / "copy.sqlite")
    assert not (tmp_path / "copy.sqlite.part").exists()
    with closing(Store(tmp_path / "copy.sqlite", read_only=True)) as store:
        assert len(store.campaigns()) == 2


def test_a_place_that_cannot_be_written_is_named(path, tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="choose another place"):
        back_up(path, tmp_path / "file" / "copy.sqlite")


def test_a_copy_of_a_corrupt_file_is_not_taken_for_one(path, tmp_path):
    pages = bytearray(path.read_bytes())
    for at in range(8192, len(pages), 4096):
        pages[at : at + 16] = b"\xa5" * 16
    path.write_bytes(pages)
    with pytest.raises(StoreError, match=r"copy\.sqlite.*(damaged|malformed)"):
        back_up(path, tmp_path / "copy.sqlite")
    assert not (tmp_path / "copy.sqlite").exists()


def test_a_copy_whose_index_contradicts_its_rows_is_refused(path, tmp_path):
    """Nothing but SQLite's own check of the whole file finds that."""
    ((uid,),) = rows(path, "SELECT uid FROM readings WHERE campaign = 'first' AND position = 3")
    pages = bytearray(path.read_bytes())
    index = next(
        n
        for n in range(0, len(pages), 4096)
        if uid.encode() in (page := pages[n : n + 4096]) and not any(name in page for name in (b"x_m", b"readings"))
    )
    at = pages.index(uid.encode(), index)
    pages[at] ^= 1
    path.write_bytes(pages)
    with pytest.raises(StoreError, match=r"the copy is damaged \(.*index"):
        back_up(path, tmp_path / "copy.sqlite")
