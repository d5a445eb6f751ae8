"""What the software knows of a machine and does with its readings: checks, calibrations, tables, verifications."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from benchmarks.year_study.plant_machine import MACHINE, STATION_M, PlantMachine
from calibration.intervals.check_design import CheckReadings, check_design, choose_poses
from calibration.intervals.check_estimate import CheckDesign, CheckEstimate, estimate_check, joint_change
from calibration.intervals.watched import WATCHED_KINDS, watched_changes
from calibration.machine.description import load_machine, shipped_machine
from calibration.machine.equilibrium import make_conditions
from calibration.machine.inverse import drives_for
from calibration.model.model import Model, Poses
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits

LOOKS = (4, 6, 8, 10, 12)
NEST_READINGS = 20  # averaged: ten before and ten after
CALIBRATION_READINGS = 4  # of each reflector at each pose
ERROR_PRIOR_M = 3.0e-6  # of the tool, for each parameter's unknown change
RANGE_U = (1.0e-4, 1.0e-6)
READING_S, CALIBRATION_H, PARTIAL_H = 5.0, 2.0, 0.25


def grid(n: int, width_m: float, height_m: float) -> np.ndarray:
    """Points (n n, 2) over a box about the workspace's middle."""
    return np.array([(width_m * x, height_m * y) for x in np.linspace(-1, 1, n) for y in np.linspace(-1, 1, n)])


@dataclass(frozen=True)
class Knowledge:
    """What a calibration knows: deviations from nominal (u,) and mountings (q, 3) as one vector (p,), covariance."""

    values: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class Tables:
    """Drive positions that bring the tool to target points, by a calibration, at the temperatures of their making."""

    knowledge: Knowledge
    parts_c: dict[str, float]
    drives_at: dict[bytes, np.ndarray] = field(default_factory=dict)  # by target points, as they are asked for


