"""The record: SQLite in WAL mode, one durable commit a reading, append-only.

Campaigns, readings and results are only ever inserted; triggers refuse to change or delete them. Readings and events of
a campaign form one hash chain (`chain`); campaigns of version 0.1 have none.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.exc import IntegrityError, SQLAlchemyError

from calibration.base.errors import InputError
from calibration.base.plain_file import require_file_or_folder
from calibration.machine.description import parse_machine
from calibration.recording.folder import read_folder
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording, make_recording
from pkm_rig.errors import StoreError
from pkm_rig.store.append import append_campaign, append_event, append_readings, head_of, now_text
from pkm_rig.store.campaign_state import campaign_state
from pkm_rig.store.chain import canonical
from pkm_rig.store.connections import engine_for_writing, writer
from pkm_rig.store.lock import Lock, campaign_worked_on
from pkm_rig.store.migrate import bring_up_to_date, engine_for_reading
from pkm_rig.store.schema import campaigns, events, heads, readings, removed_campaigns, table_changes
from pkm_rig.store.sessions import with_sessions
from pkm_rig.store.stored_rows import (
    CampaignRows,
    CampaignSummary,
    RemovedCampaign,
    StoredCampaign,
    StoredEvent,
    StoredTableChange,
    read_campaign,
    read_removed,
    read_table_change,
    stored_text,
)

STORE_NAME = "pkm-rig.sqlite"


class Store:
    """The record in one file. Safe to use from several threads."""

    def __init__(self, path: Path, *, read_only: bool = False) -> None:
        """Open the file. To write, it is made if it is not there, and an older one is migrated.

        `read_only` it must be there, and is left as it is. Raises InputError and StoreError.
        """
        self.path = path
        self._lock: Lock | None = None
        try:
            if read_only:
                with self._errors():
                    self._engine = engine_for_reading(path)
                return
            path.parent.mkdir(parents=True, exist_ok=True)
            self._engine = engine_for_writing(path)
            with self._errors():
                bring_up_to_date(self._engine, path)
        except OSError as error:
            advice = "check the path" if read_only else "choose a place that can be written"
            raise InputError(f"store {path}: {error.strerror}; {advice}") from error

    def limit_pages(self, pages: int) -> None:
        """Let the file grow to so many pages of 4096 bytes at most: a quota, and a way to try a full disk."""
        with self._engine.connect() as connection:
            connection.exec_driver_sql(f"PRAGMA max_page_count={pages}")

    def close(self) -> None:
        """Close all connections and let others have the store."""
        self._engine.dispose()
        if self._lock is not None:
            self._lock.release()

    def hold(self) -> None:
        """Keep other campaigns out until the store is closed; again does nothing.

        Raises StoreError, naming it, if another process holds the store. Reading needs no permission.
        """
        if self._lock is None:
            self._lock = Lock(self.path.with_name(f"{self.path.name}.lock"), f"store {self.path}")

    def work_on(self, campaign: str | None) -> None:
        """Hold the store and have others see which campaign is worked on; None: on none any more."""
        self.hold()
        if self._lock is not None:
            self._lock.say_campaign(campaign)

    def add_campaign(self, file: RecordingFile, machine_text: str) -> None:
        """Insert a campaign; its id must be new."""
        with self.writing() as connection:
            self._add_campaign(connection, file, machine_text)

    def _add_campaign(self, connection: sa.Connection, file: RecordingFile, machine_text: str) -> None:
        if connection.execute(sa.select(heads).where(heads.c.campaign == file.campaign)).first():
            raise InputError(f"store {self.path}: campaign '{file.campaign}' is there already")
        gone = removed_campaigns.c
        was = connection.execute(sa.select(gone.removed).where(gone.campaign == file.campaign)).scalar()
        if was is not None:
            raise InputError(f"store {self.path}: campaign '{file.campaign}' was removed on {was}; give it another id")
        append_campaign(connection, file, machine_text)

    def add_reading(self, campaign: str, uid: str, sequence: int, data: Mapping[str, float | str]) -> None:
        """Insert one reading, durable when this returns. NaN and infinities are refused."""
        with self.writing() as connection:
            append_readings(connection, campaign, [(uid, sequence, dict(data))])

    def add_event(self, campaign: str, kind: str, data: Mapping[str, Any]) -> None:
        """Insert something that happened."""
        with self.writing() as connection:
            append_event(connection, campaign, kind, dict(data))

    def head(self, campaign: str) -> str:
        """The campaign's last chain value, which stands for all of its content; empty if it is not chained."""
        with self.reading() as connection:
            return head_of(connection, campaign)[1] or ""

    def add_table_change(
        self, *, rig: str, machine: str, campaign: str | None, change: str, kind: str, data: Mapping[str, Any]
    ) -> None:
        """Insert a step of a change of the tables in the drives, durable when this returns; `change` is its id."""
        with self.writing() as connection:
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
        with self.reading() as connection:
            return [read_table_change(row, f"store {self.path}") for row in connection.execute(query)]

    def campaigns(self) -> list[CampaignSummary]:
        """All campaigns, oldest first; a damaged one says so and does not hide the others."""
        with self.reading() as connection:
            ids = connection.execute(sa.select(campaigns.c.id).order_by(campaigns.c.created)).scalars().all()
        worked_on = campaign_worked_on(self.path.with_name(f"{self.path.name}.lock"))
        return [self._summary(campaign, is_worked_on=campaign == worked_on) for campaign in ids]

    def _summary(self, campaign: object, *, is_worked_on: bool) -> CampaignSummary:
        where = f"store {self.path}: campaign {campaign!r:.120}"
        name, created, rig, count, last_event, damage = repr(campaign), "", "", 0, "", ""
        state, step, simulated = "", "", False
        try:
            name = stored_text(campaign, where)
            with self.reading() as connection:
                count = _count(connection, name)
                query = sa.select(events.c.kind).where(events.c.campaign == name).order_by(events.c.position.desc())
                last = connection.execute(query.limit(1)).first()
                last_event = "" if last is None else stored_text(last.kind, f"{where}, last event")
                head = self._campaign(connection, name)
                created, rig = head.created, stored_text(head.description.get("rig"), f"{where}, rig")
                simulated = head.description.get("simulated") is True
            state, step = campaign_state(self.events(name), is_worked_on=is_worked_on)
        except StoreError as error:
            damage = str(error)
        return CampaignSummary(name, created, rig, count, last_event, state, step, damage, simulated)

    def removed(self) -> list[RemovedCampaign]:
        """What stays of campaigns that were removed, in the order of their removal."""
        query = sa.select(removed_campaigns).order_by(removed_campaigns.c.removed)
        with self.reading() as connection:
            return [read_removed(row, f"store {self.path}") for row in connection.execute(query)]

    def events(self, campaign: str, kind: str | None = None) -> list[StoredEvent]:
        """What happened to a campaign, oldest first."""
        query = sa.select(events).where(events.c.campaign == campaign).order_by(events.c.position)
        if kind is not None:
            query = query.where(events.c.kind == kind)
        with self.reading() as connection:
            rows = self._rows(connection, campaign)
            return [rows.event(row) for row in connection.execute(query)]

    def count_readings(self, campaign: str) -> int:
        """How many readings a campaign has, 0 if there is no such campaign."""
        with self.reading() as connection:
            return _count(connection, campaign)

    def has_readings(self, campaign: str) -> bool:
        """Whether anything was measured in a campaign."""
        return self.count_readings(campaign) > 0

    def header(self, campaign: str) -> RecordingFile:
        """What a campaign was measured with; InputError if it is unknown."""
        with self.reading() as connection, self._damage(campaign):
            return RecordingFile.model_validate(self._campaign(connection, campaign).description)

    def recording(self, campaign: str) -> Recording:
        """All readings of a campaign; InputError if it is unknown or has none, StoreError if one is damaged."""
        query = sa.select(readings).where(readings.c.campaign == campaign).order_by(readings.c.sequence)
        with self.reading() as connection:
            head = self._campaign(connection, campaign)
            rows = self._rows(connection, campaign)
            data = [rows.reading(row).data for row in connection.execute(query)]
        with self._damage(campaign):
            file = RecordingFile.model_validate(head.description)
            recording = make_recording(file, parse_machine(head.machine, f"machine of campaign {campaign}"), data)
            return with_sessions(recording, self.events(campaign))

    @contextmanager
    def _damage(self, campaign: str) -> Iterator[None]:
        """What the values of a campaign that is not chained may cause, in one line."""
        try:
            yield
        except InputError:
            raise
        except (ValueError, TypeError, LookupError, OverflowError) as error:
            raise StoreError(
                f"store {self.path}: campaign '{campaign}' is damaged ({error}); restore the store from a backup"
            ) from error

    def _campaign(self, connection: sa.Connection, campaign: str) -> StoredCampaign:
        row = connection.execute(sa.select(campaigns).where(campaigns.c.id == campaign)).first()
        if row is None:
            raise InputError(f"store {self.path}: no campaign '{campaign}'; `pkm-rig list` shows what is there")
        return read_campaign(row, f"store {self.path}")

    def _rows(self, connection: sa.Connection, campaign: str) -> CampaignRows:
        start = sa.select(sa.literal(0).label("position"), campaigns.c.chain).where(campaigns.c.id == campaign)
        parts = [sa.select(t.c.position, t.c.chain).where(t.c.campaign == campaign) for t in (readings, events)]
        chains = {row.position: row.chain for row in connection.execute(start.union_all(*parts))}
        if chains.get(0) is not None:
            head = connection.execute(sa.select(heads).where(heads.c.campaign == campaign)).first()
            if head is None or (head.position, head.chain) != (len(chains) - 1, chains.get(head.position)):
                raise StoreError(
                    f"store {self.path}: campaign '{campaign}': damaged (rows are missing or were added); "
                    "`pkm-rig audit` says which, restore the store from a backup"
                )
        return CampaignRows(f"store {self.path}", campaign, chains)

    def add_recording(self, recording: Recording) -> None:
        """Import a recording as a campaign, all or nothing."""
        campaign = recording.file.campaign
        rows = [recording.row(i) for i in range(len(recording))]
        with self.writing() as connection:
            self._add_campaign(connection, recording.file, recording.machine.text)
            append_readings(connection, campaign, [(str(row["uid"]), int(row["sequence"]), row) for row in rows])
            append_event(connection, campaign, "imported", {"readings": len(rows)})

    @contextmanager
    def writing(self) -> Iterator[sa.Connection]:
        """A transaction that writes; nobody else does meanwhile. SQLite's errors come in one line."""
        with self._errors(), writer(self._engine).begin() as connection:
            yield connection

    @contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """A connection that sees the store at one moment. SQLite's errors come in one line."""
        with self._errors(), self._engine.connect() as connection:
            yield connection

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """SQLite's errors in one line."""
        try:
            yield
        except IntegrityError as error:
            raise InputError(f"store {self.path}: {error.orig}; a reading's uid must be unique") from error
        except UnicodeError as error:
            raise InputError(f"store {self.path}: a name that is not Unicode; check it") from error
        except (SQLAlchemyError, sqlite3.Error) as error:
            cause = str(getattr(error, "orig", None) or error)
            if "not a database" in cause:
                raise InputError(f"store {self.path}: {cause}; choose another folder") from error
            advice = "; free space or choose another place" if "full" in cause else ""
            raise StoreError(f"store {self.path}: {cause}{advice}") from error


