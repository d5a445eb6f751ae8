"""Homing the drives of a rig that have lost their reference, on request only and interlocked like any motion."""

from __future__ import annotations

from typing import Any

from calibration.base.errors import InputError
from drivers.drives.homing import HomingParameters
from pkm_rig.jobs.life_record import REFERENCE_LOST, note_event
from pkm_rig.rig.drive_tables import telling_tables
from pkm_rig.rig.rig import Rig
from pkm_rig.rig.table_change import switch_off
from pkm_rig.store.store import Store


def home_drives(rig: Rig, *, again: bool = False, store: Store | None = None) -> dict[str, Any]:
    """Home the drives that are not referenced, or all with `again`; where each is then (docs/reference/json.md).

    One after the other, the others under their brakes; compensation is switched off and stays off (which a
    `store` records, so that `pkm-rig tables rollback` can bring it back). InputError, before anything moves, where the
    rig file does not say how; raises what a motion raises, with a note which tables are active.
    """
    homings = [
        _homing(rig, number) if again or not drive.reference.is_valid else None
        for number, drive in enumerate(rig.drives.drives)
    ]
    lost = [drive.name for drive in rig.drives.drives if not drive.reference.is_valid]
    if any(homings):
        with telling_tables(rig, store):
            switch_off(rig, store, "home")
            with rig.supervisor.during_motion():
                rig.drives.home(homings)
        if store is not None:
            for name, homing in zip((drive.name for drive in rig.drives.drives), homings, strict=True):
                if homing is not None:
                    why = "the drive had lost it" if name in lost else "homed again on request"
                    note_event(rig, store, REFERENCE_LOST, {"part": name, "detail": why})
    positions_m = rig.positions_m()
    return {
        "drives": {
            drive.name: {"homed": homing is not None, "position_m": float(position_m)}
            for drive, homing, position_m in zip(rig.drives.drives, homings, positions_m, strict=True)
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
    return HomingParameters(
        **entry.homing.model_dump(exclude={"position_m", "position_rad"}), position_m=entry.homing.position
    )
