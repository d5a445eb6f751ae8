"""A machine's life in the store: machines, instruments, calibrations, checks and events, which outlast campaigns.

Rows are only added. A calibration has a row when it is identified and another with its verdict; what campaigns of
older stores say of theirs is read from their events (`pkm_rig.store.former_life`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import sqlalchemy as sa

from calibration.machine.description import Machine
from pkm_rig.errors import StoreError
from pkm_rig.store import schema
from pkm_rig.store.append import now_text
from pkm_rig.store.chain import canonical
from pkm_rig.store.store import Store
from pkm_rig.store.stored_rows import stored_number, stored_object, stored_text

LifeTable = Literal["machines", "instruments", "calibrations", "checks", "machine_events"]
IDENTIFIED, ACCEPTED, REFUSED, NOT_DECIDED = "identified", "accepted", "refused", "not decided"
PROPOSED = "proposed"  # verified, but beyond the envelope: it waits for somebody's approval


class LifeRow(NamedTuple):
    """One row of a machine's life; `machine` is the machine's key, `campaign` and `serial` where its table has them."""

    id: int
    created: str
    rig: str
    machine: str
    kind: str
    data: dict[str, Any]
    campaign: str | None = None
    serial: str | None = None


def machine_key(machine: Machine, names: tuple[str, ...]) -> str:
    """What a machine's history goes by: its name, and a hash of its nominal geometry and its parameters' names.

    Tolerances, comments and planned loads of the machine file are left out: they change no parameter's meaning; and
    what has its default, so that a key that a later version adds begins no history anew.
    """
    stated = machine.file.model_dump(mode="json", exclude={"tolerances", "load_cases"}, exclude_defaults=True)
    digest = hashlib.sha256(canonical({"file": stated, "parameters": sorted(names)}).encode("ascii")).hexdigest()
    return f"{machine.name}/{digest[:12]}"


def add_life_row(
    connection: sa.Connection,
    table: LifeTable,
    *,
    rig: str,
    machine: str,
    kind: str,
    data: Mapping[str, Any],
    created: str | None = None,
    **own: str | None,
) -> None:
    """Add a row within the transaction that the connection has begun; `own` are the columns of its table alone."""
    values = {"created": created or now_text(), "rig": rig, "machine": machine, "kind": kind}
    connection.execute(schema.metadata.tables[table].insert().values(**values, data=canonical(dict(data)), **own))


def add_to_life(
    store: Store,
    table: LifeTable,
    *,
    rig: str,
    machine: str,
    kind: str,
    data: Mapping[str, Any],
    created: str | None = None,
    **own: str | None,
) -> None:
    """Add a row, durable when this returns."""
    with store.writing() as connection:
        add_life_row(connection, table, rig=rig, machine=machine, kind=kind, data=data, created=created, **own)


def life_rows(store: Store, table: LifeTable, rig: str | None, machine: str | None = None) -> list[LifeRow]:
    """The rows of a rig, or of all with None, of one machine or of all that it has been, oldest first.

    StoreError, naming the row, for one that is not as it was written.
    """
    source = schema.metadata.tables[table]
    query = sa.select(source).order_by(source.c.id)
    if rig is not None:
        query = query.where(source.c.rig == rig)
    if machine is not None:
        query = query.where(source.c.machine == machine)
    with store.reading() as connection:
        return [_read(row, f"store {store.name}: row {row.id!r:.20} of {table}") for row in connection.execute(query)]


def rigs_with_a_life(store: Store) -> list[str]:
    """Names of all rigs that have a row in any table, in alphabetical order."""
    parts = [sa.select(schema.metadata.tables[name].c.rig) for name in ("machines", "calibrations", "checks")]
    with store.reading() as connection:
        found = connection.execute(sa.union(*parts)).scalars().all()
    return sorted(stored_text(name, f"store {store.name}, rig of a machine's life") for name in found)


def _read(row: Any, where: str) -> LifeRow:
    created, rig, machine, kind = (stored_text(text, where) for text in (row.created, row.rig, row.machine, row.kind))
    data = stored_object(row.data, where)
    if row.data != canonical(data):
        raise StoreError(f"{where}: damaged (not as it was written); restore the store from a backup")
    own: dict[str, str | None] = {}
    for name in ("campaign", "serial"):
        value = row._mapping.get(name)
        own[name] = None if value is None else stored_text(value, where)
    return LifeRow(stored_number(row.id, where), created, rig, machine, kind, data, **own)
