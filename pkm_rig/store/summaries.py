"""All campaigns in a list, in four queries whatever their number; each row that is used is compared with its chain.

An event of which only the kind is of interest is compared as the text that it is stored as: where that gives its chain
value, it is as it was written, and need not be parsed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import sqlalchemy as sa

from pkm_rig.errors import StoreError
from pkm_rig.store.campaign_state import campaign_state
from pkm_rig.store.chain import event_link_of_text
from pkm_rig.store.schema import campaigns, events, heads, readings
from pkm_rig.store.sessions import BEGUN, ENDED
from pkm_rig.store.stored_rows import (
    CampaignRows,
    CampaignSummary,
    EventData,
    StoredEvent,
    parsed,
    read_campaign,
    stored_text,
)

AT_ONCE = 1000  # rows that are in memory
_NOTHING: dict[str, Any] = {}


class _Numbers(NamedTuple):
    """How many rows a campaign has, and the sum of their positions."""

    rows: int = 0
    positions: float = 0.0


class _Events(NamedTuple):
    """What is read of a campaign's events: how they stand in its numbering, the last one's kind, or their damage."""

    numbers: _Numbers = _Numbers()
    last: Any = None
    last_chain: Any = None
    found: Sequence[StoredEvent] = ()
    damage: str = ""


class _Head(NamedTuple):
    """The last row of a campaign as `heads` has it, and its chain value if it is a reading."""

    position: Any
    chain: Any
    of_reading: Any


def list_campaigns(
    connection: sa.Connection, where: str, worked_on: set[str], only: object = None
) -> list[CampaignSummary]:
    """All campaigns, or one, oldest first; a damaged one says so and does not hide the others.

    `where` is how messages call the store. Raises what the database raises where it cannot be read at all.
    """
    numbers = _numbers_of_readings(connection, only)
    last = _heads(connection, only)
    said = _events(connection, where, only)
    query = sa.select(campaigns) if only is None else sa.select(campaigns).where(campaigns.c.id == only)
    found = [
        _summary(
            row,
            where,
            numbers.get(row.id, _Numbers()),
            last.get(row.id),
            said.get(row.id, _Events()),
            is_worked_on=row.id in worked_on,
        )
        for row in _stream(connection, query)
    ]
    return [summary for _, summary in sorted(found, key=lambda entry: entry[0])]


def _summary(
    row: Any, where: str, count: _Numbers, head: _Head | None, said: _Events, *, is_worked_on: bool
) -> tuple[tuple[bool, str], CampaignSummary]:
    """A campaign as far as it can be read, with what it is sorted by."""
    order = (isinstance(row.created, str), str(row.created))
    summary = CampaignSummary(repr(row.id), "", "", 0, "")
    here = f"{where}: campaign {row.id!r:.120}"
    try:
        summary = summary._replace(campaign=stored_text(row.id, here), readings=count.rows)
        kind = "" if said.last is None else stored_text(said.last, f"{here}, last event")
        summary = summary._replace(last_event=kind)
        stored = read_campaign(row, where)
        rig = stored_text(stored.description.get("rig"), f"{here}, rig")
        simulated = stored.description.get("simulated") is True
        summary = summary._replace(created=stored.created, rig=rig, simulated=simulated)
        if stored.chain is not None:
            _require_whole(where, stored.id, count, head, said, stored.chain)
        if said.damage:
            raise StoreError(said.damage)
        state, step = campaign_state(said.found, is_worked_on=is_worked_on)
    except StoreError as error:
        return order, summary._replace(damage=str(error))
    return order, summary._replace(state=state, step=step)


def _require_whole(where: str, campaign: str, count: _Numbers, head: _Head | None, said: _Events, chain: str) -> None:
    """StoreError if rows of a chained campaign are missing or were added."""
    rows = count.rows + said.numbers.rows
    positions = count.positions + said.numbers.positions
    own = chain if rows == 0 else said.last_chain if head is None or head.of_reading is None else head.of_reading
    if head is None or (head.position, head.chain) != (rows, own) or 2 * positions != rows * (rows + 1):
        raise StoreError(
            f"{where}: campaign '{campaign}': damaged (rows are missing or were added); "
            "`pkm-rig audit` says which, restore the store from a backup"
        )


def _numbers_of_readings(connection: sa.Connection, only: object) -> dict[object, _Numbers]:
    name = readings.c.campaign
    query = sa.select(name, sa.func.count(), sa.func.sum(readings.c.position)).group_by(name)
    rows = connection.execute(query if only is None else query.where(name == only))
    return {row[0]: _Numbers(row[1], float(row[2])) for row in rows}


def _heads(connection: sa.Connection, only: object) -> dict[object, _Head]:
    at_head = (readings.c.campaign == heads.c.campaign) & (readings.c.position == heads.c.position)
    query = sa.select(heads, readings.c.chain.label("of_reading")).outerjoin(readings, at_head)
    rows = connection.execute(query if only is None else query.where(heads.c.campaign == only))
    return {row.campaign: _Head(row.position, row.chain, row.of_reading) for row in rows}


def _events(connection: sa.Connection, where: str, only: object) -> dict[object, _Events]:
    """Each campaign's events, every one compared with its chain value."""
    chosen = sa.true() if only is None else events.c.campaign == only
    return {campaign: _of_one(where, campaign, rows) for campaign, rows in event_rows(connection, chosen)}


