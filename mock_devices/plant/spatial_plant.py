"""A machine in space behind the mock devices: legs, cranks, sliders and guides of any machine file.

Not modelled: effects (`mock_devices.effects` are of the planar machine), disturbances beyond noise, drift and warmth.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mock_devices.clock import RigClock
from mock_devices.plant.base_plant import BasePlant, DrivePart, Sighting
from mock_devices.plant.optics import StationView
from mock_devices.plant.sight_lines import hides, looks_here
from mock_devices.plant.spatial_equilibrium import SpatialPose
from mock_devices.plant.spatial_machine import TrueSpatialMachine, closed_drive, draw_spatial_machine, middle_pose
from mock_devices.plant.structure import NoEquilibrium
from mock_devices.plant.thermal import Thermal
from mock_devices.settings import MockSettings
from mock_devices.spatial_file import SpatialMachine, read_spatial_machine

Array = NDArray[np.float64]

_GRAVITY_M_PER_S2 = 9.80665
_FEED_M = 0.010  # of a drive's screw
_GEAR = 200.0  # of a crank, whose motor has the rating of the others


class SpatialTruth:
    """The truth of a mock rig, free of noise: only for scoring and tests. Drive positions are encoder positions.

    Temperatures are the true ones of rig time `t_s`, or those of `temperatures_c` (by sensor name) if given.
    """

    def __init__(self, machine: TrueSpatialMachine, view: StationView, thermal: Thermal) -> None:
        self.machine = machine
        self._view, self._thermal = view, thermal

    @property
    def station_from_machine(self) -> tuple[Array, Array]:
        """Rotation (3, 3) and translation (3,) in metres of the drift-free station frame."""
        return self._view.rotation.copy(), self._view.translation_m.copy()

    def pose(
        self,
        drives: Sequence[float],
        payload: int,
        t_s: float = 0.0,
        *,
        temperatures_c: Mapping[str, float] | None = None,
    ) -> Array:
        """Tool point in metres and rotation vector (6,), machine frame."""
        at = self._thermal.parts_c(t_s) if temperatures_c is None else temperatures_c
        return self.machine.tool(self.machine.pose(drives, payload, at), at)

    def smr_positions(
        self,
        drives: Sequence[float],
        payload: int,
        t_s: float = 0.0,
        *,
        temperatures_c: Mapping[str, float] | None = None,
        in_station_frame: bool = False,
    ) -> dict[str, Array]:
        """Each SMR by name, shape (3,) in metres: machine frame or drift-free station frame."""
        at = self._thermal.parts_c(t_s) if temperatures_c is None else temperatures_c
        places = self.machine.reflectors(self.machine.pose(drives, payload, at), drives, at)
        return {
            smr.name: self._view.rotation @ place + self._view.translation_m if in_station_frame else place
            for smr, (place, _) in zip(self.machine.file.smrs, places, strict=True)
        }

    def forces_n(
        self, drives: Sequence[float], payload: int, *, temperatures_c: Mapping[str, float] | None = None
    ) -> Array:
        """Forces of the struts (s,), tension positive."""
        at = self._thermal.parts_c(0.0) if temperatures_c is None else temperatures_c
        return self.machine.rod_forces_n(drives, payload, self.machine.pose(drives, payload, at), at)


class SpatialPlant(BasePlant):
    """The machine in space, its payload and the station in front of it."""

    def __init__(self, machine_path: str | Path, settings: MockSettings, clock: RigClock) -> None:
        self.nominal: SpatialMachine = read_spatial_machine(machine_path)
        start = middle_pose(self.nominal)
        parts = [
            DrivePart(drive.name, drive.travel, float(np.clip(closed_drive(self.nominal, a, start), *drive.travel)))
            for a, drive in enumerate(self.nominal.drives)
        ]
        super().__init__(parts, settings, clock, StationView(settings, self.nominal.gravity))
        self._machine = draw_spatial_machine(self.nominal, settings)
        self.truth = SpatialTruth(self._machine, self.view, self.thermal)
        self._pose: SpatialPose | None = None
        self.can_be_strained = any(np.isfinite(rod.force_limit_n) for rod in self.nominal.rods)
        self._pose_lock = threading.Lock()
        self._loads, self._forces_n = np.zeros(len(parts)), np.zeros(len(self.nominal.rods))

    @property
    def machine(self) -> SpatialMachine:
        """The machine as its file states it."""
        return self.nominal

    def load_kg(self, drive: int) -> float:
        """The mass whose weight is the force that a drive held when the machine was last looked at."""
        load = abs(float(self._loads[drive]))
        if self.nominal.drives[drive].kind == "crank":
            load *= 2.0 * np.pi / (_FEED_M * _GEAR)
        return load / _GRAVITY_M_PER_S2

    def sightings(self, t_s: float) -> list[Sighting]:
        """All reflectors as the station sees them at rig time `t_s`, in the order of the machine file."""
        drives, temperatures_c = self._drive_positions(t_s), self.thermal.parts_c(t_s)
        pose = self._pose_at(drives, temperatures_c)
        places = self._machine.reflectors(pose, drives, temperatures_c)
        station_m = -self.view.rotation.T @ self.view.translation_m
        thick = [i for i, rod in enumerate(self.nominal.rods) if rod.diameter_m is not None]
        struts = self._machine.assembly(drives, self._payload, temperatures_c)
        seen = []
        for i, (smr, (place, facing)) in enumerate(zip(self.nominal.smrs, places, strict=True)):
            visible = facing is None or looks_here(facing, smr.acceptance_rad, place, station_m)
            for k in thick:
                joint, diameter_m = pose.place(struts.platform_m[k]), self.nominal.rods[k].diameter_m or 0.0
                visible = visible and not hides(struts.base_m[k], joint, diameter_m, place, station_m)
            polar = self.view.polar((float(place[0]), float(place[1]), float(place[2])), t_s)
            seen.append(Sighting(i, smr.name, polar, visible))
        return seen

    def overloaded(self, t_s: float) -> str | None:
        """The strut whose force is beyond its limit, or why nothing is at rest there; None while all is well."""
        drives, temperatures_c = self._drive_positions(t_s), self.thermal.parts_c(t_s)
        try:
            self._pose_at(drives, temperatures_c)
        except NoEquilibrium as error:
            return str(error)
        for rod, force in zip(self.nominal.rods, self._forces_n.tolist(), strict=True):
            if abs(force) > rod.force_limit_n:
                return f"{rod.name}: {force:.0f} N, {rod.force_limit_n:.0f} N permitted"
        return None

    def _drive_positions(self, t_s: float) -> list[float]:
        return [drive.encoder_m(t_s) for drive in self._drives]

    def _pose_at(self, drives: Sequence[float], temperatures_c: Mapping[str, float]) -> SpatialPose:
        """The pose at rest, found from the last one; the same to round-off from wherever it is sought."""
        with self._pose_lock:
            try:
                pose = self._machine.pose(drives, self._payload, temperatures_c, self._pose)
            except NoEquilibrium:  # the last pose was far away, or on no good way to this one
                pose = self._machine.pose(drives, self._payload, temperatures_c)
            self._pose = pose
            self._forces_n, self._loads = self._machine.loads(drives, self._payload, pose, temperatures_c)
            return pose
