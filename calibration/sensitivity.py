"""Derivatives of poses at rest by the implicit function theorem: dx = -K^-1 dG.

G is the gradient of the energy over the free coordinates, K its Hessian, geometric stiffness included. Rotations are
left increments. Each method gives dG for one kind of quantity; `respond` turns columns of dG into derivatives of
the pose. Formulas: docs/method.md; n poses, f free coordinates. Poses that are not at rest give NaN.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from calibration.carriers import Carrier
from calibration.equilibrium import Conditions, Equilibrium, carriers_of, state_at
from calibration.machine import Array, Geometry, Machine
from calibration.mechanics import Cholesky, State

_AXES = np.eye(3)


@dataclass(frozen=True)
class Sensitivity:
    """The state at rest, its factored stiffness and what moves the base ends. Poses last: dG columns are (f, n)."""

    machine: Machine
    geometry: Geometry
    at: Conditions
    state: State
    stiffness: Cholesky
    carriers: list[Carrier]
    shift: Array  # W (f, 3, c, n)

    @classmethod
    def of(cls, machine: Machine, geometry: Geometry, drives: Array, at: Conditions, rest: Equilibrium) -> Sensitivity:
        """At the poses of `rest`, which `solve` found for the same arguments."""
        state = state_at(machine, geometry, drives, at, rest.position_m, rest.rotation)
        stiffness = Cholesky.of(state.hessian())
        carriers = carriers_of(machine, geometry, drives, at)
        return cls(machine, geometry, at, state, stiffness, carriers, state.end_shift())

    def respond(self, columns: list[Array]) -> Array:
        """Derivatives (n, f, k) of the free coordinates from k columns dG (f, n)."""
        if not columns:
            return np.empty((self.shift.shape[-1], len(self.machine.dof), 0))
        answer = self.stiffness.solve(np.stack(columns, axis=1))
        return np.ascontiguousarray(-answer.transpose(2, 0, 1))

    def length(self, strut: int) -> Array:
        """dG per metre of a strut's length."""
        return -self.state.stiffness[strut] * self.state.wrench[:, strut] * self.at.factors["struts"]

    def platform_joint(self, strut: int, axis: int) -> Array:
        """dG per metre of a strut's platform joint along an axis of the platform; guides that hold it included."""
        column = self.state.rotation[:, axis] * self.at.factors["platform"]
        out = np.zeros(self.state.wrench[:, 0].shape)
        guides = len(self.geometry.length_m) + np.flatnonzero(self.machine.guide_joint == strut)
        for c in (strut, *guides):
            out += np.einsum("fin,in->fn", self.shift[:, :, c], column)
            for row, f in enumerate(self.machine.dof):
                if f >= 3:
                    turned = np.cross(_AXES[f - 3], column.T).T
                    out[row] += self.state.force[c] * np.einsum("in,in->n", self.state.direction[:, c], turned)
        return out

    def base_end(self, constraint: int, shift: Array) -> Array:
        """dG for a shift (3, n) of the base end of a constraint."""
        return -np.einsum("fin,in->fn", self.shift[:, :, constraint], shift)

    def base_joint(self, strut: int, axis: int) -> Array:
        """dG per metre of a strut's base joint, in the frame of what carries it."""
        return self.base_end(strut, self.carriers[self.machine.strut_drive[strut]].d_point()[:, axis])

    def pivot(self, drive: int, axis: int) -> Array:
        """dG per metre of a crank's pivot."""
        return self._carried(drive, lambda _: self.carriers[drive].d_pivot()[:, axis])

    def axis_tilt(self, drive: int, about: Array) -> Array:
        """dG per radian of a turn of a drive's axis about a direction (3,)."""
        return self._carried(drive, lambda joint: self.carriers[drive].d_tilt(joint, about))

    def travel(self, drive: int) -> Array:
        """dG per metre (radian) of a drive's travel Q."""
        if self.machine.drive_kinds[drive] == "leg":
            total = np.zeros(self.state.wrench[:, 0].shape)
            for strut in np.flatnonzero(self.machine.strut_drive == drive):
                total -= self.state.stiffness[strut] * self.state.wrench[:, strut]
            return total
        return self._carried(drive, lambda joint: self.carriers[drive].d_travel(joint))

    def drives(self) -> Array:
        """Derivatives (n, f, d) of the free coordinates with the drive coordinates."""
        per_unit = [self.geometry.scale[a] * self._growth(a) for a in range(len(self.machine.drive_names))]
        return self.respond([self.travel(a) * per_unit[a] for a in range(len(per_unit))])

    def drive_scale(self, drive: int) -> Array:
        """dG per unit of a drive's scale."""
        return self.travel(drive) * self.carriers[drive].travel / self.geometry.scale[drive]

    def guide_position(self, plane: int) -> Array:
        """dG per metre of a guide plane's place along its normal."""
        c = len(self.geometry.length_m) + plane
        return -self.state.stiffness[c] * self.state.wrench[:, c] * self.at.factors["base"]

    def guide_tilt(self, plane: int, about: Array) -> Array:
        """dG per radian of a turn of a guide plane's normal about a direction (3,), through its point."""
        c = len(self.geometry.length_m) + plane
        turned = np.cross(about, self.geometry.guide_normal[plane])
        lever = self.state.lever[:, c]
        v = lever + self.state.position - self.state.setting.base_ends[:, c]
        out = self.state.stiffness[c] * (turned @ v) * self.state.wrench[:, c]
        for row, f in enumerate(self.machine.dof):
            moved = (
                np.outer(_AXES[f], np.ones_like(self.at.factors["base"]))
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
        lever = np.einsum("ijn,jn->in", self.state.rotation, point_m) * self.at.factors["platform"]
        turned = np.cross(lever.T, force_n.T).T
        return -np.concatenate([force_n, turned])[self.machine.dof]

    def mass(self, index: int) -> Array:
        """dG per kilogram of a mass of the conditions."""
        _, com = self.at.masses[index]
        gravity = np.repeat(self.machine.gravity_m_per_s2[:, None], len(com), axis=1)
        return self.force(gravity, com.T)

    def centre_of_mass(self, index: int, axis: int) -> Array:
        """dG per metre of a mass's place along an axis of the platform."""
        mass, com = self.at.masses[index]
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
                out += self.length(i) * geometry.length_m[i] / self.at.factors["struts"]
            elif part == "platform":
                for axis in range(3):
                    if geometry.platform_joint_m[i, axis] != 0.0:
                        out += self.platform_joint(i, axis) * geometry.platform_joint_m[i, axis] / self.at.factors[part]
            else:
                out += self._base_growth(part, i, int(a))
        if part == "platform":
            for index, (_, com) in enumerate(self.at.masses):
                for axis in range(3):
                    out += self.centre_of_mass(index, axis) * com[:, axis] / self.at.factors[part]
        if part == "base":
            for c, point in enumerate(geometry.guide_point_m, start=len(geometry.length_m)):
                out += self.base_end(c, np.repeat(point[:, None], out.shape[1], axis=1))
        return out

    def _base_growth(self, part: str, strut: int, drive: int) -> Array:
        carrier = self.carriers[drive]
        if carrier.kind == "leg" and part == "drives":
            return self.travel(drive) * carrier.travel / carrier.grown
        return self.base_end(strut, carrier.d_growth(self.geometry.base_joint_m[strut], part))

    def _growth(self, drive: int) -> Array:
        grown = self.carriers[drive].grown
        return np.ones_like(grown) if self.machine.drive_kinds[drive] == "crank" else grown

    def _carried(self, drive: int, shift: Callable[[Array], Array]) -> Array:
        """dG when every joint of a drive moves by shift(joint) (3, n)."""
        struts = np.flatnonzero(self.machine.strut_drive == drive)
        total = np.zeros(self.state.wrench[:, 0].shape)
        for i in struts:
            total += self.base_end(int(i), shift(self.geometry.base_joint_m[i]))
        return total
