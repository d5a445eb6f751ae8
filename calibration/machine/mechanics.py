"""The mechanics of many poses at once: forces, energy gradient and Hessian of a platform on elastic constraints.

V = 1/2 sum k e^2 minus the work of the loads (docs/reference/machine.md). With D_f the motion of a joint for a unit
of the free coordinate f, J_f = n . D_f and t = k e, the gradient is sum t J_f and the Hessian sum (k - t/L) J_f J_g +
t/L D_f . D_g + t n . d2(R m). A guide is a strut of infinite length: t/L is zero.

All arrays have poses last, so that every operation runs along contiguous memory; c constraints (struts, then
guides), s struts, f free coordinates, n poses, a axes: three, or x and y alone where nothing leaves the plane z = 0.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.machine.description import Geometry, Machine

SMALLEST_PIVOT = 1e-9  # of a diagonal element: below it a coordinate is held by nothing
NEAR_REST = 0.03  # of a strut's length: the geometric stiffness is left out where a residual is larger

RETAINED_BYTES = 31_000_000  # the largest that glibc's threshold follows is 32 MiB


def retain_heap() -> None:
    """Have the allocator keep what the arrays of one block of poses used for those of the next.

    glibc returns large arrays to the system when they are freed, and their pages are faulted in anew for the next
    block: up to a third of the time of a fit. It stops doing so once one as large as this was freed. The array is never
    touched, so it occupies nothing; other allocators are not affected.
    """
    np.empty(RETAINED_BYTES, dtype=np.uint8)


@dataclass(frozen=True)
class LoadedStructure:
    """What a pose depends on besides itself, and what of it stays the same while the pose is searched.

    base_ends (a, c, n); free_length (s, n): unstrained; platform_growth (n,). loads (a, 1 + a, n): the sum of all
    forces, then the sums of their products with each coordinate of their points in the platform frame: all that
    gradient and Hessian need to know of loads, however many there are.
    """

    machine: Machine
    geometry: Geometry
    base_ends: Array
    free_length: Array
    platform_growth: Array
    loads: Array

    @property
    def axes(self) -> int:
        """Number of axes a."""
        return len(self.base_ends)

    @cached_property
    def joints(self) -> Array:
        """Platform joints (c, a) of all constraints, in the platform frame."""
        joint = self.geometry.platform_joint_m
        if self.machine.guide_joint.size:
            joint = np.concatenate([joint, joint[self.machine.guide_joint]])
        return np.ascontiguousarray(joint[:, : self.axes])

    @cached_property
    def force_and_moment_rows(self) -> Array:
        """Rows (1 + a, c) that sum forces, and forces times the coordinates of their joints."""
        return np.vstack([np.ones(len(self.joints)), self.joints.T])

    def take(self, rows: NDArray[np.intp]) -> LoadedStructure:
        """Some of the poses."""
        return LoadedStructure(
            self.machine,
            self.geometry,
            self.base_ends[:, :, rows],
            self.free_length[:, rows],
            self.platform_growth[rows],
            self.loads[:, :, rows],
        )

    def without_z_axis(self) -> LoadedStructure:
        """The same without the axis z, which no force and no motion has."""
        return LoadedStructure(
            self.machine,
            self.geometry,
            self.base_ends[:2],
            self.free_length,
            self.platform_growth,
            self.loads[:2, :3],
        )


def sum_of_loads(
    gravity_m_per_s2: Array, masses: Iterable[tuple[Array, Array]], forces: Iterable[tuple[Array, Array]], n: int
) -> Array:
    """`LoadedStructure.loads` (3, 4, n) of masses (n,) at points (n, 3) and forces (n, 3) at points (n, 3)."""
    total = np.zeros((3, 4, n))

    def add(axis: int, force: Array, point_m: Array) -> None:
        total[axis, 0] += force
        for along in range(3):
            total[axis, 1 + along] += force * point_m[:, along]

    for mass, point_m in masses:
        if np.any(mass):
            for axis, gravity in enumerate(gravity_m_per_s2.tolist()):
                if gravity != 0.0:
                    add(axis, gravity * mass, point_m)
    for forces_n, point_m in forces:
        for axis in range(3):
            add(axis, forces_n[:, axis], point_m)
    return total


@dataclass(frozen=True)
class MechanicalState:
    """Poses, not necessarily at rest.

    position (a, n); rotation (a, a, n); lever (a, c, n): r = R m; direction (a, c, n): n; residual (c, n): e;
    force (c, n): t = k e; stiffness (c, 1); curvature (c, n): t / L.
    """

    structure: LoadedStructure
    position: Array
    rotation: Array
    lever: Array
    direction: Array
    residual: Array
    force: Array
    stiffness: Array
    curvature: Array

    @classmethod
    def from_poses(cls, structure: LoadedStructure, p: Array, rotation: Array) -> MechanicalState:
        """The state at positions (a, n) and rotations (a, a, n)."""
        geometry, a, s = structure.geometry, structure.axes, len(structure.free_length)
        lever = np.matmul(structure.joints, rotation * structure.platform_growth)
        direction = lever + p[:, None]
        direction -= structure.base_ends
        residual = np.empty(direction.shape[1:])
        curvature = np.zeros_like(residual)
        if len(residual) > s:
            normal = geometry.guide_normal[:, :a]
            residual[s:] = np.einsum("gi,ign->gn", normal, direction[:, s:])
            direction[:, s:] = normal.T[:, :, None]
        length = np.square(direction[0, :s])
        for v in direction[1:, :s]:
            length += v * v
        np.sqrt(length, out=length)
        np.subtract(length, structure.free_length, out=residual[:s])
        direction[:, :s] /= length
        k = geometry.stiffness_n_per_m[:, None]
        force = k * residual
        np.divide(force[:s], length, out=curvature[:s])
        return cls(
            structure=structure,
            position=p,
            rotation=rotation,
            lever=lever,
            direction=direction,
            residual=residual,
            force=force,
            stiffness=k,
            curvature=curvature,
        )

    @cached_property
    def wrench(self) -> Array:
        """J (f, c, n): change of the residuals with the free coordinates."""
        dof = self.structure.machine.dof.tolist()
        out = np.empty((len(dof), *self.residual.shape))
        for row, c in enumerate(dof):
            if c < 3:
                out[row] = self.direction[c]
            else:
                i, j = rotation_axes(c)
                np.multiply(self.lever[i], self.direction[j], out=out[row])
                out[row] -= self.lever[j] * self.direction[i]
        return out

    @cached_property
    def _forces(self) -> Array:
        """Forces of the constraints less the loads (a, 1 + a, n), summed as in `LoadedStructure.loads`."""
        out = np.matmul(self.structure.force_and_moment_rows, self.force * self.direction)
        out -= self.structure.loads
        return out

    @cached_property
    def _moment_sums(self) -> Array:
        """Sums (a, a, n) of lever_i force_j of constraints and loads."""
        grown = self.rotation * self.structure.platform_growth
        return np.einsum("ikn,jkn->ijn", grown, self._forces[:, 1:])

    def gradient(self) -> Array:
        """dV over the free coordinates (f, n)."""
        dof = self.structure.machine.dof.tolist()
        out = np.empty((len(dof), self.residual.shape[1]))
        for row, c in zip(out, dof, strict=True):
            if c < 3:
                row[:] = self._forces[c, 0]
            else:
                i, j = rotation_axes(c)
                np.subtract(self._moment_sums[i, j], self._moment_sums[j, i], out=row)
        return out

    def hessian(self, *, at_rest: bool = False) -> Array:
        """d2V over the free coordinates (f, f, n), symmetric.

        Where poses are not known to be at rest and far from it (a residual beyond NEAR_REST), the Gauss-Newton part
        alone: positive whatever the residuals.
        """
        strained = np.abs(self.residual[: len(self.structure.free_length)]) / self.structure.geometry.length_m[:, None]
        near = at_rest | (np.max(strained, axis=0) < NEAR_REST)
        curvature, turned = self.curvature, self._moment_sums
        if not near.all():
            curvature, turned = curvature * near, turned * near
        weight = self.stiffness - curvature
        h = np.empty((len(self.wrench), *self.wrench[:, 0].shape))
        for i, row in enumerate(self.wrench):
            h[i, : i + 1] = np.einsum("cn,gcn->gn", weight * row, self.wrench[: i + 1])
            h[:i, i] = h[i, :i]
        self._add_geometric_stiffness(h, curvature, turned)
        return h

    def _add_geometric_stiffness(self, h: Array, curvature: Array, turned: Array) -> None:
        """Add the geometric stiffness, sum t/L D_f . D_g + t n . d2(R m): of turns, tr(X) 1 - X made symmetric.

        X = sum t/L r r^T - sum r t n^T, the loads among the forces t n.
        """
        bent = curvature * self.lever
        pull, shift = np.sum(curvature, axis=0), np.sum(bent, axis=1)
        x = np.einsum("icn,jcn->ijn", bent, self.lever) - turned
        dof = self.structure.machine.dof.tolist()
        for i, f in enumerate(dof):
            if f < 3:
                h[i, i] += pull
            for j, g in enumerate(dof[: i + 1]):
                if f < 3 or f == g + 3:
                    continue
                if g < 3:
                    extra = _cross_component(f - 3, g, shift)
                elif f == g:
                    p, q = rotation_axes(f)
                    # A flat machine turns about z alone: p and q are its two axes.
                    extra = x[p, p] + x[q, q]
                else:
                    extra = -0.5 * (x[f - 3, g - 3] + x[g - 3, f - 3])
                h[i, j] += extra
                if i != j:
                    h[j, i] += extra

    def force_after(self, step: Array) -> Array:
        """Forces (c, n) after a step (f, n) of the free coordinates so short that its square does not count."""
        motion = np.einsum("fcn,fn->cn", self.wrench, step)
        motion *= self.stiffness
        motion += self.force
        return motion

    def end_shift(self) -> Array:
        """W (f, 3, c, n): change of the gradient with a shift of a constraint's platform end."""
        weighted = (self.stiffness - self.curvature) * self.wrench
        w = weighted[:, None] * self.direction
        for row, c in zip(w, self.structure.machine.dof.tolist(), strict=True):
            if c < 3:
                row[c] += self.curvature
            else:
                i, j = rotation_axes(c)
                row[j] += self.curvature * self.lever[i]
                row[i] -= self.curvature * self.lever[j]
        return w


