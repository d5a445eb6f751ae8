"""The record: SQLite in WAL mode, one durable commit a reading, append-only.

Campaigns, readings and results are only ever inserted; triggers refuse to change or delete them. Readings and events of
a campaign form one hash chain (`chain`); campaigns of version 0.1 have none.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError, SQLAlchemyError

from calibration.base.errors import InputError
from calibration.machine.description import parse_machine
from calibration.recording.folder import read_folder
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording, make_recording
from pkm_rig.errors import StoreError
from pkm_rig.store.chain import canonical, event_link, genesis, reading_link
from pkm_rig.store.connections import engine_for_writing, writer
from pkm_rig.store.migrate import bring_up_to_date
from pkm_rig.store.schema import campaigns, events, heads, readings, table_changes

STORE_NAME = "pkm-rig.sqlite"


@dataclass(frozen=True)
class StoredEvent:
    """Something that happened to a campaign: started, stopped, identified, activated, verified ..."""

    created: str
    kind: str
    data: dict[str, Any]


@dataclass(frozen=True)
class StoredTableChange:
    """One step of a change of the tables in a rig's drives, of a campaign or by hand."""

    id: int
    created: str
    rig: str
    machine: str
    campaign: str | None
    change: str
    kind: str
    data: dict[str, Any]


class Store:
    """The record in one file. Safe to use from several threads."""

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._engine = engine_for_writing(path)
            with self._errors():
                bring_up_to_date(self._engine, path)
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
        name, description = file.campaign, file.model_dump(mode="json")
        if connection.execute(sa.select(campaigns.c.id).where(campaigns.c.id == name)).first():
            raise InputError(f"store {self.path}: campaign '{name}' is there already")
        connection.execute(
            campaigns.insert().values(
                id=name, created=file.created, description=canonical(description), machine=machine_text
            )
        )
        start = genesis(name, file.created, description, machine_text)
        connection.execute(heads.insert().values(campaign=name, position=0, chain=start))

    def add_reading(self, campaign: str, uid: str, sequence: int, data: Mapping[str, float | str]) -> None:
        """Insert one reading, durable when this returns. NaN and infinities are refused."""
        with self._writing() as connection:
            _append_readings(connection, campaign, [(uid, sequence, dict(data))])

    def add_event(self, campaign: str, kind: str, data: Mapping[str, Any]) -> None:
        """Insert something that happened."""
        with self._writing() as connection:
            _append_event(connection, campaign, kind, dict(data))

    def head(self, campaign: str) -> str:
        """The campaign's last chain value, which stands for all of its content; empty if it is not chained."""
        with self._reading() as connection:
            return _head(connection, campaign)[1] or ""

    def add_table_change(
        self, *, rig: str, machine: str, campaign: str | None, change: str, kind: str, data: Mapping[str, Any]
    ) -> None:
        """Insert a step of a change of the tables in the drives, durable when this returns; `change` is its id."""
        with self._writing() as connection:
            connection.execute(
                table_changes.insert().values(
                    created=now_text(),
                    rig=rig,
                    machine=machine,
                    campaign=campaign,
                    change=change,
                    kind=kind,
                    data=canonical(dict(data)),
                )
            )

    def table_changes(self, rig: str | None = None) -> list[StoredTableChange]:
        """All steps of changes of tables, of one rig or of all, oldest first."""
        query = sa.select(table_changes).order_by(table_changes.c.id)
        if rig is not None:
            query = query.where(table_changes.c.rig == rig)
        with self._reading() as connection:
            return [
                StoredTableChange(r.id, r.created, r.rig, r.machine, r.campaign, r.change, r.kind, json.loads(r.data))
                for r in connection.execute(query)
            ]

    def campaigns(self) -> list[tuple[str, str, str, int, str]]:
        """(id, created, rig, number of readings, last event) of all campaigns, oldest first."""
        out = []
        with self._reading() as connection:
            for row in connection.execute(sa.select(campaigns).order_by(campaigns.c.created)):
                count = connection.execute(
                    sa.select(sa.func.count()).select_from(readings).where(readings.c.campaign == row.id)
                ).scalar_one()
                last = connection.execute(
                    sa.select(events.c.kind).where(events.c.campaign == row.id).order_by(events.c.position.desc())
                ).first()
                rig = json.loads(row.description)["rig"]
                out.append((row.id, row.created, rig, int(count), last.kind if last else ""))
        return out

    def events(self, campaign: str, kind: str | None = None) -> list[StoredEvent]:
        """What happened to a campaign, oldest first."""
        query = sa.select(events).where(events.c.campaign == campaign).order_by(events.c.position)
        if kind is not None:
            query = query.where(events.c.kind == kind)
        with self._reading() as connection:
            return [StoredEvent(r.created, r.kind, json.loads(r.data)) for r in connection.execute(query)]

    def has_readings(self, campaign: str) -> bool:
        """Whether anything was measured in a campaign."""
        query = sa.select(readings.c.uid).where(readings.c.campaign == campaign).limit(1)
        with self._reading() as connection:
            return connection.execute(query).first() is not None

    def header(self, campaign: str) -> RecordingFile:
        """What a campaign was measured with; InputError if it is unknown."""
        with self._reading() as connection:
            row = connection.execute(sa.select(campaigns.c.description).where(campaigns.c.id == campaign)).first()
        if row is None:
            raise InputError(f"store {self.path}: no campaign '{campaign}'; `pkm-rig list` shows what is there")
        return RecordingFile.model_validate_json(row.description)

    def recording(self, campaign: str) -> Recording:
        """All readings of a campaign; InputError if it is unknown or has none."""
        with self._reading() as connection:
            head = connection.execute(sa.select(campaigns).where(campaigns.c.id == campaign)).first()
            if head is None:
                raise InputError(f"store {self.path}: no campaign '{campaign}'; `pkm-rig list` shows what is there")
            rows = connection.execute(
                sa.select(readings.c.data).where(readings.c.campaign == campaign).order_by(readings.c.sequence)
            ).all()
        file = RecordingFile.model_validate_json(head.description)
        machine = parse_machine(head.machine, f"machine of campaign {campaign}")
        return make_recording(file, machine, [json.loads(row.data) for row in rows])

    def add_recording(self, recording: Recording) -> None:
        """Import a recording as a campaign, all or nothing."""
        campaign = recording.file.campaign
        rows = [recording.row(i) for i in range(len(recording))]
        with self._writing() as connection:
            self._insert_campaign(connection, recording.file, recording.machine.text)
            _append_readings(connection, campaign, [(str(row["uid"]), int(row["sequence"]), row) for row in rows])
            _append_event(connection, campaign, "imported", {"readings": len(rows)})

    @contextmanager
    def _writing(self) -> Iterator[sa.Connection]:
        with self._errors(), writer(self._engine).begin() as connection:
            yield connection

    @contextmanager
    def _reading(self) -> Iterator[sa.Connection]:
        with self._errors(), self._engine.connect() as connection:
            yield connection

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """SQLite's errors in one line."""
        try:
            yield
        except IntegrityError as error:
            raise InputError(f"store {self.path}: {error.orig}; a reading's uid must be unique") from error
        except SQLAlchemyError as error:
            cause = str(getattr(error, "orig", None) or error)
            if "not a database" in cause:
                raise InputError(f"store {self.path}: {cause}; choose another folder") from error
            advice = "; free space or choose another place" if "full" in cause else ""
            raise StoreError(f"store {self.path}: {cause}{advice}") from error


