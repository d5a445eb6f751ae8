from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from calibration import equilibrium, station
from calibration.machine import Array, Machine, load_machine, shipped_machine
from calibration.observation_model import Frame, Layout, ModelOptions, Observations, Visits, predict
from calibration.parameters import ParameterSet

TEMPERATURES_C = {"struts": 21.0, "columns": 20.7, "base": 20.5, "platform": 22.0}
STATED = station.StationAccuracy(2.4e-6, 1.0e-4, 1.0e-4, 1.0e-6)
LOOKING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
PLACE = np.array([0.0, 0.3, 3.2])
PLATE_COM_M = (0.0, -0.2, 0.0)


@pytest.fixture(scope="session")
def machine() -> Machine:
    return load_machine(shipped_machine("planar4"))


@dataclass(frozen=True)
class Synthetic:
    """A machine with known errors, seen by a station with known noise; drawn from one seed."""

    machine: Machine
    layout: Layout
    truth: Array
    frame: Frame
    rough: Frame
    rng: np.random.Generator

    def visits(self, xy: Array, payload_kg: Array) -> Visits:
        n = len(xy)
        target = np.zeros((n, 6))
        target[:, :2] = xy
        upright = np.broadcast_to(np.eye(3), (n, 3, 3))
        drives = equilibrium.drives_for(self.machine, self.machine.nominal, target[:, :3], upright)
        temperatures = {name: np.full(n, t) for name, t in TEMPERATURES_C.items()}
        return Visits(drives, target, payload_kg, np.tile(PLATE_COM_M, (n, 1)), temperatures)

    def see(self, visits: Visits, *, noise: bool = True) -> Observations:
        count = len(self.layout.smrs)
        blank = Observations(
            visits,
            np.repeat(np.arange(len(visits)), count),
            np.tile(np.array(self.layout.smrs), len(visits)),
            np.zeros((count * len(visits), 3)),
            np.tile(np.eye(3), (count * len(visits), 1, 1)),
        )
        position = predict(self.layout, self.frame, ModelOptions(), self.truth, blank).position_m
        hz, v, d = station.angles(position)
        covariance = station.covariances(hz, v, d, STATED)
        if noise:
            hz = hz + self.rng.normal(0.0, STATED.angle_sd_rad, hz.size)
            v = v + self.rng.normal(0.0, STATED.angle_sd_rad, hz.size)
            d = d + self.rng.normal(0.0, STATED.range_sd_m, hz.size)
            position = station.points(hz, v, d)
        return Observations(visits, blank.visit, blank.smr, position, covariance)

    def workspace(self, count: int) -> Array:
        low, high = self.machine.workspace_m.T
        return self.rng.uniform(low, high, (count, 2))


@pytest.fixture(scope="session")
def synthetic(machine):
    def make(seed: int, *, stiffness_spread: bool = True) -> Synthetic:
        rng = np.random.default_rng(seed)
        parameters = ParameterSet.of(machine)
        layout = Layout.of(parameters, (0, 1, 2, 3, 4), 1e-5, 1e-3)
        truth = np.zeros(layout.size)
        tolerance = np.array([p.tolerance for p in parameters.parameters])
        truth[: len(parameters)] = rng.uniform(-1.0, 1.0, len(parameters)) * tolerance
        if not stiffness_spread:
            truth[parameters.rows("ln_stiffness")] = 0.0
        truth[layout.mounting : layout.frame] = rng.uniform(-5e-4, 5e-4, layout.frame - layout.mounting)
        rough = Frame(LOOKING, -LOOKING @ PLACE)
        turn = equilibrium.rotation_matrix(rng.normal(0.0, 1e-3, 3)) @ LOOKING
        frame = Frame(turn, -turn @ PLACE + rng.normal(0.0, 3e-3, 3))
        return Synthetic(machine, layout, truth, frame, rough, rng)

    return make
