"""Any shipped machine with errors drawn from its tolerances, and its tool error with neither frame nor tool offset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix, rotation_vector, skew
from calibration.machine.description import Machine, load_machine, shipped_machine
from calibration.machine.inverse import nominal_drives, platform_poses
from calibration.model.model import Model
from calibration.model.operating_conditions import OperatingConditions
from calibration.model.parameters import ParameterSet

LEVER_M = 0.3


@dataclass(frozen=True)
class DrawnMachine:
    """The truth of one seed. `base` and `tool`: rotations (3, 3) and shifts (3,) that fit it to its commands best."""

    model: Model
    truth: Array
    base: tuple[Array, Array]
    tool: tuple[Array, Array]

    @classmethod
    def of(cls, name: str, seed: int) -> DrawnMachine:
        machine = load_machine(shipped_machine(name))
        model = Model(ParameterSet.of(machine))
        tolerance = np.array([p.tolerance for p in model.parameters.parameters])
        truth = np.random.default_rng([seed, 15]).uniform(-1.0, 1.0, tolerance.size) * tolerance
        still = (np.eye(3), np.zeros(3))
        drawn = cls(model, truth, still, still)
        target = drawn.targets(300, seed)
        for _ in range(4):
            drawn = drawn._fitted(target)
        return drawn

    @property
    def machine(self) -> Machine:
        return self.model.machine

    def load(self, mass_kg: float = 0.0) -> OperatingConditions:
        case = self.machine.load_cases[-1].centre_of_mass_m if self.machine.load_cases else (0.0, -0.2, 0.0)
        warm = dict.fromkeys(self.machine.sensors.values(), self.machine.reference_temperature_c)
        return OperatingConditions(mass_kg, case, warm)

    def targets(self, count: int, seed: int) -> Array:
        low, high = self.machine.commanded_limits.T
        return platform_poses(self.machine, np.random.default_rng([seed, 16]).uniform(low, high, (count, len(low))))

    def tool_error(self, drives: Array, target: Array, load: OperatingConditions) -> Array:
        """Error (n, 6) of tool point and orientation against platform poses (n, 6)."""
        poses = self.model.predict(self.truth, load.at_poses(drives, target))
        rotation = self.base[0] @ poses.equilibrium.rotation @ self.tool[0]
        lever = poses.equilibrium.rotation @ (self.tool[1] + self.machine.tool_point_m)
        tool = (poses.equilibrium.position_m + lever) @ self.base[0].T + self.base[1]
        wanted = rotation_matrix(target[:, 3:])
        point = target[:, :3] + wanted @ self.machine.tool_point_m
        return np.concatenate([tool - point, rotation_vector(rotation @ wanted.transpose(0, 2, 1))], axis=1)

    def tool_error_free(self):
        """The error without load as a function of drives and targets."""
        return lambda drives, target: self.tool_error(drives, target, self.load())

    def _fitted(self, target: Array) -> DrawnMachine:
        """One step of the least-squares fit of frame and tool offset, without load."""
        error = self.tool_error(nominal_drives(self.machine, target), target, self.load())
        wanted = rotation_matrix(target[:, 3:])
        point = target[:, :3] + wanted @ self.machine.tool_point_m
        free = np.isin(np.arange(6), self.machine.commanded)
        weight = np.where(np.arange(6) < 3, 1.0, LEVER_M) * free
        n = len(target)
        gauge = np.zeros((n, 6, 12))
        gauge[:, :3, :3] = np.eye(3)
        gauge[:, :3, 3:6] = -skew(point)
        gauge[:, 3:, 3:6] = np.eye(3)
        gauge[:, :3, 6:9] = wanted
        gauge[:, 3:, 9:] = wanted
        x = np.linalg.lstsq((gauge * weight[:, None]).reshape(-1, 12), -(error * weight).ravel(), rcond=1e-9)[0]
        turn = rotation_matrix(x[None, 3:6])[0]
        base = (turn @ self.base[0], turn @ self.base[1] + x[:3])
        tool = (self.tool[0] @ rotation_matrix(x[None, 9:])[0], self.tool[1] + self.tool[0] @ x[6:9])
        return DrawnMachine(self.model, self.truth, base, tool)
