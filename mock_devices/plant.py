"""The one machine that all mock devices share: what stands where, and what an instrument would read of it.

Nothing true leaves through the readings; `Plant.truth` is for scoring and tests only.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from mock_devices.clock import RigClock
from mock_devices.machine_file import MachineFile, read_machine_file
from mock_devices.optics import Polar, StationView
from mock_devices.seeds import generator
from mock_devices.settings import MockSettings
from mock_devices.thermal import Thermal
from mock_devices.true_machine import draw_machine
from mock_devices.truth import Truth


@dataclass(frozen=True)
class SetPoint:
    """The set-point that a drive follows: how many it has taken so far, and the target in increments."""

    count: int
    target_inc: int


class DriveMotion(Protocol):
    """What the plant asks of a drive."""

    def encoder_m(self, t_s: float) -> float:
        """Where the drive stands at rig time `t_s`, not earlier than a few set-points ago."""
        ...

    def set_point(self, t_s: float) -> SetPoint:
        """The set-point that was followed at `t_s`."""
        ...

    def is_moving(self, t_s: float) -> bool:
        """Whether a motion is under way."""
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
    targets, the number of the visit to this pair of targets and the number of the reading of this visit, never on time.
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

    def attach(self, drives: tuple[DriveMotion, ...]) -> None:
        """Connect the drives, in the order of the machine file."""
        if len(drives) != len(self.nominal.sliders):
            raise ValueError(f"{len(self.nominal.sliders)} drives wanted, {len(drives)} given")
        self._drives = drives

    @property
    def payload(self) -> int:
        """Number of the payload that is on."""
        return self._payload

    def put_on(self, payload: int) -> None:
        """Exchange the payload, at once."""
        if not 0 <= payload < len(self.settings.payloads):
            raise ValueError(f"there is no payload {payload}")
        self._payload = payload

    def moving_mass_kg(self) -> float:
        """Nominal mass that the drives carry, payload included."""
        return self.nominal.moving_mass_kg + self.settings.payloads[self._payload].mass_kg

    def is_moving(self) -> bool:
        """Whether any drive moves now."""
        t_s = self.clock.now_s()
        return any(drive.is_moving(t_s) for drive in self._drives)

    def sightings(self, t_s: float) -> list[Sighting]:
        """All reflectors as the station sees them at rig time `t_s`, in the order of the machine file."""
        drives_m = tuple(drive.encoder_m(t_s) for drive in self._drives)
        temperatures_c = self.thermal.parts_c(t_s)
        pose = self._machine.pose(drives_m, self._payload, temperatures_c)
        places = self._machine.smr_positions(pose, drives_m, temperatures_c)
        return [
            Sighting(i, smr.name, self.view.polar(place, t_s))
            for i, (smr, place) in enumerate(zip(self.nominal.smrs, places, strict=True))
        ]

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
        key = (smr, *targets, visit, reading)
        hz, v, distance = generator(self.settings.seed, "reading", *key).standard_normal(3)
        sd = self.settings.instrument
        return ReadingNoise(float(sd.angle_sd_rad * hz), float(sd.angle_sd_rad * v), float(sd.range_sd_m * distance))
