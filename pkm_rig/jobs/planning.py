"""Planning a campaign: which poses to measure, and what they will tell, before anything moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, get_args

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import station_frame
from calibration.identification.observability import planned_observability
from calibration.identification.pose_selection import (
    CampaignForecast,
    Criterion,
    Instrument,
    PlannedLoad,
    Selection,
    candidate_poses,
    grid_poses,
    visits_at,
    workspace_poses,
)
from calibration.instruments import station_geometry
from calibration.instruments.readings import Readings
from calibration.instruments.smr_positions import ReflectorObservations, SmrPositions, StationModel
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.description import COORDINATES, Machine
from calibration.model.model import Model, SystematicUncertainties
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits
from pkm_rig.rig.config import RigFile

CANDIDATE_POSES = 256
EVALUATION_POSES = 200
MAX_POSES = 500
SEED = 1
POSITION_SD_M, ORIENTATION_SD_RAD = 7e-6, 3e-5  # of a full-pose instrument, where no rig says better


@dataclass(frozen=True)
class Planner:
    """A machine, what is known of it, how it is measured and under which loads."""

    model: Model
    instrument: Instrument
    loads: tuple[PlannedLoad, ...]

    @classmethod
    def of_rig(cls, file: RigFile, machine: Machine) -> Planner:
        """As the rig's campaign measures: without and with its payload, all reflectors of platform and drives."""
        payloads = (file.payloads[0], file.payloads[file.campaign.loaded_payload])
        return cls(
            Model(ParameterSet.of(machine), SystematicUncertainties.from_declared(file.payloads, machine)),
            lambda visits: [_station_observations(file, machine, visits)],
            tuple(PlannedLoad(p.mass_kg, p.com_m) for p in payloads),
        )

    @classmethod
    def of_machine(cls, machine: Machine) -> Planner:
        """Full poses in the machine's frame, under every load case of the machine file."""
        cases = machine.load_cases
        sigma = np.where(machine.dof < 3, POSITION_SD_M, ORIENTATION_SD_RAD)
        shares = [c.u_mass_kg / c.mass_kg for c in cases if c.mass_kg > 0.0]
        systematic = SystematicUncertainties(max(shares, default=0.0), 0.0, machine.u_expansion_per_k)

        def instrument(visits: Visits) -> list[Readings]:
            return [ToolCoordinates.of(visits, tuple(machine.dof.tolist()), visits.target_m, sigma)]

        loads = tuple(PlannedLoad(c.mass_kg, c.centre_of_mass_m, c.force_n, c.force_point_m) for c in cases) or (
            PlannedLoad(),
        )
        return cls(Model(ParameterSet.of(machine), systematic), instrument, loads)

    @property
    def machine(self) -> Machine:
        """The machine to be measured."""
        return self.model.machine

    def typical_errors(self) -> Array:
        """Deviations (p,) drawn within the tolerances: a nominal machine would have no internal forces to show."""
        sigma = self.model.parameters.sigma
        return np.asarray(np.random.default_rng(SEED).normal(size=sigma.size) * sigma)

    def selection(self, tool: Array) -> Selection:
        """What measuring some of the tool poses (n, 6) would tell."""
        evaluation_visits = visits_at(
            self.machine, workspace_poses(self.machine, EVALUATION_POSES, SEED + 1), self.loads[:1]
        )
        return Selection.of(self.model, tool, self.loads, self.instrument, evaluation_visits, self.typical_errors())

    def _fill_grid(self, count: int) -> Array:
        """The largest grid of at most `count` tool poses, filled up to that number with evenly spread ones."""
        grid = grid_poses(self.machine, count)
        missing = count - len(grid)
        return np.vstack([grid, workspace_poses(self.machine, missing, SEED + 3)]) if missing else grid

    def plan(self, count: int, criterion: Criterion) -> dict[str, Any]:
        """Selected poses, beside a grid and evenly spread ones, and what stays open (docs/reference/json.md)."""
        sets = {
            "selected": self.selection(candidate_poses(self.machine, CANDIDATE_POSES, SEED)).select(count, criterion),
            "grid": self.selection(self._fill_grid(count)).forecast_all(),
            "spread": self.selection(workspace_poses(self.machine, count, SEED + 2)).forecast_all(),
        }
        chosen = sets["selected"]
        visits = visits_at(self.machine, chosen.tool, self.loads)
        observability = planned_observability(self.model, visits, self.instrument(visits), self.typical_errors())
        return {
            "machine": self.machine.name,
            "criterion": criterion,
            "coordinates": [COORDINATES[c] for c in self.machine.commanded],
            "targets": np.round(chosen.tool[:, self.machine.commanded], 6).tolist(),
            "payloads_kg": [load.mass_kg for load in self.loads],
            "sets": {name: _summary(prospect) for name, prospect in sets.items()},
            "decided": observability.n_determined,
            "parameters": {
                name: {"left": float(left)}
                for name, left in zip(observability.parameters.names, observability.remaining_share, strict=True)
            },
            "open": list(observability.sentences),
        }


def parse_criterion(name: str) -> Criterion:
    """The criterion of that name; InputError if there is none."""
    if name not in get_args(Criterion):
        raise InputError(f"criterion '{name}' is unknown; use {' or '.join(get_args(Criterion))}")
    return name  # type: ignore[return-value]


def parse_count(count: int) -> int:
    """A number of poses that can be planned; InputError if not."""
    if not 1 <= count <= MAX_POSES:
        raise InputError(f"poses: {count} poses cannot be planned; choose 1 to {MAX_POSES}")
    return count


def _summary(prospect: CampaignForecast) -> dict[str, float | int]:
    return {
        "poses": len(prospect.tool),
        "u_position_m": prospect.u_position_m,
        "u_orientation_rad": prospect.u_orientation_rad,
    }


def _station_observations(file: RigFile, machine: Machine, visits: Visits) -> SmrPositions:
    """Readings of all reflectors that move, with the covariance that the station states; their values do not matter."""
    smrs = tuple(i for i, s in enumerate(machine.smrs) if s.on != "floor")
    frame = station_frame(file.station.position_m, file.station.heading_rad, machine.gravity_m_per_s2)
    accuracy = file.station.accuracy.to_station_accuracy()
    station = StationModel.from_accuracy(frame, smrs, accuracy)
    count = len(visits) * len(smrs)
    visit, smr = np.repeat(np.arange(len(visits)), len(smrs)), np.tile(smrs, len(visits))
    blank = ReflectorObservations(visits, visit, smr, np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1)))
    model = Model(ParameterSet.of(machine))
    nominal_unknowns = np.zeros(len(station.unknowns(machine)))
    poses = model.predict(np.zeros(len(model)), visits)
    point = SmrPositions(blank, station).compare(poses, visit[:, None], nominal_unknowns, derivatives=False).residual
    covariance = station_geometry.point_covariances(*station_geometry.points_to_polar(point), accuracy)
    covariance /= file.campaign.readings_per_smr
    return SmrPositions(ReflectorObservations(visits, visit, smr, point, covariance), station)
