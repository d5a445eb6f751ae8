"""The changes of a machine that a check watches: each parameter alone, and what moves several of them at once.

A slider that has lost its reference moves both base joints of its struts; a knocked column tilts its axis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.machine.description import Machine
from calibration.model.model import Poses
from calibration.model.parameters import ParameterSet

WATCHED_KINDS = ("strut_length", "platform_joint", "base_joint", "pivot", "guide_position", "axis_tilt", "drive_scale")


@dataclass(frozen=True)
class WatchedChanges:
    """Names (w,) of the watched changes; combination (p, w): by how much a unit of each changes every parameter."""

    names: tuple[str, ...]
    combination: Array


def watched_changes(parameters: ParameterSet) -> WatchedChanges:
    """Every parameter of the geometry, and the offset of every drive (a leg's is its strut's length, and there)."""
    names, columns = [], []
    for row, parameter in enumerate(parameters.parameters):
        if parameter.kind in WATCHED_KINDS:
            names.append(parameter.name)
            columns.append(np.eye(len(parameters))[row])
    for drive, name in enumerate(parameters.machine.drive_names):
        column = drive_offset(parameters, drive)
        if np.any(column) and parameters.machine.drive_kinds[drive] != "leg":
            names.append(f"drive_offset.{name}")
            columns.append(column)
    return WatchedChanges(tuple(names), np.stack(columns, axis=1))


def drive_offset(parameters: ParameterSet, drive: int) -> Array:
    """What becomes of every parameter (p,) where a drive stands a unit (m; rad of a crank) beyond what it says.

    A slider takes the base joints of its struts along its axis, a leg is longer, a crank turns its joints.
    """
    machine = parameters.machine
    column, kind = np.zeros(len(parameters)), machine.drive_kinds[drive]
    for row, parameter in enumerate(parameters.parameters):
        strut = parameter.part
        if kind == "leg" and parameter.kind == "strut_length" and machine.strut_drive[strut] == drive:
            column[row] = 1.0
        elif kind != "leg" and parameter.kind == "base_joint" and machine.strut_drive[strut] == drive:
            column[row] = carried_shift(machine, drive, machine.nominal.base_joint_m[strut])[parameter.axis]
    return column


def carried_shift(machine: Machine, drive: int, point_m: Array) -> Array:
    """By how much (3,) a point (3,) that a drive carries is displaced by a unit of the drive, before it has moved."""
    axis = machine.nominal.axis[drive]
    return np.asarray(np.cross(axis, point_m) if machine.drive_kinds[drive] == "crank" else axis)


def smr_response(poses: Poses, smrs: tuple[int, ...], mounting_m: Array) -> Array:
    """Shift of reflectors (v, s, 3, p) at poses with a unit of every machine parameter; zero for floor nests.

    smrs (s,): their rows in the machine file; mounting_m (s, 3): where they are mounted on their part.
    """
    count = len(poses.model.parameters)
    out = np.zeros((len(poses.visits), len(smrs), 3, count))
    for k, smr in enumerate(smrs):
        if poses.model.machine.smrs[smr].on != "floor":
            out[:, k] = poses.reflector_derivatives(smr, mounting_m[k])[:, :, :count]
    return out


def tool_response(poses: Poses) -> Array:
    """Shift of the tool point (v, 3, p) at poses with a unit of every machine parameter."""
    count = len(poses.model.parameters)
    return poses.platform_point_derivatives(poses.model.machine.tool_point_m)[:, :, :count]


def station_nuisance(place_m: Array, station_m: Array) -> Array:
    """What a station that was set up anew adds to readings at places (r, 3) of the machine's frame: (r, 3, 8).

    Three small rotations about the station, three shifts, the constant and the scale of its ranges. station_m (3,).
    """
    sight = place_m - station_m
    distance = np.linalg.norm(sight, axis=1, keepdims=True)
    out = np.zeros((len(place_m), 3, 8))
    for axis in range(3):
        out[:, :, axis] = np.cross(np.eye(3)[axis], sight)
        out[:, axis, 3 + axis] = 1.0
    out[:, :, 6] = sight / distance
    out[:, :, 7] = sight
    return out
