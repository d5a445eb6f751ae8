"""Pose at static equilibrium, batched over poses.

A machine is a set of elastic constraints; the pose minimises V = 1/2 sum k e^2 minus the work of the loads
(docs/reference/machine.md, docs/explanation/method.md). Newton's method with the full Hessian, geometric stiffness
included, in blocks of poses, so that memory does not grow with their number. Derivatives are in `sensitivity`, the
way back from poses to drives in `inverse`. All arrays are float64; n poses, s struts, c constraints (struts, then
guides), d drives.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.rotation import (
    cayley_rotations,
    cayley_rotations_about_z,
    rotation_matrix,
    rotation_vector,
    rotations_about_z,
    rotations_poses_last,
)
from calibration.machine.carriers import Carrier, on_branch
from calibration.machine.description import FIXED, Geometry, Machine
from calibration.machine.mechanics import Cholesky, LoadedStructure, MechanicalState, retain_heap, sum_of_loads

STEP_TOLERANCE = 1e-13  # of the last Newton step, in m and rad
CONVERGED_STEP = 5e-15  # of the remaining error, estimated from the ratio of the last two steps
CHORD_BELOW = 1e-3  # steps so short that the Hessian is kept for the next one
LONGEST_STEP = 0.2  # longer ones would leave the assembly branch
MAX_STEPS = 30
BLOCK = 1024  # poses at once: their arrays stay in the processor's cache


class PoseStatus(IntEnum):
    """Outcome of the search for a pose."""

    AT_REST = 0
    SINGULAR = 1  # a coordinate that nothing holds
    NOT_CONVERGED = 2
    OTHER_BRANCH = 3  # at rest, but on another assembly branch


@dataclass(frozen=True)
class Conditions:
    """What acts on the machine besides its drives, one row a pose.

    masses: pairs of mass (n,) in kg and centre of mass (n, 3) in m; forces: pairs of force (n, 3) in N, machine
    frame, and its point (n, 3) in m; both points in the platform frame. factors: part name to
    thermal length factor (n,); see `Machine.expansion_factors`.
    """

    masses: tuple[tuple[Array, Array], ...]
    factors: Mapping[str, Array]
    forces: tuple[tuple[Array, Array], ...] = ()

    def take(self, rows: NDArray[np.intp] | slice) -> Conditions:
        """The conditions of some poses."""
        return Conditions(
            masses=tuple((m[rows], c[rows]) for m, c in self.masses),
            factors={part: f[rows] for part, f in self.factors.items()},
            forces=tuple((f[rows], c[rows]) for f, c in self.forces),
        )

    def without_loads(self) -> Conditions:
        """The same without any mass or force."""
        return Conditions((), self.factors)


@dataclass(frozen=True)
class Equilibrium:
    """Poses at rest. position_m (n, 3), rotation (n, 3, 3), status (n,): `PoseStatus`; rows not at rest are NaN.

    force_n (n, c): forces of the constraints, tension positive.
    """

    position_m: Array
    rotation: Array
    force_n: Array
    status: NDArray[np.int8]

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Which poses (n,) are at rest."""
        return self.status == PoseStatus.AT_REST

    def coordinates(self) -> Array:
        """(n, 6): x, y, z in m and the rotation vector in rad."""
        return np.concatenate([self.position_m, rotation_vector(self.rotation)], axis=1)


def make_conditions(
    machine: Machine,
    n_poses: int,
    temperatures_c: Mapping[str, Array] | None = None,
    payload_kg: Array | float = 0.0,
    payload_com_m: Array | tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Conditions:
    """Conditions for n poses: moving mass, one payload, temperatures (reference temperature where None)."""
    if temperatures_c is None:
        temperatures_c = {s: np.full(n_poses, machine.reference_temperature_c) for s in machine.sensors.values()}
    moving = (
        np.full(n_poses, machine.moving_mass_kg),
        np.broadcast_to(machine.centre_of_mass_m, (n_poses, 3)),
    )
    payload = (
        np.broadcast_to(np.asarray(payload_kg, dtype=float), (n_poses,)),
        np.broadcast_to(np.asarray(payload_com_m, dtype=float), (n_poses, 3)),
    )
    return Conditions(masses=(moving, payload), factors=machine.expansion_factors(temperatures_c))


def solve(
    machine: Machine, geometry: Geometry, drives: Array, at: Conditions, start: Array | None = None
) -> Equilibrium:
    """Poses at equilibrium for drive coordinates (n, d), from `start` (n, 6) or the middle of the workspace.

    Never returns a number for a pose that is not at rest on its assembly branch: its row is NaN and `status` says why.
    """
    n = len(drives)
    if n >= BLOCK:
        retain_heap()
    if start is None:
        start = np.broadcast_to(workspace_middle(machine), (n, 6))
    position, rotation = np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1))
    force = np.empty((n, len(geometry.stiffness_n_per_m)))
    status = np.empty(n, dtype=np.int8)
    for rows in blocks(n):
        acting = at.take(rows)
        carriers = carriers_of(machine, geometry, drives[rows], acting)
        structure = _drop_z_axis(_loaded_structure(machine, geometry, carriers, acting), start[rows])
        rest = _newton(structure, start[rows])
        rest.status[(rest.status == PoseStatus.AT_REST) & ~_on_assembly_branch(structure, carriers, rest)] = (
            PoseStatus.OTHER_BRANCH
        )
        axes = structure.axes
        position[rows, :axes] = rest.position.T
        rotation[rows, :axes, :axes] = rest.rotation.transpose(2, 0, 1)
        force[rows] = rest.force.T
        status[rows] = rest.status
    not_at_rest = status != PoseStatus.AT_REST
    if np.any(not_at_rest):
        for values in (position, rotation, force):
            values[not_at_rest] = np.nan
    return Equilibrium(position, rotation, force, status)


