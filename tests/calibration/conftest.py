from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from calibration.base.arrays import Array
from calibration.base.frame import Frame
from calibration.base.rotation import rotation_matrix
from calibration.identification.estimators import identify
from calibration.identification.fit import Estimator, Fit
from calibration.identification.problem import Layout
from calibration.instruments import station_geometry
from calibration.instruments.smr_positions import ReflectorObservations, SmrPositions, StationModel
from calibration.machine.description import Machine, load_machine, shipped_machine
from calibration.machine.inverse import nominal_drives
from calibration.model.model import Model, SystematicUncertainties
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits

TEMPERATURES_C = {"struts": 21.0, "columns": 20.7, "base": 20.5, "platform": 22.0}
STATED = station_geometry.StationAccuracy(2.4e-6, 1.0e-4, 1.0e-4, 1.0e-6)
LOOKING = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
PLACE = np.array([0.0, 0.3, 3.2])
PLATE_COM_M = (0.0, -0.2, 0.0)
SMRS = (0, 1, 2, 3, 4)
KNOWN = SystematicUncertainties(
    payload_mass=1e-3, expansion_per_k=dict.fromkeys(("struts", "drives", "base", "platform"), 0.3e-6)
)


@pytest.fixture(scope="session")
def machine() -> Machine:
    return load_machine(shipped_machine("planar4"))


@dataclass(frozen=True)
class Synthetic:
    """A machine with known errors, seen by a station with known noise; drawn from one seed."""

    model: Model
    station: StationModel  # its start is the true frame
    layout: Layout
    truth: Array
    rough: Frame
    rng: np.random.Generator

    @property
    def machine(self) -> Machine:
        return self.model.machine

    @property
    def frame(self) -> Frame:
        return self.station.start

    def visits(self, xy: Array, payload_kg: Array) -> Visits:
        n = len(xy)
        target = np.zeros((n, 6))
        target[:, :2] = xy
        temperatures = {name: np.full(n, t) for name, t in TEMPERATURES_C.items()}
        drives = nominal_drives(self.machine, target)
        return Visits(drives, target, payload_kg, np.tile(PLATE_COM_M, (n, 1)), temperatures)

    def see(self, visits: Visits, *, noise: bool = True) -> ReflectorObservations:
        count = len(SMRS)
        blank = ReflectorObservations(
            visits,
            np.repeat(np.arange(len(visits)), count),
            np.tile(np.array(SMRS), len(visits)),
            np.zeros((count * len(visits), 3)),
            np.tile(np.eye(3), (count * len(visits), 1, 1)),
        )
        poses = self.model.predict(self.truth[: len(self.model)], visits)
        own = self.truth[self.layout.instrument_slices[0]]
        position = SmrPositions(blank, self.station).compare(poses, blank.visit[:, None], own).residual
        hz, v, d = station_geometry.points_to_polar(position)
        covariance = station_geometry.point_covariances(hz, v, d, STATED)
        if noise:
            hz = hz + self.rng.normal(0.0, STATED.angle_sd_rad, hz.size)
            v = v + self.rng.normal(0.0, STATED.angle_sd_rad, hz.size)
            d = d + self.rng.normal(0.0, STATED.range_sd_m, hz.size)
            position = station_geometry.polar_to_points(hz, v, d)
        return ReflectorObservations(visits, blank.visit, blank.smr, position, covariance)

    def fit(
        self, seen: ReflectorObservations, start: Frame, estimator: Estimator = "map", *, robust: bool = False
    ) -> Fit:
        instrument = StationModel(start, SMRS, 1e-5, 1e-6, 5e-7)
        return identify(self.model, seen.visits, [SmrPositions(seen, instrument)], estimator, robust=robust)

    def workspace(self, count: int) -> Array:
        low, high = self.machine.commanded_limits.T
        return self.rng.uniform(low, high, (count, 2))


@pytest.fixture(scope="session")
def synthetic(machine):
    def make(seed: int, *, stiffness_spread: bool = True) -> Synthetic:
        rng = np.random.default_rng(seed)
        model = Model(ParameterSet.of(machine), KNOWN)
        rough = Frame(LOOKING, -LOOKING @ PLACE)
        turn = rotation_matrix(rng.normal(0.0, 1e-3, 3)) @ LOOKING
        seer = StationModel(Frame(turn, -turn @ PLACE + rng.normal(0.0, 3e-3, 3)), SMRS, 1e-5, 1e-6, 5e-7)
        blank = ReflectorObservations(None, *[np.zeros(0, dtype=int)] * 2, np.zeros((0, 3)), np.zeros((0, 3, 3)))
        layout = Layout.of(model, [SmrPositions(blank, seer)])
        truth = np.zeros(layout.size)
        tolerance = np.array([p.tolerance for p in model.parameters.parameters])
        truth[: len(tolerance)] = rng.uniform(-1.0, 1.0, len(tolerance)) * tolerance
        if not stiffness_spread:
            truth[model.parameters.rows("ln_stiffness")] = 0.0
        mounting = layout.instrument_slices[0].start + np.arange(3 * len(SMRS))
        truth[mounting] = rng.uniform(-5e-4, 5e-4, mounting.size)
        return Synthetic(model, seer, layout, truth, rough, rng)

    return make
