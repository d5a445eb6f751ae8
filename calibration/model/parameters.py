"""The machine's parameters: which errors a part may have, their tolerances, and their effect on the pose.

A parameter vector holds deviations from nominal: metres, radians, relative scale, ln of a stiffness ratio.
Its prior standard deviation is the tolerance divided by sqrt 3 (a uniform distribution's).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix, skew
from calibration.machine.description import Geometry, Machine, across
from calibration.machine.sensitivity import Sensitivity

UNITS = {
    "strut_length": "m",
    "platform_joint": "m",
    "base_joint": "m",
    "pivot": "m",
    "guide_position": "m",
    "guide_tilt": "rad",
    "axis_tilt": "rad",
    "drive_scale": "1",
    "ln_stiffness": "1",
}
KINDS = tuple(UNITS)
JOINTS = ("platform_joint", "base_joint")


@dataclass(frozen=True)
class MachineParameter:
    """One scalar unknown: its kind, the part (strut, guide plane, constraint or drive) and its direction.

    axis: 0 to 2 for a coordinate of a point, else -1. about (3,): the direction of a tilt, else zero.
    """

    name: str
    kind: str
    part: int
    axis: int
    about: tuple[float, float, float]
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
    parameters: tuple[MachineParameter, ...]

    @classmethod
    def of(cls, machine: Machine, kinds: Sequence[str] = KINDS) -> ParameterSet:
        """All parameters of the given kinds, in the order of KINDS and of the machine file."""
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
        length, scale, pivot = g.length_m.copy(), g.scale.copy(), g.pivot_m.copy()
        platform, base = g.platform_joint_m.copy(), g.base_joint_m.copy()
        ln_ratio, tilt = np.zeros(g.stiffness_n_per_m.size), np.zeros((scale.size, 3))
        offset, lean = np.zeros(len(g.guide_normal)), np.zeros((len(g.guide_normal), 3))
        for p, value in zip(self.parameters, theta, strict=True):
            match p.kind:
                case "strut_length":
                    length[p.part] += value
                case "platform_joint":
                    platform[p.part, p.axis] += value
                case "base_joint":
                    base[p.part, p.axis] += value
                case "pivot":
                    pivot[p.part, p.axis] += value
                case "guide_position":
                    offset[p.part] += value
                case "guide_tilt":
                    lean[p.part] += value * np.array(p.about)
                case "axis_tilt":
                    tilt[p.part] += value * np.array(p.about)
                case "drive_scale":
                    scale[p.part] *= 1.0 + value
                case "ln_stiffness":
                    ln_ratio[p.part] += value
        normal = np.einsum("gij,gj->gi", rotation_matrix(lean), g.guide_normal)
        return replace(
            g,
            length_m=length,
            platform_joint_m=platform,
            base_joint_m=base,
            pivot_m=pivot,
            stiffness_n_per_m=g.stiffness_n_per_m * np.exp(ln_ratio),
            axis=np.einsum("dij,dj->di", rotation_matrix(tilt), g.axis),
            scale=scale,
            guide_normal=normal,
            guide_point_m=g.guide_point_m + offset[:, None] * g.guide_normal,
        )

    def gradient_columns(self, at: Sensitivity) -> list[Array]:
        """dG (f, n) of every parameter at poses at rest."""
        joints: dict[tuple[str, int], Array] = {}
        return [self._joint_column(p, at, joints) if p.kind in JOINTS else self._column(p, at) for p in self.parameters]

    def _joint_column(self, p: MachineParameter, at: Sensitivity, cache: dict[tuple[str, int], Array]) -> Array:
        """A column of a joint: all axes of a joint are computed at once and kept in `cache`."""
        key = (p.kind, p.part)
        if key not in cache:
            cache[key] = at.platform_joint(p.part) if p.kind == "platform_joint" else at.base_joint(p.part)
        return cache[key][:, p.axis]

    def _column(self, p: MachineParameter, at: Sensitivity) -> Array:
        columns: dict[str, Callable[[], Array]] = {
            "strut_length": lambda: at.length(p.part),
            "pivot": lambda: at.pivot(p.part, p.axis),
            # The plane moves along its nominal normal, which may have been tilted since.
            "guide_position": lambda: (
                at.guide_position(p.part)
                * float(self.machine.nominal.guide_normal[p.part] @ at.geometry.guide_normal[p.part])
            ),
            "guide_tilt": lambda: at.guide_tilt(p.part, self._tilt_direction(p, at.geometry)),
            "axis_tilt": lambda: at.axis_tilt(p.part, self._tilt_direction(p, at.geometry)),
            "drive_scale": lambda: at.drive_scale(p.part) * self.machine.nominal.scale[p.part],
            "ln_stiffness": lambda: at.ln_stiffness(p.part),
        }
        return columns[p.kind]()

    def _tilt_direction(self, p: MachineParameter, geometry: Geometry) -> Array:
        """Direction (3,) about which a tilted part turns on with one of its tilts.

        Two tilts are one rotation vector t: the exponential's left Jacobian, 1 + [t]/2 + [t]^2/6, on the tilt's own.
        """
        nominal, now = self.machine.nominal, geometry
        before, after = (nominal.axis, now.axis) if p.kind == "axis_tilt" else (nominal.guide_normal, now.guide_normal)
        about = np.array(p.about)
        by_tilt = skew(skew(before[p.part]) @ after[p.part])
        once = by_tilt @ about
        return np.asarray(about + once / 2.0 + by_tilt @ once / 6.0)

    def shift_of_carried_point(self, at: Sensitivity, drive: int, point_m: Array) -> Array:
        """Derivative (n, 3, p) of the place of a point that a drive carries, with every parameter."""
        carrier = at.carriers[drive]
        out = np.zeros((carrier.base.size, 3, len(self)))
        for i, p in enumerate(self.parameters):
            if p.part != drive:
                continue
            if p.kind == "axis_tilt":
                out[:, :, i] = carrier.d_tilt(point_m, self._tilt_direction(p, at.geometry)).T
            elif p.kind == "pivot":
                out[:, :, i] = carrier.d_pivot()[:, p.axis].T
            elif p.kind == "drive_scale":
                per_unit = carrier.travel * self.machine.nominal.scale[drive] / at.geometry.scale[drive]
                out[:, :, i] = (carrier.d_travel(point_m) * per_unit).T
        return out


def _all_parameters(machine: Machine) -> list[MachineParameter]:
    return [*_strut_errors(machine), *_guide_and_drive_errors(machine), *_stiffness_errors(machine)]


def _machine_parameters_of_kind(
    kind: str, name: str, part: int, tolerance: float | None, axis: int = -1
) -> MachineParameter:
    return MachineParameter(f"{kind}.{name}", kind, part, axis, (0.0, 0.0, 0.0), tolerance or 0.0)


def _strut_errors(machine: Machine) -> Iterator[MachineParameter]:
    tol = machine.file.tolerances
    for i, name in enumerate(machine.strut_names):
        yield _machine_parameters_of_kind("strut_length", name, i, tol.strut_length_m)
    for kind, size in zip(JOINTS, (tol.platform_joint_m, tol.base_joint_m), strict=True):
        for i, name in enumerate(machine.strut_names):
            yield from _point_errors(machine, kind, name, i, size)


def _point_errors(
    machine: Machine, kind: str, name: str, part: int, tolerance: float | None
) -> Iterator[MachineParameter]:
    for axis in (0, 1) if machine.planar else (0, 1, 2):
        yield _machine_parameters_of_kind(kind, f"{name}.{'xyz'[axis]}", part, tolerance, axis)


def _guide_and_drive_errors(machine: Machine) -> Iterator[MachineParameter]:
    tol = machine.file.tolerances
    for a, name in enumerate(machine.drive_names):
        if machine.drive_kinds[a] == "crank":
            yield from _point_errors(machine, "pivot", name, a, tol.pivot_m)
    for g, name in enumerate(machine.guide_names):
        yield _machine_parameters_of_kind("guide_position", name, g, tol.guide_position_m)
    for g, name in enumerate(machine.guide_names):
        for label, about in _tilts(machine.guide_turns[g], machine.planar):
            yield _tilt("guide_tilt", f"{name}.{label}", g, about, tol.guide_tilt_rad)
    for a, name in enumerate(machine.drive_names):
        if machine.drive_kinds[a] != "leg":
            for label, about in _tilts(across(machine.nominal.axis[a]), machine.planar):
                yield _tilt("axis_tilt", f"{name}.{label}", a, about, tol.axis_tilt_rad)
    for a, name in enumerate(machine.drive_names):
        yield _machine_parameters_of_kind("drive_scale", name, a, tol.drive_scale)


def _tilt(kind: str, name: str, part: int, about: Array, tolerance: float | None) -> MachineParameter:
    turn = (float(about[0]), float(about[1]), float(about[2]))
    return MachineParameter(f"{kind}.{name}", kind, part, -1, turn, tolerance or 0.0)


def _stiffness_errors(machine: Machine) -> Iterator[MachineParameter]:
    for c, name in enumerate((*machine.strut_names, *machine.guide_names)):
        yield _machine_parameters_of_kind("ln_stiffness", name, c, machine.file.tolerances.ln_stiffness)


def _tilts(turns: Array, planar: bool) -> list[tuple[str, Array]]:
    """Names and directions of tilts: 'rx' along the machine's axis, else 't1', 't2'. In a plane only those about z."""
    out = []
    for number, about in enumerate(turns, start=1):
        along = int(np.argmax(np.abs(about)))
        aligned = abs(about[along]) > 1.0 - 1e-12
        if planar and not (aligned and along == 2):
            continue
        out.append(
            (f"r{'xyz'[along]}" if aligned else f"t{number}", about * np.sign(about[along]) if aligned else about)
        )
    return out
