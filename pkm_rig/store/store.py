"""The record: SQLite in WAL mode, one durable commit a reading, append-only.

Campaigns, readings and results are only ever inserted; triggers refuse to change or delete them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy import event
from sqlalchemy.exc import IntegrityError, SQLAlchemyError

from calibration.base.errors import InputError
from calibration.machine.description import parse_machine
from calibration.recording.folder import read_folder
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording, make_recording
from pkm_rig.errors import StoreError

STORE_NAME = "pkm-rig.sqlite"

_metadata = sa.MetaData()

_campaigns = sa.Table(
    "campaigns",
    _metadata,
    sa.Column("id", sa.String, primary_key=True),
    sa.Column("created", sa.String, nullable=False),
    sa.Column("description", sa.Text, nullable=False),
    sa.Column("machine", sa.Text, nullable=False),
)
_readings = sa.Table(
    "readings",
    _metadata,
    sa.Column("campaign", sa.ForeignKey("campaigns.id"), primary_key=True),
    sa.Column("uid", sa.String, primary_key=True),
    sa.Column("sequence", sa.Integer, nullable=False),
    sa.Column("data", sa.Text, nullable=False),
)
_events = sa.Table(
    "events",
    _metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("campaign", sa.ForeignKey("campaigns.id"), nullable=False, index=True),
    sa.Column("created", sa.String, nullable=False),
    sa.Column("kind", sa.String, nullable=False),
    sa.Column("data", sa.Text, nullable=False),
)
_APPEND_ONLY = ("campaigns", "readings", "events")


@dataclass(frozen=True)
class StoredEvent:
    """Something that happened to a campaign: started, stopped, identified, activated, verified ..."""

    created: str
    kind: str
    data: dict[str, Any]


class Store:
    """The record in one file. Safe to use from several threads."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._engine = sa.create_engine(f"sqlite:///{path}")
            event.listen(self._engine, "connect", _sync_to_disk)
            with self._writing() as connection:
                _metadata.create_all(connection)
                for table in _APPEND_ONLY:
                    for verb in ("UPDATE", "DELETE"):
                        connection.exec_driver_sql(
                            f"CREATE TRIGGER IF NOT EXISTS keep_{table}_{verb.lower()} BEFORE {verb} ON {table} "
                            "BEGIN SELECT RAISE(ABORT, 'the record is append-only'); END"
                        )
        except OSError as error:
            raise InputError(f"store {path}: {error.strerror}; choose a place that can be written") from error

    def limit_pages(self, pages: int) -> None:
        """Let the file grow to so many pages of 4096 bytes at most: a quota, and a way to try a full disk."""
        with self._engine.connect() as connection:
            connection.exec_driver_sql(f"PRAGMA max_page_count={pages}")

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    def add_campaign(self, file: RecordingFile, machine_text: str) -> None:
        """Insert a campaign; its id must be new."""
        with self._writing() as connection:
            self._insert_campaign(connection, file, machine_text)

    def _insert_campaign(self, connection: sa.Connection, file: RecordingFile, machine_text: str) -> None:
        if connection.execute(sa.select(_campaigns.c.id).where(_campaigns.c.id == file.campaign)).first():
            raise InputError(f"store {self.path}: campaign '{file.campaign}' is there already")
        connection.execute(
            _campaigns.insert().values(
                id=file.campaign,
                created=file.created,
                description=file.model_dump_json(),
                machine=machine_text,
            )
        )

    def add_reading(self, campaign: str, uid: str, sequence: int, data: Mapping[str, float | str]) -> None:
        """Insert one reading, durable when this returns. NaN and infinities are refused."""
        text = json.dumps(dict(data), allow_nan=False)
        with self._writing() as connection:
            connection.execute(_readings.insert().values(uid=uid, campaign=campaign, sequence=sequence, data=text))

    def add_event(self, campaign: str, kind: str, data: Mapping[str, Any]) -> None:
        """Insert something that happened."""
        with self._writing() as connection:
            connection.execute(
                _events.insert().values(
                    campaign=campaign,
                    created=now_text(),
                    kind=kind,
                    data=json.dumps(dict(data), allow_nan=False),
                )
            )

    def campaigns(self) -> list[tuple[str, str, str, int, str]]:
        """(id, created, rig, number of readings, last event) of all campaigns, oldest first."""
        out = []
        with self._reading() as connection:
            for row in connection.execute(sa.select(_campaigns).order_by(_campaigns.c.created)):
                count = connection.execute(
                    sa.select(sa.func.count()).select_from(_readings).where(_readings.c.campaign == row.id)
                ).scalar_one()
                last = connection.execute(
                    sa.select(_events.c.kind).where(_events.c.campaign == row.id).order_by(_events.c.id.desc())
                ).first()
                rig = json.loads(row.description)["rig"]
                out.append((row.id, row.created, rig, int(count), last.kind if last else ""))
        return out

    def events(self, campaign: str, kind: str | None = None) -> list[StoredEvent]:
        """What happened to a campaign, oldest first."""
        query = sa.select(_events).where(_events.c.campaign == campaign).order_by(_events.c.id)
        if kind is not None:
            query = query.where(_events.c.kind == kind)
        with self._reading() as connection:
            return [StoredEvent(r.created, r.kind, json.loads(r.data)) for r in connection.execute(query)]

    def has_readings(self, campaign: str) -> bool:
        """Whether anything was measured in a campaign."""
        query = sa.select(_readings.c.uid).where(_readings.c.campaign == campaign).limit(1)
        with self._reading() as connection:
            return connection.execute(query).first() is not None

    def recording(self, campaign: str) -> Recording:
        """All readings of a campaign; InputError if it is unknown or has none."""
        with self._reading() as connection:
            head = connection.execute(sa.select(_campaigns).where(_campaigns.c.id == campaign)).first()
            if head is None:
                raise InputError(f"store {self.path}: no campaign '{campaign}'; `pkm-rig list` shows what is there")
            rows = connection.execute(
                sa.select(_readings.c.data).where(_readings.c.campaign == campaign).order_by(_readings.c.sequence)
            ).all()
        file = RecordingFile.model_validate_json(head.description)
        machine = parse_machine(head.machine, f"machine of campaign {campaign}")
        return make_recording(file, machine, [json.loads(row.data) for row in rows])

    def add_recording(self, recording: Recording) -> None:
        """Import a recording as a campaign, all or nothing."""
        rows = []
        for i in range(len(recording)):
            data = recording.row(i)
            text = json.dumps(data, allow_nan=False)
            uid = str(data["uid"])
            rows.append(
                {
                    "uid": uid,
                    "campaign": recording.file.campaign,
                    "sequence": int(data["sequence"]),
                    "data": text,
                }
            )
        with self._writing() as connection:
            self._insert_campaign(connection, recording.file, recording.machine.text)
            connection.execute(_readings.insert(), rows)
        self.add_event(recording.file.campaign, "imported", {"readings": len(rows)})

    @contextmanager
    def _writing(self) -> Iterator[sa.Connection]:
        try:
            with self._engine.begin() as connection:
                yield connection
        except IntegrityError as error:
            raise InputError(f"store {self.path}: {error.orig}; a reading's uid must be unique") from error
        except SQLAlchemyError as error:
            cause = getattr(error, "orig", None) or error
            if "not a database" in str(cause):
                raise InputError(f"store {self.path}: {cause}; choose another folder") from error
            raise StoreError(f"store {self.path}: {cause}; free space or choose another place") from error

    @contextmanager
    def _reading(self) -> Iterator[sa.Connection]:
        try:
            with self._engine.connect() as connection:
                yield connection
        except SQLAlchemyError as error:
            cause = getattr(error, "orig", None) or error
            raise StoreError(f"store {self.path}: {cause}") from error


@contextmanager
def open_store(out: Path) -> Iterator[Store]:
    """The store in a folder, created if it does not exist."""
    store = Store(out / STORE_NAME)
    try:
        yield store
    finally:
        store.close()


@contextmanager
def open_existing_store(out: Path) -> Iterator[Store]:
    """The store in a folder; InputError, and nothing created, if there is none."""
    if not (out / STORE_NAME).is_file():
        raise InputError(f"there is no store in {out}; give --out")
    with open_store(out) as store:
        yield store


def find_recording(name: str, out: Path) -> Recording:
    """A recording by its folder, or by its campaign id in the store; InputError if it is neither."""
    folder = Path(name)
    if folder.is_dir():
        return read_folder(folder)
    if not (out / STORE_NAME).is_file():
        raise InputError(f"'{name}' is no recording folder, and there is no store in {out}; give --out")
    with open_store(out) as store:
        return store.recording(name)


def now_text() -> str:
    """Now in UTC, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _sync_to_disk(connection: Any, _record: object) -> None:
    cursor = connection.cursor()
    cursor.execute("PRAGMA journal_mode=WAL")
    cursor.execute("PRAGMA synchronous=FULL")
    cursor.execute("PRAGMA foreign_keys=ON")
    cursor.close()
