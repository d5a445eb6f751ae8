"""The mechanics of many poses at once: forces, energy gradient and Hessian of a platform on elastic constraints.

V = 1/2 sum k e^2 minus the work of the loads (docs/machine.md). With D_f the motion of a joint for a unit of the
free coordinate f, J_f = n . D_f and t = k e, the gradient is sum t J_f and the Hessian
sum (k - t/L) J_f J_g + t/L D_f . D_g + t n . d2(R m). A guide is a strut of infinite length: t/L is zero.

All arrays have poses last, so that every operation runs along contiguous memory; c constraints (struts, then
guides), s struts, f free coordinates, n poses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.machine import Array, Geometry, Machine

SMALLEST_PIVOT = 1e-9  # of a diagonal element: below it a coordinate is held by nothing
NEAR_REST = 1e-2  # of a strut's length: the geometric stiffness is left out where a residual is larger


@dataclass(frozen=True)
class Load:
    """A force (3, n) in the machine frame at a point (3, n) of the platform frame."""

    force_n: Array
    point_m: Array


@dataclass(frozen=True)
class Setting:
    """What a pose depends on besides itself: base ends (3, c, n), unstrained lengths (s, n), growth (n,), loads."""

    machine: Machine
    geometry: Geometry
    base_ends: Array
    free_length: Array
    platform_growth: Array
    loads: tuple[Load, ...]

    def take(self, rows: NDArray[np.intp]) -> Setting:
        """Some of the poses."""
        loads = tuple(Load(load.force_n[:, rows], load.point_m[:, rows]) for load in self.loads)
        return Setting(
            self.machine,
            self.geometry,
            self.base_ends[:, :, rows],
            self.free_length[:, rows],
            self.platform_growth[rows],
            loads,
        )


@dataclass(frozen=True)
class State:
    """Poses, not necessarily at rest.

    position (3, n); rotation (3, 3, n); lever (3, c, n): r = R m; direction (3, c, n): n; wrench (f, c, n): J; residual (c, n): e; force (c, n): t = k e;
    stiffness (c, 1); curvature (c, n): t / L; load_levers: R c of each load (3, n).
    """

    setting: Setting
    position: Array
    rotation: Array
    lever: Array
    direction: Array
    wrench: Array
    residual: Array
    force: Array
    stiffness: Array
    curvature: Array
    load_levers: tuple[Array, ...]

    @classmethod
    def at(cls, setting: Setting, p: Array, rotation: Array) -> State:
        """The state at positions (3, n) and rotations (3, 3, n)."""
        machine, geometry = setting.machine, setting.geometry
        joint = geometry.platform_joint_m
        if machine.guide_joint.size:
            joint = np.concatenate([joint, joint[machine.guide_joint]])
        lever = np.matmul(joint, rotation)
        lever *= setting.platform_growth
        v = lever + p[:, None]
        v -= setting.base_ends
        s = len(geometry.length_m)
        length = np.sqrt(v[0, :s] ** 2 + v[1, :s] ** 2 + v[2, :s] ** 2)
        residual = np.empty(v.shape[1:])
        residual[:s] = length - setting.free_length
        curvature = np.zeros_like(residual)
        curvature[:s] = residual[:s] / length
        if machine.guide_joint.size:
            residual[s:] = np.einsum("gi,ign->gn", geometry.guide_normal, v[:, s:])
            v[:, s:] = geometry.guide_normal.T[:, :, None]
        v[:, :s] /= length
        k = geometry.stiffness_n_per_m[:, None]
        levers = tuple(
            np.einsum("ijn,jn->in", rotation, load.point_m) * setting.platform_growth for load in setting.loads
        )
        wrench = np.stack([_turned_or_moved(int(c), v, lever) for c in machine.dof])
        return cls(setting, p, rotation, lever, v, wrench, residual, k * residual, k, k * curvature, levers)

    def gradient(self) -> Array:
        """dV over the free coordinates (f, n)."""
        g = np.einsum("cn,fcn->fn", self.force, self.wrench)
        for load, lever in zip(self.setting.loads, self.load_levers, strict=True):
            for row, c in enumerate(self.setting.machine.dof):
                g[row] -= _turned_or_moved(int(c), load.force_n, lever)
        return g

    def hessian(self) -> Array:
        """d2V over the free coordinates (f, f, n), symmetric.

        Far from rest (a residual beyond NEAR_REST) the Gauss-Newton part alone: positive whatever the residuals.
        """
        length_of_residual = np.max(np.abs(self.residual), axis=0)
        near = (length_of_residual < NEAR_REST * np.min(self.setting.geometry.length_m)).astype(float)
        curvature, force = self.curvature * near, self.force * near
        h = np.einsum("fcn,gcn->fgn", (self.stiffness - curvature) * self.wrench, self.wrench)
        dof = [int(c) for c in self.setting.machine.dof]
        for i, f in enumerate(dof):
            for j, g in enumerate(dof[: i + 1]):
                extra = self._bend(f, g, curvature, force)
                if f >= 3 and g >= 3:
                    for load, lever in zip(self.setting.loads, self.load_levers, strict=True):
                        extra = extra - near * _second(f - 3, g - 3, load.force_n, lever)
                h[i, j] += extra
                if i != j:
                    h[j, i] += extra
        return h

    def _bend(self, f: int, g: int, curvature: Array, force: Array) -> Array:
        """Geometric stiffness: sum t/L D_f . D_g + t n . d2(R m), f >= g."""
        r = self.lever
        if f < 3:
            return np.sum(curvature, axis=0) if f == g else np.zeros(curvature.shape[1])
        if g < 3:
            return np.einsum("cn,cn->n", curvature, _cross_component(f - 3, g, r))
        a, b = f - 3, g - 3
        dot = -r[a] * r[b]
        if a == b:
            dot += r[0] ** 2 + r[1] ** 2 + r[2] ** 2
        return np.einsum("cn,cn->n", curvature, dot) + np.einsum("cn,cn->n", force, _second(a, b, self.direction, r))

    def end_shift(self) -> Array:
        """W (f, 3, c, n): change of the gradient with a shift of a constraint's platform end."""
        w = (self.stiffness - self.curvature)[None, None] * self.wrench[:, None] * self.direction[None]
        for row, c in enumerate(self.setting.machine.dof):
            if c < 3:
                w[row, c] += self.curvature
            else:
                for i in range(3):
                    if i != c - 3:
                        w[row, i] += self.curvature * _cross_component(int(c) - 3, i, self.lever)
        return w


