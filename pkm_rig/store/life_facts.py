"""The rows of a machine's life as the facts that calibration intervals are decided on (`calibration.intervals`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime, time, timedelta
from typing import Any

import numpy as np

from calibration.base.errors import InputError
from calibration.intervals.facts import (
    EVENT_KINDS,
    CalibrationFact,
    CheckFact,
    ErrorFigure,
    EventFact,
    InstrumentFact,
    MachineFact,
    MachineHistory,
    Postponement,
    Tolerance,
)
from pkm_rig.errors import StoreError
from pkm_rig.store.former_life import calibration_rows
from pkm_rig.store.life import ACCEPTED, IDENTIFIED, LifeRow, life_rows
from pkm_rig.store.store import Store

TOLERANCE_CHANGED, POSTPONED, ROLLED_BACK = "tolerance changed", "postponed", "rolled back"


def utc_s(created: str) -> float:
    """Unix time of a row."""
    return datetime.fromisoformat(created).timestamp()


def machine_history(
    store: Store, rig: str, key: str, tolerance_m: float | None = None, now_utc_s: float = 0.0
) -> MachineHistory:
    """All facts of one machine of a rig, the calibrations whose tables were accepted and not rolled back only.

    tolerance_m: that of the rig file now, which the store may not have been told of yet. InputError where facts
    contradict one another (the clock was set back), StoreError for a row that is damaged.
    """
    calibrations = calibration_rows(store, rig)
    checks = life_rows(store, "checks", rig, key)
    events = life_rows(store, "machine_events", rig, key)
    rolled_back = {str(row.data["campaign"]): utc_s(row.created) for row in events if row.kind == ROLLED_BACK}
    facts = _calibrations([row for row in calibrations if row.machine == key], rolled_back)
    known = {fact.id for fact in facts}
    with RowDamage(f"store {store.name}: the life of rig {rig}"):
        return MachineHistory(
            machine=_machine(key, facts, events, None if tolerance_m is None else Tolerance(now_utc_s, tolerance_m)),
            instruments=_instruments(life_rows(store, "instruments", rig)),
            calibrations=tuple(facts),
            checks=tuple(check_fact(row) for row in checks if row.data["calibration"] in known),
            events=tuple(
                EventFact(utc_s(row.created), row.kind, str(row.data.get("part", "")), str(row.data.get("detail", "")))
                for row in events
                if row.kind in EVENT_KINDS and not _is_first_tolerance(row, events)
            ),
            postponements=tuple(
                Postponement(utc_s(row.created), row.data["until_utc_s"], row.data["who"], row.data["why"])
                for row in events
                if row.kind == POSTPONED
            ),
        )


class RowDamage:
    """A context: what a row that lacks a key, or has another type there, causes: one line."""

    def __init__(self, where: str) -> None:
        self._where = where

    def __enter__(self) -> None:
        return None

    def __exit__(self, _kind: object, error: BaseException | None, _traceback: object) -> None:
        if isinstance(error, (LookupError, TypeError, ValueError)) and not isinstance(error, InputError):
            raise StoreError(
                f"{self._where} is damaged ({type(error).__name__}: {error}); restore the store from a backup"
            ) from error


def _is_first_tolerance(row: LifeRow, events: Sequence[LifeRow]) -> bool:
    return row.kind == TOLERANCE_CHANGED and row is next(r for r in events if r.kind == TOLERANCE_CHANGED)


def _machine(
    key: str, calibrations: Sequence[CalibrationFact], events: Sequence[LifeRow], now: Tolerance | None
) -> MachineFact:
    tolerances = [Tolerance(utc_s(r.created), r.data["position_m"]) for r in events if r.kind == TOLERANCE_CHANGED]
    if now is not None and (not tolerances or tolerances[-1].position_m != now.position_m):
        tolerances = [t for t in tolerances if t.since_utc_s < now.since_utc_s] + [now]
    if not tolerances:
        raise InputError("rig file: recalibration.tolerance_m is missing; state the largest error that is allowed")
    name, _, identity = key.rpartition("/")
    names = calibrations[-1].parameter_names if calibrations else ()
    return MachineFact(name, identity, names, tuple(tolerances))


def _instruments(rows: Sequence[LifeRow]) -> tuple[InstrumentFact, ...]:
    """Stations that have measured, each with the certificate that was stated last."""
    certificates = [row for row in rows if row.kind == "certificate" and row.data["name"] == "station"]
    facts: dict[str, InstrumentFact] = {}
    for row in rows:
        if row.kind == "station" and row.serial:
            own = [c for c in certificates if c.serial in ("", row.serial)]
            if own:
                due_s = end_of_day_utc_s(own[-1].data["due"])
                facts[row.serial] = InstrumentFact(row.serial, own[-1].data["number"], due_s)
    return tuple(facts.values())


def end_of_day_utc_s(day: str) -> float:
    """Unix time of the end of a day (ISO 8601), in UTC: when a certificate ends."""
    return datetime.combine(date.fromisoformat(day) + timedelta(days=1), time(), tzinfo=UTC).timestamp()


def _calibrations(rows: Sequence[LifeRow], rolled_back: Mapping[str, float]) -> list[CalibrationFact]:
    """Those with a verdict that their tables stay, in the order of the verdicts; none that was rolled back since."""
    identified = {row.campaign: row.data for row in rows if row.kind == IDENTIFIED}
    out = []
    for row in rows:
        gone = rolled_back.get(str(row.campaign), 0.0) > utc_s(row.created)
        if row.kind == ACCEPTED and row.campaign in identified and not gone:
            with RowDamage(f"calibration {row.campaign}"):
                out.append(calibration_fact(str(row.campaign), identified[row.campaign], row.data))
    return out


def calibration_fact(campaign: str, found: Mapping[str, Any], verdict: Mapping[str, Any]) -> CalibrationFact:
    """A calibration from what was identified and from its verdict."""
    temperatures = list(found["temperatures_c"].values())
    tables = "/".join(f"{drive}:{t['generation']}:{t['crc']}" for drive, t in sorted(verdict["tables"].items()))
    return CalibrationFact(
        id=campaign,
        t_utc_s=float(verdict["t_utc_s"]),
        instrument=str(found["instrument"]),
        parameter_names=tuple(found["parameters"]),
        parameters=tuple(float(v) for v in found["values"]),
        covariance=covariance_of(found),
        temperature_c=float(np.mean(temperatures)) if temperatures else 20.0,
        operating_h=float(found.get("operating_h", 0.0)),
        as_found=_figure(verdict["as_found"]),
        as_left=_figure(verdict["as_left"]),
        extent=found.get("extent", "full"),
        tables=tables,
        software=str(found.get("software", "")),
    )


def covariance_of(found: Mapping[str, Any]) -> tuple[tuple[float, ...], ...]:
    """The covariance of the parameters; of a campaign that kept none, that of its uncertainties alone."""
    if "unknowns" in found:
        count = len(found["parameters"])
        return tuple(tuple(float(v) for v in row[:count]) for row in found["unknowns"]["covariance"][:count])
    return tuple(map(tuple, np.diag(np.square(found["u"])).tolist()))


def _figure(data: Mapping[str, float] | None) -> ErrorFigure | None:
    return None if data is None else ErrorFigure(float(data["position_m"]), float(data["u_m"]))


def check_fact(row: LifeRow) -> CheckFact:
    """A row of `checks`."""
    data = row.data
    return CheckFact(
        id=str(data["id"]),
        t_utc_s=float(data["t_utc_s"]),
        calibration=str(data["calibration"]),
        instrument=str(data["instrument"]),
        error=ErrorFigure(float(data["error"]["position_m"]), float(data["error"]["u_m"])),
        watched=tuple(data["watched"]),
        change=tuple(float(v) for v in data["change"]),
        change_u=tuple(float(v) for v in data["change_u"]),
        reference_u=tuple(float(v) for v in data["reference_u"]),
        error_per_change=tuple(float(v) for v in data["error_per_change"]),
        independent=float(data["independent"]),
        temperature_c=float(data["temperature_c"]),
        poses=int(data["poses"]),
        operating_h=float(data["operating_h"]),
        duration_s=float(data["duration_s"]),
        known_error_m=float(data.get("known_error_m", 0.0)),
        known_alignment=tuple(float(v) for v in data.get("known_alignment", ())),
    )


def check_data(fact: CheckFact) -> dict[str, Any]:
    """The same the other way round."""
    data = {name: value for name, value in vars(fact).items() if name != "error"}
    for name in ("watched", "change", "change_u", "reference_u", "error_per_change"):
        data[name] = list(data[name])
    return data | {"error": {"position_m": fact.error.position_m, "u_m": fact.error.u_m}}
