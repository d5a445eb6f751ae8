"""A damaged store ends no command in an internal error: what is damaged is named, the rest stays usable."""

from __future__ import annotations

import json
import re
import shutil
import sqlite3
from contextlib import closing

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.base.errors import InputError
from calibration.recording.recording import Recording
from pkm_rig.errors import CampaignRefused, StoreError
from pkm_rig.store.audit import audit
from pkm_rig.store.store import Store, open_store
from tests.either import either
from tests.pkm_rig.store.stores import change, drop_triggers, rows, small_store, version_0_1_store

EXPECTED = (InputError, StoreError, CampaignRefused)
OLD = "embedded-mock-20261122-035604-9d78"
NOT_UTF_8 = "CAST(X'7BFF22' AS TEXT)"


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    return small_store(tmp_path_factory.mktemp("store") / "pkm-rig.sqlite", "first", "second")


@pytest.fixture(scope="module")
def untouched(original):
    return look(original)[1]


@pytest.fixture
def path(original, tmp_path):
    return shutil.copy(original, tmp_path / "pkm-rig.sqlite")


def look(path):
    """All that looking at a store does: campaigns with their damage, and whatever of them was not refused."""
    read = {}
    with closing(Store(path, read_only=True)) as store:
        found = {row.campaign: row.damage for row in store.campaigns()}
        store.removed()
        store.table_changes()
        audit(store)
        for campaign in found:
            for name in ("recording", "events", "header"):
                value, line = either(lambda: getattr(store, name)(campaign), *EXPECTED)  # noqa: B023
                if line is None:
                    read[campaign, name] = comparable(value)
    return found, read


def comparable(value):
    """A recording as its rows, anything else as it is."""
    return [value.row(i) for i in range(len(value))] if isinstance(value, Recording) else value


def refusal(path):
    """Why a store cannot be looked at as a whole, None if it can."""
    return either(lambda: look(path), *EXPECTED)[1]


def states(path):
    with closing(Store(path, read_only=True)) as store:
        return [one.state for one in audit(store)]


@pytest.mark.parametrize(
    ("table", "column", "value"),
    [
        ("readings", "data", "'{\"x_m\": '"),
        ("readings", "data", NOT_UTF_8),
        ("readings", "data", "'[1]'"),
        ("readings", "data", "X'00'"),
        ("readings", "data", "'{\"x_m\":1e999}'"),
        ("readings", "data", "'{\"x_m\":NaN}'"),
        ("readings", "sequence", "'x'"),
        ("readings", "uid", NOT_UTF_8),
        ("events", "data", NOT_UTF_8),
        ("events", "data", '\'{"a":"\\ud800"}\''),
        ("events", "kind", NOT_UTF_8),
        ("events", "created", "5.5"),
    ],
)
def test_a_damaged_row_is_named_and_the_rest_is_used(path, table, column, value):
    position = 3 if table == "readings" else 7
    change(path, f"UPDATE {table} SET {column} = {value} WHERE campaign = 'first' AND position = {position}")
    with closing(Store(path, read_only=True)) as store:
        read = store.recording if table == "readings" else store.events
        with pytest.raises(StoreError, match=rf"campaign 'first', .* \(row {position}\): damaged"):
            read("first")
        assert len(store.recording("second")) == 7
        assert len(store.events("second")) == 3
        assert [one.state for one in audit(store)] == ["broken", "whole"]


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("description", NOT_UTF_8),
        ("description", "'{'"),
        ("description", 'REPLACE(description, \'"rig":"plant"\', \'"rig":"plank"\')'),
        ("machine", "X'FF'"),
        ("created", "X'FF'"),
    ],
)
def test_a_list_names_the_damaged_campaign_and_shows_the_others(path, column, value, run):
    change(path, f"UPDATE campaigns SET {column} = {value} WHERE id = 'first'")
    status, out, err = run("list", "--out", path.parent)
    assert status == 3
    assert "campaign 'first'" in err.splitlines()[-1]
    assert "damaged" in err.splitlines()[-1]
    assert "DAMAGED" in next(line for line in out.splitlines() if line.startswith("first"))
    assert "measured" in next(line for line in out.splitlines() if line.startswith("second"))
    status, out, _ = run("list", "--json", "--out", path.parent)
    listed = {row["campaign"]: row["damage"] for row in json.loads(out)["campaigns"]}
    assert listed["first"]
    assert listed["second"] == ""


@pytest.mark.parametrize(
    ("statement", "what"),
    [
        ("UPDATE events SET kind = 'accepted' WHERE campaign = 'first' AND position = 10", r"\(row 10\): damaged"),
        ("UPDATE events SET data = '{\"plan\":\"set-up\"}' WHERE campaign = 'first' AND position = 10", "row 10"),
        ("UPDATE events SET data = '{}' WHERE campaign = 'first' AND position = 8", "row 8"),
        ("DELETE FROM events WHERE campaign = 'first' AND position = 10", "rows are missing or were added"),
        ("DELETE FROM readings WHERE campaign = 'first' AND position = 3", "rows are missing or were added"),
        ("UPDATE heads SET chain = 'x' WHERE campaign = 'first'", "rows are missing or were added"),
    ],
)
def test_a_list_computes_nothing_from_rows_that_are_not_as_they_were_written(path, statement, what):
    change(path, statement)
    with closing(Store(path, read_only=True)) as store:
        first, second = store.campaigns()
    assert re.search(what, first.damage)
    assert (first.campaign, first.state) == ("first", "")
    assert (second.damage, second.state) == ("", "measured")