def _turned_or_moved(c: int, force: Array, lever: Array) -> Array:
    """The part of a force (3, ...) with lever (3, ...) that works on the coordinate c: force or moment."""
    if c < 3:
        return np.asarray(force[c])
    i, j = (c - 2) % 3, (c - 1) % 3
    return np.asarray(lever[i] * force[j] - lever[j] * force[i])


def _cross_component(axis: int, component: int, lever: Array) -> Array:
    """Component of e_axis x lever (zero where both are the same, which is not asked for)."""
    third = 3 - axis - component
    if axis == component:
        return np.zeros(lever.shape[1:])
    return np.asarray(-lever[third] if (component - axis) % 3 == 1 else lever[third])


def _second(a: int, b: int, force: Array, lever: Array) -> Array:
    """force . d2(R m) for turns about the axes a and b: symmetric part of r n^T - (r . n) I."""
    if a != b:
        return np.asarray(0.5 * (lever[a] * force[b] + lever[b] * force[a]))
    i, j = (a + 1) % 3, (a + 2) % 3
    return np.asarray(-(lever[i] * force[i] + lever[j] * force[j]))


@dataclass(frozen=True)
class Cholesky:
    """Lower factors (f, f, n) of symmetric matrices, and which of them are safely positive (n,)."""

    lower: Array
    positive: NDArray[np.bool_]

    @classmethod
    def of(cls, matrix: Array) -> Cholesky:
        """Factor matrices (f, f, n)."""
        f, n = matrix.shape[0], matrix.shape[2]
        lower = np.zeros_like(matrix)
        positive = np.ones(n, dtype=bool)
        for j in range(f):
            pivot = matrix[j, j] - np.einsum("kn,kn->n", lower[j, :j], lower[j, :j])
            positive &= pivot > SMALLEST_PIVOT * matrix[j, j]
            root = np.sqrt(np.where(positive, pivot, 1.0))
            lower[j, j] = root
            for i in range(j + 1, f):
                lower[i, j] = (matrix[i, j] - np.einsum("kn,kn->n", lower[i, :j], lower[j, :j])) / root
        return cls(lower, positive)

    def solve(self, right: Array) -> Array:
        """Solutions of right sides (f, ..., n)."""
        f = self.lower.shape[0]
        x = right.copy()
        for i in range(f):
            for k in range(i):
                x[i] -= self.lower[i, k] * x[k]
            x[i] /= self.lower[i, i]
        for i in reversed(range(f)):
            for k in range(i + 1, f):
                x[i] -= self.lower[k, i] * x[k]
            x[i] /= self.lower[i, i]
        return x
