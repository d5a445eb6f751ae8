"""Homing the drives of a rig that have lost their reference, on request only and interlocked like any motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from calibration.base.errors import InputError
from drivers.drives.homing import HomingParameters
from pkm_rig.jobs.life_record import REFERENCE_LOST, note_event
from pkm_rig.rig.drive_tables import telling_tables
from pkm_rig.rig.led_rows import require_drives_agree
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.table_change import switch_off
from pkm_rig.store.store import Store


def home_drives(rig: Rig, *, again: bool = False, store: Store | None = None) -> dict[str, Any]:
    """Home the drives that are not referenced, or all with `again`; where each is then (docs/reference/json.md).

    One after the other, the others under their brakes; compensation is switched off and stays off (which a
    `store` records, so that `pkm-rig tables rollback` can bring it back). InputError, before anything moves, where the
    rig file does not say how, or where drives that must agree would not; raises what a motion raises, with a note
    which tables are active.
    """
    homings = [
        _homing(rig, number) if again or not drive.reference.is_valid else None
        for number, drive in enumerate(rig.drives.drives)
    ]
    lost = [drive.name for drive in rig.drives.drives if not drive.reference.is_valid]
    if any(homings):
        _require_agreement(rig, homings)
        with telling_tables(rig, store):
            switch_off(rig, store, "home")
            with rig.supervisor.during_motion():
                rig.drives.home(homings)
        if store is not None:
            for name, homing in zip((drive.name for drive in rig.drives.drives), homings, strict=True):
                if homing is not None:
                    why = "the drive had lost it" if name in lost else "homed again on request"
                    note_event(rig, store, REFERENCE_LOST, {"part": name, "detail": why})
    return {
        "drives": {
            drive.name: {
                "homed": homing is not None,
                "position_rad" if drive.name in rig.machine.rotary_drives else "position_m": float(position),
            }
            for drive, homing, position in zip(rig.drives.drives, homings, rig.positions_m(), strict=True)
        },
        "compensation_switched_off": any(homings),
        "simulated": bool(rig.simulated_devices),
    }


def _homing(rig: Rig, number: int) -> HomingParameters:
    entry = rig.file.drives[number]
    if entry.homing is None:
        raise InputError(
            f"rig file: drives: {entry.name} must be homed but has no [drives.homing]; "
            "add it (docs/reference/drive-objects.md) or home the drive by its own means"
        )
    return entry.homing.parameters


def _require_agreement(rig: Rig, homings: list[HomingParameters | None]) -> None:
    """Raise InputError where the drives that keep their reference say that the machine is not where it is homed.

    Only drives that must agree can say it: those that stay give the pose, and with it where the others are.
    """
    places = [
        position_m if homing is None else homing.position_m
        for homing, position_m in zip(homings, rig.positions_m(), strict=True)
    ]
    try:
        require_drives_agree(rig.machine, np.array(places))
    except InputError as error:
        raise InputError(f"homing: {error}; no drive was homed") from error
