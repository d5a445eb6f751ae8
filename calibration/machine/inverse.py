"""Drive coordinates for given poses: rigid closure in closed form, and exactly at equilibrium."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix, rotation_vector
from calibration.machine.description import Geometry, Machine
from calibration.machine.equilibrium import Conditions, Equilibrium, make_conditions, solve
from calibration.machine.sensitivity import Sensitivity

ROUND_OFF = 1e-9  # of a pose that a machine takes exactly


def rigid_drives(machine: Machine, geometry: Geometry, pose: Array) -> Array:
    """Drive coordinates (n, d) that close each drive's first strut at full poses (n, 6), at the reference temperature.

    NaN where the pose is out of reach. The formulas are in docs/reference/machine.md.
    """
    drives = np.empty((len(pose), len(machine.drive_names)))
    rotation = rotation_matrix(pose[:, 3:])
    for a, kind in enumerate(machine.drive_kinds):
        i = int(np.flatnonzero(machine.strut_drive == a)[0])
        w = pose[:, :3] + rotation @ geometry.platform_joint_m[i]
        b, u, length = geometry.base_joint_m[i], geometry.axis[a], geometry.length_m[i]
        with np.errstate(invalid="ignore", divide="ignore"):
            if kind == "leg":
                travel = np.sqrt(np.sum((w - b) ** 2, axis=1)) - length
            elif kind == "slider":
                along = (w - b) @ u
                across2 = np.sum((w - b) ** 2, axis=1) - along**2
                travel = along + machine.branch[a] * np.sqrt(length**2 - across2)
            else:
                angle = _crank_angle(w - geometry.pivot_m[a], b, u, length, machine.branch[a])
                middle = np.mean(machine.travel[a])
                travel = angle - 2.0 * np.pi * np.round((angle - middle) / (2.0 * np.pi))
        drives[:, a] = travel / geometry.scale[a]
    return drives


def _crank_angle(w: Array, arm: Array, u: Array, length: float, branch: float) -> Array:
    """Angle (n,) that brings an arm (3,), turned about u, to the distance `length` of points w (n, 3)."""
    arm_across, w_across = arm - u * (u @ arm), w - np.outer(w @ u, u)
    reach = np.linalg.norm(arm_across) * np.sqrt(np.sum(w_across**2, axis=1))
    between = (np.sum(w**2, axis=1) + arm @ arm - length**2 - 2.0 * (w @ u) * (u @ arm)) / (2.0 * reach)
    towards = np.arctan2(np.cross(arm_across, w_across) @ u, w_across @ arm_across)
    angle = towards - branch * np.arccos(between)
    return np.asarray(angle)


def drives_for(
    machine: Machine, geometry: Geometry, target: Array, at: Conditions | None = None
) -> tuple[Array, Array]:
    """Drive coordinates (n, d) that bring the commanded coordinates of the tool to `target` (n, 6), and the poses.

    target: tool point in m and rotation vector in rad; coordinates that the drives do not command are where to
    start from. With more drives than commanded coordinates the ones nearest to the rigid closure are taken.
    Newton's method on `solve`; NaN where no drive position is found. Without conditions: no load, reference
    temperature.
    """
    if at is None:
        at = make_conditions(machine, len(target)).without_loads()
    pose = target.copy()
    pose[:, :3] -= rotation_matrix(target[:, 3:]) @ machine.tool_point_m
    drives = rigid_drives(machine, geometry, pose)
    grown = at.factors["platform"][:, None]
    for _ in range(8):
        rest = solve(machine, geometry, drives, at, pose)
        tool = rest.position_m + grown * (rest.rotation @ machine.tool_point_m)
        turn = rest.rotation @ rotation_matrix(target[:, 3:]).transpose(0, 2, 1)
        error = np.concatenate([tool - target[:, :3], rotation_vector(turn)], axis=1)[:, machine.commanded]
        pose = rest.coordinates()
        if not np.nanmax(np.abs(error), initial=0.0) > 1e-12:
            break
        per_drive = tool_jacobian(
            machine, Sensitivity.at_equilibrium(machine, geometry, drives, at, rest).drives(), rest, at
        )
        drives = drives - np.einsum("ndk,nk->nd", pseudo_inverses(per_drive[:, machine.commanded]), error)
    unreachable = ~(np.max(np.abs(error), axis=1) < 1e-9)
    drives[unreachable], pose[unreachable] = np.nan, np.nan
    return drives, pose


def tool_jacobian(machine: Machine, pose_columns: Array, rest: Equilibrium, at: Conditions) -> Array:
    """Derivatives (n, 6, k) of tool point and orientation from those of the free coordinates (n, f, k)."""
    full = np.zeros((len(pose_columns), 6, pose_columns.shape[2]))
    full[:, machine.dof] = pose_columns
    lever = at.factors["platform"][:, None] * (rest.rotation @ machine.tool_point_m)
    full[:, :3] += np.cross(full[:, 3:].transpose(0, 2, 1), lever[:, None]).transpose(0, 2, 1)
    return full


def pseudo_inverses(matrix: Array) -> Array:
    """Pseudo-inverses (n, d, k) of matrices (n, k, d); NaN where a matrix is not finite."""
    good = np.all(np.isfinite(matrix), axis=(1, 2))
    out = np.full((matrix.shape[0], matrix.shape[2], matrix.shape[1]), np.nan)
    out[good] = np.linalg.pinv(matrix[good])
    return out


def nominal_closure(machine: Machine, target_m: Array) -> tuple[Array, Array]:
    """Drive coordinates (n, d) of the nominal machine without load for platform poses (n, 6), and its Jacobian
    (n, 6, d) there: tool point in m and orientation in rad a unit of a drive. NaN out of reach.
    """
    drives = nominal_drives(machine, target_m)
    at = make_conditions(machine, len(target_m)).without_loads()
    rest = solve(machine, machine.nominal, drives, at, target_m)
    per_drive = Sensitivity.at_equilibrium(machine, machine.nominal, drives, at, rest).drives()
    return drives, tool_jacobian(machine, per_drive, rest, at)


def nominal_drives(machine: Machine, target_m: Array) -> Array:
    """Drive coordinates (n, d) of the nominal machine without load for platform poses (n, 6); NaN out of reach."""
    tool = target_m.copy()
    tool[:, :3] += rotation_matrix(target_m[:, 3:]) @ machine.tool_point_m
    return drives_for(machine, machine.nominal, tool)[0]


def nominal_poses(machine: Machine, commanded: Array) -> Array:
    """Platform poses (n, 6) of the nominal machine without load with the tool at commanded coordinates (n, k).

    Coordinates that the drives do not command are what follows from the others; NaN out of reach.
    """
    poses = platform_poses(machine, commanded)
    tool = poses.copy()
    tool[:, :3] += rotation_matrix(poses[:, 3:]) @ machine.tool_point_m
    found = drives_for(machine, machine.nominal, tool)[1]
    moved = np.abs(found - poses) > ROUND_OFF
    return np.where(moved | np.isnan(found), found, poses)


def platform_poses(machine: Machine, commanded: Array) -> Array:
    """Platform poses (n, 6) that have the tool at commanded coordinates (n, k)."""
    poses = np.zeros((len(commanded), 6))
    poses[:, machine.commanded] = commanded
    poses[:, :3] -= rotation_matrix(poses[:, 3:]) @ machine.tool_point_m
    return poses
