"""Pose at static equilibrium, batched over poses.

A machine is a set of elastic constraints; the pose minimises V = 1/2 sum k e^2 minus the work of the loads
(docs/machine.md, docs/method.md). Newton's method with the full Hessian, geometric stiffness included, in blocks of
poses, so that memory does not grow with their number. Derivatives are in `sensitivity`, the way back from
poses to drives in `inverse`. All arrays are float64; n poses, s struts, c constraints (struts, then guides), d drives.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from calibration.carriers import Carrier, on_branch
from calibration.machine import Array, Geometry, Machine
from calibration.mechanics import Cholesky, Load, Setting, State
from calibration.rotation import rotation_matrix, rotation_vector, turns

STEP_TOLERANCE = 1e-11  # of the last Newton step, in m and rad
CHORD_BELOW = 1e-5  # steps so short that the former Hessian serves for the next one
LONGEST_STEP = 0.2  # longer ones would leave the assembly branch
MAX_STEPS = 30
BLOCK = 1024  # poses at once: their arrays stay in the processor's cache


class Status(IntEnum):
    """What became of a pose."""

    AT_REST = 0
    SINGULAR = 1  # a coordinate that nothing holds
    NOT_CONVERGED = 2
    OTHER_BRANCH = 3  # at rest, but not as the machine is assembled


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

    def unloaded(self) -> Conditions:
        """The same without any mass or force."""
        return Conditions((), self.factors)


@dataclass(frozen=True)
class Equilibrium:
    """Poses at rest. position_m (n, 3), rotation (n, 3, 3), status (n,): `Status`; rows not at rest are NaN.

    force_n (n, c): forces of the constraints, tension positive.
    """

    position_m: Array
    rotation: Array
    force_n: Array
    status: NDArray[np.int8]

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Which poses (n,) are at rest."""
        return self.status == Status.AT_REST

    def coordinates(self) -> Array:
        """(n, 6): x, y, z in m and the rotation vector in rad."""
        return np.concatenate([self.position_m, rotation_vector(self.rotation)], axis=1)


def conditions(
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
    if start is None:
        start = np.tile(workspace_middle(machine), (n, 1))
    position, rotation = np.full((n, 3), np.nan), np.full((n, 3, 3), np.nan)
    force = np.full((n, len(geometry.stiffness_n_per_m)), np.nan)
    status = np.full(n, Status.NOT_CONVERGED, dtype=np.int8)
    for rows in blocks(n):
        state, p, found = _rest(_setting(machine, geometry, drives[rows], at.take(rows)), start[rows])
        carriers = carriers_of(machine, geometry, drives[rows], at.take(rows))
        found[(found == Status.AT_REST) & ~_assembled(machine, geometry, carriers, state, p)] = Status.OTHER_BRANCH
        good = found == Status.AT_REST
        status[rows] = found
        position[rows] = np.where(good, p, np.nan).T
        rotation[rows] = np.where(good, state.rotation, np.nan).transpose(2, 0, 1)
        force[rows] = np.where(good, state.force, np.nan).T
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
    moving = [Carrier.of(machine, geometry, a, drives[:, a], base, grown) for a in range(len(machine.drive_names))]
    return [*moving, Carrier.of(machine, geometry, -1, base, base, grown)]


def _setting(machine: Machine, geometry: Geometry, drives: Array, at: Conditions) -> Setting:
    carriers = carriers_of(machine, geometry, drives, at)
    ends = np.empty((3, len(geometry.stiffness_n_per_m), len(drives)))
    free_length = geometry.length_m[:, None] * at.factors["struts"]
    for i, a in enumerate(machine.strut_drive):
        ends[:, i] = carriers[a].place(geometry.base_joint_m[i])
        if carriers[a].kind == "leg":
            free_length[i] += carriers[a].travel
    ends[:, len(free_length) :] = geometry.guide_point_m.T[:, :, None] * at.factors["base"]
    gravity = machine.gravity_m_per_s2[:, None]
    weights = [Load(gravity * mass, com.T) for mass, com in at.masses if np.any(mass)]
    pushes = [Load(force.T, point.T) for force, point in at.forces]
    return Setting(machine, geometry, ends, free_length, at.factors["platform"], (*weights, *pushes))


def state_at(
    machine: Machine, geometry: Geometry, drives: Array, at: Conditions, position_m: Array, rotation: Array
) -> State:
    """The mechanics at given poses: position_m (n, 3), rotation (n, 3, 3)."""
    return State.at(_setting(machine, geometry, drives, at), position_m.T, rotation.transpose(1, 2, 0))


def _rest(setting: Setting, start: Array) -> tuple[State, Array, NDArray[np.int8]]:
    """Newton's method from `start` (n, 6); the state, the positions (3, n) and the status of all poses."""
    dof = setting.machine.dof
    n = len(start)
    p, rotation = start[:, :3].T.copy(), turns(start[:, 3:].T)
    status = np.full(n, Status.NOT_CONVERGED, dtype=np.int8)
    active, part = np.arange(n), setting
    cholesky: Cholesky | None = None
    for _ in range(MAX_STEPS):
        state = State.at(part, p[:, active], rotation[:, :, active])
        if cholesky is None:
            cholesky = Cholesky.of(state.hessian())
        step = cholesky.solve(-state.gradient())
        with np.errstate(invalid="ignore"):
            size = np.max(np.abs(step), axis=0)
            lost = ~cholesky.positive | ~np.isfinite(size)
            step *= np.where(lost, 0.0, LONGEST_STEP / np.maximum(size, LONGEST_STEP))
        _move(p, rotation, active, np.where(np.isfinite(step), step, 0.0), dof)
        done = ~lost & (size < STEP_TOLERANCE)
        status[active[done]] = Status.AT_REST
        status[active[lost]] = Status.SINGULAR
        stay = ~done & ~lost
        if not np.any(stay):
            break
        chord = np.max(size[stay]) < CHORD_BELOW
        if not np.all(stay):
            active = active[stay]
            part = part.take(np.flatnonzero(stay))
            cholesky = Cholesky(cholesky.lower[:, :, stay], cholesky.positive[stay])
        if not chord:
            cholesky = None
    return State.at(setting, p, rotation), p, status


def _move(p: Array, rotation: Array, rows: NDArray[np.intp], step: Array, dof: NDArray[np.intp]) -> None:
    """Move poses by a step (f, n) of their free coordinates; turns act on the left."""
    everything = rows.size == p.shape[1]
    full = np.zeros((6, rows.size))
    full[dof] = step
    if everything:
        p += full[:3]
        rotation[:] = np.einsum("ijn,jkn->ikn", turns(full[3:]), rotation)
    else:
        p[:, rows] += full[:3]
        rotation[:, :, rows] = np.einsum("ijn,jkn->ikn", turns(full[3:]), rotation[:, :, rows])


def _assembled(
    machine: Machine, geometry: Geometry, carriers: list[Carrier], state: State, p: Array
) -> NDArray[np.bool_]:
    """Whether the first strut of every drive stands as the branch of the machine file says."""
    good = np.ones(p.shape[1], dtype=bool)
    for a, carrier in enumerate(carriers[:-1]):
        struts = np.flatnonzero(machine.strut_drive == a)
        if struts.size == 0:  # a baseline left this drive's link out
            continue
        first = int(struts[0])
        good &= on_branch(machine, geometry, a, carrier, state.setting.base_ends[:, first], p + state.lever[:, first])
    return good
