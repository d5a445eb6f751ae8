"""One pose at a time, written from docs/reference/machine.md alone: gradient, stiffness, drives of sliders and legs.

Nothing is shared with the package: this is what one would write by hand to give scipy a residual with its Jacobian. In
extended precision it is the reference that all competitors are held against.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.peers.rig import Rig


def cross_matrix(v: Any) -> Any:
    """[v]x (3, 3)."""
    return np.array([[0.0 * v[0], -v[2], v[1]], [v[2], 0.0 * v[0], -v[0]], [-v[1], v[0], 0.0 * v[0]]])


def rotation(d: Any) -> Any:
    """exp [d]x, Rodrigues' formula."""
    angle = np.sqrt(d @ d)
    if angle < 1e-12:
        return np.eye(3, dtype=d.dtype) + cross_matrix(d)
    k = cross_matrix(d / angle)
    return np.eye(3, dtype=d.dtype) + np.sin(angle) * k + (1.0 - np.cos(angle)) * (k @ k)


def left_jacobian(d: Any) -> Any:
    """Left increment of exp [d]x for a change of d (3, 3)."""
    angle = np.sqrt(d @ d)
    k = cross_matrix(d)
    if angle < 1e-6:
        return np.eye(3) + 0.5 * k
    return np.eye(3) + (1.0 - np.cos(angle)) / angle**2 * k + (angle - np.sin(angle)) / angle**3 * (k @ k)


@dataclass
class Pose:
    """Statics of one pose of a rig: base ends (c, 3), unstrained lengths (c,), around a first rotation (3, 3)."""

    rig: Rig
    ends: Any
    lengths: Any
    first: Any

    def balance(self, x: Any) -> tuple[Any, Any]:
        """Gradient (f,) of the energy and its Jacobian (f, f) at p = x[:3], R = exp [x[3:]] R0; planar: x, y, rz."""
        full = np.zeros(6, dtype=x.dtype)
        full[self.rig.dof] = x
        turned = rotation(full[3:]) @ self.first
        r = self.rig.joints @ turned.T
        v = full[:3] + r - self.ends
        length = np.sqrt(np.sum(v * v, axis=1))
        n = v / length[:, None]
        t = self.rig.stiffness * (length - self.lengths)
        j = np.hstack([n, np.cross(r, n)])
        rho, weight = turned @ self.rig.centre, self.rig.weight
        gradient = t @ j
        gradient[:3] -= weight
        gradient[3:] -= np.cross(rho, weight)
        stiffness = self._stiffness(r, n, t, t / length, j)
        stiffness[3:, 3:] -= np.outer(rho, weight) - (rho @ weight) * np.eye(3)
        stiffness[:, 3:] = stiffness[:, 3:] @ left_jacobian(full[3:])
        return gradient[self.rig.dof], stiffness[np.ix_(self.rig.dof, self.rig.dof)]

    def _stiffness(self, r: Any, n: Any, t: Any, u: Any, j: Any) -> Any:
        moves = np.zeros((len(r), 3, 6), dtype=r.dtype)
        moves[:, :, :3] = np.eye(3)
        moves[:, 0, 4], moves[:, 0, 5], moves[:, 1, 5] = r[:, 2], -r[:, 1], r[:, 0]
        moves[:, 1, 3], moves[:, 2, 3], moves[:, 2, 4] = -r[:, 2], r[:, 1], -r[:, 0]
        flat = moves.reshape(-1, 6)
        out = (j * (self.rig.stiffness - u)[:, None]).T @ j + (flat * np.repeat(u, 3)[:, None]).T @ flat
        out[3:, 3:] += (r * t[:, None]).T @ n - np.sum(t[:, None] * r * n) * np.eye(3)
        return out

    def lengths_at(self, x: Any) -> Any:
        """Strut lengths (c,) at a pose."""
        full = np.zeros(6, dtype=x.dtype)
        full[self.rig.dof] = x
        v = full[:3] + self.rig.joints @ (rotation(full[3:]) @ self.first).T - self.ends
        return np.sqrt(np.sum(v * v, axis=1))

    def reference(self, x: Any) -> Any:
        """Rest in extended precision (f,): residuals in extended, corrections in double precision."""
        x = x.astype(np.longdouble)
        for _ in range(12):
            gradient, stiffness = self.balance(x)
            step = np.linalg.solve(stiffness.astype(float), gradient.astype(float))
            x = x - step
            if np.max(np.abs(step)) < 1e-17:
                break
        return x
