"""What only a store on a server does: rigs at once, connections that are lost, passwords, databases that do not fit."""

from __future__ import annotations

import json
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.store import schema, server_lock
from pkm_rig.store.audit import audit
from pkm_rig.store.place import SERVER_FILE, ServerAddress, bind_folder, check_address, has_store, store_place
from pkm_rig.store.server_lock import rig_locks
from pkm_rig.store.store import Store, hold_existing_store, open_store
from tests.either import either
from tests.pkm_rig.store.stores import small_recording
from tests.postgres_server import LIMIT_S, running_server

SECRET = "xyzzy-plugh-2026"


@pytest.fixture
def database(server):
    return server.new_store()


@pytest.fixture
def address(server, database):
    return ServerAddress(server.address(database))


@pytest.fixture
def out(address, tmp_path):
    (tmp_path / SERVER_FILE).write_text(f'store = "{address}"\n')
    return tmp_path


@contextmanager
def opened(address, count):
    stores = [Store(address) for _ in range(count)]
    try:
        yield stores
    finally:
        for store in stores:
            store.close()


def test_the_steps_end_in_the_schema_that_is_worked_with(server, database):
    engine = sa.create_engine(server.address(database).replace("postgresql:", "postgresql+psycopg:"))
    with engine.connect() as connection:
        differences = compare_metadata(MigrationContext.configure(connection), schema.metadata)
    engine.dispose()
    assert [(word, table.name) for word, table in differences] == [("remove_table", rig_locks.name)]
    query = "SELECT DISTINCT tgrelid::regclass::text FROM pg_trigger WHERE NOT tgisinternal"
    assert {name for (name,) in server.query(query, database)} == set(schema.metadata.tables) - {"heads"}


def test_a_table_cannot_be_emptied_at_once(server, database):
    import psycopg  # noqa: PLC0415

    for table in sorted(set(schema.metadata.tables) - {"heads"}):
        with pytest.raises(psycopg.errors.IntegrityError, match="append-only"):
            server.query(f"TRUNCATE {table} CASCADE", database)


def test_two_rigs_work_at_once_and_one_rig_has_one_owner(address):
    with opened(address, 4) as (left, right, again, whole):
        left.work_on("l", "left")
        right.work_on("r", "right")
        for store, name in ((left, "l"), (right, "r")):
            store.add_recording(small_recording(name))
        assert left.worked_on() == {"l", "r"}
        with pytest.raises(StoreError, match=r"rig left is in use by '.*', process \d+ of .* on .* since 20.*; wait"):
            again.hold("left")
        with pytest.raises(StoreError, match="in use by '"):
            whole.hold()
        left.close()
        again.hold("left")
        assert right.worked_on() == {"r"}
        assert [one.state for one in audit(right)] == ["whole", "whole"]


def test_who_has_the_whole_store_keeps_every_rig_out(address):
    with opened(address, 2) as (whole, rig):
        whole.hold()
        with pytest.raises(StoreError, match="rig left is in use by '"):
            rig.hold("left")
        whole.close()
        rig.hold("left")


def test_who_comes_while_an_owner_ends_gets_the_rig(server, database, address, monkeypatch):
    # A server sees only after a moment that the connection of a killed owner is gone.
    monkeypatch.setattr(server_lock, "FREED_WITHIN_S", LIMIT_S)
    with opened(address, 2) as (owner, next_one), ThreadPoolExecutor(1) as pool:
        owner.hold("left")
        got = pool.submit(next_one.hold, "left")
        waiting = "SELECT count(*) FROM pg_locks WHERE locktype = 'advisory' AND NOT granted"
        while not got.done() and server.query(waiting, database) == [(0,)]:
            pass
        assert not got.done()
        owner.close()
        got.result(LIMIT_S)
        assert server.query("SELECT count(*) FROM rig_locks", database) == [(1,)]


def test_a_campaign_is_held_by_its_rig(out, address):
    with opened(address, 1) as (store,):
        store.add_recording(small_recording("first"))
        store.hold("plant")
        with pytest.raises(StoreError, match="rig plant is in use"):
            hold_existing_store(out, campaign="first").__enter__()
        with hold_existing_store(out, rig="another") as other:
            other.add_event("first", "noted", {})


def test_without_the_connection_that_has_the_lock_nothing_is_written(server, database, address):
    with opened(address, 2) as (store, other):
        store.add_recording(small_recording("first"))
        store.hold("saw")
        server.query("SELECT pg_terminate_backend(backend) FROM rig_locks", database)
        for _ in range(2):
            with pytest.raises(StoreError, match=r"terminating|lost, and with it the lock") as caught:
                store.add_event("first", "noted", {})
            assert "\n" not in str(caught.value)
        assert "lost, and with it the lock" in str(caught.value)
        store.work_on("first", "saw")  # tells nobody, and fails nobody
        other.hold("saw")
        other.add_event("first", "noted", {})
        assert [e.kind for e in store.events("first")] == ["imported", "noted"]


