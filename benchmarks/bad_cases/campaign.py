"""A campaign straight from the mock plant, mistakes included: readings as the main job stores them, without a wire.

Of what the main job does live, the station's guard is kept: a reflector more than 20 mm from where it is predicted
(60 mm before the frame is fitted) ends the campaign, unless the case is a recording by a program without such a guard.
Not kept: repeatability, warm-up, interlocks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np

from benchmarks.bad_cases.cases import Case
from calibration.base.arrays import Array
from calibration.base.frame import Frame, station_frame
from calibration.base.rotation import rotation_matrix
from calibration.instruments import station_geometry
from calibration.machine.description import Machine, load_machine
from calibration.machine.equilibrium import carried_point
from calibration.recording.columns import column_names
from calibration.recording.header import RecordingFile, StationEntry
from calibration.recording.recording import Recording, make_recording
from drivers.errors import WrongTarget
from mock_devices.plant.plant import Plant
from mock_devices.plant.structure import NoEquilibrium
from mock_devices.settings import Payload
from pkm_rig.rig.clock import VirtualClock
from pkm_rig.rig.config import RigFile, embedded_rig_path, load_rig, machine_path
from pkm_rig.rig.devices import INITIAL_TARGET_TOLERANCE_M, TARGET_TOLERANCE_M, PointingFrame
from pkm_rig.rig.rig import PART_SENSORS
from pkm_rig.rig.schedule import Block, PlannedVisit
from pkm_rig.virtual.mock_rig import settings_of

READING_S, MOVE_S = 3.0, 5.0
Correct = Callable[[Array], Array]  # what is added to commanded drive positions (d,)


def nothing(drives: Array) -> Array:
    """No correction."""
    return np.zeros_like(drives)


class PlantCampaign:
    """One machine with a case's mistake, and the readings taken of it so far."""

    def __init__(
        self, case: Case, folder: Path, poses: int | None = None, verification_poses: int | None = None
    ) -> None:
        file, _ = load_rig(embedded_rig_path())
        assert file.mock is not None
        changes = {"calibration_poses": poses, "verification_poses": verification_poses}
        campaign = file.campaign.model_copy(update={k: v for k, v in changes.items() if v is not None})
        mock = file.mock.model_copy(update={"seed": case.seed})
        self.case = case
        self.file: RigFile = file.model_copy(update={"mock": mock, "campaign": campaign})
        self.machine: Machine = load_machine(machine_file(self.file, case, folder))
        self.plant = plant_of(self.file, case)
        self._rng = np.random.default_rng([case.seed, 61])
        self._rows: list[dict[str, float | str]] = []
        self._t_s, self._check, self._visit = 3600.0, -1, -1
        self._aim = PointingFrame(frame=_rough_frame(self.file, self.machine))
        self._visits = 0
        self.planned_visits = 1

    @cached_property
    def header(self) -> RecordingFile:
        """The recording's header."""
        station = self.file.station
        return RecordingFile(
            format=1,
            campaign=f"{self.case.kind.replace(' ', '-')}-{self.case.number}",
            rig="plant",
            created="2026-01-01T00:00:00+00:00",
            software="benchmark",
            drives=tuple(d.name for d in self.file.drives),
            sensors=PART_SENSORS,
            station=StationEntry(
                name="mock", position_m=station.position_m, heading_rad=station.heading_rad, accuracy=station.accuracy
            ),
            nest_length=self.file.nest_length,
            nest_limit_m=self.file.campaign.nest_limit_m,
            payloads=self.file.payloads,
            nuisance=self.file.nuisance,
            simulated=True,
        )

    def recording(self) -> Recording:
        """What was read so far."""
        return make_recording(self.header, self.machine, self._rows)

    def temperatures_c(self) -> dict[str, float]:
        """What the parts' sensors read now."""
        return {name: self.plant.thermal.sensor_c(name, self._t_s) for name in PART_SENSORS}

    def stands_at(self, drives: Array, correct: Correct = nothing) -> Array:
        """Where the drives truly stand that are commanded somewhere."""
        out = np.array(drives, dtype=np.float64)
        added = np.nan_to_num(correct(out))
        if self.case.turned_table is not None:
            added[self.case.turned_table] *= -1.0
        out = out + added
        if self.case.turned is not None:
            low, high = self.machine.travel[self.case.turned]
            out[self.case.turned] = low + high - out[self.case.turned]
        return out

    def measure(self, block: Block, phase: str, smrs: Sequence[str], correct: Correct = nothing) -> None:
        """One block of visits between nest checks. Raises WrongTarget as the station's guard does."""
        every = self.file.campaign.nest_every_visits
        for number, visit in enumerate(block.visits):
            if number % every == 0:
                self._nests(visit, correct)
            self._visit += 1
            self._visits += 1
            self._t_s += MOVE_S
            for smr in smrs:
                self._read(phase, smr, visit, correct)
        self._nests(block.visits[-1], correct)

    def _nests(self, visit: PlannedVisit, correct: Correct) -> None:
        self._check += 1
        for nest in (smr.name for smr in self.machine.smrs if smr.on == "floor"):
            self._read("nests", nest, visit, correct, self.file.campaign.readings_per_nest)

    def _true_name(self, smr: str) -> str:
        case = self.case
        if case.swapped is None or smr not in case.swapped or self._visits < case.swapped_from * self.planned_visits:
            return smr
        return case.swapped[1 - case.swapped.index(smr)]

    def _read(self, phase: str, smr: str, visit: PlannedVisit, correct: Correct, samples: int = 1) -> None:
        stands = tuple(self.stands_at(visit.drives_m, correct).tolist())
        try:
            places = self.plant.truth.smr_positions(stands, visit.payload, self._t_s)
        except (NoEquilibrium, ValueError) as error:
            raise WrongTarget(
                "station", "plant", f"reflector {smr} is not found: {error}", "look at the machine"
            ) from error
        truth = places[self._true_name(smr)]
        accuracy = self.file.station.accuracy
        seen = self.plant.view.polar((float(truth[0]), float(truth[1]), float(truth[2])), self._t_s)
        noise = self._rng.standard_normal(3) / np.sqrt(samples)
        hz = np.array([seen.hz_rad + accuracy.angle_sd_rad * noise[0] / np.sin(seen.v_rad)])
        v = np.array([seen.v_rad + accuracy.angle_sd_rad * noise[1]])
        d = np.array([seen.distance_m + self.plant.view.range_constant_m + accuracy.range_sd_m * noise[2]])
        point = station_geometry.polar_to_points(hz, v, d)[0]
        if self.case.guarded:
            self._require_target(smr, visit, point)
        covariance = station_geometry.point_covariances(hz, v, d, accuracy.to_station_accuracy())[0] / samples
        header = self.header
        row: dict[str, float | str] = dict.fromkeys(column_names(header.drives, header.sensors), 0.0)
        row |= {"uid": f"r{len(self._rows)}", "phase": phase, "smr": smr, "sequence": float(len(self._rows))}
        row |= {"visit": float(max(self._visit, 0)), "nest_check": float(self._check), "t_rig_s": self._t_s}
        row |= dict(zip(("x_m", "y_m", "z_m"), point.tolist(), strict=True))
        row |= {f"cov_{'xyz'[i]}{'xyz'[j]}_m2": float(covariance[i, j]) for i in range(3) for j in range(i, 3)}
        row |= {"hz_rad": float(hz[0]), "v_rad": float(v[0]), "slope_distance_m": float(d[0]), "station": 1.0}
        row |= {"samples": float(samples), "payload": float(visit.payload)}
        row |= {"payload_mass_kg": self.file.payloads[visit.payload].mass_kg}
        row |= {"pose": float(visit.pose), "pass": float(visit.pass_)}
        row |= {"target_x_m": float(visit.target_m[0]), "target_y_m": float(visit.target_m[1])}
        for drive, q, side in zip(header.drives, visit.drives_m.tolist(), visit.direction, strict=True):
            row |= {f"{drive}_actual_m": q, f"{drive}_commanded_m": q, f"{drive}_direction": float(side)}
        row |= {f"{n}_temperature_c": self.plant.thermal.sensor_c(n, self._t_s) for n in header.sensors}
        self._rows.append(row)
        self._t_s += READING_S

    def _require_target(self, smr: str, visit: PlannedVisit, point: Array) -> None:
        entry = self.machine.smr(smr)
        if entry.on == "floor":
            expected = np.asarray(entry.position_m)
        elif entry.on == "platform":
            turn = rotation_matrix(visit.target_m[None, 3:])[0]
            expected = np.asarray(visit.target_m[:3] + turn @ entry.position_m)
        else:
            expected = carried_point(self.machine, entry.drive, entry.position_m, visit.drives_m)
        assert self._aim.frame is not None
        off_m = float(np.linalg.norm(self._aim.frame.to_station(expected[None])[0] - point))
        if off_m > (TARGET_TOLERANCE_M if self._aim.is_fitted else INITIAL_TARGET_TOLERANCE_M):
            raise WrongTarget("station", "plant", f"SMR '{smr}' was found {off_m * 1e3:.0f} mm from its place", "look")
        self._aim.add_point(expected, point)


