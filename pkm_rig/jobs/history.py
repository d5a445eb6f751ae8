"""A machine's life as `pkm-rig history` shows it: checks, calibrations, parameters, effects, events, doubt."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from calibration.base.errors import InputError
from pkm_rig.store.former_life import calibration_rows, rigs_with_campaigns
from pkm_rig.store.life import ACCEPTED, IDENTIFIED, LifeRow, LifeTable, life_rows, rigs_with_a_life
from pkm_rig.store.life_facts import TOLERANCE_CHANGED, RowDamage, covariance_of, utc_s
from pkm_rig.store.store import Store

TABLES: tuple[LifeTable, ...] = ("machines", "instruments", "checks", "machine_events")
OUT_OF_TOLERANCE, FIT = "out of tolerance", "fit"


def rigs_of(store: Store) -> list[str]:
    """Names of all rigs that the store knows anything of, in alphabetical order."""
    return sorted({*rigs_with_a_life(store), *rigs_with_campaigns(store)})


def chosen_rig(store: Store, name: str | None) -> str:
    """The rig of that name, or the only one; InputError that lists them."""
    rigs = rigs_of(store)
    if name is None and len(rigs) == 1:
        return rigs[0]
    if name in rigs:
        return str(name)
    there = f"there are {', '.join(rigs)}" if rigs else "nothing was calibrated or checked in it"
    raise InputError(f"store {store.name}: " + (f"no rig '{name}'; {there}" if name else f"name a rig; {there}"))


def history(store: Store, rig: str) -> dict[str, Any]:
    """The life of a rig's machine as it is now (docs/reference/json.md); what it was before is counted only.

    StoreError for a row that is not as it was written.
    """
    (life,) = histories(store, [rig])
    return life


def histories(store: Store, rigs: Sequence[str]) -> list[dict[str, Any]]:
    """The lives of several rigs, which are asked for in as few queries as that of one; of those that have one.

    InputError if none has: nothing was calibrated or checked on them yet.
    """
    only = rigs[0] if len(rigs) == 1 else None
    rows = {table: _by_rig(life_rows(store, table, only)) for table in TABLES}
    calibrations = _by_rig(calibration_rows(store, only))
    lives = []
    with_life = [rig for rig in rigs if rows["machines"].get(rig) or calibrations.get(rig)]
    if rigs and not with_life:
        raise InputError(f"store {store.name}: nothing was calibrated or checked on rig {rigs[0]} yet; calibrate it")
    for rig in with_life:
        with RowDamage(f"store {store.name}: the life of rig {rig}"):
            own = {table: rows[table].get(rig, []) for table in TABLES}
            lives.append(_history(rig, own, calibrations.get(rig, [])))
    return lives


def _by_rig(rows: Sequence[LifeRow]) -> dict[str, list[LifeRow]]:
    found: dict[str, list[LifeRow]] = {}
    for row in rows:
        found.setdefault(row.rig, []).append(row)
    return found


def _history(rig: str, own: Mapping[LifeTable, Sequence[LifeRow]], rows: Sequence[LifeRow]) -> dict[str, Any]:
    machines = own["machines"]
    key = machines[-1].machine if machines else rows[-1].machine
    events = [row for row in own["machine_events"] if row.machine == key]
    checks = [_check(row) for row in own["checks"] if row.machine == key]
    calibrations = _calibrations([row for row in rows if row.machine == key])
    tolerances = [
        {"since": row.created, "position_m": row.data["position_m"]} for row in events if row.kind == TOLERANCE_CHANGED
    ]
    former = sorted({row.machine for row in (*machines, *rows)} - {key})
    return {
        "rig": rig,
        "machine": key,
        "simulated": any(c["simulated"] for c in calibrations) or any(c["simulated"] for c in checks),
        "former_machines": former,
        "tolerances": tolerances,
        "calibrations": calibrations,
        "checks": checks,
        "parameters": _parameters(calibrations, rows),
        "events": [_event(row, events) for row in events],
        "instruments": [
            {"created": row.created, "kind": row.kind, "serial": row.serial or None, **row.data}
            for row in own["instruments"]
        ],
        "in_doubt": periods_in_doubt(checks, calibrations, tolerances),
    }


def _check(row: LifeRow) -> dict[str, Any]:
    data = row.data
    keys = ("id", "calibration", "error", "temperature_c", "poses", "duration_s", "tolerance_m", "reasons", "simulated")
    return {"created": row.created, "verdict": row.kind, "campaign": row.campaign} | {k: data[k] for k in keys}


def _event(row: LifeRow, events: Sequence[LifeRow]) -> dict[str, Any]:
    first = row.kind == TOLERANCE_CHANGED and row is next(r for r in events if r.kind == TOLERANCE_CHANGED)
    return {"created": row.created, "kind": "tolerance stated" if first else row.kind, **row.data}


def _calibrations(rows: Sequence[LifeRow]) -> list[dict[str, Any]]:
    """One entry a campaign; of two identifications of one campaign, and of two verdicts, the later one."""
    identified = {row.campaign: row for row in rows if row.kind == IDENTIFIED}
    verdicts = {row.campaign: row for row in rows if row.kind != IDENTIFIED}
    out = []
    for campaign, row in identified.items():
        verdict = verdicts.get(campaign)
        data: Mapping[str, Any] = {} if verdict is None else verdict.data
        temperatures = list(row.data["temperatures_c"].values())
        out.append(
            {
                "campaign": campaign,
                "created": row.created if verdict is None else verdict.created,
                "extent": row.data["extent"],
                "verdict": "identified" if verdict is None else verdict.kind,
                "as_found": data.get("as_found"),
                "without_tables": data.get("without_tables"),
                "as_left": data.get("as_left"),
                "temperature_c": float(np.mean(temperatures)) if temperatures else None,
                "instrument": row.data["instrument"] or None,
                "effects": list(data.get("effects", ())),
                "tables": data.get("tables"),
                "software": row.data.get("software"),
                "simulated": bool(row.data.get("simulated", False)),
            }
        )
    return sorted(out, key=lambda entry: str(entry["created"]))


def _parameters(calibrations: Sequence[Mapping[str, Any]], rows: Sequence[LifeRow]) -> dict[str, Any]:
    """Each parameter's value and standard uncertainty at each calibration, the oldest first."""
    identified = {row.campaign: row for row in rows if row.kind == IDENTIFIED}
    out: dict[str, dict[str, Any]] = {}
    for entry in calibrations:
        row = identified[entry["campaign"]]
        u = np.sqrt(np.diag(np.array(covariance_of(row.data))))
        for name, unit, value, size in zip(
            row.data["parameters"], row.data["units"], row.data["values"], u.tolist(), strict=True
        ):
            points = out.setdefault(name, {"unit": unit, "points": []})["points"]
            points.append({"campaign": entry["campaign"], "created": row.created, "value": value, "u": size})
    return out