def test_a_server_that_ends_is_one_line_and_keeps_what_was_stored():
    with running_server() as server:
        address = ServerAddress(server.address(server.new_database()))
        with opened(address, 1) as (store,):
            store.add_recording(small_recording("first"))
            store.hold("plant")
            server.stop()
            for action in (lambda: store.add_event("first", "noted", {}), store.campaigns, lambda: Store(address)):
                with pytest.raises(StoreError) as caught:
                    action()
                assert "\n" not in str(caught.value)
            assert "check that the server runs" in str(caught.value)
            server.start()
            with pytest.raises(StoreError, match="lost, and with it the lock"):
                store.add_event("first", "noted", {})
        with opened(address, 1) as (store,):
            assert [one.state for one in audit(store)] == ["whole"]


def test_processes_that_open_an_empty_database_at_once_make_one_store(server):
    address = ServerAddress(server.address(server.new_database()))
    lines = []

    def make():
        lines.append(either(lambda: Store(address).close(), InputError, StoreError)[1])

    threads = [threading.Thread(target=make, daemon=True) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(LIMIT_S)
    assert not any(thread.is_alive() for thread in threads)
    assert lines == [None] * 3


@pytest.mark.parametrize(
    "text",
    [f"postgresql://rig:{SECRET}@host/db", f"postgresql://host/db?password={SECRET}",
     f"postgresql://host/db?sslpassword={SECRET}", f"postgresql://host:{SECRET}/db", f"mysql://{SECRET}@host/db",
     f"postgresql://{SECRET}@host", f"postgresql://{SECRET}@host/d b", f"postgresql://{SECRET}@host/db#x", SECRET],
)  # fmt: skip
def test_an_address_with_a_password_or_without_sense_is_refused_and_not_shown(run, tmp_path, text):
    (tmp_path / SERVER_FILE).write_text(f'store = "{text}"\n')
    status, out, err = run("list", "--out", tmp_path)
    assert status == 2
    assert "'store'" in err
    assert ("PGPASSWORD" in err) == ("word=" in text or "rig:" in text)
    assert SECRET not in out + err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    "text", ["postgresql://rig@host:5433/db?sslmode=verify-full", "postgresql:///db?host=/run/x", "postgresql://?service=s"]
)  # fmt: skip
def test_addresses_that_libpq_knows_are_taken(text):
    assert check_address(text) == text


def test_a_password_of_the_environment_is_used_and_never_shown(server, database, tmp_path, monkeypatch, run):
    server.query(f"CREATE ROLE guarded LOGIN PASSWORD '{SECRET}'")
    server.query("GRANT ALL ON ALL TABLES IN SCHEMA public TO guarded", database)
    hba = server.data / "pg_hba.conf"
    hba.write_text("local all guarded scram-sha-256\n" + hba.read_text())
    server.query("SELECT pg_reload_conf()")
    (tmp_path / SERVER_FILE).write_text(f'store = "{server.address(database, "guarded")}"\n')
    monkeypatch.setenv("PGPASSFILE", str(tmp_path / "none"))
    for word in ("", "wrong-" + SECRET):
        monkeypatch.setenv("PGPASSWORD", word) if word else monkeypatch.delenv("PGPASSWORD", raising=False)
        status, out, err = run("list", "--out", tmp_path)
        assert status == 3
        assert "check that the server runs, its address, and PGPASSWORD or ~/.pgpass" in err
        assert SECRET not in out + err
    monkeypatch.setenv("PGPASSWORD", SECRET)
    assert run("list", "--out", tmp_path) == (0, "", "")
    with open_store(tmp_path, hold=True, rig="saw") as store:
        assert SECRET not in store.name
        assert SECRET not in str(server.query("SELECT owner FROM rig_locks", database))
    assert all(SECRET not in path.read_text() for path in tmp_path.iterdir())


def test_a_database_that_does_not_fit_is_named_and_left_alone(server):
    cases = {
        "another program": ("", "CREATE TABLE bookmarks (url TEXT)"),
        "encoding is LATIN1": ("ENCODING 'LATIN1' TEMPLATE template0", "SELECT 1"),
    }
    for message, (options, statement) in cases.items():
        name = server.new_database(options)
        server.query(statement, name)
        with pytest.raises(InputError, match=message):
            Store(ServerAddress(server.address(name)))
        assert server.query("SELECT COUNT(*) FROM pg_tables WHERE tablename = 'campaigns'", name) == [(0,)]
    with pytest.raises(InputError, match="empty; nothing was stored"):
        Store(ServerAddress(server.address(server.new_database())), read_only=True)


