"""A change of the tables in all drives, or of the host's correction: what was before is stored first, so that it can be
undone after any failure.

Steps in the store (`table_changes`), each durable before the drives are touched: `begun` with the former state of every
drive and the state to bring them to; `trial` with the images that are tried; and one that ends the change: `kept`
(tried, verified and accepted), `done` (brought to the state that was asked for) or `given up`.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, Literal

from drivers.drives.table_bank import CompensationState
from drivers.drives.table_group import answering
from drivers.drives.table_group import switch_off as switch_off_banks
from drivers.drives.table_image import TableImage, encode_table
from drivers.errors import DeviceError, TableError
from pkm_rig.errors import StoreError
from pkm_rig.rig.capabilities import uses_tables
from pkm_rig.rig.drive_tables import (
    Table,
    WantedTables,
    as_image,
    as_text,
    record_state,
    state_to_return_to,
    table_of,
    telling_tables,
)
from pkm_rig.rig.host_state import HOST, HostState, host_in_use, next_generation, state_of
from pkm_rig.rig.rig import Rig
from pkm_rig.store.store import Store
from pkm_rig.store.stored_rows import StoredTableChange

BEGUN, TRIAL, KEPT, DONE, GIVEN_UP = "begun", "trial", "kept", "done", "given up"
ENDS = (KEPT, DONE, GIVEN_UP)
VERDICT = "table_change"  # key of the verdict's event: the change that it judges

HOST_OFF = ("off", "home")  # after these the host corrects no more; it never does while a campaign measures

Purpose = Literal["calibrate", "measure", "verify", "home", "off", "rollback", "approve"]


class TableChange:
    """One change, from its first step on. Raises StoreError before the drives are touched, and DeviceError."""

    def __init__(self, rig: Rig, store: Store, steps: Sequence[StoredTableChange]) -> None:
        first = steps[0]
        self.id, self.campaign, self.machine = first.change, first.campaign, first.machine
        self.purpose: str = first.data["purpose"]
        self.former: list[dict[str, Any]] = first.data["former"]
        target = first.data["target"]
        self.target = self.before if target is None else WantedTables.of_json(target)
        self.host_former = state_of(first.data.get("host_former"))
        self.host_target = state_of(first.data.get("host_target"))
        self.end = steps[-1].kind if steps[-1].kind in ENDS else None
        self.trials = [step.data for step in steps if step.kind == TRIAL]
        self._rig, self._store, self._host_generation = rig, store, 0

    @property
    def ended(self) -> bool:
        """Whether nothing of it is left to do."""
        return self.end is not None

    @property
    def before(self) -> WantedTables:
        """The state of before."""
        return state_to_return_to(self.former)

    @property
    def description(self) -> str:
        """What the drives, or the host, go back to."""
        if self.host_target is not None and self.host_target.on:
            return f"the host's former correction, generation {self.host_target.generation}"
        return "the former tables" if self.target.on else "no compensation, as before"

    @property
    def accepted(self) -> bool:
        """Whether the verdict on its tables is stored, and they may stay."""
        return self._has_verdict("accepted")

    @property
    def judged(self) -> bool:
        """Whether it was ended, not given up, with a verdict on its tables: its campaign is complete."""
        return self.end in (KEPT, DONE) and (self.accepted or self._has_verdict("refused"))

    def left_in_use(self) -> dict[str, Table]:
        """Generation and CRC of each drive's table that was in use when it ended; nothing if none was."""
        if self.end == KEPT:
            return {drive: table_of(image) for drive, image in self._tried().items()}
        if self.end != DONE or not self.target.on:
            return {}
        return {drive: table_of(image) for drive, image in self.target.images.items() if image is not None}

    def compensate(self, images: Sequence[TableImage]) -> list[CompensationState]:
        """Store these tables, then use them on trial and power the drives again; see `Rig.compensate`."""
        data = {bank.drive.name: encode_table(image) for bank, image in zip(self._rig.banks, images, strict=True)}
        trial = {
            "images": {drive: as_text(image) for drive, image in data.items()},
            "tables": {drive: list(table_of(image)) for drive, image in data.items()},
        }
        self._add(TRIAL, trial)
        self.trials.append(trial)
        return self._rig.compensate(images)

    def try_host(self, crc: int) -> None:
        """Store that the host is to correct by this campaign, on trial: no drive uses a table meanwhile."""
        number = self._host_generation or next_generation(self._store, self._rig.file.rig)
        self._host_generation = number
        state = HostState(number, self.campaign or "", crc)
        trial: dict[str, Any] = {"images": {}, "tables": {}, HOST: state.as_json()}
        self._add(TRIAL, trial)
        self.trials.append(trial)

    def require_in_use(self) -> None:
        """Raise TableError unless the tables tried last are what every drive uses: they were measured, no others."""
        for bank in self._rig.banks:
            if not bank.uses(self._tried()[bank.drive.name]):
                raise TableError(
                    bank.drive.name, bank.drive.where, "the table that was measured is not in use any more",
                    "find out why the drive gave it up, then verify again",
                )  # fmt: skip

    def keep(self) -> None:
        """Use what was tried last for good: it is verified, and the verdict is stored.

        The host's correction is then in force by this step alone; the drives keep what they have, switched off.
        """
        host = self.trials[-1].get(HOST)
        if host is not None:
            self._rig.switch_compensation(None)
            self._add(KEPT, {HOST: host})
            return
        tried = self._tried()
        self._rig.bring_tables_to([tried[bank.drive.name] for bank in self._rig.banks], on=True)
        self._add(KEPT, {})

    def use_former(self) -> None:
        """Use what was before, within the change: to measure with it again. The change goes on."""
        former = self.before
        self._rig.bring_tables_to([former.images[bank.drive.name] for bank in self._rig.banks], on=former.on)
        self._rig.compensation = int(self.former[0]["generation"]) if former.on else 0
        self._rig.enable()

    def bring_to_target(self) -> None:
        """Bring all drives to the state that was asked for; that of before, where tables were to be tried."""
        images = self.target.images
        self._rig.bring_tables_to([images[bank.drive.name] for bank in self._rig.banks], on=self.target.on)
        self._add(DONE, {HOST: None if self.host_target is None else self.host_target.as_json()})

    def fall_back(self) -> None:
        """After a failure: the same as far as the drives answer; while one is silent, the others use no table.

        The change then stays unfinished, and the next command that connects ends it.
        """
        banks = answering(self._rig.banks)
        if len(banks) == len(self._rig.banks):
            self.bring_to_target()
            return
        for bank in banks:
            with suppress(DeviceError):
                bank.drive.disable()
        switch_off_banks(banks)

    def give_up(self, why: str) -> None:
        """End the change without touching the drives."""
        self._add(GIVEN_UP, {"why": why})

    def _has_verdict(self, verdict: str) -> bool:
        if self.campaign is None or not self.trials:
            return False
        return any(event.data.get(VERDICT) == self.id for event in self._store.events(self.campaign, verdict))

    def _tried(self) -> dict[str, bytes]:
        images = self.trials[-1]["images"]
        return {drive: as_image(text) or b"" for drive, text in images.items()}

    def _add(self, kind: str, data: dict[str, Any]) -> None:
        if _keeps_steps(self._rig):
            add_step(self._rig, self._store, self.campaign, self.id, kind, data)
        self.end = kind if kind in ENDS else None


