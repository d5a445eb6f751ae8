"""A store in a file: SQLite in WAL mode. Whoever works on a campaign has the whole file to himself."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import sqlalchemy as sa

from calibration.base.errors import InputError
from pkm_rig.store.connections import engine_for_writing, writer
from pkm_rig.store.lock import Lock, campaign_worked_on
from pkm_rig.store.migrate import bring_up_to_date, engine_for_reading


class SqliteFile:
    """One file; `name` is how messages call it."""

    def __init__(self, path: Path) -> None:
        self.path, self.name = path, str(path)
        self._lock: Lock | None = None
        self._engine: sa.Engine | None = None

    def open(self, *, read_only: bool) -> None:
        """Open the file; to write, it is made or migrated. InputError where the place is no good."""
        try:
            if read_only:
                self._engine = engine_for_reading(self.path)
                return
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._engine = engine_for_writing(self.path)
            bring_up_to_date(self._engine, self.path)
        except OSError as error:
            advice = "check the path" if read_only else "choose a place that can be written"
            raise InputError(f"store {self.path}: {error.strerror}; {advice}") from error

    @property
    def engine(self) -> sa.Engine:
        """Its connections, once it is open."""
        assert self._engine is not None
        return self._engine

    def close(self) -> None:
        """Close all connections and let others have the store."""
        if self._engine is not None:
            self._engine.dispose()
        if self._lock is not None:
            self._lock.release()

    @contextmanager
    def writing(self) -> Iterator[sa.Connection]:
        """A transaction that keeps all other writers out from its beginning."""
        with writer(self.engine).begin() as connection:
            yield connection

    @contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """A connection that sees the store at one moment."""
        with self.engine.connect() as connection:
            yield connection

    def hold(self, _rig: str | None) -> None:
        """Keep other campaigns out, of whichever rig: a file has one at a time."""
        if self._lock is None:
            self._lock = Lock(self._lock_path, f"store {self.path}")

    def say_campaign(self, campaign: str | None) -> None:
        """Have others see which campaign the holder works on."""
        if self._lock is not None:
            self._lock.say_campaign(campaign)

    def worked_on(self) -> set[str]:
        """Campaigns that somebody works on now."""
        campaign = campaign_worked_on(self._lock_path)
        return set() if campaign is None else {campaign}

    @property
    def _lock_path(self) -> Path:
        return self.path.with_name(f"{self.path.name}.lock")
