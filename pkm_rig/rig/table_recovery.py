"""A change of tables that was never ended is found when a rig is connected, and ended before anything else is done.

It may be interrupted and repeated: the change stays unfinished in the store until the drives are where they belong.
"""

from __future__ import annotations

from collections.abc import Callable

from pkm_rig.rig.drive_tables import (
    Table,
    doubt,
    read_states,
    serial_of,
    table_of,
    tables_line,
    telling_tables,
    whole_tables,
)
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.table_change import TableChange, changes_of
from pkm_rig.store.store import Store


def settle_tables(rig: Rig, store: Store | None, notify: Callable[[str], None]) -> TableChange | None:
    """End what was left unfinished, then switch off what is in doubt on all drives; says what it does.

    The change that was ended, if there was one. Without a store only the drives can be asked.
    Raises DeviceError and StoreError, which say which tables are active.
    """
    with telling_tables(rig, store):
        change = end_unfinished_change(rig, store, notify)
        why = doubt(read_states(rig), [bank.drive.name for bank in rig.banks])
        if why is not None:
            rig.switch_compensation(None)
            notify(f"{why}; compensation is now off on all drives")
        return change


def end_unfinished_change(rig: Rig, store: Store | None, notify: Callable[[str], None]) -> TableChange | None:
    """Finish a change whose tables were accepted, undo any other, and say so; the change, if there was one.

    Raises DeviceError and StoreError.
    """
    change = None if store is None else unfinished_change(rig, store)
    if change is not None and store is not None:
        with telling_tables(rig, store):
            _end(rig, store, change, notify)
    return change


def unfinished_change(rig: Rig, store: Store) -> TableChange | None:
    """The rig's last change, if it was never ended; none is begun before the one before has been."""
    changes = changes_of(rig, store)
    return None if not changes or changes[-1].ended else changes[-1]


def _end(rig: Rig, store: Store, change: TableChange, notify: Callable[[str], None]) -> None:
    of = f" of campaign {change.campaign}" if change.campaign else f" ({change.purpose})"
    found = f"an unfinished change of the tables{of} was found"
    why = _not_ours(rig, change)
    if why is not None:
        change.give_up(why)
        notify(f"{found} and given up: {why}")
        return
    if change.accepted:
        change.keep()
        notify(f"{found} and finished: its tables were accepted; {tables_line(rig, store)}")
        return
    change.bring_to_target()
    undone = "finished" if change.campaign is None else "undone"
    notify(f"{found} and {undone}; {tables_line(rig, store)}")


def _not_ours(rig: Rig, change: TableChange) -> str | None:
    """Why the drives are not what the change left behind; None if they are."""
    records = {record["drive"]: record for record in change.former}
    for bank, state in zip(rig.banks, read_states(rig), strict=True):
        name = bank.drive.name
        if name not in records or change.machine != rig.machine.name:
            return "it was made on another machine"
        if records[name]["serial"] != serial_of(bank):
            return f"drive {name} has another serial number"
        if not whole_tables(state) <= known_tables(change, name):
            return f"other tables were written to drive {name} since"
    return None


def known_tables(change: TableChange, drive: str) -> set[Table]:
    """The tables that a change may have left in a drive's banks."""
    known = {(int(g), int(c)) for record in change.former if record["drive"] == drive for g, c in record["tables"]}
    for trial in change.trials:
        if drive in trial["tables"]:  # not where the host corrects
            generation, crc = trial["tables"][drive]
            known.add((int(generation), int(crc)))
    image = change.target.images.get(drive)
    return known if image is None else known | {table_of(image)}