def rotation_axes(c: int) -> tuple[int, int]:
    """The axes i, j that a turn, the coordinate c, takes into each other: its moment is r_i f_j - r_j f_i."""
    return (c - 2) % 3, (c - 1) % 3


def _cross_component(axis: int, component: int, lever: Array) -> Array:
    """Component of e_axis x lever, another than the axis itself."""
    third = 3 - axis - component
    return np.asarray(-lever[third] if (component - axis) % 3 == 1 else lever[third])


@dataclass(frozen=True)
class Cholesky:
    """Factors (f, f, n) of symmetric matrices L D L^T: L below the diagonal, 1/D on it; and which of them are safely
    positive (n,)."""

    factors: Array
    positive: NDArray[np.bool_]

    @classmethod
    def of(cls, matrix: Array) -> Cholesky:
        """Factor matrices (f, f, n)."""
        a = matrix.copy()
        least = SMALLEST_PIVOT * np.array([a[i, i] for i in range(len(a))])
        positive = np.ones(a.shape[2], dtype=bool)
        for j in range(len(a)):
            positive &= a[j, j] > least[j]
            if not positive.all():
                a[j, j, ~positive] = 1.0
            np.divide(1.0, a[j, j], out=a[j, j])
            for i in range(j + 1, len(a)):
                unscaled = a[i, j].copy()
                a[i, j] *= a[j, j]
                a[i, j + 1 : i + 1] -= unscaled * a[j + 1 : i + 1, j]
        return cls(a, positive)

    def take(self, rows: NDArray[np.intp]) -> Cholesky:
        """Some of the matrices."""
        return Cholesky(self.factors[:, :, rows], self.positive[rows])

    def solve(self, right: Array) -> Array:
        """Solutions of right sides (f, ..., n)."""
        f = len(self.factors)
        x = right.copy()
        for i in range(f):
            for k in range(i):
                x[i] -= self.factors[i, k] * x[k]
        for i in reversed(range(f)):
            x[i] *= self.factors[i, i]
            for k in range(i + 1, f):
                x[i] -= self.factors[k, i] * x[k]
        return x

    def inverse(self) -> Array:
        """Inverse matrices (n, f, f), poses first as matmul wants them."""
        f, n = len(self.factors), self.factors.shape[2]
        unit = np.repeat(np.eye(f)[:, :, None], n, axis=2)
        return np.ascontiguousarray(self.solve(unit).transpose(2, 0, 1))