def _count(connection: sa.Connection, campaign: str) -> int:
    count = sa.select(sa.func.count()).select_from(readings).where(readings.c.campaign == campaign)
    return int(connection.execute(count).scalar_one())


def store_path(out: Path) -> Path:
    """The store in a folder; a file is a store itself: a backup or an archive."""
    return out if out.is_file() else out / STORE_NAME


def campaign_folder(out: Path, campaign: str) -> Path:
    """Where files of a campaign are written: in the store's folder, so beside a store that was given as a file."""
    return store_path(out).parent / campaign


@contextmanager
def open_store(out: Path, *, hold: bool = False, campaign: str | None = None) -> Iterator[Store]:
    """The store in a folder, created if it does not exist; with `hold` other campaigns are kept out meanwhile.

    `campaign`: the one that it is held for, which others see as running.
    """
    store = Store(store_path(out))
    try:
        if hold:
            store.work_on(campaign)
        yield store
    finally:
        store.close()


@contextmanager
def open_existing_store(out: Path) -> Iterator[Store]:
    """The store in a folder, for reading; InputError, and nothing created, if there is none."""
    if not store_path(out).is_file():
        raise InputError(f"there is no store in {out}; give --out")
    store = Store(store_path(out), read_only=True)
    try:
        yield store
    finally:
        store.close()


@contextmanager
def hold_existing_store(out: Path) -> Iterator[Store]:
    """The store in a folder, to write, other campaigns kept out; InputError, and nothing created, if there is none."""
    if not store_path(out).is_file():
        raise InputError(f"there is no store in {out}; give --out")
    with open_store(out, hold=True) as store:
        yield store


def find_recording(name: str, out: Path, *, by_sequence: bool = False) -> Recording:
    """A recording by its folder, or by its campaign id in the store; InputError if it is neither.

    `by_sequence`: in a folder, each fall of rig time begins a session.
    """
    folder = Path(name)
    if folder.is_dir():
        return read_folder(folder, by_sequence=by_sequence)
    require_file_or_folder(folder)
    if not store_path(out).is_file():
        raise InputError(f"'{name}' is no recording folder, and there is no store in {out}; give --out")
    with open_existing_store(out) as store:
        return store.recording(name)
