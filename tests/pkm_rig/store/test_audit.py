"""What the chain must find: any changed bit of a stored value, any row missing, added or moved, the last included."""

from __future__ import annotations

import shutil
import sqlite3
import threading
from contextlib import closing

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.store import chain
from pkm_rig.store.audit import audit, find_head
from pkm_rig.store.store import Store
from tests.pkm_rig.store.stores import change, drop_triggers, rows, small_recording, small_store, version_0_1_store

ROWS = 10  # of a small campaign: six readings, imported, noted, another reading, finished
COLUMNS = {
    "campaigns": ("id", "created", "description", "machine", "chain"),
    "readings": ("campaign", "position", "uid", "sequence", "data", "chain"),
    "events": ("campaign", "position", "created", "kind", "data", "chain"),
    "heads": ("campaign", "position", "chain"),
}


ALL_COLUMNS = [pytest.param(t, c, id=f"{t}.{c}") for t, columns in COLUMNS.items() for c in columns]


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    return small_store(tmp_path_factory.mktemp("store") / "store.sqlite", "first", "second")


@pytest.fixture
def path(original, tmp_path):
    return shutil.copy(original, tmp_path / "store.sqlite")


def states(path):
    """What an audit of all says, by campaign."""
    with closing(Store(path, read_only=True)) as store:
        return {one.campaign: one.state for one in audit(store)}


def problem(path, campaign="first"):
    with closing(Store(path, read_only=True)) as store:
        (found,) = audit(store, campaign)
    assert found.state == "broken"
    return found.problem


def test_an_untouched_campaign_is_whole_and_its_head_is_the_stores(path):
    with closing(Store(path, read_only=True)) as store:
        first, second = audit(store)
        assert (first.state, first.rows, first.readings, first.head) == ("whole", ROWS, 7, store.head("first"))
        assert second.state == "whole"
        assert first.head != second.head


def test_the_chain_is_what_its_definition_says(path):
    """Computed here from the definition in docs/decisions/0010-record.md, not by the package."""
    import hashlib  # noqa: PLC0415
    import json  # noqa: PLC0415

    def value(content):
        return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()

    ((created, description, machine),) = rows(
        path, "SELECT created, description, machine FROM campaigns WHERE id = 'first'"
    )
    head = value({"campaign": "first", "created": created, "description": json.loads(description), "machine": machine})
    union = (
        "SELECT position, uid, sequence, NULL, data FROM readings WHERE campaign = 'first' UNION ALL "
        "SELECT position, NULL, created, kind, data FROM events WHERE campaign = 'first' ORDER BY position"
    )
    for position, uid, second, kind, data in rows(path, union):
        content = {"after": head, "campaign": "first", "position": position}
        if uid is None:
            content["event"] = {"created": second, "kind": kind, "data": json.loads(data)}
        else:
            content["reading"] = {"uid": uid, "sequence": second, "data": json.loads(data)}
        head = value(content)
    with closing(Store(path, read_only=True)) as store:
        assert store.head("first") == head


def flipped(value, bit):
    """The value with one of its bits changed, as bytes if it is a text."""
    if isinstance(value, int):
        return value ^ (1 << bit % 40)
    raw = bytearray(value.encode())
    raw[bit // 8 % len(raw)] ^= 1 << bit % 8
    return bytes(raw)


@pytest.fixture(scope="module")
def cells(original, tmp_path_factory):
    """A store whose cells can be changed one after the other, and an open audit of it."""
    path = shutil.copy(original, tmp_path_factory.mktemp("cells") / "store.sqlite")
    with (
        closing(sqlite3.connect(path, isolation_level=None)) as connection,
        closing(Store(path, read_only=True)) as store,
    ):
        connection.execute("PRAGMA synchronous=OFF")
        drop_triggers(connection)
        yield Cells(connection, store)


class Cells:
    def __init__(self, connection, store):
        self.connection, self.store = connection, store

    def of_first(self, table, column):
        """(rowid, value) of a column's cells of the first campaign."""
        own = "id" if table == "campaigns" else "campaign"
        return self.connection.execute(f"SELECT rowid, {column} FROM {table} WHERE {own} = 'first'").fetchall()

    def states_with(self, table, column, rowid, value):
        """What an audit says while a cell has another value; None if SQLite itself refuses it as not unique."""
        (former,) = self.connection.execute(f"SELECT {column} FROM {table} WHERE rowid = ?", (rowid,)).fetchone()
        update = (
            f"UPDATE {table} SET {column} = {'CAST(? AS TEXT)' if isinstance(value, bytes) else '?'} WHERE rowid = ?"
        )
        try:
            self.connection.execute(update, (value, rowid))
        except sqlite3.IntegrityError:
            return None
        try:
            return {one.campaign: one.state for one in audit(self.store)}
        finally:
            self.connection.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (former, rowid))


