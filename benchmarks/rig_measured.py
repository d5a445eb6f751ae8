"""One rig of the rig study: a machine with its true errors, where it stands, and what is read of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.stats import qmc

from benchmarks.rig_settings import Study
from benchmarks.rig_truth import Array, Payload, deviations, draw_errors, generator, plant_of
from calibration.base.rotation import rotation_matrix, rotation_vector, skew
from calibration.identification.rigid.closure import MeasuredPoses
from calibration.machine.description import Machine, load_machine
from calibration.machine.inverse import nominal_drives
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits


def measured_targets(machine: Machine, count: int) -> Array:
    """Platform poses (n, 6) to measure: a square grid of a planar machine, scrambled Sobol points of a spatial one."""
    free = np.flatnonzero(np.ptp(machine.workspace, axis=1) > 0.0)
    if len(free) == 2:
        side = round(np.sqrt(count))
        steps = np.linspace(0.0, 1.0, side)
        share = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    else:
        share = qmc.Sobol(len(free), seed=20260101).random(count)
    return _platform(machine, free, share)


def _platform(machine: Machine, free: NDArray[np.intp], share: Array) -> Array:
    """Platform poses (n, 6) whose tool is at shares (n, k) of the workspace's ranges."""
    pose = np.tile(machine.workspace[:, 0], (len(share), 1))
    pose[:, free] += share * np.ptp(machine.workspace, axis=1)[free]
    pose[:, :3] -= rotation_matrix(pose[:, 3:]) @ machine.tool_point_m
    return pose


@dataclass(frozen=True)
class Rig:
    """A machine with its true errors, by name."""

    study: Study
    seed: int
    machine: Machine
    errors: Mapping[str, float]
    _stood: dict[tuple[object, ...], Array] = field(default_factory=dict)  # truths found before: cases share poses

    @classmethod
    def from_seed(cls, study: Study, seed: int) -> Rig:
        """The rig of a seed. Refuses priors that are narrower than the draw or know other errors."""
        machine = load_machine(study.path)
        parameters, sizes = ParameterSet.of(machine), deviations(study.path)
        if set(parameters.names) != set(sizes):
            raise AssertionError("the model and the truth have different errors")
        if np.any(parameters.sigma < np.array([sizes[name] for name in parameters.names]) * (1.0 - 1e-12)):
            raise AssertionError("a prior is narrower than the draw")
        return cls(study, seed, machine, draw_errors(study.path, seed))

    @property
    def coordinates(self) -> tuple[int, ...]:
        """What is measured: all free coordinates."""
        return tuple(int(c) for c in self.machine.dof)

    @property
    def sigma(self) -> Array:
        """Standard deviations of one reading's coordinates."""
        return np.where(self.machine.dof < 3, self.study.sigma_m, self.study.sigma_rad)

    def visits(self, target_m: Array, kg: float) -> Visits:
        """Visits of targets with a stated payload."""
        drives = nominal_drives(self.machine, target_m)
        return Visits.at_reference_temperature(self.machine, drives, target_m, kg, self.study.payload_com_m)

    def truth(self, visits: Visits, off: Mapping[str, float]) -> Array:
        """True tool point and rotation vector (v, 6) of visits whose payload is off by named errors."""
        stated = self.study.payload_com_m
        x, y, z = (stated[i] + off.get(f"payload.com.{'xyz'[i]}", 0.0) for i in range(3))
        out = np.empty((len(visits), 6))
        plant = plant_of(self.study.path)
        for kg in np.unique(visits.payload_kg):
            rows = visits.payload_kg == kg
            payload = Payload(float(kg) * (1.0 + off.get("payload.mass", 0.0)), (x, y, z))
            if payload.kg == 0.0:
                payload = Payload(0.0, stated)
            key = (payload, visits.drives[rows].tobytes())
            if key not in self._stood:
                self._stood[key] = plant.tool(self.errors, visits.drives[rows], visits.target_m[rows], payload)
            out[rows] = self._stood[key]
        return out

    def measured(self, true: Array, rng: np.random.Generator) -> Array:
        """Readings (v, 6) of true tool coordinates; errors of rotations act on the left."""
        noise = np.zeros_like(true)
        noise[:, self.machine.dof] = rng.standard_normal((len(true), len(self.machine.dof))) * self.sigma
        turned = rotation_matrix(noise[:, 3:]) @ rotation_matrix(true[:, 3:])
        return np.concatenate([true[:, :3] + noise[:, :3], rotation_vector(turned)], axis=1)

    def visits_of_all(self, target: Array, loads: tuple[float, ...]) -> Visits:
        """Visits of all targets with one stated payload after the other."""
        visits = self.visits(target, loads[0])
        for kg in loads[1:]:
            visits = visits.concatenate(self.visits(target, kg))
        return visits

    def held_out(self) -> Array:
        """Random platform poses (n, 6) of the workspace, of this rig only."""
        free = np.flatnonzero(np.ptp(self.machine.workspace, axis=1) > 0.0)
        rng = generator(f"held out {self.machine.name}", self.seed)
        return _platform(self.machine, free, rng.random((self.study.held_out, len(free))))

    def platform_measured(self, visits: Visits, value: Array) -> MeasuredPoses:
        """Readings as poses of the platform origin, with their covariances: an error of rotation moves the origin."""
        lever = rotation_matrix(value[:, 3:]) @ self.machine.tool_point_m
        pose = np.concatenate([value[:, :3] - lever, value[:, 3:]], axis=1)
        moved = np.tile(np.eye(6), (len(value), 1, 1))
        moved[:, :3, 3:] = skew(lever)
        free = moved[:, self.machine.dof][:, :, self.machine.dof]
        return MeasuredPoses(visits, pose, free @ np.diag(self.sigma**2) @ free.transpose(0, 2, 1))

    def tool_error(self, platform: Array, true: Array) -> Array:
        """Predicted platform poses (n, 6) against true tool coordinates (n, 6): m, and rad by left increments."""
        turn = rotation_matrix(platform[:, 3:])
        shift = platform[:, :3] + turn @ self.machine.tool_point_m - true[:, :3]
        return np.concatenate([shift, rotation_vector(turn @ rotation_matrix(true[:, 3:]).transpose(0, 2, 1))], axis=1)