class Workshop:
    """Designs that are the same for all machines of the kind: made once, at nominal (true errors are 1e-4 m)."""

    def __init__(self) -> None:
        self.machine = load_machine(shipped_machine(MACHINE))
        self.model = Model(ParameterSet.of(self.machine))
        self.watched = watched_changes(self.model.parameters)
        self.steppable = [p.name for p in self.model.parameters.parameters if p.kind in WATCHED_KINDS]
        self.count = len(self.model.parameters)
        self.moving = [i for i, smr in enumerate(self.machine.smrs) if smr.on != "floor"]
        self.nests = [i for i, smr in enumerate(self.machine.smrs) if smr.on == "floor"]
        self.size = self.count + 3 * len(self.moving)
        self.workspace_xy = grid(5, 0.35, 0.30)
        candidates = grid(7, 0.33, 0.28)
        design, readings = self._design(candidates, 1.0)
        self.check_xy = candidates[list(choose_poses(design, np.repeat(readings.visit, 3), LOOKS[-1]))]
        self.check_design, self.check_readings = self._design(self.check_xy, 1.0)
        visit = np.repeat(self.check_readings.visit, 3)
        self.looks = [self.check_design.rows(visit < n) for n in LOOKS]
        self.look_rows = [np.flatnonzero(visit < n) for n in LOOKS]
        self.independent = self.check_design.independent
        self.calibration_xy = np.concatenate([grid(7, 0.35, 0.30), grid(4, 0.25, 0.2)])
        self.calibration_design, self.calibration_readings = self._design(self.calibration_xy, CALIBRATION_READINGS)
        self.calibration_design = replace(self.calibration_design, prior=np.diag(self._tolerances() ** 2))
        self.sigma = dict(zip(self.watched.names, self.check_design.change_u, strict=True))

    def _tolerances(self) -> np.ndarray:
        mounting = self.machine.file.tolerances.smr_position_m / np.sqrt(3.0)
        return np.concatenate([self.model.parameters.sigma, np.full(3 * len(self.moving), mounting)])

    def visits(self, drives: np.ndarray, xy: np.ndarray, parts_c: dict[str, float]) -> Visits:
        """Visits of poses at the parts' temperatures."""
        target = np.zeros((len(xy), 6))
        target[:, :2] = xy
        at = Visits.at_reference_temperature(self.machine, drives, target)
        return replace(at, temperatures_c={p: np.full(len(xy), t) for p, t in parts_c.items()})

    def nominal(self) -> Knowledge:
        """What is known before any calibration."""
        return Knowledge(np.zeros(self.size), np.diag(self._tolerances() ** 2))

    def drives(self, tables: Tables, xy: np.ndarray) -> np.ndarray:
        """Drive positions (n, 2) with the tables on."""
        key = xy.tobytes()
        if key not in tables.drives_at:
            tables.drives_at[key] = self._drives(tables, xy)
        return tables.drives_at[key]

    def _drives(self, tables: Tables, xy: np.ndarray) -> np.ndarray:
        target = np.zeros((len(xy), 6))
        target[:, :2] = xy
        warm = {s: np.full(len(xy), tables.parts_c[s]) for s in self.machine.sensors.values()}
        geometry = self.model.parameters.geometry(tables.knowledge.values[: self.count])
        return drives_for(self.machine, geometry, target, make_conditions(self.machine, len(xy), warm))[0]

    def predict(self, known: Knowledge, drives: np.ndarray, xy: np.ndarray, parts_c: dict[str, float]) -> Poses:
        """Poses by a calibration."""
        return self.model.predict(known.values[: self.count], self.visits(drives, xy, parts_c))

    def known_error_m(self, tables: Tables, drives: np.ndarray, parts_c: dict[str, float]) -> np.ndarray:
        """Error (3 n,) over the workspace that the calibration itself expects at other temperatures."""
        tool = self.predict(tables.knowledge, drives, self.workspace_xy, parts_c).tool_m()
        tool[:, :2] -= self.workspace_xy
        tool[:, 2] = 0.0
        return np.asarray(tool.reshape(-1))

    def _design(self, xy: np.ndarray, averaged: float) -> tuple[CheckDesign, CheckReadings]:
        cold = dict.fromkeys(("struts", "columns", "base", "platform"), 20.0)
        start = Tables(self.nominal(), cold)
        poses = self.predict(start.knowledge, self.drives(start, xy), xy, cold)
        space = self.predict(start.knowledge, self.drives(start, self.workspace_xy), self.workspace_xy, cold)
        mounting = np.array([smr.position_m for smr in self.machine.smrs])
        visit, smr, place = [], [], []
        for s in self.moving:
            where = poses.reflector_m(s, mounting[s])
            visit += list(range(len(xy)))
            smr += [s] * len(xy)
            place += list(where)
        for s in self.nests:
            visit.append(-1)
            smr.append(s)
            place.append(mounting[s])
        number = np.where(np.array(visit) < 0, NEST_READINGS, averaged)
        whiten = np.linalg.inv(np.linalg.cholesky(_covariances(np.array(place), number)))
        readings = CheckReadings(np.array(visit), np.array(smr), np.array(place), whiten)
        zero = np.zeros((self.size, self.size))
        design = check_design(
            readings, poses, space, mounting, self.watched,
            station_m=np.array(STATION_M), range_u=RANGE_U, prior=zero, reference=zero,
        )  # fmt: skip
        per_parameter = np.sqrt(np.sum(design.workspace**2, axis=0) / design.points)
        sd = np.where(per_parameter > 1e-9, ERROR_PRIOR_M / np.maximum(per_parameter, 1e-9), 0.0)
        return replace(design, prior=np.diag(np.minimum(sd, self._tolerances()) ** 2)), readings

    def residual(
        self,
        readings: CheckReadings,
        known: Knowledge,
        poses: Poses,
        read_m: np.ndarray,
        nests_m: np.ndarray,
        station: tuple[np.ndarray, np.ndarray],
    ) -> np.ndarray:
        """Whitened differences (3 r,) of what was read and what is predicted, in the machine's frame.

        station: its rotation and place as they are roughly known; nests_m (2, 3): the nests' places, the frame's datum.
        """
        rough = read_m @ station[0] + station[1]
        predicted = np.empty_like(rough)
        for k, smr in enumerate(self.moving):
            rows = readings.smr == smr
            mounted = np.asarray(self.machine.smrs[smr].position_m) + known.values[self.count + 3 * k :][:3]
            predicted[rows] = poses.reflector_m(smr, mounted)[readings.visit[rows]]
        predicted[readings.visit < 0] = nests_m
        return readings.whitened(rough - predicted)

    def calibrate(
        self, plant: PlantMachine, tables: Tables, prior: Knowledge, mean_c: float, rng: np.random.Generator
    ) -> tuple[Knowledge, dict[str, float]]:
        """Measure a full calibration with the present tables on and fit it; also the temperatures then."""
        true_c, read_c = plant.parts_c(mean_c, rng)
        drives = self.drives(tables, self.calibration_xy)
        r = self.calibration_readings
        read = read_all(plant, r, drives, true_c, CALIBRATION_READINGS, rng)
        return self.fit(plant, self.calibration_design, r, self.calibration_xy, drives, read, prior, read_c), read_c

    def fit(
        self,
        plant: PlantMachine,
        readings_design: CheckDesign,
        readings: CheckReadings,
        xy: np.ndarray,
        drives: np.ndarray,
        read_m: np.ndarray,
        prior: Knowledge,
        parts_c: dict[str, float],
    ) -> Knowledge:
        """A calibration from readings (r, 3) of poses (n, 2): the most probable one by a prior, iterated."""
        design = replace(readings_design, prior=prior.covariance)
        shared = readings_design.__dict__
        design.__dict__.update({k: shared[k] for k in ("_basis", "free") if k in shared})
        values, covariance = prior.values, prior.covariance
        for _ in range(4):
            now = Knowledge(values, covariance)
            poses = self.predict(now, drives, xy, parts_c)
            residual = self.residual(readings, now, poses, read_m, nests_of(plant, self.nests), rough_station(plant))
            white = residual + design.by_parameter @ (values - prior.values)
            change, covariance = joint_change(design, white)
            step, values = prior.values + change - values, prior.values + change
            if np.max(np.abs(step)) < 1e-7:
                break
        return Knowledge(values, covariance)

    def look(self, number: int, residual: np.ndarray, known_m: np.ndarray) -> CheckEstimate:
        """What a check says at one of its looks."""
        return estimate_check(self.looks[number], residual[self.look_rows[number]], known_m)


