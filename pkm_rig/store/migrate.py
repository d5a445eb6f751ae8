"""Brings a store to the newest schema, in one transaction; Alembic is loaded only where there is something to do."""

from __future__ import annotations

import logging
import os
import sqlite3
from contextlib import closing
from pathlib import Path

import sqlalchemy as sa

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.store.connections import engine_of, in_memory, open_for_reading, writer
from pkm_rig.store.schema import REVISION

BASELINE = "0001"  # of version 0.1, which did not write its revision down
NEW = ""

_log = logging.getLogger(__name__)


def revision_of(connection: sa.Connection, path: Path | str) -> str:
    """The schema's revision, NEW for an empty database; InputError if a newer version or another program wrote it."""
    tables = set(sa.inspect(connection).get_table_names())
    if not tables:
        return NEW
    if "alembic_version" in tables:
        revision = str(connection.exec_driver_sql("SELECT version_num FROM alembic_version").scalar())
        if not revision.isdigit():
            raise StoreError(f"store {path}: damaged (it does not say its schema); restore it from a backup")
        if revision > REVISION:
            raise InputError(
                f"store {path}: written by a newer version of pkm-rig (schema {revision}, here {REVISION}); "
                "install that version"
            )
        return revision
    if {"campaigns", "readings", "events"} <= tables:
        return BASELINE
    raise InputError(f"store {path}: a database of another program; choose another folder")


def bring_up_to_date(engine: sa.Engine, path: Path) -> None:
    """Make the tables of a new store or migrate an older one, of which a copy stays beside it.

    Raises InputError if a newer version wrote it.
    """
    with engine.connect() as connection:
        if revision_of(connection, path) == REVISION:
            return
    with writer(engine).begin() as connection:
        revision = revision_of(connection, path)  # another process may just have done it
        if revision not in (NEW, REVISION):
            copy = path.with_name(f"{path.stem}-schema-{revision}{path.suffix}")
            _copy(path, copy)
            _log.warning("store %s: brought to schema %s; as it was it is kept as %s", path, REVISION, copy.name)
        migrate(connection, revision)


def engine_for_reading(path: Path) -> sa.Engine:
    """Of a file that is there, left as it is: an older schema is migrated in memory.

    Raises InputError if the file is empty or a newer version wrote it.
    """
    source = open_for_reading(path)
    engine = engine_of(source)
    with engine.connect() as connection:
        revision = revision_of(connection, path)
    if revision == REVISION:
        return engine
    if revision == NEW:
        raise InputError(f"store {path}: empty; nothing was stored in it")
    engine = engine_of(in_memory(source))
    source.close()
    with writer(engine).begin() as connection:
        migrate(connection, revision)
    with engine.connect() as connection:
        connection.exec_driver_sql("PRAGMA query_only=ON")
    return engine


def migrate(connection: sa.Connection, revision: str, to: str = "head") -> None:
    """Take the steps from a revision to another, within the transaction that the connection has begun."""
    from alembic import command  # noqa: PLC0415 - a store that is up to date opens without it
    from alembic.config import Config  # noqa: PLC0415
    from alembic.util.exc import CommandError  # noqa: PLC0415

    config = Config(attributes={"connection": connection})
    config.set_main_option("script_location", str(Path(__file__).with_name("migrations")))
    try:
        if revision == BASELINE:
            command.stamp(config, BASELINE)
        command.upgrade(config, to)
    except CommandError as error:
        raise StoreError(f"the store's schema {revision} is damaged: {error}; restore it from a backup") from error


def _copy(path: Path, copy: Path) -> None:
    """A consistent copy, complete as soon as it is there."""
    part = copy.with_name(f"{copy.name}.part")
    part.unlink(missing_ok=True)
    with closing(sqlite3.connect(path)) as source, closing(sqlite3.connect(part)) as target:
        source.backup(target)
    with part.open("rb") as stream:
        os.fsync(stream.fileno())
    part.replace(copy)
