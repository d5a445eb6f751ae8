"""The one machine that all mock devices share: its positions, and what an instrument would read of them.

Readings reveal no true values; `Plant.truth` is for scoring and tests only.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from mock_devices.clock import RigClock
from mock_devices.effects.base import GRAVITY_M_PER_S2, Leg, MotionState
from mock_devices.lasting_state import PlantState
from mock_devices.machine_file import MachineFile, read_machine_file
from mock_devices.plant.affected_machine import AffectedMachine, affected_machine, heavy_tailed, motion_states
from mock_devices.plant.motion_history import MotionHistory
from mock_devices.plant.optics import TWO_PI, Polar, StationView
from mock_devices.plant.thermal import Thermal
from mock_devices.plant.true_machine import draw_machine
from mock_devices.plant.truth import Truth
from mock_devices.seeds import generator
from mock_devices.settings import MockSettings, Vector3

_DIFFERENCE_S = 1.0e-3
_TORQUE_PER_N = 0.010 / TWO_PI / 10.0  # of the rated one, as in the drives' object 0x6077


@dataclass(frozen=True)
class SetPoint:
    """The set-point that a drive follows: how many it has accepted so far, and the target in increments."""

    count: int
    target_inc: int


@dataclass(frozen=True)
class Motion:
    """One motion of a drive as it was planned: rig times, positions, highest speed."""

    start_s: float
    end_s: float
    from_m: float
    to_m: float
    speed_m_per_s: float


class DriveMotion(Protocol):
    """What the plant needs of a drive."""

    def encoder_m(self, t_s: float) -> float:
        """Where the drive stands at rig time `t_s`, not earlier than a few set-points ago."""
        ...

    def set_point(self, t_s: float) -> SetPoint:
        """The set-point that was followed at `t_s`."""
        ...

    def is_moving(self, t_s: float) -> bool:
        """Whether a motion is under way."""
        ...


@runtime_checkable
class MotionSource(Protocol):
    """A drive that reports its motions; effects with history need it."""

    def motions_after(self, t_s: float) -> list[Motion]:
        """All motions that began after `t_s`."""
        ...


@dataclass(frozen=True)
class Sighting:
    """A reflector as the station would see it, free of noise: index and name of the SMR, face I."""

    smr: int
    name: str
    polar: Polar


@dataclass(frozen=True)
class ReadingNoise:
    """Errors of one reading: transverse angle in Hz, angle in V, distance."""

    hz_rad: float
    v_rad: float
    distance_m: float


class Plant:
    """The machine, its payload, its temperatures and the station in front of it.

    The drives are attached after they were made. Noise of a reading depends on the seed, the SMR, both
    targets, the number of the visit to this pair of targets and the number of the reading of this visit, and on the
    time at which the mock begins, never on time since then.
    A visit is a pair of set-points at which something was measured. Safe to use from several threads.
    """

    def __init__(self, machine_path: str | Path, settings: MockSettings, clock: RigClock) -> None:
        self.settings = settings
        self.clock = clock
        self.nominal: MachineFile = read_machine_file(machine_path)
        self.thermal = Thermal(settings)
        self._machine = draw_machine(self.nominal, settings)
        self.view = StationView(settings)
        self._lock = threading.Lock()
        self._payload = settings.initial_payload
        self._drives: tuple[DriveMotion, ...] = ()
        self._visits: dict[tuple[int, ...], int] = {}
        self._visit: tuple[SetPoint, ...] | None = None
        self._readings: dict[int, int] = {}
        self.truth = Truth(self._machine, self.view, self.thermal)
        self._affected = affected_machine(self._machine, self.view, self.nominal, settings)
        self._exchanges = 0
        self._moved_m, self._turned_rad = (0.0, 0.0, 0.0), 0.0
        self.changed: Callable[[], None] = lambda: None
        self._history: MotionHistory | None = None
        self._force_n = [0.0] * len(self.nominal.sliders)

    def attach(self, drives: tuple[DriveMotion, ...]) -> None:
        """Connect the drives, in the order of the machine file."""
        if len(drives) != len(self.nominal.sliders):
            raise ValueError(f"{len(self.nominal.sliders)} drives required, not {len(drives)}")
        self._drives = drives

    @property
    def payload(self) -> int:
        """Number of the present payload."""
        return self._payload

    def put_on(self, payload: int) -> None:
        """Exchange the payload, at once."""
        if not 0 <= payload < len(self.settings.payloads):
            raise ValueError(f"there is no payload {payload}")
        self._payload = payload
        self._exchanges += 1
        self.changed()

    def move_station(self, by_m: Vector3, turn_rad: float) -> None:
        """Set the station up elsewhere, at once: moved in the machine's frame, turned clockwise seen from above."""
        self.view.move(by_m, turn_rad)
        x, y, z = (a + b for a, b in zip(self._moved_m, by_m, strict=True))
        self._moved_m, self._turned_rad = (x, y, z), self._turned_rad + turn_rad
        self.changed()

    def state(self) -> PlantState:
        """What outlives a restart of the mock."""
        with self._lock:
            visits = tuple(self._visits.items())
        return PlantState(
            payload=self._payload,
            exchanges=self._exchanges,
            visits=visits,
            station_moved_m=self._moved_m,
            station_turned_rad=self._turned_rad,
        )

    def restore(self, state: PlantState) -> None:
        """Begin where another one ended."""
        self._payload, self._exchanges = state.payload, state.exchanges
        self._visits = dict(state.visits)
        self._moved_m, self._turned_rad = state.station_moved_m, state.station_turned_rad
        self.view.move(self._moved_m, self._turned_rad)

    def moving_mass_kg(self) -> float:
        """Nominal mass that the drives carry, payload included."""
        return self.nominal.moving_mass_kg + self.settings.payloads[self._payload].mass_kg

    def is_moving(self) -> bool:
        """Whether any drive moves now."""
        t_s = self.clock.now_s()
        return any(drive.is_moving(t_s) for drive in self._drives)

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

    def friction_kg(self, drive: int) -> float:
        """What effects add to a drive's load, as a mass, at the last observation of the machine."""
        return self._force_n[drive] / GRAVITY_M_PER_S2

    def weight_torque(self) -> float:
        """Torque of each drive at rest due to the weight, as a fraction of the rated torque."""
        return self.moving_mass_kg() / len(self.nominal.sliders) * GRAVITY_M_PER_S2 * _TORQUE_PER_N

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

    def motion_state(self, t_s: float, drives_s: float | None = None) -> MotionState:
        """The machine's state at rig time `t_s`, with the drives as they are at `drives_s` if observed later."""
        drives_s = t_s if drives_s is None else drives_s
        history = self._history_until(drives_s)
        positions = np.array([[drive.encoder_m(drives_s) for drive in self._drives]])
        before = np.array([[drive.encoder_m(drives_s - _DIFFERENCE_S) for drive in self._drives]])
        return motion_states(
            history,
            np.array([t_s]),
            positions,
            (positions - before) / _DIFFERENCE_S,
            np.array([self.settings.payloads[self._payload].mass_kg]),
            np.array([float(self._exchanges)]),
            self.thermal,
            drives_s=np.array([drives_s]),
        )

    def legs(self, drive: int) -> list[Leg]:
        """The legs of a drive until it was last observed."""
        return [] if self._history is None else self._history.legs(drive)

    def _history_until(self, t_s: float) -> MotionHistory:
        """The drives' motions until `t_s`, passed on to the effects."""
        if self._history is None:
            effects = () if self._affected is None else self._affected.effects
            self._history = MotionHistory([drive.encoder_m(0.0) for drive in self._drives], effects)
        for index, drive in enumerate(self._drives):
            if not isinstance(drive, MotionSource):
                continue
            last_s = self._history.legs(index)[-1].start_s
            for motion in drive.motions_after(last_s):
                if motion.start_s <= t_s:
                    self._history.add(
                        index, motion.start_s, motion.end_s, motion.to_m, motion.speed_m_per_s, reached_m=motion.from_m
                    )
        return self._history

    def reading_noise(self, smr: int, t_s: float) -> ReadingNoise:
        """Draw the errors of the next reading of an SMR and count it."""
        points = tuple(drive.set_point(t_s) for drive in self._drives)
        targets = tuple(point.target_inc for point in points)
        with self._lock:
            if points != self._visit:
                self._visit = points
                self._visits[targets] = self._visits.get(targets, 0) + 1
                self._readings = {}
            visit = self._visits[targets]
            reading = self._readings[smr] = self._readings.get(smr, 0) + 1
        begun = (round(self.settings.start_s * 1000.0),) if self.settings.start_s else ()
        key = (smr, *targets, visit, reading, *begun)
        rng = generator(self.settings.seed, "reading", *key)
        hz, v, distance = heavy_tailed(rng.standard_normal(3), self.settings.noise_tails, rng)
        sd = self.settings.instrument
        return ReadingNoise(float(sd.angle_sd_rad * hz), float(sd.angle_sd_rad * v), float(sd.range_sd_m * distance))
