"""Paths along which all drives of a machine agree: straight in the coordinates that they command, a row a SYNC.

Half way along a move in which each drive goes its own way a machine with more drives than commanded coordinates is
strained, by millimetres; along these paths it is not. What a path needs is checked on the nominal machine before
anything moves: travel, the assembly branch, the condition of the drives' Jacobian, the forces of the struts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.rotation import rotation_matrix
from calibration.machine.description import COORDINATES, Machine
from calibration.machine.equilibrium import Conditions, Equilibrium, PoseStatus, make_conditions, solve
from calibration.machine.inverse import nominal_drives, nominal_poses, tool_jacobian
from calibration.machine.sensitivity import Sensitivity

WORST_CONDITION = 50.0  # of the Jacobian from drives to commanded coordinates, rotations times the joints' radius
KNOTS = 12  # along a path, where it is checked and where its length is measured


@dataclass(frozen=True)
class LedPath:
    """A row a SYNC: share (n,) of the way, commanded coordinates (n, k), platform poses (n, 6), drives (n, d)."""

    share: Array
    commanded: Array
    pose: Array
    drives: Array
    period_s: float

    @property
    def duration_s(self) -> float:
        """From its first row to its last."""
        return (len(self.share) - 1) * self.period_s


def straight_path(
    machine: Machine, start: Array, end: Array, speed_m_per_s: float, acceleration_m_per_s2: float, period_s: float
) -> LedPath:
    """The path between commanded coordinates (k,) of the tool, from rest to rest.

    No platform joint, no slider and no leg is faster than the speed; joints do not accelerate faster along it.
    Raises InputError where the nominal machine cannot follow.
    """
    knots = start + np.linspace(0.0, 1.0, KNOTS)[:, None] * (end - start)
    pose = nominal_poses(machine, knots)
    drives = nominal_drives(machine, pose)
    _require_reached(machine, knots, drives)
    length_m = max(_farthest_joint(machine, pose), _farthest_drive(machine, drives))
    share = _trapezoid(length_m, speed_m_per_s, acceleration_m_per_s2, period_s)
    commanded = start + share[:, None] * (end - start)
    pose = nominal_poses(machine, commanded)
    drives = nominal_drives(machine, pose)
    _require_reached(machine, commanded, drives)
    return LedPath(share, commanded, pose, drives, period_s)


def _trapezoid(length_m: float, speed: float, acceleration: float, period_s: float) -> Array:
    """Share (n,) of a way at every period: constant acceleration, constant speed, constant deceleration."""
    if length_m < 1e-9:
        return np.array([0.0, 1.0])
    peak = min(speed, math.sqrt(length_m * acceleration))
    ramp_s = peak / acceleration
    total_s = length_m / peak + ramp_s
    count = max(2, math.ceil(total_s / period_s))
    t = np.linspace(0.0, total_s, count + 1)
    way = np.where(
        t < ramp_s,
        0.5 * acceleration * t**2,
        np.where(t > total_s - ramp_s, length_m - 0.5 * acceleration * (total_s - t) ** 2, peak * (t - 0.5 * ramp_s)),
    )
    return np.asarray(np.clip(way / length_m, 0.0, 1.0))


def _farthest_joint(machine: Machine, pose: Array) -> float:
    """Length of way of the platform joint or tool point that moves most, no less than KNOTS times its fastest part."""
    points = np.vstack([machine.nominal.platform_joint_m, machine.tool_point_m[None]])
    place = pose[:, None, :3] + np.einsum("nij,mj->nmi", rotation_matrix(pose[:, 3:]), points)
    steps = np.linalg.norm(np.diff(place, axis=0), axis=2)
    return float(steps.max() * (len(pose) - 1))


def _farthest_drive(machine: Machine, drives: Array) -> float:
    linear = [a for a, kind in enumerate(machine.drive_kinds) if kind != "crank"]
    steps = np.abs(np.diff(drives[:, linear], axis=0))
    return float(steps.max(initial=0.0) * (len(drives) - 1))


def _require_reached(machine: Machine, commanded: Array, drives: Array) -> None:
    low, high = machine.travel.T
    for row in np.flatnonzero(~np.all(np.isfinite(drives), axis=1)):
        raise InputError(f"path: {machine.name} does not reach {_place(machine, commanded[row])}; keep off it")
    for row, a in np.argwhere((drives < low) | (drives > high)):
        raise InputError(
            f"path: drive {machine.drive_names[a]} would be at {drives[row, a]:.4f}, its travel is {low[a]:g} to "
            f"{high[a]:g}, at {_place(machine, commanded[row])}; keep off it"
        )


def require_clear_ways(
    machine: Machine,
    ways: Array,
    *,
    payload_kg: Array | float,
    payload_com_m: Array | tuple[float, float, float],
    margin_n: float = 0.0,
) -> None:
    """Raise InputError where travel, branch, the drives' Jacobian or a strut's force forbids a straight way.

    ways (n, 2, k): commanded coordinates of both ends; payload_kg (n,) and payload_com_m (n, 3) on each. On the nominal
    machine with its weight; margin_n: what its errors may add to the force of a strut.
    """
    shares = np.linspace(0.0, 1.0, KNOTS)[:, None]
    commanded = (ways[:, :1] + shares[None] * (ways[:, 1:] - ways[:, :1])).reshape(-1, ways.shape[2])
    pose = nominal_poses(machine, commanded)
    drives = nominal_drives(machine, pose)
    _require_reached(machine, commanded, drives)
    n = len(commanded)
    kg = np.repeat(np.broadcast_to(np.asarray(payload_kg, dtype=np.float64), (len(ways),)), KNOTS)
    com = np.repeat(np.broadcast_to(np.asarray(payload_com_m, dtype=np.float64), (len(ways), 3)), KNOTS, axis=0)
    at = make_conditions(machine, n, None, kg, com)
    rest = solve(machine, machine.nominal, drives, at, pose)
    for row in np.flatnonzero(rest.status != PoseStatus.AT_REST):
        why = PoseStatus(int(rest.status[row])).name.lower().replace("_", " ")
        raise InputError(
            f"path: {machine.name} is not at rest on its assembly branch ({why}) at {_place(machine, commanded[row])}; "
            "keep off it"
        )
    condition = drive_condition(machine, drives, at, rest)
    worst = int(np.argmax(condition))
    if condition[worst] > WORST_CONDITION:
        raise InputError(
            f"path: the drives' Jacobian of {machine.name} has the condition {condition[worst]:.0f} at "
            f"{_place(machine, commanded[worst])}, {WORST_CONDITION:g} is permitted: it is almost singular; keep off it"
        )
    force = np.abs(rest.force_n[:, : len(machine.strut_names)]) + margin_n
    beyond = np.argwhere(force > machine.force_limit_n)
    for row, strut in beyond[:1]:
        raise InputError(
            f"path: strut {machine.strut_names[strut]} would bear up to {force[row, strut]:.0f} N, force_limit_n is "
            f"{machine.force_limit_n[strut]:.0f} N, at {_place(machine, commanded[row])}; keep off it or mount less"
        )


def drive_condition(machine: Machine, drives: Array, at: Conditions, rest: Equilibrium) -> Array:
    """Condition (n,) of the Jacobian from drives to commanded coordinates at equilibria.

    Rotations count as the way of a point at the joints' RMS distance from the platform's origin.
    """
    per_drive = Sensitivity.at_equilibrium(machine, machine.nominal, drives, at, rest).drives()
    jac = tool_jacobian(machine, per_drive, rest, at)[:, machine.commanded]
    jac = jac * np.where(machine.commanded > 2, joint_radius_m(machine), 1.0)[None, :, None]
    values = np.linalg.svd(jac, compute_uv=False)
    return np.asarray(values[:, 0] / np.maximum(values[:, -1], 1e-300))


def joint_radius_m(machine: Machine) -> float:
    """RMS distance of the platform's joints from its origin."""
    return float(np.sqrt(np.mean(np.sum(machine.nominal.platform_joint_m**2, axis=1))))


