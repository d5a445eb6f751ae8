"""The record of campaigns: one durable commit a reading, append-only, in a file or on a server.

Campaigns, readings and results are only ever inserted; triggers refuse to change or delete them. Readings and events of
a campaign form one hash chain (`chain`); campaigns of version 0.1 have none.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import sqlalchemy as sa

from calibration.base.errors import InputError
from calibration.base.plain_file import require_file_or_folder
from calibration.machine.description import parse_machine
from calibration.recording.folder import read_folder
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording, make_recording
from pkm_rig.errors import StoreError
from pkm_rig.store.append import append_campaign, append_event, append_readings, head_of, now_text
from pkm_rig.store.chain import canonical
from pkm_rig.store.database_errors import damage_of, one_line
from pkm_rig.store.place import ServerAddress, has_store, store_place
from pkm_rig.store.schema import campaigns, events, heads, readings, removed_campaigns, table_changes
from pkm_rig.store.sessions import with_sessions
from pkm_rig.store.sqlite_file import SqliteFile
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
)
from pkm_rig.store.summaries import list_campaigns

if TYPE_CHECKING:
    from pkm_rig.store.postgresql import Server


class Store:
    """The record in one place. Safe to use from several threads; `name` is how messages call it."""

    def __init__(self, place: Path | ServerAddress, *, read_only: bool = False) -> None:
        """Open it. To write, it is made if it is not there, and an older one is migrated.

        `read_only` it must be there, and is left as it is. Raises InputError and StoreError.
        """
        self._place: SqliteFile | Server
        if isinstance(place, Path):
            self._place = SqliteFile(place)
        else:
            from pkm_rig.store.postgresql import Server  # noqa: PLC0415 - only who has one loads it

            self._place = Server(place)
        self.name = self._place.name
        try:
            with one_line(self.name):
                self._place.open(read_only=read_only)
        except BaseException:
            self._place.close()
            raise

    @property
    def path(self) -> Path:
        """The store's file; InputError if it is on a server."""
        return self._file.path

    @property
    def _file(self) -> SqliteFile:
        if not isinstance(self._place, SqliteFile):
            raise InputError(f"store {self.name}: is on a server, not in a file; use PostgreSQL's own programs")
        return self._place

    def limit_pages(self, pages: int) -> None:
        """Let the file grow to so many pages of 4096 bytes at most: a quota, and a way to try a full disk."""
        with self._file.engine.connect() as connection:
            connection.exec_driver_sql(f"PRAGMA max_page_count={pages}")

    def close(self) -> None:
        """Close all connections and let others have the store, or the rig."""
        self._place.close()

    def hold(self, rig: str | None = None) -> None:
        """Keep others from working on a rig until the store is closed; again does nothing.

        A file, and a server without a rig's name, is held as a whole. Raises StoreError, naming it, if another process
        holds it. Reading needs no permission.
        """
        with one_line(self.name):
            self._place.hold(rig)

    def work_on(self, campaign: str | None, rig: str | None = None) -> None:
        """Hold the rig and have others see which campaign is worked on; None: on none any more."""
        self.hold(rig)
        self._place.say_campaign(campaign)

    def worked_on(self) -> set[str]:
        """Campaigns that somebody works on now."""
        with one_line(self.name):
            return self._place.worked_on()

    def add_campaign(self, file: RecordingFile, machine_text: str) -> None:
        """Insert a campaign; its id must be new."""
        with self.writing() as connection:
            self._add_campaign(connection, file, machine_text)

    def _add_campaign(self, connection: sa.Connection, file: RecordingFile, machine_text: str) -> None:
        if connection.execute(sa.select(heads).where(heads.c.campaign == file.campaign)).first():
            raise InputError(f"store {self.name}: campaign '{file.campaign}' is there already")
        gone = removed_campaigns.c
        was = connection.execute(sa.select(gone.removed).where(gone.campaign == file.campaign)).scalar()
        if was is not None:
            raise InputError(f"store {self.name}: campaign '{file.campaign}' was removed on {was}; give it another id")
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

    def heads(self) -> dict[str, str]:
        """The same of all campaigns."""
        with self.reading() as connection:
            return {row.campaign: row.chain or "" for row in connection.execute(sa.select(heads))}

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
            return [read_table_change(row, f"store {self.name}") for row in connection.execute(query)]

    def campaigns(self) -> list[CampaignSummary]:
        """All campaigns, oldest first; a damaged one says so and does not hide the others."""
        worked_on, where = self.worked_on(), f"store {self.name}"
        try:
            with self.reading() as connection:
                return list_campaigns(connection, where, worked_on)
        except StoreError:  # a page that cannot be read: which campaign has it is found one by one
            with self.reading() as connection:
                ids = connection.execute(sa.select(campaigns.c.id).order_by(campaigns.c.created)).scalars().all()
            return [self._summary(campaign, worked_on) for campaign in ids]

    def _summary(self, campaign: object, worked_on: set[str]) -> CampaignSummary:
        try:
            with self.reading() as connection:
                (summary,) = list_campaigns(connection, f"store {self.name}", worked_on, only=campaign)
        except (StoreError, InputError, ValueError) as error:
            return CampaignSummary(repr(campaign), "", "", 0, "", damage=str(error))
        return summary

    def newest(self, count: int) -> list[str]:
        """Ids of the newest campaigns."""
        query = sa.select(campaigns.c.id).order_by(campaigns.c.created.desc()).limit(count)
        with self.reading() as connection:
            return list(connection.execute(query).scalars())

    def removed(self) -> list[RemovedCampaign]:
        """What stays of campaigns that were removed, in the order of their removal."""
        query = sa.select(removed_campaigns).order_by(removed_campaigns.c.removed)
        with self.reading() as connection:
            return [read_removed(row, f"store {self.name}") for row in connection.execute(query)]

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

    def rig_of(self, campaign: str) -> str | None:
        """The rig that a campaign was measured on; None if there is no such campaign, or it cannot be read."""
        try:
            return self.header(campaign).rig
        except (InputError, StoreError):
            return None

    def header(self, campaign: str) -> RecordingFile:
        """What a campaign was measured with; InputError if it is unknown."""
        with self.reading() as connection, damage_of(self.name, campaign):
            return RecordingFile.model_validate(self._campaign(connection, campaign).description)

    def recording(self, campaign: str, *, phase: str | None = None) -> Recording:
        """All readings of a campaign, or of one phase, which takes a fraction of the time; InputError if it is unknown
        or has none, StoreError if one that is read is damaged."""
        query = sa.select(readings).where(readings.c.campaign == campaign).order_by(readings.c.sequence)
        if phase is not None:
            # Rows that are not chained may be in another form of JSON.
            forms = (f'"phase":{space}{canonical(phase)}' for space in ("", " "))
            query = query.where(sa.or_(*(readings.c.data.contains(form, autoescape=True) for form in forms)))
        with self.reading() as connection:
            head = self._campaign(connection, campaign)
            rows = self._rows(connection, campaign)
            data = [rows.reading(row).data for row in connection.execute(query)]
        with damage_of(self.name, campaign):
            file = RecordingFile.model_validate(head.description)
            recording = make_recording(file, parse_machine(head.machine, f"machine of campaign {campaign}"), data)
            return with_sessions(recording, self.events(campaign))

    def _campaign(self, connection: sa.Connection, campaign: str) -> StoredCampaign:
        row = connection.execute(sa.select(campaigns).where(campaigns.c.id == campaign)).first()
        if row is None:
            raise InputError(f"store {self.name}: no campaign '{campaign}'; `pkm-rig list` shows what is there")
        return read_campaign(row, f"store {self.name}")

    def _rows(self, connection: sa.Connection, campaign: str) -> CampaignRows:
        start = sa.select(sa.literal(0).label("position"), campaigns.c.chain).where(campaigns.c.id == campaign)
        parts = [sa.select(t.c.position, t.c.chain).where(t.c.campaign == campaign) for t in (readings, events)]
        chains = {row.position: row.chain for row in connection.execute(start.union_all(*parts))}
        if chains.get(0) is not None:
            head = connection.execute(sa.select(heads).where(heads.c.campaign == campaign)).first()
            if head is None or (head.position, head.chain) != (len(chains) - 1, chains.get(head.position)):
                raise StoreError(
                    f"store {self.name}: campaign '{campaign}': damaged (rows are missing or were added); "
                    "`pkm-rig audit` says which, restore the store from a backup"
                )
        return CampaignRows(f"store {self.name}", campaign, chains)

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
        """A transaction that writes; nobody else adds to the same campaign meanwhile. Errors come in one line."""
        with one_line(self.name), self._place.writing() as connection:
            yield connection

    @contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """A connection that sees the store at one moment. Errors come in one line."""
        with one_line(self.name), self._place.reading() as connection:
            yield connection