@pytest.mark.parametrize(("table", "column"), ALL_COLUMNS)
def test_a_changed_bit_is_found_in_every_column(cells, table, column):
    """Of every row of the first campaign: bits at the beginning, in the middle and at the end of the value."""
    tried = 0
    for rowid, value in cells.of_first(table, column):
        size = 8 * len(value.encode()) if isinstance(value, str) else 8
        for bit in sorted({0, 1, size // 3, size // 2 + 4, size - 8, size - 1}):
            found = cells.states_with(table, column, rowid, flipped(value, bit))
            if found is not None:
                tried += 1
                assert "broken" in found.values(), (rowid, bit)
                assert found["second"] == "whole"
    assert tried >= 4
    assert set({one.state for one in audit(cells.store)}) == {"whole"}


@settings(max_examples=100)
@given(data=st.data())
def test_a_changed_bit_is_found_wherever_it_is_in_the_data(cells, data):
    """Digits that round to the same number, spaces and escapes included: what is stored has one form."""
    table, column = data.draw(st.sampled_from([("readings", "data"), ("events", "data"), ("campaigns", "description")]))
    rowid, value = data.draw(st.sampled_from(cells.of_first(table, column)))
    bit = data.draw(st.integers(0, 8 * len(value) - 1))
    assert cells.states_with(table, column, rowid, flipped(value, bit)) == {"first": "broken", "second": "whole"}


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("0.30000000000000004", "0.30000000000000005"),  # the same float64
        ("\\u00b5", "\\u00B5"),
        ('"a":', '"a" :'),
        ("5]", "5.0]"),
        ("-0.0", "0.0"),
        ("null", "false"),
    ],
)
def test_a_text_that_means_the_same_is_not_as_it_was_written(cells, before, after):
    rowid, data = cells.of_first("events", "data")[1]
    assert before in data
    found = cells.states_with("events", "data", rowid, data.replace(before, after, 1))
    assert found == {"first": "broken", "second": "whole"}


@pytest.mark.parametrize("position", range(1, ROWS + 1))
def test_any_missing_row_is_found_and_named(path, position):
    table = "readings" if position in (1, 2, 3, 4, 5, 6, 9) else "events"
    change(path, f"DELETE FROM {table} WHERE campaign = 'first' AND position = {position}")
    expected = f"row {position} is missing" if position < ROWS else "9 rows, and there were 10"
    assert expected in problem(path)
    assert states(path)["second"] == "whole"


@pytest.mark.parametrize(("one", "other"), [(1, 2), (3, 6), (7, 8), (8, 10), (2, 8), (6, 9), (9, 10)])
def test_rows_that_changed_places_are_found(path, one, other):
    with closing(sqlite3.connect(path)) as connection, connection:
        drop_triggers(connection)
        for step in ((one, -1), (other, one), (-1, other)):
            for table in ("readings", "events"):
                connection.execute(
                    f"UPDATE {table} SET position = ? WHERE campaign = 'first' AND position = ?", step[::-1]
                )
    assert f"(row {one})" in problem(path)


@pytest.mark.parametrize("position", [0, 5, 8, 10, 11, -1])
def test_an_added_row_is_found(path, position):
    copied = "created, kind, data, chain FROM events WHERE campaign = 'first' AND kind = 'finished'"
    insert = "INSERT OR REPLACE INTO events (campaign, position, created, kind, data, chain)"
    change(path, f"{insert} SELECT campaign, {position}, {copied}")
    if position == 10:
        assert states(path)["first"] == "whole"  # the very same row
    else:
        assert states(path) == {"first": "broken", "second": "whole"}


def test_a_row_of_another_campaign_is_found(path):
    change(
        path,
        "UPDATE readings SET campaign = 'second', position = 11, uid = 'x' WHERE campaign = 'first' AND position = 3",
    )
    assert states(path) == {"first": "broken", "second": "broken"}


def test_rows_without_their_campaign_are_found(path):
    change(path, "DELETE FROM campaigns WHERE id = 'first'")
    assert "is missing, there are rows of it" in problem(path)
    change(path, "UPDATE heads SET campaign = 'third' WHERE campaign = 'second'")
    assert states(path) == {"first": "broken", "second": "broken", "third": "broken"}


