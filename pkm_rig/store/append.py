"""Adds rows to the end of a campaign and of its chain, within the transaction that the connection has begun."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa

from calibration.base.errors import InputError
from calibration.recording.header import RecordingFile
from pkm_rig.store.chain import canonical, event_link, genesis, reading_link
from pkm_rig.store.schema import campaigns, events, heads, readings


def now_text() -> str:
    """Now in UTC, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def append_campaign(connection: sa.Connection, file: RecordingFile, machine_text: str) -> None:
    """Begin a campaign."""
    name, description = file.campaign, file.model_dump(mode="json")
    chain = genesis(name, file.created, description, machine_text)
    connection.execute(
        campaigns.insert().values(
            id=name, created=file.created, description=canonical(description), machine=machine_text, chain=chain
        )
    )
    connection.execute(heads.insert().values(campaign=name, position=0, chain=chain))


def append_readings(
    connection: sa.Connection, campaign: str, new: Sequence[tuple[str, int, Mapping[str, float | str]]]
) -> None:
    """Add readings (uid, sequence, data)."""
    position, chain = head_of(connection, campaign, to_add=True)
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


def append_event(connection: sa.Connection, campaign: str, kind: str, data: Mapping[str, Any]) -> None:
    """Add an event."""
    position, chain = head_of(connection, campaign, to_add=True)
    position, created = position + 1, now_text()
    if chain is not None:
        chain = event_link(chain, campaign, position, created, kind, data)
    connection.execute(
        events.insert().values(
            campaign=campaign, position=position, created=created, kind=kind, data=canonical(data), chain=chain
        )
    )
    _set_head(connection, campaign, position, chain)


def head_of(connection: sa.Connection, campaign: str, *, to_add: bool = False) -> tuple[int, str | None]:
    """Number and chain value of a campaign's last row; InputError if there is no such campaign.

    `to_add`: nobody else adds to the campaign until the transaction ends, so that its chain cannot fork.
    """
    query = sa.select(heads).where(heads.c.campaign == campaign)
    # SQLite has no such clause and leaves it out: its transaction keeps all writers out from its beginning
    head = connection.execute(query.with_for_update() if to_add else query).first()
    if head is None:
        raise InputError(f"no campaign '{campaign}'; `pkm-rig list` shows what is there")
    return head.position, head.chain


def _set_head(connection: sa.Connection, campaign: str, position: int, chain: str | None) -> None:
    connection.execute(heads.update().where(heads.c.campaign == campaign).values(position=position, chain=chain))
