"""Copies of a store in one file, complete as soon as they are there, for reading anywhere."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.store.connections import open_for_reading


def back_up(path: Path, file: Path) -> None:
    """Copy a store as it is at one moment, also while a campaign is written. Raises InputError and StoreError."""
    with (
        new_store_file(file) as part,
        closing(open_for_reading(path)) as source,
        closing(sqlite3.connect(part)) as target,
    ):
        source.backup(target)


@contextmanager
def new_store_file(file: Path) -> Iterator[Path]:
    """A path to write a database to, which gets its name when it is written, checked and on the disk.

    Raises InputError if the file cannot be made or is there already, StoreError if the database is damaged.
    """
    part = file.with_name(f"{file.name}.part")
    try:
        if file.exists():
            raise InputError(f"{file}: exists already; choose another name")
        file.parent.mkdir(parents=True, exist_ok=True)
        _remove(part)
        part.touch()
        yield part
        with closing(sqlite3.connect(part)) as connection:
            connection.execute("PRAGMA journal_mode=DELETE")  # one file, which needs nothing beside it to be read
            (found,) = connection.execute("PRAGMA integrity_check(1)").fetchone()
        if found != "ok":
            raise StoreError(f"{file}: the copy is damaged ({found}), and so may be the store")
        _sync(part)
        part.rename(file)
        _sync(file.parent)
    except OSError as error:
        raise InputError(f"{file}: {error.strerror}; choose another place") from error
    except sqlite3.Error as error:
        raise StoreError(f"{file}: the copy cannot be made: {error}") from error
    finally:
        with suppress(OSError):
            _remove(part)


def _remove(part: Path) -> None:
    for end in ("", "-wal", "-shm", "-journal"):
        part.with_name(part.name + end).unlink(missing_ok=True)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