def event_rows(connection: sa.Connection, chosen: sa.ColumnElement[bool]) -> Iterable[tuple[Any, Iterable[Any]]]:
    """The events of many campaigns, each with the chain value of a reading before it, in one query.

    A campaign's rows must be taken before the next campaign is.
    """
    before = (readings.c.campaign == events.c.campaign) & (readings.c.position == events.c.position - 1)
    query = (
        sa.select(events, readings.c.chain.label("after"), campaigns.c.chain.label("genesis"))
        .outerjoin(readings, before)
        .outerjoin(campaigns, campaigns.c.id == events.c.campaign)
        .where(chosen)
        .order_by(events.c.campaign, events.c.position)
    )
    return groupby(_stream(connection, query), key=lambda row: row.campaign)


def checked_events(where: str, campaign: str, rows: Iterable[Any]) -> list[StoredEvent]:
    """A campaign's events of `event_rows` with all that they say; StoreError for one that is not as it was written."""
    chains: dict[Any, Any] = {}
    found = []
    for row in rows:
        _note_before(chains, row)
        found.append(CampaignRows(where, campaign, chains).event(row))
        chains[row.position] = row.chain
    return found


def _note_before(chains: dict[Any, Any], row: Any) -> None:
    """Keep the chain values that a row of `event_rows` brings along: the campaign's own, and the reading's before."""
    chains[0] = row.genesis
    if row.after is not None:
        chains[row.position - 1] = row.after


def _of_one(where: str, campaign: Any, rows: Iterable[Any]) -> _Events:
    chains: dict[Any, Any] = {}
    found: list[StoredEvent] = []
    here = f"{where}: campaign '{campaign}'"
    number, positions, kind, chain, damage = 0, 0.0, None, None, ""
    for row in rows:
        _, position, created, kind, data, chain, after, genesis = row
        number += 1
        positions += position if isinstance(position, int) else 0
        chains[0] = genesis
        if after is not None:
            chains[position - 1] = after
        if not damage:
            try:
                event = None
                if isinstance(position, int):
                    event = _as_written(
                        chains.get(position - 1), campaign, position, (created, kind, data), chain, here
                    )
                found.append(event or CampaignRows(where, campaign, chains).event(row))
            except StoreError as error:
                damage = str(error)
        chains[position] = chain
    return _Events(_Numbers(number, positions), kind, chain, found, damage)


def _as_written(
    after: Any, campaign: str, position: int, texts: tuple[Any, Any, Any], chain: Any, here: str
) -> StoredEvent | None:
    """An event whose stored text gives its chain value, with what it says if that counts; None if it does not."""
    created, kind, data = texts
    try:
        if chain != event_link_of_text(after, campaign, position, created, kind, data):
            return None
        if '"plan":' not in data and kind not in (BEGUN, ENDED):  # of the others only the kind counts
            return StoredEvent(created, kind, _NOTHING)
        return StoredEvent(created, kind, EventData(parsed(data), here))
    except (TypeError, ValueError):  # no texts, or a chain that somebody made of what is no JSON
        return None


def _stream(connection: sa.Connection, query: Any) -> Iterable[Any]:
    return connection.execution_options(yield_per=AT_ONCE).execute(query)