def test_a_chain_that_was_computed_anew_is_found_by_a_head_that_is_kept_elsewhere(path):
    """Whoever takes away the last row and its head, or computes all anew, cannot make the former head."""
    with closing(Store(path, read_only=True)) as store:
        kept = store.head("first")
        (before,) = audit(store, "first")
        assert find_head(kept, [before], []) == ("first", ROWS, ROWS)
    ((previous,),) = rows(path, "SELECT chain FROM readings WHERE campaign = 'first' AND position = 9")
    change(
        path,
        "DELETE FROM events WHERE campaign = 'first' AND position = 10",
        f"UPDATE heads SET position = 9, chain = '{previous}' WHERE campaign = 'first'",
    )
    with closing(Store(path, read_only=True)) as store:
        (after,) = audit(store, "first")
    assert after.state == "whole"
    assert find_head(kept, [after], []) is None


def test_an_earlier_head_stays_in_the_chain(path):
    with closing(Store(path)) as store:
        kept = store.head("first")
        store.add_event("first", "verifying", {"first_sequence": 7})
        assert find_head(kept, audit(store), []) == ("first", ROWS, ROWS + 1)
        assert find_head("0" * 64, audit(store), []) is None


def test_a_campaign_of_version_0_1_is_not_chained(tmp_path):
    path = version_0_1_store(tmp_path / "store.sqlite")
    for read_only in (True, False):
        with closing(Store(path, read_only=read_only)) as store:
            (found,) = audit(store)
            assert (found.state, found.rows, found.readings, found.head) == ("not chained", 688, 667, None)
    change(path, "UPDATE events SET data = '{' WHERE position = 670")
    with closing(Store(path, read_only=True)) as store:
        assert "event 'finished' (row 670): damaged (no JSON)" in audit(store)[0].problem


def test_removing_all_chain_values_but_one_is_found(path):
    change(path, "UPDATE heads SET chain = NULL WHERE campaign = 'first'")
    assert "its head is not that of its last row" in problem(path)
    change(path, "UPDATE campaigns SET chain = NULL WHERE id = 'second'")
    assert "chained in a campaign that is not" in problem(path, "second")


def test_writers_do_not_fork_a_chain(tmp_path):
    """Threads and further connections add rows at once: one order, one chain."""
    path = tmp_path / "store.sqlite"
    with closing(Store(path)) as store, closing(Store(path)) as other:
        store.add_recording(small_recording("first"))

        def write_events(through, name):
            for number in range(15):
                through.add_event("first", name, {"number": number})

        threads = [
            threading.Thread(target=write_events, args=(through, f"{number}"))
            for number, through in enumerate((store, store, other, other))
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        (found,) = audit(store, "first")
    assert (found.state, found.rows) == ("whole", 7 + 60)


def test_a_campaign_that_is_not_there_is_named(path):
    with closing(Store(path, read_only=True)) as store, pytest.raises(InputError, match="no campaign 'third'"):
        audit(store, "third")


def test_a_changed_row_is_never_used(path):
    number = "data = REPLACE(data, '\"payload\":0.0', '\"payload\":1.0')"
    change(path, f"UPDATE readings SET {number} WHERE campaign = 'first' AND position = 4")
    with closing(Store(path, read_only=True)) as store:
        with pytest.raises(StoreError, match=r"campaign 'first', reading .* \(row 4\): damaged \(not as it was wr"):
            store.recording("first")
        assert len(store.events("first")) == 3
        assert len(store.recording("second")) == 7


def test_a_campaign_whose_last_row_is_missing_is_never_used(path):
    change(path, f"DELETE FROM events WHERE campaign = 'first' AND position = {ROWS}")
    with closing(Store(path, read_only=True)) as store:
        for read in (store.recording, store.events):
            with pytest.raises(StoreError, match=r"campaign 'first': damaged \(rows are missing"):
                read("first")
        assert len(store.events("second")) == 3


def test_content_that_no_json_has_is_refused():
    with pytest.raises(ValueError, match="JSON compliant"):
        chain.canonical({"a": float("nan")})


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=6,
)


@given(st.text(), st.text(), st.text(), st.dictionaries(st.text(), JSON, max_size=3), st.integers(1, 10**9))
@example('"},"position":1}', '","kind":"accepted"},"position":2}', "\ud800\x00é", {'"': "\\"}, 1)
def test_the_text_that_is_stored_gives_the_same_chain_value_as_what_it_says(campaign, created, kind, data, position):
    """Lists compare rows without parsing them."""
    text = chain.canonical(data)
    assert chain.event_link_of_text("a" * 64, campaign, position, created, kind, text) == chain.event_link(
        "a" * 64, campaign, position, created, kind, data
    )
    assert chain.genesis_of_text(campaign, created, text, kind) == chain.genesis(campaign, created, data, kind)
    for changed in (text[:-1] + " }", text.replace("{", "{ ", 1)):
        assert chain.event_link_of_text("a" * 64, campaign, position, created, kind, changed) != chain.event_link(
            "a" * 64, campaign, position, created, kind, data
        )
