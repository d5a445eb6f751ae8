"""Rows as they are read: what is not as it was written is a StoreError that names the row, whatever SQLite returns."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, NamedTuple, NoReturn

from pkm_rig.errors import StoreError
from pkm_rig.store.chain import canonical, event_link, genesis, genesis_of_text, reading_link

_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


class StoredCampaign(NamedTuple):
    """A campaign itself: the header of its recording, the text of its machine file, where its chain begins."""

    id: str
    created: str
    description: dict[str, Any]
    machine: str
    chain: str | None


class CampaignSummary(NamedTuple):
    """A campaign in a list; where `damage` says something, the rest is what could be read."""

    campaign: str
    created: str
    rig: str
    readings: int
    last_event: str
    state: str = ""
    step: str = ""
    damage: str = ""
    simulated: bool = False


class StoredReading(NamedTuple):
    """A reading: its unique name, its number in the campaign and its columns."""

    uid: str
    sequence: int
    data: dict[str, Any]


class StoredEvent(NamedTuple):
    """Something that happened to a campaign: started, stopped, identified, activated, verified ..."""

    created: str
    kind: str
    data: dict[str, Any]


class StoredTableChange(NamedTuple):
    """One step of a change of the tables in a rig's drives, of a campaign or by hand."""

    id: int
    created: str
    rig: str
    machine: str
    campaign: str | None
    change: str
    kind: str
    data: dict[str, Any]


class RemovedCampaign(NamedTuple):
    """What stays of a campaign that was deleted, or moved to the file `archive`; `head` is None if it had no chain."""

    campaign: str
    created: str
    readings: int
    rows: int
    head: str | None
    removed: str
    who: str
    why: str
    archive: str | None


def read_campaign(row: Any, where: str) -> StoredCampaign:
    """A row of `campaigns`, as it was written."""
    where = f"{where}: campaign {row.id!r:.120}"
    with suppress(TypeError, ValueError):  # no texts, or not those of a campaign
        if row.chain == genesis_of_text(row.id, row.created, row.description, row.machine):
            return StoredCampaign(row.id, row.created, parsed(row.description), row.machine, row.chain)
    campaign = StoredCampaign(
        stored_text(row.id, where),
        stored_text(row.created, where),
        stored_object(row.description, f"{where}, description"),
        stored_text(row.machine, f"{where}, machine"),
        row.chain,
    )
    if row.chain is not None and (
        row.chain != genesis(*campaign[:4]) or row.description != canonical(campaign.description)
    ):
        raise _damaged(where, "not as it was written")
    return campaign


class CampaignRows:
    """Readings and events of a campaign as they are read, each compared with its chain value.

    `chains` has the chain values by position, from that of the campaign itself at 0: None where it is not chained.
    """

    def __init__(self, where: str, campaign: str, chains: Mapping[int, str | None]) -> None:
        self._where, self._campaign, self._chains = f"{where}: campaign '{campaign}'", campaign, chains

    def reading(self, row: Any) -> StoredReading:
        """A row of `readings`, as it was written."""
        where = f"{self._where}, reading {row.uid!r:.80} (row {row.position!r:.20})"
        uid, sequence = stored_text(row.uid, where), stored_number(row.sequence, where)
        reading = StoredReading(uid, sequence, stored_object(row.data, where))
        after, position = self._before(row, where)
        if after is not None:
            self._compare(row, where, reading_link(after, self._campaign, position, *reading), reading.data)
        return reading

    def event(self, row: Any) -> StoredEvent:
        """A row of `events`, as it was written."""
        where = f"{self._where}, event {row.kind!r:.80} (row {row.position!r:.20})"
        created, kind = stored_text(row.created, where), stored_text(row.kind, where)
        event = StoredEvent(created, kind, EventData(stored_object(row.data, where), where))
        after, position = self._before(row, where)
        if after is not None:
            self._compare(row, where, event_link(after, self._campaign, position, *event), event.data)
        return event

    def _before(self, row: Any, where: str) -> tuple[str | None, int]:
        """The chain value before a row, None if it is not chained; and its position."""
        position = stored_number(row.position, where)
        if self._chains.get(0) is None:
            if row.chain is not None:
                raise _damaged(where, "chained in a campaign that is not")
            return None, position
        after = self._chains.get(position - 1)
        if not isinstance(after, str):
            raise _damaged(where, "the row before it is missing")
        return after, position

    def _compare(self, row: Any, where: str, chain: str, data: object) -> None:
        if row.chain != chain or row.data != canonical(data):
            raise _damaged(where, "not as it was written")


class EventData(dict[str, Any]):
    """What was written with an event: a key that is asked for and is not there is damage, and names the row."""

    def __init__(self, data: Mapping[str, Any], where: str) -> None:
        super().__init__(data)
        self._where = where

    def __missing__(self, key: str) -> NoReturn:
        raise _damaged(self._where, f"no '{key}'")


def read_table_change(row: Any, where: str) -> StoredTableChange:
    """A row of `table_changes`."""
    where = f"{where}: change of tables {row.id!r:.20}"
    names = [stored_text(name, where) for name in (row.created, row.rig, row.machine, row.change, row.kind)]
    created, rig, machine, change, kind = names
    campaign = None if row.campaign is None else stored_text(row.campaign, where)
    return StoredTableChange(row.id, created, rig, machine, campaign, change, kind, stored_object(row.data, where))


def read_removed(row: Any, where: str) -> RemovedCampaign:
    """A row of `removed_campaigns`."""
    where = f"{where}: removed campaign {row.campaign!r:.120}"
    for value in (row.campaign, row.created, row.removed, row.who, row.why, row.head or "", row.archive or ""):
        stored_text(value, where)
    for value in (row.readings, row.rows):
        stored_number(value, where)
    return RemovedCampaign(*row)


def stored_text(value: object, where: str) -> str:
    """A text of the store; StoreError if it is none, or not the UTF-8 that was written."""
    if not isinstance(value, str):
        raise _damaged(where, "no text")
    try:
        value.encode()
    except UnicodeEncodeError as error:
        raise _damaged(where, "not UTF-8") from error
    return value


def stored_number(value: object, where: str) -> int:
    """A whole number of the store; StoreError if it is none."""
    if not isinstance(value, int):
        raise _damaged(where, "no whole number")
    return value


def stored_object(value: object, where: str) -> dict[str, Any]:
    """A JSON object of the store; StoreError if it is none, or has numbers or texts that are never written."""
    text = stored_text(value, where)
    try:
        data = _DECODER.decode(text)
        canonical(data)
        if _SURROGATE.search(text):
            json.dumps(data, ensure_ascii=False).encode()
    except (ValueError, RecursionError) as error:
        raise _damaged(where, "no JSON") from error
    if not isinstance(data, dict):
        raise _damaged(where, "no JSON object")
    return data


def _refuse(constant: str) -> NoReturn:
    raise ValueError(constant)


_DECODER = json.JSONDecoder(parse_constant=_refuse)


def parsed(text: str) -> dict[str, Any]:
    """A text that is known to be as it was written, by its chain value. ValueError if it is no JSON object."""
    data = _DECODER.decode(text)
    if not isinstance(data, dict):
        raise ValueError("no JSON object")
    return data


def _damaged(where: str, what: str) -> StoreError:
    return StoreError(f"{where}: damaged ({what}); restore the store from a backup")
