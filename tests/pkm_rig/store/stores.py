"""Stores to test with: the kept one of version 0.1, small ones, and what SQLite itself says of a file."""

from __future__ import annotations

import gzip
import sqlite3
from contextlib import closing
from pathlib import Path

VERSION_0_1 = Path(__file__).parents[2] / "data" / "version_0_1" / "store.db.gz"


def version_0_1_store(path: Path) -> Path:
    """A copy of the store that version 0.1 wrote."""
    path.write_bytes(gzip.decompress(VERSION_0_1.read_bytes()))
    return path


def rows(path: Path, query: str) -> list[tuple]:
    """What a query gives, asked of SQLite directly."""
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute(query).fetchall()
