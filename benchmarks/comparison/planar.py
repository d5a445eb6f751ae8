"""Campaigns on the mock plant: the planar default machine, whose change the plant itself carries out."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from benchmarks.comparison.change import Array, Change
from calibration.machine.description import Machine, load_machine, shipped_machine
from calibration.recording.header import RecordingFile
from calibration.recording.recording import Recording
from mock_devices.known_tables import KnownTable
from mock_devices.machine_file import MachineFile, read_machine_file
from mock_devices.plant.affected_machine import make_effects
from mock_devices.plant.true_machine import draw_machine
from mock_devices.recordings.design import DesignOptions, draw_design
from mock_devices.recordings.maker import SimulatedCampaign
from mock_devices.recordings.timeline import Timeline, plan
from mock_devices.settings import DisturbanceLevels, InstrumentProfile, MockSettings

NAME = "planar4"
OPTIONS = DesignOptions(visits=90, poses=60)
FEW = 72  # visits of the shortest campaign
PAYLOADS = ((0, 2), (0, 1), (2, 0), (0, 2, 0, 2))


@lru_cache(maxsize=1)
def nominal() -> tuple[MachineFile, Machine]:
    """The machine file, as the mock reads it and as the comparison does."""
    path = shipped_machine(NAME)
    return read_machine_file(path), load_machine(path)


@lru_cache(maxsize=32)
def design(number: int) -> Timeline:
    """One of the campaigns' designs: poses, directions, payloads, speeds."""
    rng = np.random.default_rng([17, number])
    visits = int(rng.integers(FEW, OPTIONS.visits + 30))
    options = replace(OPTIONS, visits=visits, poses=2 * visits // 3, payload_blocks=PAYLOADS[number % len(PAYLOADS)])
    return plan(nominal()[0], draw_design(nominal()[0], rng, options))


class _Lasting:
    """What lasts for a whole campaign: no memory of motions, nothing to do with the station."""

    def record_leg(self, drive: int, leg: Any) -> None:
        """Nothing to be remembered."""

    def early_s(self, state: Any) -> float:
        """Drives and station are seen at the same time."""
        return 0.0

    def apply_to_sight(self, state: Any, sight: Any) -> None:
        """The station sees what is there."""


@dataclass(frozen=True)
class Acting(_Lasting):
    """A change as the plant's effects act: on what the plant computes its equilibrium from."""

    machine: MachineFile
    change: Change

    def act(self, state: Any, deviation: Any) -> None:
        """Move the parts."""
        change, sliders = self.change, self.machine.sliders
        for a, curve in change.travel.items():
            deviation.travel_m[:, a] += curve(state.q_m[:, a])
        for a, (x, y, _) in change.column_shift_m.items():
            along = complex(x, y) * sliders[a].axis.conjugate()
            deviation.travel_m[:, a] += along.real
            deviation.sideways_m[:, a] += along.imag
        for a, (_, _, turn) in change.column_tilt_rad.items():
            deviation.sideways_m[:, a] += turn * state.q_m[:, a]
        for i, longer in change.length_m.items():
            deviation.length_m[:, i] += longer
        for i, ratio in change.ln_stiffness.items():
            deviation.ln_stiffness[:, i] += ratio
        for i, (x, y, _) in change.platform_joint_m.items():
            deviation.platform_joint_m[:, i] += complex(x, y)
        for i, (x, y, _) in change.base_joint_m.items():
            deviation.base_joint_m[:, i] += complex(x, y)
        for i, shift in change.smr_m.items():
            deviation.smr_m[:, i, :] += np.array(shift)


@dataclass(frozen=True)
class TablesOn(_Lasting):
    """Tables of one generation are on: the drives go where these send them."""

    machine: MachineFile
    tables: tuple[KnownTable, ...]

    def act(self, state: Any, deviation: Any) -> None:
        """Move the drives."""
        names = [slider.name for slider in self.machine.sliders]
        for table in self.tables:
            if table.generation == self.tables[0].generation:
                own = names.index(table.drive)
                partner = names.index(table.partner or table.drive)
                deviation.travel_m[:, own] += table.correction_m(state.q_m[:, own], state.q_m[:, partner])


@dataclass(frozen=True)
class Circumstances:
    """What differs between campaigns of one machine without being a change of it.

    seed: of noise, temperatures and disturbances; station: of where it stands and of its range errors.
    """

    seed: int
    station: int
    design: int
    instrument: InstrumentProfile = field(default_factory=InstrumentProfile)
    station_position_m: tuple[float, float, float] = (0.0, 0.3, 3.2)
    heading_rad: float = 0.0
    shop_c: float = 0.0
    tables: tuple[KnownTable, ...] = ()
    with_tables: bool = False


class PlanarCampaign(SimulatedCampaign):
    """A campaign on the machine of a seed under some circumstances, with a change if it comes after one."""

    def __init__(self, machine_seed: int, at: Circumstances, levels: DisturbanceLevels, change: Change) -> None:
        timeline = design(at.design)
        begin = timeline.design.start_s
        programme = ((begin - 3600.0, at.shop_c), (begin + 8.0 * 3600.0, at.shop_c)) if at.shop_c else ()
        settings = MockSettings(
            seed=at.seed,
            nuisance=levels,
            instrument=at.instrument,
            noise_tails=5.0,
            clock_jitter_s=0.05,
            station_position_m=at.station_position_m,
            station_heading_rad=at.heading_rad,
            temperature_programme=programme,
            known_tables=at.tables,
        )
        super().__init__(shipped_machine(NAME), settings, timeline)
        self.machine = draw_machine(self.nominal, replace(settings, seed=machine_seed))
        self.view = type(self.view)(replace(settings, seed=at.station))
        self.at, self.change = at, change

    def sight(self, effects: list[Any] | None = None) -> Any:
        """What the station sees: with the ordinary disturbances, what has changed, and tables where they are on."""
        if effects is None:
            effects = list(make_effects(self.nominal, self.settings, start_s=self.start_s))
            effects += [Acting(self.nominal, self.change)]
            if self.at.with_tables:
                effects += [TablesOn(self.nominal, self.at.tables)]
        return super().sight(effects)

    @cached_property
    def platform(self) -> Array:
        """Which readings (r,) are of a reflector on the platform."""
        return np.array([smr.on == "platform" for smr in self.nominal.smrs])[self.timeline.smr]

    def shifted_m(self, change: Change) -> Array:
        """Shift (r, 3) of the noise-free readings by a change, in the machine's axes."""
        acting: list[Any] = [Acting(self.nominal, change)]
        return np.asarray((self.points_m(acting) - self._still) @ self.view.rotation)

    @cached_property
    def _still(self) -> Array:
        return self.points_m([Acting(self.nominal, Change())])

    @cached_property
    def places_m(self) -> Array:
        """Where the readings (r, 3) are in the machine's frame."""
        return np.asarray((self._still - self.view.translation_m) @ self.view.rotation)

    @cached_property
    def weight(self) -> Array:
        """One over the standard deviation (r, 3) of each coordinate, machine's axes: the line of sight is nearly z."""
        sd, distance = self.at.instrument, np.linalg.norm(self._still, axis=1)
        across = sd.angle_sd_rad * distance
        each = np.stack([across, across, np.full(len(distance), sd.range_sd_m)], axis=1)
        return np.asarray(np.sqrt(self.timeline.samples)[:, None] / each)

    def recording(self, name: str) -> Recording:
        """What the comparison is given."""
        made = self.record(name)
        columns = dict(made.columns)
        if self.at.with_tables:
            on = np.where(self.timeline.is_nest, 0.0, float(self.at.tables[0].generation))
            columns["compensation"] = on
        return Recording(RecordingFile.model_validate(made.header), nominal()[1], columns)
