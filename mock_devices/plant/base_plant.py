"""What every plant has, whatever its machine: drives, payload, the station in front of it, noise of readings."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from mock_devices.clock import RigClock
from mock_devices.lasting_state import Knock, PlantState
from mock_devices.plant.noise import heavy_tailed
from mock_devices.plant.optics import Polar, StationView
from mock_devices.plant.thermal import Thermal
from mock_devices.seeds import generator
from mock_devices.settings import MockSettings, Vector3


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


@dataclass(frozen=True)
class Sighting:
    """A reflector as the station would see it, free of noise: index and name of the SMR, face I.

    Not `visible`: it looks elsewhere, or something stands in the beam.
    """

    smr: int
    name: str
    polar: Polar
    visible: bool = True


@dataclass(frozen=True)
class ReadingNoise:
    """Errors of one reading: transverse angle in Hz, angle in V, distance."""

    hz_rad: float
    v_rad: float
    distance_m: float


@dataclass(frozen=True)
class DrivePart:
    """What a mock drive has to know of the machine's drive: `home` is where it stands at first, in m or rad."""

    name: str
    travel: tuple[float, float]
    home: float


class NamedPart(Protocol):
    """A part of a machine file that has a name."""

    @property
    def name(self) -> str:
        """Its name."""
        ...


class NominalMachine(Protocol):
    """What a machine file says, of either reader, that devices have to know."""

    @property
    def name(self) -> str:
        """Name of the machine."""
        ...

    @property
    def smrs(self) -> Sequence[NamedPart]:
        """The reflectors, in the order of the file."""
        ...

    @property
    def moving_mass_kg(self) -> float:
        """Mass of the platform and what always moves with it."""
        ...


class BasePlant(ABC):
    """The machine's payload, its temperatures and the station in front of it; what kind of machine, subclasses know.

    The drives are attached after they were made. Noise of a reading depends on the seed, the SMR, the
    targets, the number of the visit to these targets and the number of the reading of this visit, and on the
    time at which the mock begins, never on time since then.
    A visit is a set of set-points at which something was measured. Safe to use from several threads.
    """

    def __init__(self, parts: Sequence[DrivePart], settings: MockSettings, clock: RigClock, view: StationView) -> None:
        self.parts = tuple(parts)
        self.settings = settings
        self.clock = clock
        self.view = view
        self.thermal = Thermal(settings)
        self.changed: Callable[[], None] = lambda: None
        self._lock = threading.Lock()
        self._payload = settings.initial_payload
        self._drives: tuple[DriveMotion, ...] = ()
        self._visits: dict[tuple[int, ...], int] = {}
        self._visit: tuple[SetPoint, ...] | None = None
        self._readings: dict[int, int] = {}
        self._exchanges = 0
        self._moved_m, self._turned_rad = (0.0, 0.0, 0.0), 0.0
        self.knocks: list[Knock] = []

    @property
    @abstractmethod
    def machine(self) -> NominalMachine:
        """The machine as its file states it."""

    @abstractmethod
    def sightings(self, t_s: float) -> list[Sighting]:
        """All reflectors as the station sees them at rig time `t_s`, in the order of the machine file."""

    @abstractmethod
    def load_kg(self, drive: int) -> float:
        """The mass that a drive carries, or the one whose weight is the force that it has to hold."""

    can_be_strained = False

    def overloaded(self, t_s: float) -> str | None:
        """What must not be, for which the drives fault; None while all is well."""
        del t_s
        return None

    def attach(self, drives: tuple[DriveMotion, ...]) -> None:
        """Connect the drives, in the order of the machine file."""
        if len(drives) != len(self.parts):
            raise ValueError(f"{len(self.parts)} drives required, not {len(drives)}")
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

    def set_effects(self, texts: Sequence[str]) -> None:
        """Have these effects act from now on, and no others. Raises ValueError for those that cannot be."""
        if texts:
            raise ValueError(f"this plant of {self.machine.name} has no effects")

    def move_station(self, by_m: Vector3, turn_rad: float) -> None:
        """Set the station up elsewhere, at once: moved in the machine's frame, turned clockwise seen from above."""
        self.view.move(by_m, turn_rad)
        x, y, z = (a + b for a, b in zip(self._moved_m, by_m, strict=True))
        self._moved_m, self._turned_rad = (x, y, z), self._turned_rad + turn_rad
        self.changed()

    def knock(self, knock: Knock) -> None:
        """Have a column lean and stand elsewhere from now on. Raises ValueError where there is none of that name."""
        raise ValueError(f"the mock's columns are those of planar machines with sliders, not of {self.machine.name}")

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
            knocks=tuple(self.knocks),
        )

    def restore(self, state: PlantState) -> None:
        """Begin where another one ended."""
        self._payload, self._exchanges = state.payload, state.exchanges
        self._visits = dict(state.visits)
        self._moved_m, self._turned_rad = state.station_moved_m, state.station_turned_rad
        self.view.move(self._moved_m, self._turned_rad)
        for knock in state.knocks:
            self.knock(knock)

    def moving_mass_kg(self) -> float:
        """Nominal mass that the drives carry, payload included."""
        return self.machine.moving_mass_kg + self.settings.payloads[self._payload].mass_kg

    def is_moving(self) -> bool:
        """Whether any drive moves now."""
        t_s = self.clock.now_s()
        return any(drive.is_moving(t_s) for drive in self._drives)

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
