"""The few designs that a run's cases share, with what is costly to know of each."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from mock_devices.known_tables import KnownTable, draw_known_tables
from mock_devices.machine_file import MachineFile, read_machine_file
from mock_devices.recordings.design import Design, DesignOptions, Visit, draw_design, draw_programme
from mock_devices.recordings.maker import SimulatedCampaign
from mock_devices.recordings.timeline import Timeline, plan
from mock_devices.recordings.visible_size import VisibleScale
from mock_devices.settings import DisturbanceLevels, MockSettings

MACHINE = Path(__file__).parents[2] / "calibration" / "machine" / "data" / "planar4.toml"
RICH = DesignOptions(fly_share=0.15)
PLATFORM = DesignOptions(fly_share=0.15, platform_only=True)
POOR = DesignOptions(
    randomised=False,
    both_directions=False,
    payload_blocks=(0,),
    speeds_m_per_s=(0.25,),
    dwells_s=(2.0,),
)
OPTIONS = {"rich": RICH, "platform": PLATFORM, "poor": POOR}
COUNTS = {"rich": 6, "platform": 4, "poor": 1}
FEW = {"rich": 2, "platform": 1, "poor": 1}  # of short runs: what a design costs is paid once
SWING_K = {"rich": (1.0, 2.5), "platform": (1.0, 2.5), "poor": (0.4, 0.6)}
REFERENCE_SEED = 7
WITHOUT_RESTS_H = 1.2  # about what the visits of a design take

Programme = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Drawn:
    """A design with its name, its times, the swing of the shop's temperature during it and the rig's tables."""

    name: str
    timeline: Timeline
    programme: Programme
    known_tables: tuple[KnownTable, ...] = ()
    seed: int = REFERENCE_SEED

    @property
    def duration_s(self) -> float:
        """From the begin to the last reading."""
        return float(self.timeline.t_s[-1] - self.timeline.design.start_s)

    def settings(self, seed: int, nuisance: DisturbanceLevels) -> MockSettings:
        """A rig that carries it out: noise with tails, friction in every torque, biased sensors, a jittering clock."""
        return MockSettings(
            seed=seed,
            nuisance=nuisance,
            noise_tails=5.0,
            rest_friction=True,
            temperature_sensor_bias_k=0.1,
            clock_jitter_s=0.05,
            temperature_programme=self.programme,
            known_tables=self.known_tables,
        )

    def bench(self, seed: int, nuisance: DisturbanceLevels) -> SimulatedCampaign:
        """A fresh machine to carry it out on."""
        return SimulatedCampaign(MACHINE, self.settings(seed, nuisance), self.timeline)

    @cached_property
    def visible(self) -> VisibleScale:
        """What a refit absorbs: sensitivities of one reference machine, the same for all to a ten-thousandth."""
        return VisibleScale(self.bench(self.seed, DisturbanceLevels()))

    def extended(self, visits: tuple[Visit, ...]) -> Timeline:
        """The same campaign with further visits after its own."""
        design = self.timeline.design
        return plan(self.timeline.machine, with_visits(design, (*design.visits, *visits)))


def with_visits(design: Design, visits: tuple[Visit, ...]) -> Design:
    """A design with other visits."""
    return Design(visits, design.smrs, design.nests, design.nest_every, design.nest_samples, design.start_s)


def lasting(hours: float) -> dict[str, DesignOptions]:
    """The styles with rests so much longer that a campaign lasts about so many hours."""
    return {style: _lasting(hours, options) for style, options in OPTIONS.items()}


def _lasting(hours: float, options: DesignOptions) -> DesignOptions:
    mean_s = 3600.0 * (hours - WITHOUT_RESTS_H) / options.visits
    longer = mean_s / float(np.mean(options.dwells_s))
    return replace(options, dwells_s=tuple(longer * dwell_s for dwell_s in options.dwells_s))


@dataclass
class Designs:
    """All designs of a run, drawn from one seed; each is made when it is first asked for. options: by style."""

    seed: int
    counts: dict[str, int] = field(default_factory=lambda: COUNTS)
    options: dict[str, DesignOptions] = field(default_factory=lambda: OPTIONS)
    machine: MachineFile = field(default_factory=lambda: read_machine_file(MACHINE))
    _designs: dict[str, Drawn] = field(default_factory=dict)

    def one(self, style: str, rng: np.random.Generator) -> Drawn:
        """One of the designs of a style: rich, platform or poor."""
        return self.by_name(f"{style}{int(rng.integers(self.counts[style]))}")

    def by_name(self, name: str) -> Drawn:
        """The design of a name."""
        if name not in self._designs:
            style, number = name.rstrip("0123456789"), int(name[-1])
            words = [self.seed, list(self.options).index(style), number]
            rng = np.random.default_rng(np.random.SeedSequence(words))
            timeline = plan(self.machine, draw_design(self.machine, rng, self.options[style]))
            start_s = timeline.design.start_s
            duration_s = float(timeline.t_s[-1]) - start_s
            swing_k = float(rng.uniform(*SWING_K[style]))
            programme = draw_programme(rng, swing_k, start_s, duration_s)
            # On record whatever the case is: that a recording has tables tells nothing of its effects.
            self._designs[name] = Drawn(name, timeline, programme, draw_known_tables(self.machine, rng))
        return self._designs[name]
