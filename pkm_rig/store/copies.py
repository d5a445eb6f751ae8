"""Copies of a store in one file, complete as soon as they are there, for reading anywhere."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from pathlib import Path

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.store.connections import open_for_reading


def back_up(path: Path, file: Path) -> None:
    """Copy a store as it is at one moment, also while a campaign is written. Raises InputError and StoreError."""
    part = part_of(file)
    try:
        with closing(open_for_reading(path)) as source, closing(sqlite3.connect(part)) as target:
            source.backup(target)
        finish_copy(part, file)
    except sqlite3.Error as error:
        part.unlink(missing_ok=True)
        raise StoreError(f"store {path}: copying it to {file}: {error}") from error


def part_of(file: Path) -> Path:
    """The name under which a new file is written; InputError if the file cannot be made or is there already."""
    part = file.with_name(f"{file.name}.part")
    try:
        if file.exists():
            raise InputError(f"{file}: exists already; choose another name")
        file.parent.mkdir(parents=True, exist_ok=True)
        part.unlink(missing_ok=True)
        part.touch()
    except OSError as error:
        raise InputError(f"{file}: {error.strerror}; choose another place") from error
    return part


def finish_copy(part: Path, file: Path) -> None:
    """Check a written file, synchronise it to the disk and give it its name."""
    with closing(sqlite3.connect(part)) as connection:
        connection.execute("PRAGMA journal_mode=DELETE")  # one file, which needs nothing beside it to be read
        (found,) = connection.execute("PRAGMA integrity_check(1)").fetchone()
    if found != "ok":
        raise StoreError(f"{file}: the copy is damaged ({found}); so may be the store")
    _sync(part)
    part.rename(file)
    _sync(file.parent)


def _sync(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
