"""The error that a machine will show before it is calibrated, by its tolerances, and the noise floor beside it.

Where the first is not at least twice the second no verification could decide whether a correction helps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix, rotation_vector, skew
from calibration.identification.pose_selection import workspace_poses
from calibration.machine.description import Machine
from calibration.machine.equilibrium import make_conditions, solve
from calibration.machine.inverse import nominal_drives, nominal_poses
from calibration.model.parameters import ParameterSet
from calibration.reduction.figures import figure_axes

DRAWS, POSES, SEED = 12, 60, 3
LEAST_RATIO = 2.0  # of the error before to the noise floor


@dataclass(frozen=True)
class ExpectedError:
    """Median over machines within the tolerances of the RMS errors, in the coordinates that figures are of."""

    position_m: float
    rotation_rad: float


def expected_error(machine: Machine) -> ExpectedError:
    """Errors against the commanded poses, without load, in the frame that fits best.

    The frame takes away a rigid motion of the machine and one of the tool, as the report frame and the reflectors'
    mounting do.
    """
    tool = workspace_poses(machine, POSES, SEED)
    target = nominal_poses(machine, tool[:, machine.commanded])
    drives = nominal_drives(machine, target)
    parameters = ParameterSet.of(machine)
    tolerance = np.array([p.tolerance for p in parameters.parameters])
    rng = np.random.default_rng(SEED)
    at = make_conditions(machine, POSES)
    moves, turns = figure_axes(machine)
    rms = []
    for _ in range(DRAWS):
        geometry = parameters.geometry(tolerance * rng.uniform(-1.0, 1.0, len(tolerance)))
        pose = solve(machine, geometry, drives, at, target).coordinates()
        error = _without_frames(machine, pose, target)
        rms.append([np.sqrt(np.mean(np.sum(error[:, axes] ** 2, axis=1))) for axes in (moves, turns + 3)])
    position, rotation = np.median(np.array(rms), axis=0)
    return ExpectedError(float(position), float(rotation))


def _without_frames(machine: Machine, pose: Array, target: Array) -> Array:
    """Errors (n, 6) of tool point and rotation, without the part that motions of machine and tool explain."""
    turn, wanted = rotation_matrix(pose[:, 3:]), rotation_matrix(target[:, 3:])
    lever = wanted @ machine.tool_point_m
    place = target[:, :3] + lever
    error = np.concatenate(
        [
            pose[:, :3] + turn @ machine.tool_point_m - place,
            rotation_vector(turn @ wanted.transpose(0, 2, 1)),
        ],
        axis=1,
    )
    by = np.zeros((len(pose), 6, 12))
    by[:, :3, :3] = np.eye(3)
    by[:, :3, 3:6] = -skew(place)
    by[:, 3:, 3:6] = np.eye(3)
    by[:, :3, 6:9] = wanted
    by[:, 3:, 9:] = wanted
    free = np.zeros(6, dtype=bool)
    free[machine.dof] = True
    rows = np.tile(free, len(pose))
    flat = by.reshape(-1, 12)
    weight = np.tile([1.0, 1.0, 1.0, 0.3, 0.3, 0.3], len(pose))[rows]  # rad as seen at a reflector's distance
    frame, *_ = np.linalg.lstsq(flat[rows] * weight[:, None], error.ravel()[rows] * weight, rcond=None)
    return np.asarray(error - (flat @ frame).reshape(error.shape))
