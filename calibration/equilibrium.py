"""Pose at static equilibrium, its derivatives, and drive positions for wanted poses; batched over poses.

A machine is a set of elastic constraints; the pose minimises V = 1/2 sum k e^2 minus the work of the loads
(docs/machine.md, docs/method.md). Newton's method with the full Hessian, geometric stiffness included;
derivatives by the implicit function theorem. All arrays are float64; n poses, s struts, d drives, f free
coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.machine import Array, Geometry, Machine

STEP_TOLERANCE = 1e-11  # of the last Newton step, in m and rad
MAX_STEPS = 30


@dataclass(frozen=True)
class Conditions:
    """What acts on the machine besides its drives, one row a pose.

    masses: pairs of mass (n,) in kg and centre of mass (n, 3) in m, platform frame.
    factors: part name to thermal length factor (n,); see `Machine.expansion_factors`.
    """

    masses: tuple[tuple[Array, Array], ...]
    factors: Mapping[str, Array]

    def take(self, rows: NDArray[np.intp] | slice) -> Conditions:
        """The conditions of some poses."""
        return Conditions(
            masses=tuple((m[rows], c[rows]) for m, c in self.masses),
            factors={part: f[rows] for part, f in self.factors.items()},
        )


@dataclass(frozen=True)
class Equilibrium:
    """Poses at rest. position_m (n, 3), rotation (n, 3, 3), converged (n,); rows that did not converge are NaN.

    strut_force_n (n, s), tension positive.
    """

    position_m: Array
    rotation: Array
    strut_force_n: Array
    converged: NDArray[np.bool_]

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
    machine: Machine, geometry: Geometry, drives_m: Array, at: Conditions, start_m: Array | None = None
) -> Equilibrium:
    """Poses at equilibrium for drive coordinates (n, d), from `start_m` (n, 6) or the nominal forward solution.

    Never returns a number for a pose that did not converge: its row is NaN and `converged` is False.
    """
    joints = carriage_joints(machine, geometry, drives_m, at)
    n = drives_m.shape[0]
    start = np.zeros((n, 6)) if start_m is None else start_m
    p, rot = start[:, :3].copy(), rotation_matrix(start[:, 3:])
    converged = np.zeros(n, dtype=bool)
    active = np.arange(n)
    for _ in range(MAX_STEPS):
        state = _State.at(machine, geometry, joints[active], at.take(active), p[active], rot[active])
        step = _solve_free(state.stiffness(machine.dof), -state.gradient()[:, machine.dof])
        full = np.zeros((active.size, 6))
        full[:, machine.dof] = _limited(step)
        p[active] += full[:, :3]
        rot[active] = rotation_matrix(full[:, 3:]) @ rot[active]
        with np.errstate(invalid="ignore"):
            done = np.max(np.abs(step), axis=1) < STEP_TOLERANCE
        converged[active[done]] = True
        active = active[~done & np.all(np.isfinite(step), axis=1)]
        if active.size == 0:
            break
    force = _State.at(machine, geometry, joints, at, p, rot).force_n
    p[~converged], rot[~converged], force[~converged] = np.nan, np.nan, np.nan
    return Equilibrium(p, rot, force, converged)


def drives_for(machine: Machine, geometry: Geometry, position_m: Array, rotation: Array) -> Array:
    """Drive coordinates (n, d) that close each drive's first strut, rigid and at the reference temperature.

    position_m (n, 3), rotation (n, 3, 3). NaN where the pose is out of reach. The formula is in docs/machine.md.
    """
    drives = np.empty((position_m.shape[0], len(machine.drive_names)))
    for a in range(len(machine.drive_names)):
        i = int(np.flatnonzero(machine.strut_drive == a)[0])
        w = position_m + rotation @ geometry.platform_joint_m[i] - geometry.base_joint_m[i]
        along = w @ geometry.axis[a]
        across2 = np.sum(w * w, axis=1) - along**2
        with np.errstate(invalid="ignore"):
            root = np.sqrt(geometry.length_m[i] ** 2 - across2)
        drives[:, a] = (along + machine.branch[a] * root) / geometry.scale[a]
    return drives


def carriage_joints(machine: Machine, geometry: Geometry, drives_m: Array, at: Conditions) -> Array:
    """Joints on the sliders (n, s, 3): s = b f_base + scale q f_drive u."""
    travel = drives_m * geometry.scale * at.factors["drives"][:, None]
    slide = travel[:, :, None] * geometry.axis
    joints: Array = geometry.base_joint_m * at.factors["base"][:, None, None] + slide[:, machine.strut_drive]
    return joints


@dataclass(frozen=True)
class _State:
    """The mechanics of n poses at given positions (not necessarily at rest)."""

    n: Array  # (n, s, 3) unit vectors along the struts
    r: Array  # (n, s, 3) lever arms from the platform origin
    wrench_arm: Array  # (n, s, 6) J = (n ; r x n)
    force_n: Array  # (n, s)
    force_over_length: Array  # (n, s)
    k: Array  # (s,)
    loads: tuple[tuple[Array, Array], ...]  # force (n, 3) and lever arm (n, 3)
    rotation: Array

    @classmethod
    def at(cls, machine: Machine, geometry: Geometry, joints: Array, at: Conditions, p: Array, rot: Array) -> _State:
        grown = at.factors["platform"][:, None, None]
        r = np.einsum("nij,sj->nsi", rot, geometry.platform_joint_m) * grown
        v = p[:, None, :] + r - joints
        length = np.sqrt(np.sum(v * v, axis=2))
        n = v / length[:, :, None]
        unstrained = geometry.length_m * at.factors["struts"][:, None]
        force = geometry.stiffness_n_per_m * (length - unstrained)
        loads = tuple(
            (mass[:, None] * machine.gravity_m_per_s2, np.einsum("nij,nj->ni", rot, com)) for mass, com in at.masses
        )
        arm = np.concatenate([n, np.cross(r, n)], axis=2)
        return cls(n, r, arm, force, force / length, geometry.stiffness_n_per_m, loads, rot)

    def gradient(self) -> Array:
        """dV/dx (n, 6): sum t J minus the wrenches of the loads."""
        g: Array = np.einsum("ns,nsi->ni", self.force_n, self.wrench_arm)
        for load, arm in self.loads:
            g[:, :3] -= load
            g[:, 3:] -= np.cross(arm, load)
        return g

    def strut_jacobian(self) -> Array:
        """W (n, s, 6, 3): change of a strut's wrench on the platform with a shift of its platform end."""
        eye = np.eye(3)
        nn = self.n[..., :, None] * self.n[..., None, :]
        across = self.force_over_length[..., None, None] * (eye - nn)
        lower = skew(self.r) @ across
        w: Array = self.k[:, None, None] * self.wrench_arm[..., :, None] * self.n[..., None, :]
        w[..., :3, :] += across
        w[..., 3:, :] += lower
        return w

    def stiffness(self, dof: NDArray[np.intp]) -> Array:
        """Hessian of V over the free coordinates (n, f, f), geometric stiffness included."""
        w = self.strut_jacobian()
        full = np.zeros((self.n.shape[0], 6, 6))
        full[:, :, :3] = w.sum(axis=1)
        full[:, :, 3:] = -(w @ skew(self.r)).sum(axis=1)
        rn = np.einsum("nsi,nsi->ns", self.r, self.n)
        turn = self.r[..., :, None] * self.n[..., None, :] - rn[..., None, None] * np.eye(3)
        full[:, 3:, 3:] += np.einsum("ns,nsij->nij", self.force_n, turn)
        for load, arm in self.loads:
            dot = np.einsum("ni,ni->n", arm, load)
            full[:, 3:, 3:] -= arm[:, :, None] * load[:, None, :] - dot[:, None, None] * np.eye(3)
        return full[:, dof[:, None], dof[None, :]]