def approach_point(machine: Machine, commanded: Array, side: int, approach_m: float) -> Array:
    """Commanded coordinates (..., k) from which a pose is approached: away by `approach_m`, all coordinates alike.

    side 1: from below in every coordinate. Rotations count as in `drive_condition`.
    """
    scale = np.where(machine.commanded > 2, joint_radius_m(machine), 1.0)
    return np.asarray(commanded - side * approach_m / (scale * math.sqrt(machine.commanded.size)))


def tool_coordinates(machine: Machine, pose: Array) -> Array:
    """Commanded coordinates (n, k) of the tool at platform poses (n, 6)."""
    tool = pose.copy()
    tool[:, :3] += rotation_matrix(pose[:, 3:]) @ machine.tool_point_m
    return np.asarray(tool[:, machine.commanded])


def forward_pose(machine: Machine, drives: Array) -> tuple[Array, Array]:
    """Commanded coordinates (k,) of the tool with the drives at (d,), and by how much drives (d,) differ from those of
    the nominal machine there: zero where they agree. Raises InputError where nothing is at rest."""
    at = make_conditions(machine, 1).without_loads()
    rest = solve(machine, machine.nominal, drives[None], at)
    if not rest.converged.all():
        raise InputError(
            f"machine {machine.name}: with its drives at {np.array2string(drives, precision=4, separator=', ')} the "
            "nominal machine is not at rest on its assembly branch; move it by hand into its workspace, or home it"
        )
    commanded = tool_coordinates(machine, rest.coordinates())
    agreed = nominal_drives(machine, nominal_poses(machine, commanded))
    return commanded[0], drives - agreed[0]


def _place(machine: Machine, commanded: Array) -> str:
    return ", ".join(
        f"{COORDINATES[c]} = {value:.3f} {'rad' if c > 2 else 'm'}"
        for c, value in zip(machine.commanded, commanded, strict=True)
    )