def begin(
    rig: Rig,
    store: Store,
    purpose: Purpose,
    campaign: str | None = None,
    target: WantedTables | None = None,
    host: Callable[[HostState | None], HostState | None] = lambda former: former,
) -> TableChange:
    """Store the state of every drive and of the host; nothing has been changed when this returns.

    `target`: None for that state; `host`: what the host is brought to, of what it does now.
    """
    now = None if uses_tables(rig.file, rig.machine) else host_in_use(store, rig.file.rig, rig.machine.name)
    wanted = host(now)
    data = {
        "purpose": purpose,
        "former": record_state(rig),
        "target": None if target is None else target.as_json(),
        "host_former": None if now is None else now.as_json(),
        "host_target": None if wanted is None else wanted.as_json(),
    }
    change = secrets.token_hex(8)
    if _keeps_steps(rig):
        add_step(rig, store, campaign, change, BEGUN, data)
    step = StoredTableChange(0, "", rig.file.rig, rig.machine.name, campaign, change, BEGUN, data)
    return TableChange(rig, store, [step])


@contextmanager
def changing_tables(rig: Rig, store: Store, purpose: Purpose, campaign: str) -> Iterator[TableChange]:
    """Tables may be tried within; if anything fails the former ones come back, unless the verdict has accepted them.

    The error then says which tables are active (as a note).
    """
    change = begin(rig, store, purpose, campaign)
    with telling_tables(rig, store):
        try:
            yield change
        except BaseException:
            with suppress(DeviceError, StoreError):
                if not change.ended and not change.accepted:
                    change.fall_back()
            raise


def switch_off(rig: Rig, store: Store | None, purpose: Purpose) -> None:
    """Use no table on any drive; the banks stay. A change that can be rolled back, where there is a store."""
    if store is None:
        rig.switch_compensation(None)
        return
    former = {record["drive"]: as_image(record["image"]) for record in record_state(rig)}
    stays = purpose not in HOST_OFF
    begin(
        rig,
        store,
        purpose,
        target=WantedTables(former, on=False),
        host=lambda now: now if stays or now is None else now.off(),
    ).bring_to_target()


def _keeps_steps(rig: Rig) -> bool:
    """Whether there is something to record: drives with tables, or a host that corrects."""
    return bool(rig.banks) or not uses_tables(rig.file, rig.machine)


def add_step(rig: Rig, store: Store, campaign: str | None, change: str, kind: str, data: dict[str, Any]) -> None:
    """Store a step; durable when this returns."""
    store.add_table_change(
        rig=rig.file.rig, machine=rig.machine.name, campaign=campaign, change=change, kind=kind, data=data
    )


def changes_of(rig: Rig, store: Store) -> list[TableChange]:
    """All changes of a rig that this store knows, oldest first."""
    steps: dict[str, list[StoredTableChange]] = {}
    for step in store.table_changes(rig.file.rig):
        steps.setdefault(step.change, []).append(step)
    return [TableChange(rig, store, parts) for parts in steps.values() if parts[0].kind == BEGUN]
