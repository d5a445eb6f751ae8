"""Campaigns that leave the store: what stays, and what the archive has."""

from __future__ import annotations

import json
import os
import sqlite3
import tomllib
from contextlib import closing

import pytest

from calibration.base.errors import InputError
from calibration.recording.folder import read_folder
from pkm_rig.errors import CampaignRefused
from pkm_rig.store import copies
from pkm_rig.store.audit import audit, find_head
from pkm_rig.store.lock import user_name
from pkm_rig.store.place import campaign_folder
from pkm_rig.store.removal import archive_campaign, delete_campaign
from pkm_rig.store.store import Store
from tests.pkm_rig.store.stores import change, rows, small_recording, small_store, version_0_1_store

OLD = "embedded-mock-20261122-035604-9d78"


@pytest.fixture
def path(tmp_path):
    return small_store(tmp_path / "pkm-rig.sqlite", "first", "second")


@pytest.fixture
def store(path):
    with closing(Store(path)) as store:
        yield store


def all_rows(path, campaign):
    queries = ("campaigns WHERE id", "readings WHERE campaign", "events WHERE campaign", "heads WHERE campaign")
    return [rows(path, f"SELECT * FROM {query} = '{campaign}'") for query in queries]


def test_a_deleted_campaign_leaves_its_head_who_when_and_why(store, path):
    head = store.head("first")
    removed = delete_campaign(store, "first", " wrong reflector ")
    assert store.removed() == [removed]
    assert (removed.campaign, removed.readings, removed.rows, removed.head) == ("first", 7, 10, head)
    assert (removed.why, removed.who, removed.archive) == ("wrong reflector", user_name(), None)
    assert removed.removed.startswith("20")
    assert all_rows(path, "first") == [[], [], [], []]
    assert [one.campaign for one in store.campaigns()] == ["second"]
    assert [one.state for one in audit(store)] == ["whole"]
    assert find_head(head, [], store.removed()) == ("first", 10, 10)


def test_an_archive_has_the_same_rows_and_the_same_head(store, path, tmp_path):
    before = all_rows(path, "first")
    removed = archive_campaign(store, "first", tmp_path / "deep" / "archive.sqlite", "machine sold")
    archive = tmp_path / "deep" / "archive.sqlite"
    assert removed.archive == str(archive)
    assert all_rows(archive, "first") == before
    assert all_rows(path, "first") == [[], [], [], []]
    assert [file.name for file in archive.parent.iterdir()] == ["archive.sqlite"]
    assert rows(archive, "PRAGMA journal_mode") == [("delete",)]
    with closing(Store(archive, read_only=True)) as archived:
        (found,) = audit(archived)
        assert (found.state, found.head) == ("whole", removed.head)
        assert len(archived.recording("first")) == 7
    assert campaign_folder(archive, "first") == archive.parent / "first"  # its report and pictures, not below a file


def test_a_campaign_of_version_0_1_is_archived_too(tmp_path):
    with closing(Store(version_0_1_store(tmp_path / "pkm-rig.sqlite"))) as store:
        removed = archive_campaign(store, OLD, tmp_path / "archive.sqlite", "old")
    assert (removed.head, removed.readings, removed.rows) == (None, 667, 688)
    with closing(Store(tmp_path / "archive.sqlite", read_only=True)) as archived:
        assert [one.state for one in audit(archived)] == ["not chained"]
        assert len(archived.recording(OLD)) == 667


def test_a_damaged_campaign_is_not_archived_but_can_be_deleted(store, path, tmp_path):
    change(path, "UPDATE readings SET sequence = 99 WHERE campaign = 'first' AND position = 3")
    with pytest.raises(CampaignRefused, match=r"\(row 3\): damaged .* `pkm-rig backup` copies"):
        archive_campaign(store, "first", tmp_path / "archive.sqlite", "why not")
    assert not (tmp_path / "archive.sqlite").exists()
    assert len(all_rows(path, "first")[1]) == 7
    change(path, "UPDATE campaigns SET created = CAST(X'FF' AS TEXT) WHERE id = 'first'")
    change(path, "DELETE FROM heads WHERE campaign = 'first'")
    removed = delete_campaign(store, "first", "damaged")
    assert (removed.rows, removed.head) == (0, None)