def periods_in_doubt(
    checks: Sequence[Mapping[str, Any]],
    calibrations: Sequence[Mapping[str, Any]],
    tolerances: Sequence[Mapping[str, Any]],
) -> list[dict[str, Any]]:
    """Periods in which work may be out of tolerance: from the last time the machine was known good to a bad finding.

    Known good: a check that is fit, tables that were left within tolerance. A bad finding: a check out of tolerance, or
    a calibration that found the error above the tolerance (ISO/IEC 17025, 7.10). How a machine was before it was known
    good for the first time is no question of doubt.
    """
    moments: list[tuple[float, str, bool, str, Any]] = []
    for check in checks:
        if check["verdict"] in (FIT, OUT_OF_TOLERANCE, "due"):
            good = check["verdict"] != OUT_OF_TOLERANCE
            moments.append((utc_s(check["created"]), check["created"], good, f"check {check['id']}", check["error"]))
    for entry in calibrations:
        moments += _moments_of(entry, tolerances)
    moments.sort(key=lambda moment: moment[0])
    periods: list[dict[str, Any]] = []
    last_good: str | None = None
    bad = False
    for _, created, good, what, error in moments:
        if not good and not bad and last_good is not None:
            periods.append({"since": last_good, "until": created, "found_by": what, "error": error})
        last_good, bad = (created, False) if good else (last_good, True)
    return periods


def _moments_of(
    entry: Mapping[str, Any], tolerances: Sequence[Mapping[str, Any]]
) -> list[tuple[float, str, bool, str, Any]]:
    """What a verified calibration says: how the machine was found, where that was measured, and how it was left."""
    created, found, left = str(entry["created"]), entry["as_found"], entry["as_left"]
    limit_m, what = tolerance_at(tolerances, created), f"calibration {entry['campaign']}"
    moments = []
    if found is not None and limit_m is not None:
        moments.append((utc_s(created) - 1.0, created, found["position_m"] <= limit_m, what, found))
    if left is not None and entry["verdict"] == ACCEPTED:
        good = limit_m is None or left["position_m"] <= limit_m
        moments.append((utc_s(created), created, good, what, left))
    return moments


def tolerance_at(tolerances: Sequence[Mapping[str, Any]], created: str) -> float | None:
    """The tolerance that held then; before the first one that one, None if there was never any."""
    valid = [t for t in tolerances if utc_s(t["since"]) <= utc_s(created)] or list(tolerances[:1])
    return float(valid[-1]["position_m"]) if valid else None


def life_picture(life: Mapping[str, Any], parameters: int) -> bytes:
    """The picture of a life as PNG, with the parameters that have changed most."""
    from pkm_rig.report.history_pictures import draw_history  # noqa: PLC0415 - drawing takes a second to import
    from pkm_rig.report.pictures import save_png  # noqa: PLC0415

    stream = io.BytesIO()
    figure = draw_history(life, largest_changes(life["parameters"], parameters))
    save_png(figure, stream, simulated=life["simulated"])
    return stream.getvalue()


def largest_changes(parameters: Mapping[str, Any], count: int) -> list[str]:
    """The parameters that have changed most between two calibrations, in their standard uncertainties."""

    def size(points: Sequence[Mapping[str, float]]) -> float:
        return max((abs(b["value"] - a["value"]) / np.hypot(a["u"], b["u"]) for a, b in _pairs(points)), default=0.0)

    ranked = sorted(parameters, key=lambda name: -size(parameters[name]["points"]))
    return ranked[:count]


def _pairs(points: Sequence[Mapping[str, float]]) -> list[tuple[Mapping[str, float], Mapping[str, float]]]:
    return [(a, b) for i, a in enumerate(points) for b in points[i + 1 :] if a["u"] > 0.0 or b["u"] > 0.0]
