"""What all drives of a rig hold and use, as it is stored before a change and as it is told to people."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from drivers.drives.table_bank import BankStatus, CompensationMode, CompensationState, TableBank
from drivers.drives.table_image import decode_table, image_crc
from drivers.errors import DeviceError
from pkm_rig.errors import StoreError
from pkm_rig.rig.host_state import host_in_use
from pkm_rig.rig.rig import Rig
from pkm_rig.store.store import Store

Table = tuple[int, int]  # generation and CRC
TABLES_NOTE = "tables: "  # begins the line that tells which are active


@dataclass(frozen=True)
class WantedTables:
    """What all drives are to be brought to: images by drive (None: no bank active), used for good or not at all."""

    images: Mapping[str, bytes | None]
    on: bool

    def as_json(self) -> dict[str, Any]:
        """For the store."""
        return {"on": self.on, "images": {drive: as_text(image) for drive, image in self.images.items()}}

    @classmethod
    def of_json(cls, data: Mapping[str, Any]) -> WantedTables:
        """From the store."""
        return cls({drive: as_image(text) for drive, text in data["images"].items()}, bool(data["on"]))


def as_text(image: bytes | None) -> str | None:
    """An image in JSON."""
    return None if image is None else base64.b64encode(image).decode("ascii")


def as_image(text: str | None) -> bytes | None:
    """An image out of JSON."""
    return None if text is None else base64.b64decode(text)


def table_of(image: bytes) -> Table:
    """Generation and CRC of an image."""
    return decode_table(image).generation, image_crc(image)


def read_states(rig: Rig) -> list[CompensationState]:
    """The state of every drive's compensation, in their order."""
    return [bank.state() for bank in rig.banks]


def whole_tables(state: CompensationState) -> set[Table]:
    """The tables in a drive's banks."""
    return {(bank.generation, bank.crc) for bank in state.banks if bank.status is BankStatus.WHOLE}


def record_state(rig: Rig) -> list[dict[str, Any]]:
    """Mode, bank, generation, tables and active image of every drive, for the store."""
    return [_record_drive(bank, state) for bank, state in zip(rig.banks, read_states(rig), strict=True)]


def _record_drive(bank: TableBank, state: CompensationState) -> dict[str, Any]:
    usable = state.active and state.banks[state.active - 1].status is BankStatus.WHOLE
    return {
        "drive": bank.drive.name,
        "serial": serial_of(bank),
        "mode": state.mode.name.lower(),
        "bank": state.active,
        "generation": state.generation,
        "crc": state.crc,
        "tables": [list(table) for table in sorted(whole_tables(state))],
        "image": as_text(bank.image_bytes(state.active)) if usable else None,
    }


def serial_of(bank: TableBank) -> int | None:
    """The serial number of a bank's drive."""
    return None if bank.drive.identity is None else bank.drive.identity.serial


def state_to_return_to(records: Sequence[Mapping[str, Any]]) -> WantedTables:
    """The state that was recorded; a table that was only on trial is not used again."""
    images = {record["drive"]: as_image(record["image"]) for record in records}
    kept = bool(records) and all(record["mode"] == CompensationMode.KEPT.name.lower() for record in records)
    return WantedTables(images, kept and None not in images.values())


def doubt(states: Sequence[CompensationState], names: Sequence[str]) -> str | None:
    """Why the drives must not go on as they are: half active, or on trial without anybody verifying; None if not."""
    if any(state.mode is CompensationMode.TRIAL for state in states):
        return f"tables that were never verified are in use ({_in_words(states, names)})"
    if len({(state.on, state.generation if state.on else 0) for state in states}) > 1:
        return f"the tables are half active ({_in_words(states, names)})"
    return None


def tables_line(rig: Rig, store: Store | None) -> str:
    """Which tables are active, in one line, whatever state the rig is in."""
    try:
        for bank in rig.banks:
            bank.drive.require_heartbeat()
        states = read_states(rig)
    except DeviceError as error:
        return f"tables: unknown: {error.device} could not be reached; `pkm-rig tables show` tells"
    names = [bank.drive.name for bank in rig.banks]
    if not any(state.on for state in states):
        tables = "off on all drives" if states else "none, the drives store no tables"
        host = None if store is None else host_in_use(store, rig.file.rig, rig.machine.name)
        return f"tables: {tables}{'' if host is None else f'; {host.in_words()}'}"
    if doubt(states, names) and len({(state.mode, state.generation) for state in states}) > 1:
        return f"tables: {_in_words(states, names)}"
    first = states[0]
    campaign = None if store is None else campaign_of(store, names[0], (first.generation, first.crc))
    trial = ", on trial" if first.mode is CompensationMode.TRIAL else ""
    return f"tables: generation {first.generation}{f' of campaign {campaign}' if campaign else ''}{trial} on all drives"


@contextmanager
def telling_tables(rig: Rig, store: Store | None) -> Iterator[None]:
    """An error says which tables are active after it, as a note; once, however often this is entered."""
    try:
        yield
    except BaseException as error:
        if not any(note.startswith(TABLES_NOTE) for note in getattr(error, "__notes__", ())):
            try:
                error.add_note(tables_line(rig, store))
            except StoreError:  # the drives can still tell
                error.add_note(tables_line(rig, None))
        raise


def campaign_of(store: Store, drive: str, table: Table) -> str | None:
    """The campaign that a drive's table was computed from, by what is stored here; None if it is not."""
    for step in reversed(store.table_changes()):
        if step.kind == "trial" and step.data["tables"].get(drive) == list(table):
            return step.campaign
    return None


def _in_words(states: Sequence[CompensationState], names: Sequence[str]) -> str:
    words = {
        CompensationMode.OFF: "off",
        CompensationMode.KEPT: "generation {}",
        CompensationMode.TRIAL: "generation {} on trial",
    }
    return ", ".join(
        f"{name} {words[state.mode].format(state.generation)}" for name, state in zip(names, states, strict=True)
    )