def test_an_archive_that_cannot_be_finished_leaves_the_campaign(store, path, tmp_path, monkeypatch):
    before = all_rows(path, "first")

    def fail(_path):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(copies, "_sync", fail)
    with pytest.raises(InputError, match="No space left"):
        archive_campaign(store, "first", tmp_path / "archive.sqlite", "why not")
    monkeypatch.undo()
    assert all_rows(path, "first") == before
    assert store.removed() == []
    assert list(tmp_path.glob("archive*")) == []
    archive_campaign(store, "first", tmp_path / "archive.sqlite", "again")


def test_what_cannot_be_removed_is_named(store, tmp_path):
    (tmp_path / "there").write_text("precious")
    with pytest.raises(InputError, match="there: exists already"):
        archive_campaign(store, "first", tmp_path / "there", "why not")
    with pytest.raises(InputError, match="--why says nothing"):
        delete_campaign(store, "first", "  ")
    with pytest.raises(InputError, match="no campaign 'third'"):
        delete_campaign(store, "third", "why not")
    with pytest.raises(InputError, match="no campaign 'third'"):
        archive_campaign(store, "third", tmp_path / "archive.sqlite", "why not")
    assert (tmp_path / "there").read_text() == "precious"
    assert sorted(os.listdir(tmp_path)) == ["pkm-rig.sqlite", "pkm-rig.sqlite-shm", "pkm-rig.sqlite-wal", "there"]


def test_an_id_is_not_given_again(store):
    delete_campaign(store, "first", "wrong")
    with pytest.raises(InputError, match=r"'first' was removed on 20.*; give it another id"):
        store.add_recording(small_recording("first"))
    assert store.campaigns()[0].campaign == "second"


def test_only_campaigns_whose_removal_is_on_record_can_be_deleted(store, path):
    delete_campaign(store, "first", "wrong")
    with closing(sqlite3.connect(path)) as other:
        for table in ("campaigns", "readings", "events", "removed_campaigns"):
            with pytest.raises(sqlite3.IntegrityError, match="append-only"):
                other.execute(f"DELETE FROM {table}")
            with pytest.raises(sqlite3.IntegrityError, match="append-only"):
                other.execute(
                    f"UPDATE {table} SET created = ''" if table != "readings" else "UPDATE readings SET data = 1"
                )


def test_the_commands_say_what_they_did_and_ask_before_they_delete(path, tmp_path, run):
    out = ["--out", tmp_path]
    status, _, err = run("delete", "first", "--why", "wrong", *out)
    assert (status, "give --yes" in err) == (2, True)
    status, printed, _ = run("delete", "first", "--why", "wrong [/b]", "--yes", "--json", *out)
    assert status == 0
    assert json.loads(printed)["why"] == "wrong [/b]"
    status, printed, _ = run("archive", "second", tmp_path / "a.sqlite", "--why", "sold", *out)
    assert (status, "archived to" in printed) == (0, True)
    status, printed, _ = run("list", *out)
    assert printed.startswith("2 removed: pkm-rig list --removed")
    status, printed, _ = run("list", "--removed", *out)
    assert "deleted on" in printed
    assert "wrong [/b]" in printed
    status, printed, _ = run("audit", "second", "--out", tmp_path / "a.sqlite")
    head = printed.split("head ")[1].strip()
    for where in (tmp_path, tmp_path / "a.sqlite"):
        assert run("audit", "--head", head.upper(), "--out", where)[0] == 0
        status, _, err = run("audit", "--head", "0" * 64, "--out", where)
        assert (status, "is not in the record" in err) == (1, True)
    assert run("audit", "--head", "abc", *out)[0] == 2
    assert run("audit", "third", *out)[0] == 2
    assert run("delete", "third", "--why", "x", "--out", tmp_path / "nowhere")[0] == 2
    assert not (tmp_path / "nowhere").exists()


def test_an_export_has_the_head_and_is_read_as_before(path, tmp_path, run):
    status, printed, _ = run("export", "first", tmp_path / "f", "--json", "--out", tmp_path)
    record = tomllib.loads((tmp_path / "f" / "record.toml").read_text(encoding="utf-8"))
    assert status == 0
    assert record == {"campaign": "first", "head": json.loads(printed)["head"], "readings": 7}
    assert run("audit", "first", "--head", record["head"], "--out", tmp_path)[0] == 0
    assert len(read_folder(tmp_path / "f")) == 7