def _covariances(place_m: np.ndarray, averaged: np.ndarray) -> np.ndarray:
    """Covariance (r, 3, 3) of a reading in the machine frame, as the station's accuracy states it."""
    sight = place_m - np.array(STATION_M)
    distance = np.linalg.norm(sight, axis=1)
    along = sight / distance[:, None]
    outer = along[:, :, None] * along[:, None, :]
    across = np.eye(3) - outer
    variance = (1.0e-4**2) * outer + ((2.4e-6 * distance) ** 2)[:, None, None] * across
    return np.asarray(variance / averaged[:, None, None])


def nests_of(plant: PlantMachine, nests: list[int]) -> np.ndarray:
    """Places (2, 3) of the nests: they define the machine's frame."""
    return np.array([plant.drawn.file.smrs[i].position_m for i in nests])


def rough_station(plant: PlantMachine) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and place of the station as an orientation on the nests gives them: off by parts of a millimetre."""
    return plant.rotation, plant.station_m


def read_all(
    plant: PlantMachine,
    readings: CheckReadings,
    drives: np.ndarray,
    parts_c: dict[str, float],
    averaged: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """Readings (r, 3) of all reflectors at all poses."""
    at_poses = plant.reflectors_m(drives, parts_c, rng)
    places = at_poses[np.maximum(readings.visit, 0), readings.smr]
    number = np.where(readings.visit < 0, NEST_READINGS, averaged)
    return plant.read(places, number, rng)


@cache
def workshop() -> Workshop:
    """The one of this process."""
    return Workshop()
