"""Poses that were measured: the box of their commanded coordinates, and what counts as within it."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.rotation import rotation_matrix
from calibration.machine.description import COORDINATES, Machine
from calibration.machine.inverse import nominal_poses
from calibration.machine.led_path import tool_coordinates

BEYOND_MEASURED = 0.02
HELD = 0.05  # of the workspace's side beyond the measured poses, where the correction of the nearest one is held


def measured_box(machine: Machine, target_m: Array) -> Array:
    """Limits (k, 2) of the commanded tool coordinates over measured platform poses (n, 6), within the workspace.

    They reach BEYOND_MEASURED of the workspace's side beyond the outermost pose: drawn poses seldom lie on its edge.
    """
    tool = target_m.copy()
    tool[:, :3] += rotation_matrix(target_m[:, 3:]) @ machine.tool_point_m
    values = tool[:, machine.commanded]
    low, high = machine.commanded_limits.T
    flat = np.flatnonzero(~(np.ptp(values, axis=0) > BEYOND_MEASURED * (high - low)))
    if flat.size:
        name = COORDINATES[machine.commanded[flat[0]]]
        raise InputError(f"compensation: all measured poses have the same {name}; measure where the machine works")
    margin = BEYOND_MEASURED * (high - low)
    return np.stack(
        [np.maximum(values.min(axis=0) - margin, low), np.minimum(values.max(axis=0) + margin, high)], axis=1
    )


def held_poses(machine: Machine, box: Array, target_m: Array) -> Array:
    """Platform poses (n, 6) for whose correction to ask at poses (n, 6): themselves, or the nearest ones in a
    box (k, 2) of commanded coordinates that were measured.

    InputError for poses further than HELD from what was measured: there is no correction.
    """
    commanded = tool_coordinates(machine, target_m)
    inside = np.clip(commanded, box[:, 0], box[:, 1])
    low, high = machine.commanded_limits.T
    beyond = np.abs(commanded - inside) / (high - low)
    if np.any(beyond > HELD):
        row, axis = divmod(int(np.argmax(beyond)), beyond.shape[1])
        name, unit = COORDINATES[machine.commanded[axis]], "rad" if machine.commanded[axis] > 2 else "m"
        raise InputError(
            f"correction: {name} = {commanded[row, axis]:.4f} {unit}; {box[axis, 0]:.4f} to "
            f"{box[axis, 1]:.4f} {unit} were measured, beyond them there is none; keep off it, or "
            "measure there"
        )
    moved = np.any(inside != commanded, axis=1)
    out = target_m.copy()
    if np.any(moved):
        out[moved] = nominal_poses(machine, inside[moved])
    return out
