"""SQLite's settings: every commit reaches the disk, a writer has the file to itself from its first statement on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy import event


def engine_for_writing(path: Path) -> sa.Engine:
    """For a file that may be written, made if it is not there: WAL mode, each commit synchronised to the disk."""
    engine = sa.create_engine(f"sqlite:///{path}")
    event.listen(engine, "connect", _sync_to_disk)
    event.listen(engine, "begin", _begin)
    return engine


def writer(engine: sa.Engine) -> sa.Engine:
    """The same engine, with transactions that keep other writers out from their beginning."""
    return engine.execution_options(begin="BEGIN IMMEDIATE")


def _begin(connection: sa.Connection) -> None:
    connection.exec_driver_sql(connection.get_execution_options().get("begin", "BEGIN"))


def _sync_to_disk(connection: Any, _record: object) -> None:
    connection.isolation_level = None  # transactions begin and end where SQLAlchemy says, not where sqlite3 guesses
    cursor = connection.cursor()
    cursor.execute("PRAGMA journal_mode=WAL")
    cursor.execute("PRAGMA synchronous=FULL")
    cursor.execute("PRAGMA foreign_keys=ON")
    cursor.close()
