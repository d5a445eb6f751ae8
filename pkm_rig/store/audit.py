"""Whether a campaign is as it was written: every value, and no row missing, added or moved.

The chain finds any change of the file that does not compute it anew. One that does is found by a head that is kept
elsewhere: in a report, an export or on paper.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import sqlalchemy as sa

from calibration.base.errors import InputError
from pkm_rig.errors import StoreError
from pkm_rig.store.append import head_of
from pkm_rig.store.schema import campaigns, events, heads, readings
from pkm_rig.store.store import Store
from pkm_rig.store.stored_rows import CampaignRows, RemovedCampaign, read_campaign


@dataclass
class Audit:
    """What was found of one campaign. `row_of` has the number of the row behind each chain value."""

    campaign: str
    state: Literal["whole", "not chained", "broken"] = "whole"
    rows: int = 0
    readings: int = 0
    head: str | None = None
    problem: str = ""
    row_of: dict[str, int] = field(default_factory=dict, repr=False)

    def as_dict(self) -> dict[str, Any]:
        """For programs (docs/reference/json.md)."""
        return {name: value for name, value in vars(self).items() if name != "row_of"}


class FoundHead(NamedTuple):
    """Where a head was found: after which row of how many."""

    campaign: str
    row: int
    rows: int


def find_head(head: str, audits: Sequence[Audit], removed: Sequence[RemovedCampaign]) -> FoundHead | None:
    """The row whose chain value, or the removed campaign whose last one, is `head`."""
    for audit in audits:
        if head in audit.row_of:
            return FoundHead(audit.campaign, audit.row_of[head], audit.rows)
    return next((FoundHead(gone.campaign, gone.rows, gone.rows) for gone in removed if gone.head == head), None)


def audit(store: Store, campaign: str | None = None) -> list[Audit]:
    """Audit a campaign, or all that there is any row of; InputError if there is no such campaign."""
    with store.reading() as connection:
        tables = (campaigns.c.id, readings.c.campaign, events.c.campaign, heads.c.campaign)
        names = connection.execute(sa.union(*(sa.select(column) for column in tables))).scalars().all()
    if campaign is not None:
        if campaign not in names:
            raise InputError(f"store {store.name}: no campaign '{campaign}'; `pkm-rig list` shows what is there")
        names = [campaign]
    return [_audit(store, name) for name in names]


def _audit(store: Store, campaign: Any) -> Audit:
    result = Audit(campaign if isinstance(campaign, str) else repr(campaign))
    try:
        with store.reading() as connection:
            _follow_chain(connection, f"store {store.name}", campaign, result)
    except (StoreError, InputError) as error:
        result.state, result.problem = "broken", str(error)
    return result


def _follow_chain(connection: sa.Connection, where: str, campaign: str, result: Audit) -> None:
    """Take the rows in their order up to the first that is not as it was written, which is a StoreError."""
    row = connection.execute(sa.select(campaigns).where(campaigns.c.id == campaign)).first()
    if row is None:
        raise StoreError(f"{where}: campaign {campaign!r:.120} is missing, there are rows of it")
    chains: dict[int, str | None] = {0: read_campaign(row, where).chain}
    rows = CampaignRows(where, campaign, chains)
    where = f"{where}: campaign '{campaign}'"
    for is_reading, row in heapq.merge(
        _rows(connection, events, campaign), _rows(connection, readings, campaign), key=_position
    ):
        if row.position != result.rows + 1:
            raise StoreError(f"{where}: row {result.rows + 1} is missing; next is {row.position!r:.20}")
        (rows.reading if is_reading else rows.event)(row)
        result.rows += 1
        result.readings += is_reading
        chains[result.rows] = row.chain
    position, result.head = head_of(connection, campaign)
    if position != result.rows:
        raise StoreError(f"{where}: {result.rows} rows, and there were {position}")
    if result.head != chains[position]:
        raise StoreError(f"{where}: its head is not that of its last row")
    result.row_of = {chain: number for number, chain in chains.items() if isinstance(chain, str)}
    result.state = "not chained" if result.head is None else "whole"


def _rows(connection: sa.Connection, table: sa.Table, campaign: str) -> Iterable[tuple[bool, Any]]:
    query = sa.select(table).where(table.c.campaign == campaign).order_by(table.c.position)
    return ((table is readings, row) for row in connection.execute(query))


def _position(entry: tuple[bool, Any]) -> int:
    """Rows with a position that is no number come first, and end the audit."""
    position = entry[1].position
    return position if isinstance(position, int) else 0
