"""What a machine's life is told by each command that connects: which devices answer, calibrations and verdicts."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np
import sqlalchemy as sa

from calibration.identification.calibration import Calibration
from calibration.identification.fit import Fit
from calibration.model.parameters import ParameterSet
from calibration.reduction.figures import Figures
from calibration.reduction.reduction import CALIBRATION
from pkm_rig.results.callbacks import Notify
from pkm_rig.results.outcome import CampaignOutcome
from pkm_rig.rig.rig import Rig
from pkm_rig.store.life import (
    IDENTIFIED,
    LifeRow,
    LifeTable,
    add_life_row,
    add_to_life,
    life_rows,
    machine_key,
)
from pkm_rig.store.store import Store
from pkm_rig.version import __version__

STATION, DRIVE, CERTIFICATE = "station", "drive", "certificate"
DRIVE_REPLACED, STATION_REPLACED = "drive replaced", "station replaced"
REFERENCE_LOST, TOLERANCE_CHANGED = "reference lost", "tolerance changed"
HISTORY_BEGINS = "history begins"
MOUNTING = "mounting."


def key_of(rig: Rig) -> str:
    """What the history of a rig's machine goes by."""
    return machine_key(rig.machine, ParameterSet.of(rig.machine).names)


def utc_text(t_utc_s: float) -> str:
    """Unix time as the store writes it."""
    return datetime.fromtimestamp(t_utc_s, UTC).isoformat(timespec="milliseconds")


def note_devices(rig: Rig, store: Store, notify: Notify, now_s: Callable[[], float] = time.time) -> list[str]:
    """Record machine, station, drives, certificates and tolerance where they differ from what is known; the changes.

    A drive is the one that it was while vendor, product and serial number (0x1018) are. Each change is said once. A new
    machine file, or other names of parameters, begin the machine's history anew.
    """
    return _Devices(rig, store, notify, utc_text(now_s())).note()


class _Devices:
    def __init__(self, rig: Rig, store: Store, notify: Notify, created: str) -> None:
        self._rig, self._store, self._notify, self._created = rig, store, notify, created
        self._key = key_of(rig)
        self._rows: list[tuple[LifeTable, str, dict[str, Any], dict[str, str | None]]] = []
        self._changes: list[str] = []

    def note(self) -> list[str]:
        former = life_rows(self._store, "machines", self._rig.file.rig)
        known = self._former_instruments()
        self._machine(former)
        for drive in self._rig.drives.drives:
            if drive.identity is not None:
                now = {"name": drive.name, "vendor": drive.identity.vendor, "product": drive.identity.product}
                now |= {"revision": drive.identity.revision}
                same = ("vendor", "product")
                self._instrument(known, DRIVE, now, str(drive.identity.serial), same, DRIVE_REPLACED)
        station = self._rig.station.identity
        if station is not None:
            self._instrument(
                known, STATION, {"name": STATION, "make": station.name}, str(station.serial), ("make",),
                STATION_REPLACED,
            )  # fmt: skip
        for entry in self._rig.file.certificates:
            data = {"name": entry.instrument, "number": entry.number, "due": entry.due.isoformat()}
            self._instrument(known, CERTIFICATE, data, entry.serial or "", ("number", "due"), None)
        self._tolerance()
        if self._rows:
            with self._store.writing() as connection:
                for table, kind, data, own in self._rows:
                    self._write(connection, table, kind, data, own)
        for line in self._changes:
            self._notify(line)
        return self._changes

    def _write(
        self, connection: sa.Connection, table: LifeTable, kind: str, data: Mapping[str, Any], own: Mapping[str, Any]
    ) -> None:
        rig, created = self._rig.file.rig, self._created
        add_life_row(connection, table, rig=rig, machine=self._key, kind=kind, data=data, created=created, **own)

    def _former_instruments(self) -> dict[tuple[str, str], LifeRow]:
        rows = life_rows(self._store, "instruments", self._rig.file.rig)
        return {(row.kind, str(row.data.get("name"))): row for row in rows}

    def _machine(self, former: Sequence[LifeRow]) -> None:
        if former and former[-1].machine == self._key:
            return
        machine = self._rig.machine
        data = {"name": machine.name, "parameters": list(ParameterSet.of(machine).names)}
        self._rows.append(("machines", HISTORY_BEGINS, data, {}))
        if former:
            self._changes.append(
                f"rig {self._rig.file.rig}: another machine file, or other parameters, than before "
                f"({former[-1].machine}, now {self._key}): its history begins anew"
            )

    def _instrument(
        self,
        known: Mapping[tuple[str, str], LifeRow],
        kind: str,
        data: dict[str, Any],
        serial: str,
        same: Sequence[str],
        event: str | None,
    ) -> None:
        before = known.get((kind, data["name"]))
        if before is not None and before.serial == serial and all(before.data.get(k) == data[k] for k in same):
            return
        self._rows.append(("instruments", kind, data, {"serial": serial}))
        if before is None or event is None:
            return
        detail = {"part": data["name"], "serial": serial, "former_serial": before.serial, **data}
        self._rows.append(("machine_events", event, detail, {"campaign": None}))
        what = "the station" if kind == STATION else f"drive {data['name']}"
        self._changes.append(f"{what} was replaced: serial number {serial}, before {before.serial}")

    def _tolerance(self) -> None:
        tolerance_m = self._rig.file.recalibration.tolerance_m
        if tolerance_m is None:
            return
        rows = life_rows(self._store, "machine_events", self._rig.file.rig, self._key)
        before = next((row.data["position_m"] for row in reversed(rows) if row.kind == TOLERANCE_CHANGED), None)
        if before == tolerance_m:
            return
        self._rows.append(("machine_events", TOLERANCE_CHANGED, {"position_m": tolerance_m}, {"campaign": None}))
        if before is not None:
            self._changes.append(f"the tolerance is {tolerance_m * 1e6:g} um, before {before * 1e6:g} um")