def blocks(n: int) -> Iterator[slice]:
    """Rows of n poses, BLOCK at a time."""
    return (slice(first, min(first + BLOCK, n)) for first in range(0, n, BLOCK))


def workspace_middle(machine: Machine) -> Array:
    """Platform pose (6,) in the middle of the workspace."""
    middle = machine.workspace.mean(axis=1)
    middle[:3] -= rotation_matrix(middle[None, 3:])[0] @ machine.tool_point_m
    return middle


def carriers_of(machine: Machine, geometry: Geometry, drives: Array, at: Conditions) -> list[Carrier]:
    """The carrier of every drive, and that of the base last (index FIXED)."""
    base, grown = at.factors["base"], at.factors["drives"]
    moving = [
        Carrier.from_geometry(machine, geometry, a, drives[:, a], base, grown) for a in range(len(machine.drive_names))
    ]
    return [*moving, Carrier.from_geometry(machine, geometry, FIXED, base, base, grown)]


def carried_point(machine: Machine, drive: int, point_m: Array, drives: Array) -> Array:
    """Where (3,) a point (3,) on a drive is with the drives at (d,): nominal machine, reference temperature."""
    carriers = carriers_of(machine, machine.nominal, drives[None], make_conditions(machine, 1))
    return np.asarray(carriers[drive].position(point_m)[:, 0])


def _loaded_structure(machine: Machine, geometry: Geometry, carriers: list[Carrier], at: Conditions) -> LoadedStructure:
    n = carriers[FIXED].base.size
    free_length = geometry.length_m[:, None] * at.factors["struts"]
    ends = np.empty((3, len(geometry.stiffness_n_per_m), n))
    for a, carrier in enumerate(carriers):
        struts = np.flatnonzero(machine.strut_drive == (a if a < len(carriers) - 1 else FIXED))
        if struts.size:
            ends[:, struts] = carrier.positions(geometry.base_joint_m[struts])
            if carrier.kind == "leg":
                free_length[struts] += carrier.travel
    ends[:, len(free_length) :] = geometry.guide_point_m.T[:, :, None] * at.factors["base"]
    loads = sum_of_loads(machine.gravity_m_per_s2, at.masses, at.forces, n)
    return LoadedStructure(machine, geometry, ends, free_length, at.factors["platform"], loads)


def _drop_z_axis(structure: LoadedStructure, start: Array) -> LoadedStructure:
    """The setting without the axis z where the machine and its poses `start` (n, 6) lie in the plane z = 0."""
    geometry = structure.geometry
    across = (geometry.platform_joint_m[:, 2], geometry.guide_normal[:, 2], structure.base_ends[2], start[:, 2:5])
    return structure.without_z_axis() if structure.machine.planar and not any(np.any(z) for z in across) else structure


def state_at(
    machine: Machine, geometry: Geometry, drives: Array, at: Conditions, position_m: Array, rotation: Array
) -> MechanicalState:
    """The mechanics at given poses: position_m (n, 3), rotation (n, 3, 3)."""
    structure = _loaded_structure(machine, geometry, carriers_of(machine, geometry, drives, at), at)
    return MechanicalState.from_poses(
        structure, np.ascontiguousarray(position_m.T), np.ascontiguousarray(rotation.transpose(1, 2, 0))
    )