@dataclass(frozen=True)
class PoseDerivatives:
    """Derivatives of the free coordinates with respect to what the pose depends on (implicit function theorem).

    All (n, f, ...): length (s), platform_joint (s, 3), base_joint (s, 3), slide (d, 3) for a shift of the
    slider's joints, ln_stiffness (s), mass (one column a mass of the conditions, in kg).
    """

    length: Array
    platform_joint: Array
    base_joint: Array
    slide: Array
    ln_stiffness: Array
    mass: Array


def derivatives(
    machine: Machine, geometry: Geometry, drives_m: Array, at: Conditions, rest: Equilibrium
) -> PoseDerivatives:
    """Derivatives at equilibrium; thermal factors are included (per metre at the reference temperature)."""
    joints = carriage_joints(machine, geometry, drives_m, at)
    state = _State.at(machine, geometry, joints, at, rest.position_m, rest.rotation)
    compliance = np.linalg.inv(state.stiffness(machine.dof))
    w = state.strut_jacobian()
    f_strut, f_base, f_platform = (at.factors[k][:, None, None] for k in ("struts", "base", "platform"))

    # dG/d(parameter), then dx = -K^-1 dG; the minus sign is taken in `respond`.
    d_length = -state.k[None, :, None] * state.wrench_arm * f_strut
    d_point = w.copy()
    d_point[..., 3:, :] -= state.force_n[..., None, None] * skew(state.n)
    d_joint = d_point @ rest.rotation[:, None] * f_platform[..., None]
    d_stiffness = state.force_n[..., None] * state.wrench_arm
    n_drives = len(machine.drive_names)
    d_slide = np.stack([-w[:, machine.strut_drive == a].sum(axis=1) for a in range(n_drives)], axis=1)
    gravity = machine.gravity_m_per_s2
    d_mass = np.stack(
        [
            -np.concatenate([np.broadcast_to(gravity, arm.shape), np.cross(arm, gravity)], axis=1)
            for _, arm in state.loads
        ],
        axis=1,
    )

    def respond(gradient: Array) -> Array:
        """-K^-1 dG for dG of shape (n, parts, 6) or (n, parts, 6, 3); returns (n, f, parts[, 3])."""
        spec = "nfg,npg->nfp" if gradient.ndim == 3 else "nfg,npgc->nfpc"
        response: Array = -np.einsum(spec, compliance, gradient[:, :, machine.dof])
        return response

    return PoseDerivatives(
        length=respond(d_length),
        platform_joint=respond(d_joint),
        base_joint=respond(-w * f_base[..., None]),
        slide=respond(d_slide),
        ln_stiffness=respond(d_stiffness),
        mass=respond(d_mass),
    )