def note_event(rig: Rig, store: Store, kind: str, data: Mapping[str, Any]) -> None:
    """Record something that happened to the machine."""
    add_to_life(store, "machine_events", rig=rig.file.rig, machine=key_of(rig), kind=kind, data=data, campaign=None)


def operating_h(rig: Rig, store: Store, now_utc_s: float) -> float:
    """Hours of operation by the PLC, where the rig file names its reading; else hours since the first record."""
    name = rig.file.recalibration.operating_time
    if name is not None:
        return float(rig.supervisor.state().readings[name]) / 3600.0
    first = life_rows(store, "machines", rig.file.rig)
    if not first:
        return 0.0
    return max(0.0, now_utc_s - datetime.fromisoformat(first[0].created).timestamp()) / 3600.0


def mean_temperature_c(temperatures_c: Mapping[str, float]) -> float:
    """Mean of the temperatures of the machine's parts."""
    return float(np.mean(list(temperatures_c.values())))


def record_identified(
    rig: Rig, store: Store, campaign: str, calibration: Calibration, *, now_s: float | None = None
) -> None:
    """Keep what a campaign has identified: parameters, covariance, conditions and software."""
    rows = calibration.reduction.info.phase == CALIBRATION
    temperatures = {
        name: float(np.mean(values[rows]))
        for name, values in calibration.reduction.observations.visits.temperatures_c.items()
    }
    data = identified_data(rig, store, calibration.fit, temperatures, now_s=now_s)
    add_identified(rig, store, campaign, data | {"report": _report_in_machine(calibration)})


def add_identified(rig: Rig, store: Store, campaign: str, data: Mapping[str, Any]) -> None:
    """Add a calibration's row."""
    own = {"rig": rig.file.rig, "machine": key_of(rig), "kind": IDENTIFIED, "campaign": campaign}
    add_to_life(store, "calibrations", data=data, **own)


def identified_data(
    rig: Rig,
    store: Store,
    fit: Fit,
    temperatures_c: Mapping[str, float],
    *,
    extent: str = "full",
    now_s: float | None = None,
) -> dict[str, Any]:
    """What the life keeps of a fit, at temperatures of the parts."""
    now = time.time() if now_s is None else now_s
    station = rig.station.identity
    return {
        "t_utc_s": now,
        "extent": extent,
        "instrument": "" if station is None else str(station.serial),
        "parameters": list(fit.model.parameters.names),
        "units": [p.unit for p in fit.model.parameters.parameters],
        "values": fit.theta.tolist(),
        "unknowns": _lasting_unknowns(fit),
        "chi2_per_dof": fit.chi2_per_dof,
        "temperatures_c": dict(temperatures_c),
        "operating_h": operating_h(rig, store, now),
        "software": f"pkm-rig {__version__}",
        "simulated": bool(rig.simulated_devices),
    }


def _lasting_unknowns(fit: Fit) -> dict[str, Any]:
    """What a later set-up of the station finds again: the model's unknowns and the reflectors' mountings, together."""
    lasting = [i for i, name in enumerate(fit.layout.names) if i < len(fit.model) or name.startswith(MOUNTING)]
    return {
        "names": [fit.layout.names[i] for i in lasting],
        "values": fit.unknowns[lasting].tolist(),
        "covariance": fit.covariance[np.ix_(lasting, lasting)].tolist(),
    }


def _report_in_machine(calibration: Calibration) -> dict[str, Any]:
    """The frame of before and after in the machine's, and its reflectors: wherever a station stands later."""
    frame, report = calibration.fit.frame, calibration.report
    return {
        "smrs": [report.machine.smrs[i].name for i in report.smrs],
        "mounting_m": report.mounting_m.tolist(),
        "rotation": (frame.rotation.T @ report.frame.rotation).tolist(),
        "translation_m": (frame.rotation.T @ (report.frame.translation_m - frame.translation_m)).tolist(),
    }


def verdict_data(outcome: CampaignOutcome, *, had_tables: bool, change: str) -> dict[str, Any]:
    """What the life keeps of a verdict: the error as found and as left, the tables, effects that were found.

    A verification measures `before` without tables: that is how the machine was found only where none were in use.
    """
    diagnosis = outcome.diagnosis.diagnosis
    without = pooled([v.before for v in outcome.verified])
    return {
        "t_utc_s": time.time(),
        "as_found": None if had_tables else without,
        "without_tables": without,
        "as_left": pooled([v.after for v in outcome.verified]),
        "tables": outcome.written[-1].drives,
        "table_change": change,
        "beyond": list(outcome.beyond),
        "table_temperatures_c": dict(outcome.written[-1].table.conditions.temperatures_c),
        "effects": [] if diagnosis is None else [effect.effect for effect in diagnosis.effects],
        "diagnosis": outcome.diagnosis.failure if diagnosis is None else diagnosis.verdict,
    }


def pooled(several: Sequence[Figures]) -> dict[str, float]:
    """RMS of several sets of poses together, with the standard uncertainty that follows from theirs (GUM 5.1.2)."""
    n = np.array([f.n for f in several], dtype=float)
    rms, u = np.array([f.position_rms_m for f in several]), np.array([f.u_position_rms_m for f in several])
    share = n / n.sum()
    together = float(np.sqrt(share @ rms**2))
    u_square = float(np.sqrt(np.sum((share * 2.0 * rms * u) ** 2)))
    return {"position_m": together, "u_m": u_square / (2.0 * together) if together > 0.0 else float(np.max(u))}
