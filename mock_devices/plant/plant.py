"""The planar machine that all mock devices share: its positions, and what an instrument would read of them.

Readings reveal no true values; `Plant.truth` is for scoring and tests only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mock_devices.clock import RigClock
from mock_devices.effects import parse
from mock_devices.effects.base import GRAVITY_M_PER_S2, Array, Effect, MotionState
from mock_devices.lasting_state import Knock
from mock_devices.machine_file import MachineFile, read_machine_file
from mock_devices.plant.affected_machine import AffectedMachine, affected_machine
from mock_devices.plant.base_plant import BasePlant, DriveMotion, DrivePart, Motion, SetPoint, Sighting
from mock_devices.plant.history_plant import HistoryPlant, MotionSource
from mock_devices.plant.optics import TWO_PI, Polar, StationView
from mock_devices.plant.true_machine import draw_machine, knocked
from mock_devices.plant.truth import Truth
from mock_devices.settings import MockSettings

_TORQUE_PER_N = 0.010 / TWO_PI / 10.0  # of the rated one, as in the drives' object 0x6077


class Plant(HistoryPlant):
    """The planar machine with two sliders or more, and the effects that may be wrong with it."""

    def __init__(self, machine_path: str | Path, settings: MockSettings, clock: RigClock) -> None:
        self.nominal: MachineFile = read_machine_file(machine_path)
        parts = [DrivePart(s.name, s.travel_m, home_m(self.nominal, i)) for i, s in enumerate(self.nominal.sliders)]
        super().__init__(parts, settings, clock, StationView(settings))
        self._machine = draw_machine(self.nominal, settings)
        self.truth = Truth(self._machine, self.view, self.thermal)
        self._affected = affected_machine(self._machine, self.view, self.nominal, settings)
        self._force_n = [0.0] * len(self.nominal.sliders)

    @property
    def machine(self) -> MachineFile:
        """The machine as its file states it."""
        return self.nominal

    def set_effects(self, texts: Sequence[str]) -> None:
        """Have these effects act from now on, and no others; what has a memory begins anew.

        Raises EffectError, which is a ValueError, and changes nothing, if one cannot be.
        """
        settings = replace(self.settings, effects=tuple(parse(text, self.nominal) for text in texts))
        affected = affected_machine(
            self._machine, self.view, self.nominal, settings, start_s=max(0.0, self.clock.now_s())
        )
        with self._lock:
            self.settings, self._affected, self._history = settings, affected, None
            self._force_n = [0.0] * len(self.nominal.sliders)

    def knock(self, knock: Knock) -> None:
        """Have a slider's column lean about its foot and stand elsewhere, from now on. ValueError without such."""
        names = [slider.name for slider in self.nominal.sliders]
        if knock.drive not in names:
            raise ValueError(f"there is no column '{knock.drive}'; there are {', '.join(names)}")
        machine = knocked(self._machine, knock.drive, knock.lean_rad, knock.shift_m)
        start_s = max(0.0, self.clock.now_s())
        affected = affected_machine(machine, self.view, self.nominal, self.settings, start_s=start_s)
        with self._lock:
            self._machine, self._affected, self._history = machine, affected, None
            self.truth = Truth(machine, self.view, self.thermal)
            self.knocks.append(knock)
        self.changed()

    def load_kg(self, drive: int) -> float:
        """Its share of the moving mass, and what effects add as a mass at the last observation of the machine."""
        return self.moving_mass_kg() / len(self.nominal.sliders) + self._force_n[drive] / GRAVITY_M_PER_S2

    def sightings(self, t_s: float) -> list[Sighting]:
        """All reflectors as the station sees them at rig time `t_s`, in the order of the machine file."""
        if self._affected is not None:
            return self._affected_sightings(self._affected, t_s)
        temperatures_c = self.thermal.parts_c(t_s)
        drives_m = tuple(drive.encoder_m(t_s) for drive in self._drives)
        pose = self._machine.pose(drives_m, self._payload, temperatures_c)
        places = self._machine.smr_positions(pose, drives_m, temperatures_c)
        return [
            Sighting(i, smr.name, self.view.polar(place, t_s))
            for i, (smr, place) in enumerate(zip(self.nominal.smrs, places, strict=True))
        ]

    @property
    def acting(self) -> Sequence[Effect]:
        """The effects that act."""
        return () if self._affected is None else self._affected.effects

    def torque_at_rest(self) -> Array:
        """Torque (d,) of each drive at rest due to the weight, as a fraction of the rated torque."""
        drives = len(self.nominal.sliders)
        return np.full(drives, self.moving_mass_kg() / drives * GRAVITY_M_PER_S2 * _TORQUE_PER_N)

    def _affected_sightings(self, affected: AffectedMachine, t_s: float) -> list[Sighting]:
        with self._lock:
            state = self._observed_state(affected, t_s)
            payload = np.array([self._payload])
            observed = affected.sight(state, payload)
            self._force_n = [float(force) for force in affected.deviation(state).force_n[0]]
        return [
            Sighting(
                i,
                smr.name,
                Polar(float(observed.hz_rad[0, i]), float(observed.v_rad[0, i]), float(observed.distance_m[0, i])),
            )
            for i, smr in enumerate(self.nominal.smrs)
        ]

    def _observed_state(self, affected: AffectedMachine, t_s: float) -> MotionState:
        """The present state; the drives are observed later than the station by its latency."""
        now = self.motion_state(t_s)
        early_s = float(affected.early_s(now)[0])
        return now if early_s == 0.0 else self.motion_state(t_s, t_s + early_s)


def home_m(machine: MachineFile, drive: int) -> float:
    """Drive coordinate of pose zero by the nominal geometry, kept within the travel."""
    slider = machine.sliders[drive]
    strut = next(s for s in machine.struts if s.drive == drive)
    w = (strut.platform_joint - strut.base_joint) * slider.axis.conjugate()  # along and across the axis
    half = (strut.length_m**2 - w.imag**2) ** 0.5
    low, high = slider.travel_m
    return min(max(w.real + slider.branch * half, low), high)


__all__ = ["BasePlant", "DriveMotion", "Motion", "MotionSource", "Plant", "SetPoint", "Sighting", "home_m"]