def plant_of(file: RigFile, case: Case) -> Plant:
    """The plant of a case, with what is truly on its platform."""
    settings = settings_of(file)
    truly = tuple(
        replace(p, mass_kg=case.truly_kg.get(n, p.mass_kg), com_m=_com(p, n, case))
        for n, p in enumerate(settings.payloads)
    )
    return Plant(machine_path(file, embedded_rig_path()), replace(settings, payloads=truly), VirtualClock())


def _com(payload: Payload, number: int, case: Case) -> tuple[float, float, float]:
    return payload.com_m if case.truly_com_m is None or number == 0 else case.truly_com_m


def machine_file(file: RigFile, case: Case, folder: Path) -> Path:
    """The machine file that the calibration reads: the shipped one, or one with a case's mistake written beside."""
    path = machine_path(file, embedded_rig_path())
    if not case.file_changes:
        return path
    text = path.read_text(encoding="utf-8")
    for old, new in case.file_changes:
        if old not in text:
            raise ValueError(f"{path}: has no '{old}'")
        text = text.replace(old, new)
    folder.mkdir(parents=True, exist_ok=True)
    wrong = folder / f"wrong-{case.number}.toml"
    wrong.write_text(text, encoding="utf-8")
    return wrong


def _rough_frame(file: RigFile, machine: Machine) -> Frame:
    return station_frame(file.station.position_m, file.station.heading_rad, machine.gravity_m_per_s2)