@dataclass
class _Equilibria:
    """Poses found, poses last: position (a, n), rotation (a, a, n), direction (a, c, n) and force (c, n) of the
    constraints, status (n,)."""

    position: Array
    rotation: Array
    direction: Array
    force: Array
    status: NDArray[np.int8]

    @classmethod
    def from_poses(cls, structure: LoadedStructure, start: Array) -> _Equilibria:
        """From poses (n, 6)."""
        n, a = len(start), structure.axes
        rotation = rotations_about_z(start[:, 5]) if a == 2 else rotations_poses_last(start[:, 3:].T)
        nothing = np.empty((a, 0, n))
        status = np.full(n, PoseStatus.NOT_CONVERGED, dtype=np.int8)
        return cls(np.array(start[:, :a].T, order="C"), rotation, nothing, nothing[0], status)

    def take(self, rows: NDArray[np.intp]) -> _Equilibria:
        """Some of the poses."""
        return _Equilibria(*(array[..., rows] for array in self._arrays()))

    @classmethod
    def merge(cls, parts: list[tuple[NDArray[np.intp], _Equilibria]]) -> _Equilibria:
        """All poses; those that occur in several parts take the last value."""
        if len(parts) == 1:
            return parts[0][1]
        every = cls(*(array.copy() for array in parts[0][1]._arrays()))
        for rows, part in parts[1:]:
            for merged, its in zip(every._arrays(), part._arrays(), strict=True):
                merged[..., rows] = its
        return every

    def _arrays(self) -> tuple[NDArray[Any], ...]:
        return self.position, self.rotation, self.direction, self.force, self.status


def _newton(structure: LoadedStructure, start: Array) -> _Equilibria:
    """Newton's method from `start` (n, 6).

    A Hessian serves for as many steps as they shrink fast. Poses that have settled are stepped on with the others (it
    costs less than to sort them out) until half of them have.
    """
    part = _Equilibria.from_poses(structure, start)
    rows, parts = np.arange(len(start)), []
    cholesky: Cholesky | None = None
    previous = np.zeros(len(start))
    for steps_left in reversed(range(MAX_STEPS)):
        state = MechanicalState.from_poses(structure, part.position, part.rotation)
        if cholesky is None:
            cholesky = Cholesky.of(state.hessian())
        step = cholesky.solve(-state.gradient())
        size, diverged = _limit_step(step, cholesky.positive)
        _move(part, step, structure)
        settled = (size < STEP_TOLERANCE) | (size * size < CONVERGED_STEP * previous)
        waiting = part.status == PoseStatus.NOT_CONVERGED
        part.status[waiting & settled & ~diverged] = PoseStatus.AT_REST
        part.status[waiting & diverged] = PoseStatus.SINGULAR
        active = np.flatnonzero(part.status == PoseStatus.NOT_CONVERGED)
        if 2 * active.size < rows.size or steps_left == 0:
            part.force, part.direction = state.force_after(step), state.direction
            parts.append((rows, part))
            if active.size == 0:
                break
            rows, part, structure, size = rows[active], part.take(active), structure.take(active), size[active]
            cholesky = cholesky.take(active)
            active = np.arange(active.size)
        previous = size
        if np.max(size[active]) > CHORD_BELOW:
            cholesky = None
    return _Equilibria.merge(parts)


def _limit_step(step: Array, positive: NDArray[np.bool_]) -> tuple[Array, NDArray[np.bool_]]:
    """Sizes (n,) of steps (f, n), which are cut in place to LONGEST_STEP, and which of the poses diverged."""
    size = np.max(np.abs(step), axis=0)
    diverged = ~(positive & (size < np.inf))
    if np.any(diverged):
        step[:, diverged] = 0.0
        size[diverged] = 0.0
    if np.max(size) > LONGEST_STEP:
        step *= LONGEST_STEP / np.maximum(size, LONGEST_STEP)
    return size, diverged


def _move(poses: _Equilibria, step: Array, structure: LoadedStructure) -> None:
    """Move poses by a step (f, n) of the free coordinates; turns act on the left."""
    turn = np.zeros((3, step.shape[1]))
    for row, c in zip(step, structure.machine.dof.tolist(), strict=True):
        if c < 3:
            poses.position[c] += row
        else:
            turn[c - 3] = row
    by = cayley_rotations_about_z(turn[2]) if structure.axes == 2 else cayley_rotations(turn)
    poses.rotation = np.einsum("ijn,jkn->ikn", by, poses.rotation)


def _on_assembly_branch(structure: LoadedStructure, carriers: list[Carrier], rest: _Equilibria) -> NDArray[np.bool_]:
    """Whether the first strut of every drive is on the branch that the machine file states."""
    machine = structure.machine
    good = np.ones(rest.status.size, dtype=bool)
    for a, carrier in enumerate(carriers[:-1]):
        struts = np.flatnonzero(machine.strut_drive == a)
        if carrier.kind == "leg" or struts.size == 0:  # a leg has one branch; a baseline left this drive's link out
            continue
        first = int(struts[0])
        ends, directions = structure.base_ends[:, first], rest.direction[:, first]
        good &= on_branch(carrier, float(machine.branch[a]), ends, directions)
    return good
