"""What every competitor gets: one machine with errors, its drives, and commanded poses to start from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix
from calibration.machine import equilibrium
from calibration.machine.description import Geometry, Machine, load_machine, shipped_machine
from calibration.machine.equilibrium import Conditions, Equilibrium
from calibration.machine.inverse import drives_for
from calibration.model.parameters import ParameterSet


def targets(machine: Machine, n: int, seed: int) -> tuple[Array, Array]:
    """Random tool poses of the workspace (n, 6), and the drives (n, d) that bring the nominal machine there."""
    low, high = machine.workspace.T
    wanted = np.tile(machine.workspace.mean(axis=1), (n, 1))
    commanded = machine.commanded
    wanted[:, commanded] = np.random.default_rng(seed).uniform(low, high, (n, 6))[:, commanded]
    return wanted, drives_for(machine, machine.nominal, wanted)[0]


@dataclass(frozen=True)
class Rig:
    """A machine without guides, with random errors as large as its tolerances, carrying its own mass; n poses."""

    machine: Machine
    geometry: Geometry
    drives: Array
    start: Array

    @classmethod
    def of(cls, name: str, n: int, seed: int = 1) -> Rig:
        """A shipped machine; `start` (n, 6) are the poses that were commanded."""
        machine = load_machine(shipped_machine(name))
        parameters = ParameterSet.of(machine)
        tolerance = np.array([p.tolerance for p in parameters.parameters])
        errors = np.random.default_rng(seed).uniform(-1.0, 1.0, len(tolerance)) * tolerance
        wanted, drives = targets(machine, n, seed)
        start = wanted.copy()
        start[:, :3] -= rotation_matrix(wanted[:, 3:]) @ machine.tool_point_m
        return cls(machine, parameters.geometry(errors), drives, start)

    @property
    def dof(self) -> Array:
        """Free coordinates."""
        return self.machine.dof

    @property
    def joints(self) -> Array:
        """Platform joints (c, 3)."""
        return self.geometry.platform_joint_m

    @property
    def stiffness(self) -> Array:
        """Stiffnesses (c,)."""
        return self.geometry.stiffness_n_per_m

    @property
    def centre(self) -> Array:
        """Centre of mass (3,)."""
        return self.machine.centre_of_mass_m

    @property
    def weight(self) -> Array:
        """Weight (3,)."""
        return self.machine.moving_mass_kg * self.machine.gravity_m_per_s2

    @property
    def conditions(self) -> Conditions:
        """No payload, reference temperature."""
        return equilibrium.make_conditions(self.machine, len(self.drives))

    def solve(self) -> Equilibrium:
        """What is measured of this package."""
        return equilibrium.solve(self.machine, self.geometry, self.drives, self.conditions, self.start)

    def ends(self, pose: int) -> tuple[Array, Array]:
        """Base ends (c, 3) and unstrained lengths (c,) at one pose's drives (docs/reference/machine.md, Drives)."""
        ends, lengths = self.geometry.base_joint_m.copy(), self.geometry.length_m.copy()
        for strut, a in enumerate(self.machine.strut_drive):
            travel = self.geometry.scale[a] * self.drives[pose, a]
            if self.machine.drive_kinds[a] == "leg":
                lengths[strut] += travel
            else:
                ends[strut] += travel * self.geometry.axis[a]
        return ends, lengths

    def part(self, n: int) -> Rig:
        """The first n poses."""
        return Rig(self.machine, self.geometry, self.drives[:n], self.start[:n])
