from __future__ import annotations

import shutil
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import event

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.store import connections, migrate, schema
from pkm_rig.store.connections import engine_for_writing
from pkm_rig.store.store import Store
from tests.pkm_rig.plant_recording import record
from tests.pkm_rig.store.stores import rows, version_0_1_store

CAMPAIGN = "embedded-mock-20261122-035604-9d78"
READINGS = "SELECT campaign, uid, sequence, data FROM readings ORDER BY rowid"
EVENTS = "SELECT campaign, created, kind, data FROM events ORDER BY {}"
CAMPAIGNS = "SELECT id, created, description, machine FROM campaigns"


@pytest.fixture
def old(tmp_path):
    return version_0_1_store(tmp_path / "store.sqlite")


@pytest.fixture
def content(old):
    """Readings, events and campaigns of the kept store, before anything opened it."""
    return rows(old, READINGS), rows(old, EVENTS.format("id")), rows(old, CAMPAIGNS)


def content_now(path):
    return rows(path, READINGS), rows(path, EVENTS.format("position")), rows(path, CAMPAIGNS)


def test_a_store_of_version_0_1_keeps_every_value(old, content):
    with closing(Store(old)) as store:
        assert len(store.recording(CAMPAIGN)) == 667
        assert store.head(CAMPAIGN) == ""
    assert content_now(old) == content
    assert rows(old, "SELECT version_num FROM alembic_version") == [(schema.REVISION,)]
    assert rows(old, "SELECT campaign, position, chain FROM heads") == [(CAMPAIGN, 667 + 21, None)]
    numbers = rows(old, "SELECT position FROM readings UNION ALL SELECT position FROM events ORDER BY 1")
    assert numbers == [(n,) for n in range(1, 689)]


def test_the_store_as_it_was_stays_beside_it(old, content, caplog):
    before = old.read_bytes()
    with closing(Store(old)):
        pass
    kept = old.with_name("store-schema-0001.sqlite")
    assert (rows(kept, READINGS), rows(kept, EVENTS.format("id")), rows(kept, CAMPAIGNS)) == content
    assert kept.name in caplog.text
    assert sorted(path.name for path in old.parent.iterdir()) == ["store-schema-0001.sqlite", "store.sqlite"]
    caplog.clear()
    with closing(Store(old)):
        pass
    assert caplog.text == ""
    assert old.read_bytes() != before


def test_a_campaign_of_version_0_1_goes_on_without_a_chain(old):
    with closing(Store(old)) as store:
        store.add_event(CAMPAIGN, "started", {"plan": "more"})
        assert store.head(CAMPAIGN) == ""
        assert store.events(CAMPAIGN)[-1].kind == "started"
    assert rows(old, "SELECT position, chain FROM events ORDER BY position DESC LIMIT 1") == [(689, None)]


def test_the_steps_end_in_the_schema_that_is_worked_with(tmp_path):
    with closing(Store(tmp_path / "store.sqlite")):
        pass
    engine = sa.create_engine(f"sqlite:///{tmp_path / 'store.sqlite'}")
    with engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), schema.metadata) == []
    engine.dispose()
    folder = ScriptDirectory(str(Path(migrate.__file__).with_name("migrations")))
    assert folder.get_current_head() == schema.REVISION


def test_the_first_step_makes_the_store_of_version_0_1(old, tmp_path):
    """Tables, columns and triggers of the kept file are those of the baseline."""
    made = tmp_path / "made.sqlite"
    engine = engine_for_writing(made)
    with engine.begin() as connection:
        migrate.migrate(connection, migrate.NEW, migrate.BASELINE)
    engine.dispose()
    query = "SELECT name, sql FROM sqlite_master WHERE name NOT LIKE '%alembic%' AND sql IS NOT NULL ORDER BY name"
    assert plain(rows(made, query)) == plain(rows(old, query))


def plain(statements):
    return [(name, " ".join(sql.split())) for name, sql in statements]


def test_a_newer_store_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "store.sqlite"
    with closing(Store(path)):
        pass
    with closing(sqlite3.connect(path)) as other, other:
        other.execute("UPDATE alembic_version SET version_num = '0999'")
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"newer version of pkm-rig \(schema 0999"):
        Store(path)
    assert path.read_bytes() == before


def test_the_database_of_another_program_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "store.sqlite"
    with closing(sqlite3.connect(path)) as other, other:
        other.execute("CREATE TABLE bookmarks (url TEXT)")
    with pytest.raises(InputError, match="another program"):
        Store(path)
    assert rows(path, "SELECT name FROM sqlite_master") == [("bookmarks",)]


