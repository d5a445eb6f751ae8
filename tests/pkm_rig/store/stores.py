"""Stores to test with: the kept one of version 0.1, a small one, and what SQLite itself says and does."""

from __future__ import annotations

import gzip
import sqlite3
from contextlib import closing
from dataclasses import replace
from functools import cache
from pathlib import Path

from calibration.recording.recording import Recording
from pkm_rig.store.store import Store
from tests.pkm_rig.plant_recording import record

VERSION_0_1 = Path(__file__).parents[2] / "data" / "version_0_1" / "store.db.gz"


def version_0_1_store(path: Path) -> Path:
    """A copy of the store that version 0.1 wrote."""
    path.write_bytes(gzip.decompress(VERSION_0_1.read_bytes()))
    return path


def rows(path: Path, query: str) -> list[tuple]:
    """What a query gives, asked of SQLite directly."""
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute(query).fetchall()


@cache
def _recorded() -> Recording:
    return record(3, calibration_poses=6)


def small_recording(campaign: str, readings: int = 6) -> Recording:
    """The first readings of a simulated campaign."""
    part = _recorded().take(slice(readings))
    return replace(part, file=part.file.model_copy(update={"campaign": campaign}))


def small_store(path: Path, *names: str) -> Path:
    """A store with small campaigns: an event, six readings at once, an event, a seventh reading, an event."""
    extra = _recorded().row(6)
    with closing(Store(path)) as store:
        for name in names:
            store.add_recording(small_recording(name))
            store.add_event(name, "noted", {"rig_file": {"a": 0.30000000000000004, "µ": [True, None, -0.0, 5]}})
            store.add_reading(name, str(extra["uid"]), 6, extra)
            store.add_event(name, "finished", {"plan": "calibration"})
    return path


def change(path: Path, *statements: str) -> None:
    """Change a store as only SQLite can: without triggers and foreign keys."""
    with closing(sqlite3.connect(path)) as connection, connection:
        drop_triggers(connection)
        for statement in statements:
            assert connection.execute(statement).rowcount == 1, statement


def drop_triggers(connection: sqlite3.Connection) -> None:
    """Let rows be changed and deleted."""
    for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
        connection.execute(f"DROP TRIGGER {name}")
