"""What campaigns say of a machine's calibrations whose rows are missing: those of stores that had no such rows yet."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import datetime
from functools import lru_cache
from typing import Any

import sqlalchemy as sa

from calibration.base.errors import InputError
from calibration.machine.description import Machine, parse_machine
from calibration.model.parameters import ParameterSet
from pkm_rig.errors import StoreError
from pkm_rig.store.life import ACCEPTED, IDENTIFIED, NOT_DECIDED, REFUSED, LifeRow, life_rows, machine_key
from pkm_rig.store.schema import calibrations, campaigns, events
from pkm_rig.store.store import Store
from pkm_rig.store.stored_rows import StoredEvent, stored_object, stored_text
from pkm_rig.store.summaries import checked_events, event_rows


def calibration_rows(store: Store, rig: str | None) -> list[LifeRow]:
    """All calibrations of a rig, or of all with None, oldest first: rows of its life, and what events say."""
    rows = life_rows(store, "calibrations", rig)
    rows += _of_campaigns_without_row(store, rig)
    return sorted(rows, key=lambda row: (row.created, row.id))


def rigs_with_campaigns(store: Store) -> list[str]:
    """Names of the rigs that any campaign was measured on, in alphabetical order."""
    found = set()
    with store.reading() as connection:
        for row in connection.execute(sa.select(campaigns.c.id, campaigns.c.description)):
            rig = stored_object(row.description, f"store {store.name}: campaign {row.id!r:.120}").get("rig")
            if isinstance(rig, str):
                found.add(rig)
    return sorted(found)


def _of_campaigns_without_row(store: Store, rig: str | None) -> list[LifeRow]:
    """What the events of campaigns say that were identified and have no row; a damaged one is left to `audit`."""
    where = f"store {store.name}"
    without = campaigns.c.id.not_in(sa.select(calibrations.c.campaign)) & campaigns.c.id.in_(
        sa.select(events.c.campaign).where(events.c.kind == IDENTIFIED)
    )
    found: list[LifeRow] = []
    with store.reading() as connection:
        query = sa.select(campaigns.c.id, campaigns.c.description, campaigns.c.machine).where(without)
        wanted = {}
        for row in connection.execute(query):
            here = f"{where}: campaign {row.id!r:.120}"
            own = stored_object(row.description, here).get("rig")
            if isinstance(own, str) and rig in (None, own):
                wanted[stored_text(row.id, here)] = (stored_text(own, here), str(row.machine))
        if not wanted:
            return []
        in_all = events.c.campaign.in_(sa.select(campaigns.c.id).where(without))
        for campaign, rows in event_rows(connection, in_all):
            if campaign in wanted:
                found += _from_events(where, *wanted[campaign], campaign, rows)
    return found


def _from_events(where: str, rig: str, text: str, campaign: str, rows: Iterable[Any]) -> list[LifeRow]:
    try:
        stored = checked_events(where, campaign, rows)
        machine = _machine(text)
        identified = [event for event in stored if event.kind == IDENTIFIED][-1]
        names = tuple(identified.data["parameters"])  # JSON has them in alphabetical order
        in_order = ParameterSet.of(machine).names
        names = in_order if sorted(in_order) == sorted(names) else names
        key = machine_key(machine, names)
        found = [LifeRow(0, identified.created, rig, key, IDENTIFIED, _identified(identified, stored, names), campaign)]
        verdicts = [event for event in stored if event.kind in (ACCEPTED, REFUSED)]
        if verdicts:
            verdict = verdicts[-1]
            kind = verdict.data.get("decision") or verdict.kind
            kind = kind if kind in (ACCEPTED, REFUSED, NOT_DECIDED) else verdict.kind
            found.append(LifeRow(0, verdict.created, rig, key, kind, _verdict(verdict, stored), campaign))
    except (StoreError, InputError):
        return []
    return found


@lru_cache(maxsize=64)
def _machine(text: str) -> Machine:
    """Of a machine file's text, which is the same for most campaigns of a rig."""
    return parse_machine(text, "machine of a campaign")


def _identified(event: StoredEvent, stored: Sequence[StoredEvent], names: Sequence[str]) -> dict[str, Any]:
    parameters = [event.data["parameters"][name] for name in names]
    settings = next((e.data for e in stored if e.kind == "settings"), {})
    activated = [e.data["temperatures_c"] for e in stored if e.kind == "activated"]
    return {
        "t_utc_s": _utc_s(event.created),
        "extent": "full",
        "instrument": str((settings.get("station") or {}).get("serial", "")),
        "parameters": list(names),
        "units": [p["unit"] for p in parameters],
        "values": [p["value"] for p in parameters],
        "u": [p["u"] for p in parameters],
        "chi2_per_dof": event.data.get("chi2_per_dof"),
        "temperatures_c": activated[0] if activated else {},
    }


def _verdict(event: StoredEvent, stored: Sequence[StoredEvent]) -> dict[str, Any]:
    verified = event.data.get("verified") or []
    diagnosed: dict[str, Any] = next((e.data for e in reversed(stored) if e.kind == "diagnosed"), {})
    activated = [e.data for e in stored if e.kind == "activated"]
    return {
        "t_utc_s": _utc_s(event.created),
        "as_found": None,  # whether tables were in use before was not kept
        "without_tables": _pooled([v["before"] for v in verified]),
        "as_left": _pooled([v["after"] for v in verified]),
        "tables": activated[-1]["tables"] if activated else {},
        "effects": [effect["effect"] for effect in diagnosed.get("effects") or []],
        "diagnosis": diagnosed.get("verdict") or diagnosed.get("failure") or "",
    }


def _pooled(figures: Sequence[dict[str, Any]]) -> dict[str, float] | None:
    """RMS over all poses, with the largest of the uncertainties; None without any."""
    if not figures:
        return None
    poses = sum(f["n"] for f in figures)
    square = sum(f["n"] * f["position_rms_m"] ** 2 for f in figures) / poses
    return {"position_m": square**0.5, "u_m": max(f["u_position_rms_m"] for f in figures)}


def _utc_s(created: str) -> float:
    return datetime.fromisoformat(created).timestamp()
