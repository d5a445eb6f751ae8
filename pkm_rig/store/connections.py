"""SQLite's settings: every commit reaches the disk, a writer has the file to itself from its first statement on.

Text that is not UTF-8 is read with surrogates in place of its bytes, so that only the row that has it is unreadable.
"""

from __future__ import annotations

import shutil
import sqlite3
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import sqlalchemy as sa
from sqlalchemy import event

WAIT_S = 20  # for another process, which may be migrating the file
TRY_S = 0.05  # between attempts where SQLite itself does not wait


def engine_for_writing(path: Path) -> sa.Engine:
    """For a file that may be written, made if it is not there: WAL mode, each commit synchronised to the disk."""
    engine = sa.create_engine(sa.URL.create("sqlite", database=str(path)))
    event.listen(engine, "connect", _sync_to_disk)
    return _with_transactions(engine)


def engine_of(connection: sqlite3.Connection) -> sa.Engine:
    """For one connection that is there already; threads take turns."""
    engine = sa.create_engine(
        "sqlite://", creator=lambda: connection, poolclass=sa.QueuePool, pool_size=1, max_overflow=0
    )
    return _with_transactions(engine)


def writer(engine: sa.Engine) -> sa.Engine:
    """The same engine, with transactions that keep other writers out from their beginning."""
    return engine.execution_options(begin="BEGIN IMMEDIATE")


def open_for_reading(path: Path) -> sqlite3.Connection:
    """A connection that changes nothing, also where neither the file nor its folder can be written.

    SQLite needs to write beside a file in WAL mode, unless it is told that the file does not change: without write
    permission nobody changes it. What another process left in the log is then read from a copy.
    """
    try:
        return _connect(f"{path.absolute().as_uri()}?mode=rw")
    except sqlite3.OperationalError as error:
        if error.sqlite_errorcode & 0xFF not in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY):
            raise
    log = path.with_name(f"{path.name}-wal")
    if not (log.is_file() and log.stat().st_size):
        return _connect(f"{path.absolute().as_uri()}?mode=ro&immutable=1")
    with TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        shutil.copyfile(path, copy)
        shutil.copyfile(log, copy.with_name(log.name))
        source = _connect(f"{copy.as_uri()}?mode=rw")
        memory = in_memory(source)
        source.close()
    return memory


def in_memory(source: sqlite3.Connection) -> sqlite3.Connection:
    """A copy of a database in memory."""
    memory = sqlite3.connect(":memory:", check_same_thread=False)
    _set_up(memory)
    source.backup(memory)
    return memory


def _connect(uri: str) -> sqlite3.Connection:
    connection = sqlite3.connect(uri, uri=True, check_same_thread=False)
    _set_up(connection)
    try:
        connection.execute("PRAGMA query_only=ON")
        connection.execute("SELECT COUNT(*) FROM sqlite_master").fetchone()
    except sqlite3.Error:
        connection.close()
        raise
    return connection


def _with_transactions(engine: sa.Engine) -> sa.Engine:
    event.listen(engine, "begin", _begin)
    return engine


def _begin(connection: sa.Connection) -> None:
    connection.exec_driver_sql(connection.get_execution_options().get("begin", "BEGIN"))


def _sync_to_disk(connection: Any, _record: object) -> None:
    _set_up(connection)
    cursor = connection.cursor()
    _use_wal(cursor)
    cursor.execute("PRAGMA synchronous=FULL")
    cursor.execute("PRAGMA foreign_keys=ON")
    cursor.close()


def _use_wal(cursor: Any) -> None:
    """A file's first change to WAL mode needs it alone; SQLite's own waiting ends at once where two processes try."""
    cursor.execute("PRAGMA busy_timeout=0")
    for left in reversed(range(round(WAIT_S / TRY_S) + 1)):
        try:
            cursor.execute("PRAGMA journal_mode=WAL")
            break
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode & 0xFF != sqlite3.SQLITE_BUSY or not left:
                raise
        time.sleep(TRY_S)
    cursor.execute(f"PRAGMA busy_timeout={1000 * WAIT_S}")


def _set_up(connection: Any) -> None:
    connection.isolation_level = None  # transactions begin and end where SQLAlchemy says, not where sqlite3 guesses
    connection.text_factory = _decode


def _decode(text: bytes) -> str:
    return text.decode("utf-8", "surrogateescape")