@pytest.mark.parametrize("command", ["show", "export", "identify", "diagnose", "audit", "report"])
def test_every_command_on_a_damaged_campaign_ends_with_one_line(path, command, run):
    change(path, f"UPDATE readings SET data = {NOT_UTF_8} WHERE campaign = 'first' AND position = 2")
    change(path, f"UPDATE events SET data = {NOT_UTF_8} WHERE campaign = 'first' AND position = 8")
    folder = [path.parent / "exported"] if command == "export" else []
    status, _, err = run(command, "first", *folder, "--out", path.parent)
    assert status == (1 if command == "audit" else 3)
    assert "row 2" in err or "row 8" in err
    assert len(err.splitlines()) == 1
    if command in ("export", "show", "audit"):
        assert run(command, "second", *folder, "--out", path.parent)[0] == 0


def test_an_event_of_version_0_1_without_a_key_that_is_needed_is_named(tmp_path, run):
    path = version_0_1_store(tmp_path / "pkm-rig.sqlite")
    Store(path).close()  # as the present version has it
    ((campaign,),) = rows(path, "SELECT id FROM campaigns")
    with closing(sqlite3.connect(path)) as connection, connection:
        drop_triggers(connection)
        connection.execute("UPDATE events SET data = REPLACE(data, '\"temperatures_c\"', '\"temperature_c\"')")
    status, _, err = run("report", campaign, "--out", tmp_path)
    assert status == 3
    assert re.search(r"event 'activated' \(row \d+\): damaged \(no 'temperatures_c'\)", err.splitlines()[-1])


def test_an_id_that_is_no_text_does_not_hide_the_others(path):
    change(path, f"UPDATE campaigns SET id = {NOT_UTF_8} WHERE id = 'first'")
    found, _ = look(path)
    assert found["second"] == ""
    assert [damage for campaign, damage in found.items() if campaign != "second" and damage]


@pytest.mark.parametrize("name", ["\udcff", "a\ud800", "\0", "\x1b[31m", "'", "[/b]"])
def test_any_name_that_is_asked_for_is_answered(path, name):
    with closing(Store(path, read_only=True)) as store, pytest.raises(InputError):
        store.recording(name)


def test_a_file_that_ends_early_is_named(path, tmp_path):
    whole = path.read_bytes()
    for size in (0, 1, 50, 100, 4096, 8192):
        path.write_bytes(whole[:size])
        assert str(path) in (refusal(path) or ""), size
    for size in (len(whole) // 2, len(whole) - 4096, len(whole) - 1):
        path.write_bytes(whole[:size])
        assert refusal(path) or "broken" in states(path), size


def test_a_corrupt_page_of_one_campaign_leaves_the_other(path):
    """A page that holds readings of the first campaign only is overwritten."""
    pages = path.read_bytes()
    ((uid,),) = rows(path, "SELECT uid FROM readings WHERE campaign = 'first' AND position = 3")
    at = next(n for n in range(0, len(pages), 4096) if f'"uid":"{uid}"'.encode() in pages[n : n + 4096])
    path.write_bytes(pages[:at] + b"\xa5" * 4096 + pages[at + 4096 :])
    assert states(path)[0] == "broken"
    with closing(Store(path, read_only=True)) as store:
        assert len(store.events("second")) == 3


@settings(max_examples=40)
@given(data=st.data())
def test_flipped_bytes_never_cause_another_error_nor_another_value(original, untouched, tmp_path_factory, data):
    """What is read without a complaint is what was written."""
    raw = bytearray(original.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path_factory.getbasetemp() / "flipped.sqlite"
    path.write_bytes(raw)
    result, line = either(lambda: look(path), *EXPECTED)
    if line is not None:
        assert str(path) in line or "schema" in line
    else:
        for name, value in result[1].items():
            assert value == untouched.get(name, []), name  # a name that was changed itself has no events


@settings(max_examples=5)
@given(data=st.data())
def test_nor_in_a_store_of_version_0_1(tmp_path_factory, data):
    path = version_0_1_store(tmp_path_factory.getbasetemp() / "flipped-old.sqlite")
    raw = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 8))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(raw)
    why = refusal(path)
    assert not why or str(path) in why or "schema" in why


@settings(max_examples=5)
@given(data=st.data())
def test_writing_to_a_damaged_store_ends_as_well(original, tmp_path_factory, data):
    raw = bytearray(original.read_bytes())
    raw[data.draw(st.integers(0, len(raw) - 1))] ^= data.draw(st.integers(1, 255))
    folder = tmp_path_factory.mktemp("written")
    (folder / "pkm-rig.sqlite").write_bytes(raw)

    def write():
        with open_store(folder) as store:
            store.add_event("second", "noted", {})
            store.add_table_change(rig="r", machine="m", campaign=None, change="c", kind="k", data={})
            return [change.change for change in store.table_changes()]

    written, line = either(write, *EXPECTED)
    assert written == ["c"] if line is None else line


def test_a_damaged_schema_version_is_named(path):
    for value, message in (
        ("''", "does not say its schema"),
        ("'x'", "does not say"),
        ("'0000'", "0000 is damaged"),
    ):
        with closing(sqlite3.connect(path)) as other, other:
            other.execute(f"UPDATE alembic_version SET version_num = {value}")
        for read_only in (True, False):
            with pytest.raises(StoreError, match=message):
                Store(path, read_only=read_only)