@pytest.mark.parametrize(
    ("revision", "error", "message"),
    [("0999", InputError, "newer version of pkm-rig"), ("x", StoreError, "does not say its schema"),
     ("0001", StoreError, r"has schema 0001, this version .*; back it up with pg_dump")],
)  # fmt: skip
def test_another_schema_is_not_read_as_this_one(server, database, address, revision, error, message):
    server.query(f"UPDATE alembic_version SET version_num = '{revision}'", database)
    with pytest.raises(error, match=message):
        Store(address, read_only=True)


def test_a_commit_reaches_the_disk_whatever_the_role_says(server, database, address):
    server.query(f"ALTER DATABASE {database} SET synchronous_commit = off")
    server.query(f"ALTER DATABASE {database} SET idle_session_timeout = '5min'")
    names = ("synchronous_commit", "lock_timeout", "idle_session_timeout")
    with opened(address, 1) as (store,), store.writing() as connection:
        shown = {name: connection.exec_driver_sql(f"SHOW {name}").scalar() for name in names}
    assert shown == {"synchronous_commit": "on", "lock_timeout": "10s", "idle_session_timeout": "0"}
    server.query(f"ALTER DATABASE {database} SET synchronous_commit = remote_apply")
    with opened(address, 1) as (store,), store.writing() as connection:
        assert connection.exec_driver_sql("SHOW synchronous_commit").scalar() == "remote_apply"


def test_a_folder_is_bound_to_one_store(tmp_path):
    address = "postgresql://rig@host/campaigns"
    assert not has_store(tmp_path)
    bind_folder(tmp_path / "runs", address)
    bind_folder(tmp_path / "runs", address)
    assert store_place(tmp_path / "runs") == ServerAddress(address)
    with pytest.raises(InputError, match="give another --out"):
        bind_folder(tmp_path / "runs", address + "2")
    Store(tmp_path / "file" / "pkm-rig.sqlite").close()
    with pytest.raises(InputError, match="has a store of its own"):
        bind_folder(tmp_path / "file", address)
    (tmp_path / "file" / SERVER_FILE).write_text(f'store = "{address}"\n')
    with pytest.raises(InputError, match="move one away"):
        store_place(tmp_path / "file")
    (tmp_path / "none").write_text("")
    with pytest.raises(InputError, match="choose a place"):
        bind_folder(tmp_path / "none" / "deep", address)


def test_a_rig_file_names_the_store_of_its_commands(run, address, tmp_path):
    from pkm_rig.rig.config import embedded_rig_path  # noqa: PLC0415

    rig, runs = tmp_path / "rig.toml", tmp_path / "runs"
    rig.write_text(f'store = "{address}"\n' + embedded_rig_path().read_text())
    status, _, err = run("recalibrate", "check", "--rig", rig, "--out", runs)
    assert status == 10
    assert "due" in err
    assert store_place(runs) == address
    assert run("list", "--out", runs).returncode == 0
    rig.write_text(rig.read_text().replace("rigs@", f"rigs:{SECRET}@"))
    status, out, err = run("recalibrate", "check", "--rig", rig, "--out", tmp_path / "other")
    assert status == 2
    assert "PGPASSWORD" in err
    assert SECRET not in out + err


def test_commands_on_a_server_are_those_on_a_file(run, out, address, tmp_path):
    with opened(address, 1) as (store,):
        store.add_recording(small_recording("first"))
        head = store.head("first")
    assert "first  " in run("list", "--out", out).stdout
    assert json.loads(run("show", "first", "--json", "--out", out).stdout)["head"] == head
    assert run("audit", "--head", head, "--out", out).returncode == 0
    assert run("export", "first", tmp_path / "exported", "--out", out).returncode == 0
    assert run("audit", "nothing", "--out", out).returncode == 2
    status, _, err = run("backup", tmp_path / "copy.sqlite", "--out", out)
    assert status == 2
    assert f"pg_dump --dbname={address} --file={tmp_path / 'copy.sqlite'}" in err
    assert run("archive", "first", tmp_path / "old.sqlite", "--why", "sold", "--out", out).returncode == 0
    assert run("audit", "--head", head, "--out", tmp_path / "old.sqlite").returncode == 0
    assert "1 removed" in run("list", "--out", out).stdout


def test_without_psycopg_it_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(InputError, match=r"pip install 'pkm-rig\[postgresql\]'"):
        Store(ServerAddress("postgresql://rig@host/campaigns"))


def test_a_server_that_is_not_there_is_one_line(tmp_path, run):
    (tmp_path / SERVER_FILE).write_text(f'store = "postgresql://rig@/campaigns?host={tmp_path}"\n')
    status, _, err = run("list", "--out", tmp_path)
    assert status == 3
    assert "check that the server runs" in err
    assert len(err.splitlines()) == 1