def _count(connection: sa.Connection, campaign: str) -> int:
    count = sa.select(sa.func.count()).select_from(readings).where(readings.c.campaign == campaign)
    return int(connection.execute(count).scalar_one())


@contextmanager
def open_store(
    out: Path, *, hold: bool = False, rig: str | None = None, campaign: str | None = None
) -> Iterator[Store]:
    """The store of a folder, created if it does not exist; with `hold` others are kept off the rig meanwhile.

    `campaign`: the one that it is held for, which others see as running.
    """
    store = Store(store_place(out))
    try:
        if hold:
            store.work_on(campaign, rig)
        yield store
    finally:
        store.close()


@contextmanager
def open_existing_store(out: Path) -> Iterator[Store]:
    """The store of a folder, for reading; InputError, and nothing created, if there is none."""
    require_store(out)
    store = Store(store_place(out), read_only=True)
    try:
        yield store
    finally:
        store.close()


@contextmanager
def hold_existing_store(out: Path, *, rig: str | None = None, campaign: str | None = None) -> Iterator[Store]:
    """The store of a folder, to write, others kept off the rig; InputError, and nothing created, if there is none.

    `campaign`: its rig is meant.
    """
    require_store(out)
    with open_store(out) as store:
        store.hold(rig if campaign is None else store.rig_of(campaign))
        yield store


def require_store(out: Path) -> None:
    """InputError if a folder has no store."""
    if not has_store(out):
        raise InputError(f"there is no store in {out}; give --out")


def find_recording(name: str, out: Path, *, by_sequence: bool = False) -> Recording:
    """A recording by its folder, or by its campaign id in the store; InputError if it is neither. `by_sequence`: in a
    folder, each fall of rig time begins a session."""
    folder = Path(name)
    if folder.is_dir():
        return read_folder(folder, by_sequence=by_sequence)
    require_file_or_folder(folder)
    if folder.name != name or folder.is_file():  # a path, as no id is
        raise InputError(f"'{name}' is no folder of a recording; check the path, or give a campaign's id")
    if not has_store(out):
        raise InputError(f"'{name}' is no recording folder, and there is no store in {out}; give --out")
    with open_existing_store(out) as store:
        return store.recording(name)