def _solve_free(stiffness: Array, right: Array) -> Array:
    """Solve K dx = b pose by pose; NaN where K is singular (a singular pose has no answer)."""
    try:
        return np.asarray(np.linalg.solve(stiffness, right[..., None])[..., 0], dtype=np.float64)
    except np.linalg.LinAlgError:
        step = np.full(right.shape, np.nan)
        for i in range(right.shape[0]):
            if np.linalg.matrix_rank(stiffness[i]) == stiffness.shape[1]:
                step[i] = np.linalg.solve(stiffness[i], right[i])
        return step


def _limited(step: Array, largest: float = 0.2) -> Array:
    """Shorten steps that would leave the assembly branch."""
    with np.errstate(invalid="ignore"):
        size = np.max(np.abs(step), axis=1, keepdims=True)
        return step * (largest / np.maximum(size, largest))


def skew(v: Array) -> Array:
    """Cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return out


def rotation_matrix(vector: Array) -> Array:
    """Rotation matrices (n, 3, 3) of rotation vectors (n, 3), Rodrigues' formula."""
    angle = np.sqrt(np.sum(vector * vector, axis=-1))[..., None, None]
    k = skew(vector)
    with np.errstate(invalid="ignore", divide="ignore"):
        a = np.where(angle > 1e-8, np.sin(angle) / angle, 1.0 - angle**2 / 6.0)
        b = np.where(angle > 1e-8, (1.0 - np.cos(angle)) / angle**2, 0.5)
    matrix: Array = np.eye(3) + a * k + b * (k @ k)
    return matrix


def rotation_vector(matrix: Array) -> Array:
    """Rotation vectors (n, 3) of rotation matrices (n, 3, 3), for angles well below pi."""
    twice_axis = np.stack(
        [
            matrix[..., 2, 1] - matrix[..., 1, 2],
            matrix[..., 0, 2] - matrix[..., 2, 0],
            matrix[..., 1, 0] - matrix[..., 0, 1],
        ],
        axis=-1,
    )
    sine = 0.5 * np.sqrt(np.sum(twice_axis * twice_axis, axis=-1))
    cosine = 0.5 * (np.trace(matrix, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    with np.errstate(invalid="ignore", divide="ignore"):
        factor = np.where(sine > 1e-12, 0.5 * angle / sine, 0.5)
    vector: Array = factor[..., None] * twice_axis
    return vector
