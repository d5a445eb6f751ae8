"""A store with thousands of campaigns as they are after years: headers, events and lives of full size, few readings.

Events are those of one calibration from its settings to its verdict, the identification a real one. Rows are inserted
in bulk, with the chain values that the store itself would give them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from calibration.identification.calibration import identified_summary, identify_recording
from calibration.recording.recording import Recording
from pkm_rig.store.chain import canonical, event_link, genesis, reading_link
from pkm_rig.store.life import machine_key
from pkm_rig.store.schema import calibrations, campaigns, events, heads, machines, readings
from pkm_rig.store.store import Store
from tests.pkm_rig.plant_recording import record

RIGS, READINGS = 40, 20
AT_ONCE = 250  # campaigns in one transaction
FIRST = datetime(2016, 1, 1, tzinfo=UTC)
SETTINGS_BYTES, DIAGNOSED_BYTES, VERDICT_BYTES = 3700, 3100, 1400  # of a calibration of the demo
ENDS = ("accepted",) * 7 + ("refused", "interrupted", "measured")  # what becomes of ten campaigns
PLAN = (
    ("settings", {"filler": "x" * SETTINGS_BYTES}), ("session_begun", {"session": 1, "t_rig_s": 0.0}),
    ("started", {"plan": "calibration"}), ("payload_asked", {"payload": 2}), ("payload_on", {"payload": 2}),
    ("payload_asked", {"payload": 0}), ("payload_on", {"payload": 0}), ("finished", {"plan": "calibration"}),
    ("identified", None), ("diagnosed", {"verdict": "none", "filler": "x" * DIAGNOSED_BYTES}), ("verifying", {}),
    *((kind, {"plan": plan}) for plan in ("repeatability", "verification before") for kind in ("started", "finished")),
    ("activated", {"tables": {}, "temperatures_c": {}}),
    *(((kind, {"plan": plan})) for plan in ("verification after", "nests") for kind in ("started", "finished")),
    ("activated", {"tables": {}, "temperatures_c": {}}),
    *(((kind, {"plan": "verification after"})) for kind in ("started", "finished")),
)  # fmt: skip
MEASURED = 8  # events of it before the identification


def fill(path: Path, count: int) -> None:
    """Put so many campaigns into a new store."""
    recording = record(1, calibration_poses=8)
    identified = identified_summary(identify_recording(recording, baselines=False))
    with closing(Store(path)) as store:
        for first in range(0, count, AT_ONCE):
            rows: dict[Any, list[dict[str, Any]]] = {
                table: [] for table in (campaigns, heads, readings, events, machines, calibrations)
            }
            for number in range(first, min(first + AT_ONCE, count)):
                _campaign(rows, number, recording, identified)
            with store.writing() as connection:
                for table, some in rows.items():
                    if some:
                        connection.execute(table.insert(), some)


def _campaign(rows: dict[Any, list[dict[str, Any]]], number: int, recording: Recording, found: dict[str, Any]) -> None:
    name, rig = f"campaign-{number:05d}", f"rig-{number % RIGS:02d}"
    begun = FIRST + timedelta(hours=8 * number)
    created = begun.isoformat(timespec="milliseconds")
    file = recording.file.model_copy(update={"campaign": name, "rig": rig, "created": created})
    description, machine = file.model_dump(mode="json"), recording.machine.text
    chain, position, end = genesis(name, created, description, machine), 0, ENDS[number // RIGS % len(ENDS)]
    rows[campaigns].append(
        {"id": name, "created": created, "description": canonical(description), "machine": machine, "chain": chain}
    )
    for kind, data in _happened(end, found):
        if kind == "finished" and position < READINGS:  # the readings come while the first plan runs
            for sequence in range(READINGS):
                position += 1
                row, uid = recording.row(sequence), f"{name}-{sequence}"
                chain = reading_link(chain, name, position, uid, sequence, row)
                rows[readings].append(
                    {"campaign": name, "position": position, "uid": uid, "sequence": sequence}
                    | {"data": canonical(row), "chain": chain}
                )
        position += 1
        at = (begun + timedelta(minutes=3 * position)).isoformat(timespec="milliseconds")
        chain = event_link(chain, name, position, at, kind, data)
        rows[events].append(
            {
                "campaign": name,
                "position": position,
                "created": at,
                "kind": kind,
                "data": canonical(data),
                "chain": chain,
            }
        )
    rows[heads].append({"campaign": name, "position": position, "chain": chain})
    if end in ("accepted", "refused"):
        _life(rows, name, rig, begun, end, recording, found)


def _happened(end: str, found: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
    for number, (kind, data) in enumerate(PLAN):
        if end in ("interrupted", "measured") and number == MEASURED:
            break
        yield kind, found if data is None else data
    if end in ("accepted", "refused"):
        yield end, {"decision": end, "filler": "x" * VERDICT_BYTES}
    if end != "interrupted":
        why = "refused" if end == "refused" else "finished"
        yield "session_ended", {"session": 1, "t_rig_s": 7200.0, "why": why}


def _life(
    rows: dict[Any, list[dict[str, Any]]], name: str, rig: str, begun: datetime, end: str, recording: Recording,
    found: dict[str, Any],
) -> None:  # fmt: skip
    """Two rows of a calibration, with its covariance, and once the machine."""
    names = list(found["parameters"])
    key = machine_key(recording.machine, tuple(names))
    created = (begun + timedelta(hours=2)).isoformat(timespec="milliseconds")
    own = {"created": created, "rig": rig, "machine": key}
    if not any(row["rig"] == rig for row in rows[machines]):  # one in each transaction: a machine file read again
        rows[machines].append(own | {"kind": "history begins", "data": canonical({"name": recording.machine.name})})
    values = [p["value"] for p in found["parameters"].values()]
    u = [p["u"] for p in found["parameters"].values()]
    identified = {
        "t_utc_s": begun.timestamp(), "extent": "full", "instrument": "990001", "parameters": names,
        "units": [p["unit"] for p in found["parameters"].values()], "values": values, "u": u,
        "unknowns": {"names": names, "values": values, "covariance": np.diag(np.square(u)).tolist()},
        "temperatures_c": {"struts": 21.0}, "simulated": True,
    }  # fmt: skip
    error = {"position_m": 7e-6, "u_m": 1e-6}
    verdict = {"t_utc_s": begun.timestamp(), "as_found": error, "as_left": error, "tables": {}, "effects": []}
    rows[calibrations] += [
        own | {"campaign": name, "kind": "identified", "data": canonical(identified)},
        own | {"campaign": name, "kind": end, "data": canonical(verdict)},
    ]
