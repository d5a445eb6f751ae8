"""Where the parts of the nominal machine are, to be shown: tool, struts, carriages and reflectors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix
from calibration.machine.carriers import Carrier
from calibration.machine.description import FIXED, Machine
from calibration.machine.equilibrium import workspace_middle
from calibration.machine.inverse import nominal_drives

STEPS = 8
CLOSE_M = 1e-5  # for a picture


@dataclass(frozen=True)
class Parts:
    """Places in the machine frame, m: struts (s, 2, 3) from base to platform, carriages (d, 3), reflectors (r, 3)."""

    struts: Array
    carriages: Array
    reflectors: Array
    tool: Array


def platform_pose(machine: Machine, drives: Array, near: Array | None = None) -> Array | None:
    """Platform pose (6,) in which the nominal machine has its drives (d,) at these coordinates; None if none is found.

    Gauss-Newton over the commanded coordinates from the pose `near`, the middle of the workspace without one.
    """
    pose = (workspace_middle(machine) if near is None else near).astype(float).copy()
    free = machine.commanded
    for _ in range(STEPS):
        trial = np.repeat(pose[None], 1 + len(free), axis=0)
        step = 1e-6
        trial[1 + np.arange(len(free)), free] += step
        at = nominal_drives(machine, trial)
        if not np.all(np.isfinite(at)):
            return None
        away = drives - at[0]
        if float(np.max(np.abs(away))) < CLOSE_M:
            return pose
        slope = ((at[1:] - at[0]) / step).T
        pose[free] += np.linalg.lstsq(slope, away, rcond=None)[0]
    return None


def places(machine: Machine, drives: Array, pose: Array) -> Parts:
    """Places of the nominal machine's parts with its drives at (d,) and its platform at a pose (6,)."""
    geometry, one = machine.nominal, np.ones(1)
    count = len(machine.drive_names)
    carriers = {
        drive: Carrier.from_geometry(machine, geometry, drive, drives[[drive]] if drive != FIXED else one, one, one)
        for drive in (*range(count), FIXED)
    }
    turn = rotation_matrix(pose[None, 3:])[0]
    lower = geometry.platform_joint_m[: len(machine.strut_names)] @ turn.T + pose[:3]
    upper = np.array(
        [carriers[int(d)].position(p)[:, 0] for d, p in zip(machine.strut_drive, geometry.base_joint_m, strict=True)]
    )
    carriages = np.array([upper[machine.strut_drive == drive].mean(axis=0) for drive in range(count)])
    reflectors = [
        smr.position_m
        if smr.on == "floor"
        else carriers[smr.drive].position(smr.position_m)[:, 0]
        if smr.on == "slider"
        else turn @ smr.position_m + pose[:3]
        for smr in machine.smrs
    ]
    tool = turn @ machine.tool_point_m + pose[:3]
    return Parts(np.stack([upper, lower], axis=1), carriages, np.array(reflectors), tool)
