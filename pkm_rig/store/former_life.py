"""What campaigns say of a machine's calibrations whose rows are missing: those of stores that had no such rows yet."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

import sqlalchemy as sa

from calibration.base.errors import InputError
from calibration.machine.description import parse_machine
from calibration.model.parameters import ParameterSet
from pkm_rig.errors import StoreError
from pkm_rig.store.life import ACCEPTED, IDENTIFIED, NOT_DECIDED, REFUSED, LifeRow, life_rows, machine_key
from pkm_rig.store.schema import calibrations, campaigns, events
from pkm_rig.store.store import Store
from pkm_rig.store.stored_rows import StoredEvent, stored_object, stored_text


def calibration_rows(store: Store, rig: str) -> list[LifeRow]:
    """All calibrations of a rig, oldest first: rows of its life, and what older campaigns' events say."""
    rows = life_rows(store, "calibrations", rig)
    rows += [row for campaign in _campaigns_without_row(store, rig) for row in _from_events(store, rig, campaign)]
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


def _campaigns_without_row(store: Store, rig: str) -> list[str]:
    """Campaigns that were identified and have no row; one that is damaged is left to `audit`."""
    known = sa.select(calibrations.c.campaign)
    query = (
        sa.select(campaigns.c.id, campaigns.c.description)
        .where(campaigns.c.id.not_in(known))
        .where(campaigns.c.id.in_(sa.select(events.c.campaign).where(events.c.kind == IDENTIFIED)))
        .order_by(campaigns.c.created)
    )
    found = []
    with store.reading() as connection:
        for row in connection.execute(query):
            where = f"store {store.name}: campaign {row.id!r:.120}"
            if stored_object(row.description, where).get("rig") == rig:
                found.append(stored_text(row.id, where))
    return found


def _from_events(store: Store, rig: str, campaign: str) -> list[LifeRow]:
    try:
        stored = store.events(campaign)
        with store.reading() as connection:
            text = connection.execute(sa.select(campaigns.c.machine).where(campaigns.c.id == campaign)).scalar_one()
        machine = parse_machine(str(text), f"machine of campaign {campaign}")
        identified = [event for event in stored if event.kind == IDENTIFIED][-1]
        names = tuple(identified.data["parameters"])  # JSON has them in alphabetical order
        in_order = ParameterSet.of(machine).names
        names = in_order if sorted(in_order) == sorted(names) else names
        key = machine_key(machine, names)
        rows = [LifeRow(0, identified.created, rig, key, IDENTIFIED, _identified(identified, stored, names), campaign)]
        verdicts = [event for event in stored if event.kind in (ACCEPTED, REFUSED)]
        if verdicts:
            verdict = verdicts[-1]
            kind = verdict.data.get("decision") or verdict.kind
            kind = kind if kind in (ACCEPTED, REFUSED, NOT_DECIDED) else verdict.kind
            rows.append(LifeRow(0, verdict.created, rig, key, kind, _verdict(verdict, stored), campaign))
    except (StoreError, InputError):
        return []
    return rows


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
