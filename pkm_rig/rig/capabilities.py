"""What a rig can do, as its file tells: checked before any device is touched, so that no command fails late."""

from __future__ import annotations

from enum import Flag, auto
from itertools import product
from pathlib import Path

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.compensation.grid import GRID_MARGIN_M
from calibration.machine.description import COORDINATES, Machine
from calibration.machine.inverse import nominal_drives, platform_poses
from drivers.drives.bus_load import MOST_LOAD, sync_load
from pkm_rig.rig.config import RigFile, drive_profile
from pkm_rig.rig.led_motion import is_led, require_possible_motion
from pkm_rig.rig.schedule import require_measured_verification, require_reachable_poses

ROUND_OFF_M = 1e-9
EDGE_POINTS = 9  # along each coordinate of the workspace, ends included


class Need(Flag):
    """What a command needs of a rig."""

    NOTHING = 0
    MOTION = auto()  # to visit the whole workspace
    TABLES = auto()  # to store compensation tables in the drives
    HOMING = auto()  # to home every drive


def require_capabilities(file: RigFile, machine: Machine, rig_path: Path, needs: Need) -> None:
    """Raise InputError, in one line, if the rig cannot do what is needed."""
    tables = Need.TABLES in needs and uses_tables(file, machine)
    if tables:
        _require_tables(file, rig_path)
    if Need.HOMING in needs:
        _require_homing(file, rig_path)
    if Need.MOTION in needs:
        require_possible_motion(machine, file.campaign)
        _require_led_drives(file, machine, rig_path)
        if has_table_drives(machine):
            require_travel(machine, GRID_MARGIN_M if tables else file.campaign.approach_m)
        else:
            require_reachable_poses(machine, file.campaign, file.payloads, file.station.position_m)
        if Need.TABLES in needs:
            require_measured_verification(machine, file.campaign, file.station.position_m)


def _require_led_drives(file: RigFile, machine: Machine, rig_path: Path) -> None:
    """Led drives need cyclic synchronous position mode."""
    if not is_led(machine, file.campaign):
        return
    load = sync_load(len(file.drives), file.can.sync_period_s, file.can.bitrate)
    if load > MOST_LOAD:
        least_s = sync_load(len(file.drives), 1.0, file.can.bitrate) / MOST_LOAD
        raise InputError(
            f"{rig_path}: can.sync_period_s: {len(file.drives)} drives every {file.can.sync_period_s * 1e3:g} ms load "
            f"the bus to {load:.0%}, {MOST_LOAD:.0%} is permitted; at this bit rate give "
            f"{least_s * 1e3:.1f} ms or more"
        )
    for drive in file.drives:
        profile = drive_profile(drive, rig_path)
        if not profile.capabilities.cyclic_position:
            raise InputError(
                f"{rig_path}: drive {drive.name}: a '{profile.name}' has no cyclic synchronous position mode, in which "
                f"the drives of {machine.name} are led along paths"
            )


def uses_tables(file: RigFile, machine: Machine) -> bool:
    """Whether tables in the drives compensate, rather than the computer that leads them."""
    chosen = file.campaign.compensation
    return has_table_drives(machine) if chosen is None else chosen == "drive-tables"


def can_verify(file: RigFile, machine: Machine, rig_path: Path) -> bool:
    """Whether a correction can act: by this computer, or by tables that all drives store."""
    return not uses_tables(file, machine) or all(
        drive_profile(drive, rig_path).capabilities.table_bank for drive in file.drives
    )


def has_table_drives(machine: Machine) -> bool:
    """Whether a table of each drive over its own position and its one partner's can compensate the machine."""
    return machine.drive_kinds == ("slider", "slider")


def require_travel(machine: Machine, margin_m: float) -> None:
    """Raise InputError unless the drives reach the whole workspace, and `margin_m` beyond, within their travel.

    By the nominal machine, on the edges of the workspace; the message names the drive and pose that miss most.
    """
    commanded = _workspace_edges(machine)
    drives = nominal_drives(machine, platform_poses(machine, commanded))
    if not np.all(np.isfinite(drives)):
        row = int(np.flatnonzero(~np.isfinite(drives).all(axis=1))[0])
        raise InputError(
            f"machine {machine.name}: its struts do not reach the workspace's {_place(machine, commanded[row])}"
        )
    low, high = machine.travel.T
    missing_m = np.maximum(low + margin_m - drives, drives + margin_m - high)
    row, drive = divmod(int(np.argmax(missing_m)), missing_m.shape[1])
    if missing_m[row, drive] > ROUND_OFF_M:
        raise InputError(
            f"machine {machine.name}: drive {machine.drive_names[drive]} lacks {missing_m[row, drive] * 1e3:.1f} mm "
            f"of travel at the workspace's {_place(machine, commanded[row])}: it needs {drives[row, drive]:.4f} m and "
            f"{margin_m * 1e3:g} mm beyond, travel_m is {low[drive]:g} m to {high[drive]:g} m; make the workspace "
            "smaller or the travel longer"
        )


def _require_tables(file: RigFile, rig_path: Path) -> None:
    for drive in file.drives:
        profile = drive_profile(drive, rig_path)
        if not profile.capabilities.table_bank:
            raise InputError(
                f"{rig_path}: drive {drive.name}: a '{profile.name}' stores no compensation tables; "
                "`measure` and `identify` work without them"
            )


def _require_homing(file: RigFile, rig_path: Path) -> None:
    for drive in file.drives:
        if drive.homing is None:
            raise InputError(
                f"{rig_path}: drive {drive.name} must be homed but has no [drives.homing]; add it "
                "(docs/reference/drive-objects.md) or home the drive by its own means"
            )
        profile = drive_profile(drive, rig_path)
        if not profile.capabilities.homing:
            raise InputError(f"{rig_path}: drive {drive.name}: a '{profile.name}' cannot be homed from here")


def _workspace_edges(machine: Machine) -> Array:
    """Commanded coordinates (n, k) of all points of a grid that lie on the boundary of the workspace."""
    shares = np.array(list(product(np.linspace(0.0, 1.0, EDGE_POINTS), repeat=len(machine.commanded))))
    on_edge = ((shares == 0.0) | (shares == 1.0)).any(axis=1)
    low, high = machine.commanded_limits.T
    return np.asarray(low + (high - low) * shares[on_edge])


def _place(machine: Machine, commanded: Array) -> str:
    """A point of the boundary in words."""
    is_corner = bool(np.all(np.isin(commanded, machine.commanded_limits)))
    return ("corner " if is_corner else "edge ") + ", ".join(
        f"{COORDINATES[c]} = {value:g} {'rad' if c > 2 else 'm'}"
        for c, value in zip(machine.commanded, commanded, strict=True)
    )