def test_a_kill_at_any_statement_of_a_migration_leaves_a_usable_store(old, content, tmp_path):
    """What is on the disk before each statement is what a kill there leaves: each such copy is the old store."""
    copies = []

    def copy(_connection, _cursor, statement, *_):
        if migrating:
            folder = tmp_path / f"killed-{len(copies)}"
            folder.mkdir()
            for file in old.parent.glob("store.sqlite*"):
                shutil.copy(file, folder)
            copies.append((statement, folder / "store.sqlite"))

    migrating = True
    event.listen(sa.Engine, "before_cursor_execute", copy)
    try:
        with closing(Store(old)):
            migrating = False
    finally:
        event.remove(sa.Engine, "before_cursor_execute", copy)
    steps = " ".join(statement for statement, _ in copies)
    assert "DROP TABLE former_events" in steps
    assert "CREATE TRIGGER" in steps
    for _, path in copies:
        assert (rows(path, READINGS), rows(path, EVENTS.format("id")), rows(path, CAMPAIGNS)) == content
    with closing(Store(copies[-1][1])):  # and is migrated by the next command
        pass
    assert content_now(copies[-1][1]) == content


KILLED = """
import os, signal, sys
from pathlib import Path
import sqlalchemy as sa
from sqlalchemy import event
from pkm_rig.store.store import Store

@event.listens_for(sa.Engine, "before_cursor_execute")
def kill(_connection, _cursor, statement, *_):
    if "DROP TABLE former_events" in statement:
        os.kill(os.getpid(), signal.SIGKILL)

Store(Path(sys.argv[1]))
"""


def test_a_killed_migration_is_done_again(old, content):
    assert subprocess.run([sys.executable, "-c", KILLED, old], check=False, timeout=60).returncode == -signal.SIGKILL
    assert (rows(old, READINGS), rows(old, EVENTS.format("id")), rows(old, CAMPAIGNS)) == content
    with closing(Store(old)):
        pass
    assert content_now(old) == content


def test_two_processes_may_open_an_older_store_at_once(old, content):
    script = "import sys; from pathlib import Path; from pkm_rig.store.store import Store; Store(Path(sys.argv[1]))"
    processes = [subprocess.Popen([sys.executable, "-c", script, old]) for _ in range(2)]
    assert [process.wait(timeout=60) for process in processes] == [0, 0]
    assert content_now(old) == content


def test_a_store_that_is_read_at_the_moment_of_its_first_opening_is_waited_for(old, content, monkeypatch):
    """SQLite refuses the change to WAL mode at once while another process reads."""
    other = sqlite3.connect(old, isolation_level=None)
    other.execute("BEGIN")
    other.execute("SELECT COUNT(*) FROM readings").fetchone()
    pauses = []

    def pause(seconds):
        pauses.append(seconds)
        if len(pauses) == 3:
            other.close()

    monkeypatch.setattr(connections.time, "sleep", pause)
    with closing(Store(old)):
        pass
    assert len(pauses) == 3
    assert content_now(old) == content


def test_a_store_that_is_read_for_good_is_refused_in_one_line(old, monkeypatch):
    with closing(sqlite3.connect(old, isolation_level=None)) as other:
        other.execute("BEGIN")
        other.execute("SELECT COUNT(*) FROM readings").fetchone()
        pauses = []
        monkeypatch.setattr(connections.time, "sleep", pauses.append)
        with pytest.raises(StoreError, match=r"store\.sqlite: database is locked; another process .* wait"):
            Store(old)
    assert sum(pauses) == pytest.approx(connections.WAIT_S)


def test_changes_of_tables_are_kept_in_order_and_unchanged(tmp_path):
    path = tmp_path / "store.sqlite"
    with closing(Store(path)) as store:
        for number, rig in enumerate(("a", "b", "a")):
            store.add_table_change(
                rig=rig, machine="m", campaign=None, change=f"c{number}", kind="begun", data={"left": {"bank": number}}
            )
        assert [change.change for change in store.table_changes()] == ["c0", "c1", "c2"]
        (first, last) = store.table_changes("a")
    assert (first.data, last.data) == ({"left": {"bank": 0}}, {"left": {"bank": 2}})
    assert (last.rig, last.machine, last.campaign, last.kind) == ("a", "m", None, "begun")
    with closing(sqlite3.connect(path)) as other:
        for statement in ("UPDATE table_changes SET kind = 'done'", "DELETE FROM table_changes"):
            with pytest.raises(sqlite3.IntegrityError, match="append-only"):
                other.execute(statement)


def test_a_campaign_may_have_no_rows(tmp_path):
    recording = record(3, calibration_poses=6)
    with closing(Store(tmp_path / "store.sqlite")) as store:
        store.add_campaign(recording.file, recording.machine.text)
        assert len(store.head(recording.file.campaign)) == 64
        with pytest.raises(InputError, match="no campaign 'other'"):
            store.head("other")
