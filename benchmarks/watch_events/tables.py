"""What the drives hold and use, told by the mock, against what the store says is in force."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pkm_rig.jobs.tables_in_force import parse_tables
from pkm_rig.rig.config import load_rig
from pkm_rig.rig.table_change import TRIAL as TRIED
from pkm_rig.store.life import life_rows
from pkm_rig.store.life_facts import machine_history
from pkm_rig.store.place import STORE_NAME
from pkm_rig.store.store import Store

OFF, KEPT = 0, 1  # object 0x2100:01
TOLERANCE_M = 60e-6


@dataclass(frozen=True)
class Held:
    """Of each drive: mode, generation, CRC and machine of its active table, and its serial number."""

    drives: dict[str, dict[str, Any]]

    @classmethod
    def of(cls, status: dict[str, Any]) -> Held:
        """From what the mock's `status` says."""
        keys = ("compensation", "generation", "crc", "machine", "serial")
        return cls({name: {key: drive[key] for key in keys} for name, drive in status["drives"].items()})

    @property
    def used(self) -> bool:
        """Whether every drive uses its table for good."""
        return all(drive["compensation"] == KEPT for drive in self.drives.values())

    @property
    def tables(self) -> dict[str, tuple[int, int]]:
        """Generation and CRC of each drive's active table."""
        return {name: (drive["generation"], drive["crc"]) for name, drive in self.drives.items()}

    def __str__(self) -> str:
        generations = "/".join(str(drive["generation"]) for drive in self.drives.values())
        words = {OFF: "off", KEPT: "on"}
        modes = dict.fromkeys(words.get(drive["compensation"], "trial") for drive in self.drives.values())
        return f"{generations} {'/'.join(modes)}"


def wrong_tables(held: Held, out: Path, rig: Path) -> list[str]:
    """Tables in use whose generation, CRC, machine or drive is not that of the calibration in force; one line each."""
    _, machine = load_rig(rig)
    store = Store(out / STORE_NAME)
    try:
        keys = [row.machine for row in life_rows(store, "calibrations", "mock-rig") if row.machine]
        force = machine_history(store, "mock-rig", keys[0], TOLERANCE_M).last_calibration
        steps = store.table_changes("mock-rig")
    finally:
        store.close()
    wanted = {} if force is None else parse_tables(force.tables)
    serials = _serials(steps, wanted)
    stated = hashlib.sha256(machine.name.encode()).digest()[:16].hex()
    out_lines = []
    if len({drive["compensation"] for drive in held.drives.values()}) > 1:
        out_lines.append(f"the drives are in different modes: {held}")
    for name, drive in held.drives.items():
        if drive["compensation"] == OFF:
            continue
        if drive["compensation"] != KEPT:
            out_lines.append(f"drive {name}: on trial after the command has ended")
        if (drive["generation"], drive["crc"]) != wanted.get(name):
            out_lines.append(
                f"drive {name}: uses {drive['generation']}/{drive['crc']:08x}, in force is {wanted.get(name)}"
            )
        if drive["machine"] != stated:
            out_lines.append(f"drive {name}: its table is of another machine")
        if drive["serial"] not in serials.get(name, ()):
            out_lines.append(f"drive {name}: its table was measured on another drive")
    return out_lines


def _serials(steps: list[Any], wanted: dict[str, tuple[int, int]]) -> dict[str, set[int]]:
    """Serial numbers of the drives on which the tables in force were tried."""
    former = {step.change: step.data["former"] for step in steps if "former" in step.data}
    found: dict[str, set[int]] = {}
    for step in steps:
        if step.kind == TRIED:
            for record in former.get(step.change, ()):
                if tuple(step.data["tables"][record["drive"]]) == wanted.get(record["drive"]):
                    found.setdefault(record["drive"], set()).add(record["serial"])
    return found
