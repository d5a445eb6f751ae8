"""A machine in space behind the mock devices: legs, cranks, sliders and guides of any machine file.

Not modelled: those effects of `mock_devices.effects` that are not in `in_space`.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mock_devices.clock import RigClock
from mock_devices.effects import parse
from mock_devices.effects.base import Effect, MotionState
from mock_devices.effects.in_space import view_of
from mock_devices.plant.affected_machine import polar_series
from mock_devices.plant.base_plant import DrivePart, Sighting
from mock_devices.plant.history_plant import HistoryPlant
from mock_devices.plant.optics import TWO_PI, Polar, StationView
from mock_devices.plant.sight_lines import hides, looks_here
from mock_devices.plant.spatial_draw import draw_spatial_machine
from mock_devices.plant.spatial_effects import SpatialEffects
from mock_devices.plant.spatial_equilibrium import SMALL_STEP, SpatialPose
from mock_devices.plant.spatial_machine import (
    Departure,
    TrueSpatialMachine,
    closed_drive,
    middle_pose,
)
from mock_devices.plant.structure import NoEquilibrium
from mock_devices.plant.thermal import Thermal
from mock_devices.settings import MockSettings
from mock_devices.spatial_file import SpatialMachine, read_spatial_machine

Array = NDArray[np.float64]

_GRAVITY_M_PER_S2 = 9.80665
_FEED_M = 0.010  # of a drive's screw
_TORQUE_PER_N = _FEED_M / TWO_PI / 10.0  # of the rated one, as in the drives' object 0x6077
_GEAR = 200.0  # of a crank, whose motor has the rating of the others
_WATCHED_STEP = 1e-7  # rad or m: what is left then is far below what changes a force


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


class SpatialPlant(HistoryPlant):
    """The machine in space, its payload, the station in front of it, and those effects that its parts can have."""

    joined_s = 0.05  # a led drive makes a motion a SYNC

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
        self._effects = SpatialEffects.of(self.nominal, settings)

    @property
    def machine(self) -> SpatialMachine:
        """The machine as its file states it."""
        return self.nominal

    @property
    def acting(self) -> Sequence[Effect]:
        """The effects that act."""
        return self._effects.effects

    @property
    def metres(self) -> Array | float:
        """The unit (d,) of a drive in the motions that effects see: a crank's angle times its arm."""
        return self._effects.metres

    def set_effects(self, texts: Sequence[str]) -> None:
        """Have these effects act from now on, and no others; what has a memory begins anew.

        Raises EffectError, which is a ValueError, and changes nothing, if one cannot be.
        """
        view = view_of(self.nominal)
        settings = replace(self.settings, effects=tuple(parse(text, view) for text in texts))
        effects = SpatialEffects.of(self.nominal, settings, start_s=max(0.0, self.clock.now_s()))
        with self._lock:
            self.settings, self._effects, self._history = settings, effects, None

    def load_kg(self, drive: int) -> float:
        """The mass whose weight is the force that a drive held when the machine was last looked at."""
        load = abs(float(self._loads[drive]))
        if self.nominal.drives[drive].kind == "crank":
            load *= 2.0 * np.pi / (_FEED_M * _GEAR)
        return load / _GRAVITY_M_PER_S2

    def torque_at_rest(self) -> Array:
        """Torque (d,) of each drive at rest, as a fraction of the rated torque."""
        loads_kg = np.array([self.load_kg(a) for a in range(len(self.parts))])
        return np.asarray(loads_kg * _GRAVITY_M_PER_S2 * _TORQUE_PER_N)

    def sightings(self, t_s: float) -> list[Sighting]:
        """All reflectors as the station sees them at rig time `t_s`, in the order of the machine file."""
        drives_s = t_s
        state, departure = None, None
        if self.acting:
            with self._lock:
                state = self.motion_state(t_s)
                if (early_s := self._effects.early_s(state)) != 0.0:
                    drives_s = t_s + early_s
                    state = self.motion_state(t_s, drives_s)
                if self._effects.need_loads:
                    state = replace(state, loads_n=self._driving_n(drives_s, t_s)[None])
                departure = self._effects.departure(state)
        drives, temperatures_c = self._drive_positions(drives_s), self.thermal.parts_c(t_s)
        pose = self._pose_at(drives, temperatures_c, departure)
        places = self._machine.reflectors(pose, drives, temperatures_c, departure)
        polar = self._polar(np.array([place for place, _ in places]), t_s, state)
        station_m = -self.view.rotation.T @ self.view.translation_m
        thick = [i for i, rod in enumerate(self.nominal.rods) if rod.diameter_m is not None]
        struts = self._machine.assembly(drives, self._payload, temperatures_c, departure)
        seen = []
        for i, (smr, (place, facing)) in enumerate(zip(self.nominal.smrs, places, strict=True)):
            visible = facing is None or looks_here(facing, smr.acceptance_rad, place, station_m)
            for k in thick:
                joint, diameter_m = pose.place(struts.platform_m[k]), self.nominal.rods[k].diameter_m or 0.0
                visible = visible and not hides(struts.base_m[k], joint, diameter_m, place, station_m)
            seen.append(Sighting(i, smr.name, polar[i], visible))
        return seen

    def _polar(self, places_m: Array, t_s: float, state: MotionState | None) -> list[Polar]:
        """What the station sees of places (s, 3), with the effects of instrument and air."""
        if state is None:
            return [self.view.polar((float(x), float(y), float(z)), t_s) for x, y, z in places_m]
        sight = polar_series(self.view, places_m[None], state.t_s)
        for effect in self.acting:
            effect.apply_to_sight(state, sight)
        return [
            Polar(float(hz) % TWO_PI, float(v), float(distance))
            for hz, v, distance in zip(sight.hz_rad[0], sight.v_rad[0], sight.distance_m[0], strict=True)
        ]

    def overloaded(self, t_s: float) -> str | None:
        """The strut whose force is beyond its limit, or why nothing is at rest there; None while all is well.

        Of the machine without effects: these are far below what breaks a strut.
        """
        drives, temperatures_c = self._drive_positions(t_s), self.thermal.parts_c(t_s)
        try:
            self._pose_at(drives, temperatures_c, small_step=_WATCHED_STEP)
        except NoEquilibrium as error:
            return str(error)
        for rod, force in zip(self.nominal.rods, self._forces_n.tolist(), strict=True):
            if abs(force) > rod.force_limit_n:
                return f"{rod.name}: {force:.0f} N, {rod.force_limit_n:.0f} N permitted"
        return None

    def _driving_n(self, drives_s: float, t_s: float) -> Array:
        """Force (d,) of each drive in its positive direction without effects: a leg that is pulled holds back."""
        self._pose_at(self._drive_positions(drives_s), self.thermal.parts_c(t_s))
        return self._loads * self._effects.pushes

    def _drive_positions(self, t_s: float) -> list[float]:
        return [drive.encoder_m(t_s) for drive in self._drives]

    def _pose_at(
        self,
        drives: Sequence[float],
        temperatures_c: Mapping[str, float],
        departure: Departure | None = None,
        small_step: float = SMALL_STEP,
    ) -> SpatialPose:
        """The pose at rest, found from the last one; that of a reading bit for bit the same, whatever was before."""
        with self._pose_lock:
            try:
                pose = self._machine.pose(drives, self._payload, temperatures_c, self._pose, departure, small_step)
            except NoEquilibrium:  # the last pose was far away, or on no good way to this one
                pose = self._machine.pose(drives, self._payload, temperatures_c, None, departure)
            if small_step == SMALL_STEP:
                pose = self._machine.pose(drives, self._payload, temperatures_c, pose.rounded(), departure)
            self._pose = pose
            self._forces_n, self._loads = self._machine.loads(drives, self._payload, pose, temperatures_c, departure)
            if departure is not None:
                self._loads = self._loads + departure.force_n
            return pose
