"""The tables in the drives, or the host's correction, by hand: show, switch off, go back to before the last change."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from calibration.base.errors import InputError
from calibration.compensation.samples import CorrectionSamples
from drivers.drives.table_bank import BankStatus, CompensationState, TableBank
from drivers.drives.table_image import decode_table, machine_id_of
from drivers.errors import DriveFault, TableError
from pkm_rig.jobs.former_correction import SAMPLES, activated_events
from pkm_rig.rig.capabilities import uses_tables
from pkm_rig.rig.drive_tables import (
    WantedTables,
    campaign_of,
    read_states,
    serial_of,
    tables_line,
    telling_tables,
)
from pkm_rig.rig.host_state import host_in_use
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.table_change import DONE, KEPT, TableChange, begin, changes_of, switch_off
from pkm_rig.store.store import Store

BY_HAND = ("off", "rollback", "home", "approve")
STANDS_M_PER_S = 1e-4


def show_tables(rig: Rig, store: Store | None) -> dict[str, Any]:
    """What each drive holds and uses, and of which campaign it is (docs/reference/json.md)."""
    _require_correction(rig)
    states = read_states(rig)
    return {
        "rig": rig.file.rig,
        "simulated": bool(rig.simulated_devices),
        "tables": tables_line(rig, store).removeprefix("tables: "),
        "drives": {
            bank.drive.name: _drive(rig, store, bank, state) for bank, state in zip(rig.banks, states, strict=True)
        },
        "host": None if uses_tables(rig.file, rig.machine) else _host(rig, store),
    }


def _host(rig: Rig, store: Store | None) -> dict[str, Any]:
    """Which correction this computer makes of its targets: of which campaign, for which loads, of what size."""
    state = None if store is None else host_in_use(store, rig.file.rig, rig.machine.name)
    if state is None or store is None:
        return {"generation": None, "campaign": None, "on": False, "crc": None, "payloads": []}
    units = ["rad" if kind == "crank" else "m" for kind in rig.machine.drive_kinds]
    payloads = []
    for data in activated_events(store, state.campaign).values():
        largest = np.abs(CorrectionSamples.of_json(data[SAMPLES]).correction).max(axis=0)
        payloads.append(
            {
                "payload_kg": data["payload_kg"],
                "temperatures_c": data["temperatures_c"],
                "largest_correction": {
                    name: {"value": float(value), "unit": unit}
                    for name, value, unit in zip(rig.machine.drive_names, largest, units, strict=True)
                },
            }
        )
    return {**state.as_json(), "payloads": payloads}


def _drive(rig: Rig, store: Store | None, bank: TableBank, state: CompensationState) -> dict[str, Any]:
    return {
        "mode": state.mode.name.lower(),
        "bank": state.active or None,
        "valid": state.valid,
        "payload_kg": state.payload_kg,
        "serial": serial_of(bank),
        "banks": [
            {
                **asdict(stored),
                "status": stored.status.name.lower(),
                "campaign": None
                if store is None
                else campaign_of(store, bank.drive.name, (stored.generation, stored.crc)),
                "of_this_machine": _is_of_this_machine(rig, bank, stored.number)
                if stored.status is BankStatus.WHOLE
                else None,
            }
            for stored in state.banks
        ],
    }


def _is_of_this_machine(rig: Rig, bank: TableBank, number: int) -> bool:
    try:
        return bank.read_image(number).machine_id == machine_id_of(rig.machine.name)
    except TableError:
        return False


def change_to_off(rig: Rig, store: Store | None) -> None:
    """Use no table on any drive. Raises DriveFault while one moves, and what supervision finds.

    An error says which tables are active.
    """
    _require_correction(rig)
    if store is None and not uses_tables(rig.file, rig.machine):
        raise InputError(f"rig {rig.file.rig}: what the host corrects is in the store; give the --out that has it")
    with telling_tables(rig, store):
        require_standstill(rig)
        with rig.supervisor.during_motion():
            switch_off(rig, store, "off")


def last_change(rig: Rig, store: Store) -> TableChange:
    """The change that a rollback undoes; InputError if there is none, or its former tables are not this machine's."""
    _require_correction(rig)
    changes = [c for c in changes_of(rig, store) if c.end == KEPT or (c.end == DONE and c.purpose in BY_HAND)]
    if not changes:
        raise InputError(
            f"rig {rig.file.rig}: no change of its tables is in this store; give the --out of the last one"
        )
    change = changes[-1]
    if change.machine != rig.machine.name:
        raise InputError(f"the former tables are of machine {change.machine}, this is {rig.machine.name}; not written")
    records = {record["drive"]: record for record in change.former}
    for bank in rig.banks:
        record = records.get(bank.drive.name)
        if record is None or record["serial"] != serial_of(bank):
            raise InputError(f"the former tables are not of drive {bank.drive.name} as it is now; not written")
    for image in change.before.images.values():
        if image is not None and decode_table(image).machine_id != machine_id_of(rig.machine.name):
            raise InputError(f"the former tables are not of machine {rig.machine.name}; not written")
    if change.host_former is not None:
        store.header(change.host_former.campaign)  # InputError where it was removed: its correction cannot come back
    return change


def describe_before(change: TableChange) -> str:
    """The state before a change, in words."""
    if change.host_former is not None:
        return change.host_former.in_words()
    if not change.before.on:
        return "off on all drives"
    return f"generation {change.former[0]['generation']} on all drives"


def roll_back(rig: Rig, store: Store, change: TableChange) -> None:
    """Bring all drives to their state before a change: a change of its own, so that it can be rolled back too."""
    before = change.before
    with telling_tables(rig, store):
        require_standstill(rig)
        with rig.supervisor.during_motion():
            begin(
                rig,
                store,
                "rollback",
                target=WantedTables(before.images, before.on),
                host=lambda _: change.host_former,
            ).bring_to_target()


def _require_correction(rig: Rig) -> None:
    if not rig.banks and uses_tables(rig.file, rig.machine):
        raise InputError(f"rig {rig.file.rig}: its drives store no compensation tables; there is nothing to show")


def require_standstill(rig: Rig) -> None:
    """Raise DriveFault while a drive moves."""
    for drive, sample in zip(rig.drives.drives, rig.drives.sample(), strict=True):
        if not abs(sample.velocity_m_per_s) <= STANDS_M_PER_S:
            raise DriveFault(
                drive.name, drive.where, f"it moves at {sample.velocity_m_per_s * 1e3:.3g} mm/s",
                "tables are changed at standstill only; wait, or find out who moves it",
            )  # fmt: skip
