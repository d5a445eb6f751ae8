"""The machine's unknowns: which errors a part may have, how large, and what each does to the pose.

A parameter vector holds deviations from nominal: metres, radians, relative scale, ln of a stiffness ratio.
Its prior standard deviation is the tolerance divided by sqrt 3 (a uniform distribution's).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.equilibrium import Conditions, PoseDerivatives, rotation_matrix
from calibration.machine import Array, Geometry, Machine

KINDS = ("strut_length", "platform_joint", "base_joint", "axis_tilt", "drive_scale", "ln_stiffness")
UNITS = {
    "strut_length": "m",
    "platform_joint": "m",
    "base_joint": "m",
    "axis_tilt": "rad",
    "drive_scale": "1",
    "ln_stiffness": "1",
}


@dataclass(frozen=True)
class Parameter:
    """One scalar unknown: its kind, the part (strut or drive index) and the axis (0 to 2, or -1)."""

    name: str
    kind: str
    part: int
    axis: int
    tolerance: float

    @property
    def unit(self) -> str:
        """SI unit, '1' for a ratio."""
        return UNITS[self.kind]

    @property
    def sigma(self) -> float:
        """Prior standard deviation."""
        return self.tolerance / np.sqrt(3.0)


@dataclass(frozen=True)
class ParameterSet:
    """An ordered choice of unknowns of one machine."""

    machine: Machine
    parameters: tuple[Parameter, ...]

    @classmethod
    def of(cls, machine: Machine, kinds: Sequence[str] = KINDS) -> ParameterSet:
        """All parameters of the given kinds, in the order of the machine file."""
        return cls(machine, tuple(p for p in _all_parameters(machine) if p.kind in kinds))

    def __len__(self) -> int:
        return len(self.parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """Names such as 'strut_length.left_upper' or 'platform_joint.left_upper.x'."""
        return tuple(p.name for p in self.parameters)

    @property
    def sigma(self) -> Array:
        """Prior standard deviations (p,)."""
        return np.array([p.sigma for p in self.parameters])

    def rows(self, kind: str) -> NDArray[np.intp]:
        """Indices of the parameters of one kind."""
        return np.array([i for i, p in enumerate(self.parameters) if p.kind == kind], dtype=np.intp)

    def geometry(self, theta: Array) -> Geometry:
        """The geometry with the deviations theta (p,) applied to nominal."""
        g = self.machine.nominal
        length, scale = g.length_m.copy(), g.scale.copy()
        platform, base = g.platform_joint_m.copy(), g.base_joint_m.copy()
        ln_ratio, tilt = np.zeros(length.size), np.zeros((scale.size, 3))
        for p, value in zip(self.parameters, theta, strict=True):
            match p.kind:
                case "strut_length":
                    length[p.part] += value
                case "platform_joint":
                    platform[p.part, p.axis] += value
                case "base_joint":
                    base[p.part, p.axis] += value
                case "axis_tilt":
                    tilt[p.part, p.axis] += value
                case "drive_scale":
                    scale[p.part] *= 1.0 + value
                case "ln_stiffness":
                    ln_ratio[p.part] += value
        axis = np.einsum("dij,dj->di", rotation_matrix(tilt), g.axis)
        return replace(
            g,
            length_m=length,
            platform_joint_m=platform,
            base_joint_m=base,
            stiffness_n_per_m=g.stiffness_n_per_m * np.exp(ln_ratio),
            axis=axis,
            scale=scale,
        )

    def slide_derivative(self, geometry: Geometry, drives_m: Array, at: Conditions) -> Array:
        """Shift of each slider with each parameter (n, d, 3, p); non-zero for tilts and scales only."""
        travel = drives_m * geometry.scale * at.factors["drives"][:, None]
        out = np.zeros((*travel.shape, 3, len(self)))
        for i, p in enumerate(self.parameters):
            if p.kind == "axis_tilt":
                turned = np.cross(np.eye(3)[p.axis], geometry.axis[p.part])
                out[:, p.part, :, i] = travel[:, p.part, None] * turned
            elif p.kind == "drive_scale":
                relative = self.machine.nominal.scale[p.part] / geometry.scale[p.part]
                out[:, p.part, :, i] = travel[:, p.part, None] * geometry.axis[p.part] * relative
        return out

    def pose_jacobian(self, d: PoseDerivatives, slide: Array) -> Array:
        """Derivative of the free coordinates with each parameter (n, f, p).

        d: `equilibrium.derivatives`; slide: `slide_derivative`.
        """
        out = np.einsum("nfac,nacp->nfp", d.slide, slide)
        for i, p in enumerate(self.parameters):
            match p.kind:
                case "strut_length":
                    out[:, :, i] = d.length[:, :, p.part]
                case "platform_joint":
                    out[:, :, i] = d.platform_joint[:, :, p.part, p.axis]
                case "base_joint":
                    out[:, :, i] = d.base_joint[:, :, p.part, p.axis]
                case "ln_stiffness":
                    out[:, :, i] = d.ln_stiffness[:, :, p.part]
        return out


def _all_parameters(machine: Machine) -> list[Parameter]:
    tol = machine.file.tolerances
    moves = [int(c) for c in machine.dof if c < 3]
    turns = [int(c) - 3 for c in machine.dof if c >= 3]
    out: list[Parameter] = []
    for i, name in enumerate(machine.strut_names):
        out.append(Parameter(f"strut_length.{name}", "strut_length", i, -1, tol.strut_length_m))
    for kind, size in (("platform_joint", tol.platform_joint_m), ("base_joint", tol.base_joint_m)):
        for i, name in enumerate(machine.strut_names):
            out += [Parameter(f"{kind}.{name}.{'xyz'[c]}", kind, i, c, size) for c in moves]
    for a, name in enumerate(machine.drive_names):
        out += [
            Parameter(f"axis_tilt.{name}.r{'xyz'[c]}", "axis_tilt", a, c, tol.axis_tilt_rad)
            for c in turns
            if abs(machine.nominal.axis[a, c]) < 0.999
        ]
    for a, name in enumerate(machine.drive_names):
        out.append(Parameter(f"drive_scale.{name}", "drive_scale", a, -1, tol.drive_scale))
    for i, name in enumerate(machine.strut_names):
        out.append(Parameter(f"ln_stiffness.{name}", "ln_stiffness", i, -1, tol.ln_stiffness))
    return out