def _head(connection: sa.Connection, campaign: str) -> tuple[int, str | None]:
    """Number and chain value of a campaign's last row."""
    head = connection.execute(sa.select(heads).where(heads.c.campaign == campaign)).first()
    if head is None:
        raise InputError(f"no campaign '{campaign}'; `pkm-rig list` shows what is there")
    return head.position, head.chain


def _set_head(connection: sa.Connection, campaign: str, position: int, chain: str | None) -> None:
    connection.execute(heads.update().where(heads.c.campaign == campaign).values(position=position, chain=chain))


def _append_readings(
    connection: sa.Connection, campaign: str, new: Sequence[tuple[str, int, Mapping[str, float | str]]]
) -> None:
    """Add readings (uid, sequence, data) to the end of a campaign and of its chain."""
    position, chain = _head(connection, campaign)
    rows = []
    for uid, sequence, data in new:
        position += 1
        if chain is not None:
            chain = reading_link(chain, campaign, position, uid, sequence, data)
        rows.append(
            {"campaign": campaign, "position": position, "uid": uid, "sequence": sequence}
            | {"data": canonical(data), "chain": chain}
        )
    connection.execute(readings.insert(), rows)
    _set_head(connection, campaign, position, chain)


def _append_event(connection: sa.Connection, campaign: str, kind: str, data: Mapping[str, Any]) -> None:
    """Add an event to the end of a campaign and of its chain."""
    position, chain = _head(connection, campaign)
    position, created = position + 1, now_text()
    if chain is not None:
        chain = event_link(chain, campaign, position, created, kind, data)
    connection.execute(
        events.insert().values(
            campaign=campaign, position=position, created=created, kind=kind, data=canonical(data), chain=chain
        )
    )
    _set_head(connection, campaign, position, chain)


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
