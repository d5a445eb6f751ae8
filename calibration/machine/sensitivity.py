"""Derivatives of poses at rest by the implicit function theorem: dx = -K^-1 dG.

G is the gradient of the energy over the free coordinates, K its Hessian, geometric stiffness included. Rotations are
left increments. Each method gives dG for one kind of quantity; `pose_derivatives` turns columns of dG into
derivatives of the pose. Formulas: docs/explanation/method.md; n poses, f free coordinates. Poses that are not at rest
give NaN.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.machine.carriers import Carrier
from calibration.machine.description import Geometry, Machine
from calibration.machine.equilibrium import Conditions, Equilibrium, carriers_of, state_at
from calibration.machine.mechanics import Cholesky, MechanicalState, rotation_axes

_AXES = np.eye(3)


@dataclass(frozen=True)
class Sensitivity:
    """The state at rest, its factored stiffness and what moves the base ends. Poses last: dG columns are (f, n)."""

    machine: Machine
    geometry: Geometry
    conditions: Conditions
    state: MechanicalState
    stiffness: Cholesky
    carriers: list[Carrier]
    base_end_shift: Array  # W (f, 3, c, n)

    @classmethod
    def at_equilibrium(
        cls, machine: Machine, geometry: Geometry, drives: Array, at: Conditions, rest: Equilibrium
    ) -> Sensitivity:
        """At the poses of `rest`, which `solve` found for the same arguments."""
        state = state_at(machine, geometry, drives, at, rest.position_m, rest.rotation)
        stiffness = Cholesky.of(state.hessian(at_rest=True))
        carriers = carriers_of(machine, geometry, drives, at)
        return cls(machine, geometry, at, state, stiffness, carriers, state.end_shift())

    @cached_property
    def _negative_compliance(self) -> Array:
        """Inverse stiffnesses (n, f, f), negative: small matrices, applied to many columns at once."""
        return -self.stiffness.inverse()

    def pose_derivatives(self, columns: Sequence[Array]) -> Array:
        """Derivatives (n, f, k) of the free coordinates from k columns dG (f, n)."""
        if not columns:
            return np.empty((self.base_end_shift.shape[-1], len(self.machine.dof), 0))
        pulls = np.stack(columns, axis=1).transpose(2, 0, 1)
        return np.asarray(self._negative_compliance @ np.ascontiguousarray(pulls))

    def length(self, strut: int) -> Array:
        """dG per metre of a strut's length."""
        return -self.state.stiffness[strut] * self.state.wrench[:, strut] * self.conditions.factors["struts"]

    def platform_joint(self, strut: int) -> Array:
        """dG (f, 3, n) per metre of a strut's platform joint along each axis of the platform; guides on it included."""
        state = self.state
        out = np.zeros((len(self.machine.dof), 3, state.residual.shape[1]))
        guides = len(self.geometry.length_m) + np.flatnonzero(self.machine.guide_joint == strut)
        grown = state.rotation * self.conditions.factors["platform"]
        for c in (strut, *guides):
            out += np.einsum("fin,ian->fan", self.base_end_shift[:, :, c], grown)
            pull = state.force[c] * state.direction[:, c]
            for row, f in enumerate(self.machine.dof.tolist()):
                if f >= 3:
                    i, j = rotation_axes(f)
                    out[row] += grown[i] * pull[j] - grown[j] * pull[i]
        return out

    def base_end(self, constraint: int, shift: Array) -> Array:
        """dG for a shift (3, n) of the base end of a constraint."""
        return -np.einsum("fin,in->fn", self.base_end_shift[:, :, constraint], shift)

    def base_joint(self, strut: int) -> Array:
        """dG (f, 3, n) per metre of a strut's base joint along each axis of the frame of what carries it."""
        carrier = self.carriers[self.machine.strut_drive[strut]]
        if carrier.kind == "crank":
            return -np.einsum("fin,ian->fan", self.base_end_shift[:, :, strut], carrier.d_point())
        return self.base_end_shift[:, :, strut] * -carrier.base

    def pivot(self, drive: int, axis: int) -> Array:
        """dG per metre of a crank's pivot."""
        return self._joint_shift_columns(drive, [self.carriers[drive].d_pivot()[:, axis]] * len(self._struts(drive)))

    def axis_tilt(self, drive: int, direction: Array) -> Array:
        """dG per radian of a turn of a drive's axis about a direction (3,)."""
        carrier, joints = self.carriers[drive], self.geometry.base_joint_m[self._struts(drive)]
        return self._joint_shift_columns(drive, [carrier.d_tilt(joint, direction) for joint in joints])

    def travel(self, drive: int) -> Array:
        """dG per metre (radian) of a drive's travel Q."""
        if self.machine.drive_kinds[drive] == "leg":
            struts = self._struts(drive)
            return -np.einsum("c,fcn->fn", self.geometry.stiffness_n_per_m[struts], self.state.wrench[:, struts])
        carrier, joints = self.carriers[drive], self.geometry.base_joint_m[self._struts(drive)]
        return self._joint_shift_columns(drive, [carrier.d_travel(joint) for joint in joints])

    def drives(self) -> Array:
        """Derivatives (n, f, d) of the free coordinates with the drive coordinates."""
        per_unit = [self.geometry.scale[a] * self._growth(a) for a in range(len(self.machine.drive_names))]
        return self.pose_derivatives([self.travel(a) * per_unit[a] for a in range(len(per_unit))])

    def drive_scale(self, drive: int) -> Array:
        """dG per unit of a drive's scale."""
        return self.travel(drive) * self.carriers[drive].travel / self.geometry.scale[drive]

    def guide_position(self, plane: int) -> Array:
        """dG per metre of a guide plane's place along its normal."""
        c = len(self.geometry.length_m) + plane
        return -self.state.stiffness[c] * self.state.wrench[:, c] * self.conditions.factors["base"]

    def guide_tilt(self, plane: int, direction: Array) -> Array:
        """dG per radian of a turn of a guide plane's normal about a direction (3,), through its point."""
        c = len(self.geometry.length_m) + plane
        turned = np.cross(direction, self.geometry.guide_normal[plane])
        lever = self.state.lever[:, c]
        v = lever + self.state.position - self.state.structure.base_ends[:, c]
        out = self.state.stiffness[c] * (turned @ v) * self.state.wrench[:, c]
        for row, f in enumerate(self.machine.dof):
            moved = (
                np.outer(_AXES[f], np.ones_like(self.conditions.factors["base"]))
                if f < 3
                else np.cross(_AXES[f - 3], lever.T).T
            )
            out[row] += self.state.force[c] * (turned @ moved)
        return out

    def ln_stiffness(self, constraint: int) -> Array:
        """dG per unit of the logarithm of a stiffness."""
        return self.state.force[constraint] * self.state.wrench[:, constraint]

    def force(self, force_n: Array, point_m: Array) -> Array:
        """dG for a force (3, n) more at a point (3, n) of the platform frame."""
        lever = np.einsum("ijn,jn->in", self.state.rotation, point_m) * self.conditions.factors["platform"]
        turned = np.cross(lever.T, force_n.T).T
        return -np.concatenate([force_n, turned])[self.machine.dof]

    def mass(self, index: int) -> Array:
        """dG per kilogram of a mass of the conditions."""
        _, com = self.conditions.masses[index]
        gravity = np.repeat(self.machine.gravity_m_per_s2[:, None], len(com), axis=1)
        return self.force(gravity, com.T)

    def centre_of_mass(self, index: int, axis: int) -> Array:
        """dG per metre of a mass's place along an axis of the platform."""
        mass, com = self.conditions.masses[index]
        weight = self.machine.gravity_m_per_s2[:, None] * mass
        shifted = np.zeros_like(com)
        shifted[:, axis] = 1.0
        out = self.force(weight, shifted.T)
        out[self.machine.dof < 3] = 0.0
        return out

    def growth(self, part: str) -> Array:
        """dG per unit of a part's thermal length factor, all its dimensions together."""
        out = np.zeros(self.state.wrench[:, 0].shape)
        machine, geometry = self.machine, self.geometry
        for i, a in enumerate(machine.strut_drive):
            if part == "struts":
                out += self.length(i) * geometry.length_m[i] / self.conditions.factors["struts"]
            elif part == "platform":
                out += (
                    np.einsum("fan,a->fn", self.platform_joint(i), geometry.platform_joint_m[i])
                    / self.conditions.factors[part]
                )
            else:
                out += self._base_growth(part, i, int(a))
        if part == "platform":
            weights = [(np.outer(machine.gravity_m_per_s2, mass), com.T) for mass, com in self.conditions.masses]
            for force_n, point_m in weights + [(force.T, point.T) for force, point in self.conditions.forces]:
                moment = self.force(force_n, point_m) / self.conditions.factors[part]
                moment[machine.dof < 3] = 0.0  # a point that moves on the platform turns it only
                out += moment
        if part == "base":
            for c, point in enumerate(geometry.guide_point_m, start=len(geometry.length_m)):
                out += self.base_end(c, np.repeat(point[:, None], self.conditions.factors[part].size, axis=1))
        return out

    def _base_growth(self, part: str, strut: int, drive: int) -> Array:
        carrier = self.carriers[drive]
        if carrier.kind == "leg" and part == "drives":
            return self.travel(drive) * carrier.travel / carrier.thermal_factor
        return self.base_end(strut, carrier.d_growth(self.geometry.base_joint_m[strut], part))

    def _growth(self, drive: int) -> Array:
        grown = self.carriers[drive].thermal_factor
        return np.ones_like(grown) if self.machine.drive_kinds[drive] == "crank" else grown

    def _struts(self, drive: int) -> NDArray[np.intp]:
        return np.flatnonzero(self.machine.strut_drive == drive)

    def _joint_shift_columns(self, drive: int, shifts: Sequence[Array]) -> Array:
        """dG when the joints of a drive's struts move by shifts (3, n)."""
        total = np.zeros(self.state.wrench[:, 0].shape)
        for strut, shift in zip(self._struts(drive), shifts, strict=True):
            total += self.base_end(int(strut), shift)
        return total
