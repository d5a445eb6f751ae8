"""One machine in one campaign: drawn with its disturbances, and simulated with effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution, Departures
from benchmarks.other_simulator.disturbances import Drift, Levels, draw_drift, draw_levels, draw_on_machine
from benchmarks.other_simulator.equilibrium import Load, Poses, drive_loads_n, points_m, settle
from benchmarks.other_simulator.machine import GROUPS, Geometry, Machine, rotations_of
from benchmarks.other_simulator.nominal import draw_nominal
from benchmarks.other_simulator.rows import Rows, draw_campaign
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Conditions, Equilibrium
from benchmarks.other_simulator.station import Station, draw_accuracy, draw_placing
from benchmarks.other_simulator.tables import draw_tables
from benchmarks.other_simulator.weather import Weather, draw_weather

Array = NDArray[np.float64]

LEVEL_SD_RAD = 5e-6  # of the station's two turns about level axes
# What of an effect acts: a contribution, the number of the drive or strut (None: the rig), and the amplitude there.
Part = tuple[Contribution, int | None, float]


@dataclass(frozen=True)
class Rig:
    """A campaign ready to be simulated; `calm` departures are its ordinary disturbances, but for the drift."""

    machine: Machine
    geometry: Geometry  # true
    rows: Rows
    weather: Weather
    conditions: Conditions
    station: Station
    levels: Levels
    drift: Drift
    calm: Departures
    scene: Scene
    covariances_m2: Array  # (r, 3, 3), of the readings of `scene`
    sigma_m: float  # of a coordinate of a platform reflector, by that

    @property
    def start(self) -> Poses:
        """Where the platform hangs without effects."""
        return self.scene.calm.positions_m, self.scene.calm.rotations

    def simulate(self, parts: Sequence[Part]) -> tuple[Array, Equilibrium]:
        """What the station would see (r, 3) without noise and drift, and the state, with parts of effects."""
        departures, loads = self.calm.copy(), list[Load]()
        for contribution, place, amplitude in parts:
            departures.add(contribution, place, amplitude)
            if contribution.under_load is not None:
                loads.append((contribution.under_load, place, amplitude))
        state, together = settle(self.machine, self.geometry, self.conditions, departures, loads, self.start)
        points = points_m(self.machine, self.geometry, self.rows.smr, state, together)
        return self.station.sees(points, self.geometry, together), state


def draw_rig(
    base: str, style: str, rng: np.random.Generator, *, following_share: float = 1.0, fine_ranges: bool = False
) -> Rig:
    """A rig about the machine file `base`; following_share as `draw_campaign`, fine_ranges as `draw_accuracy`."""
    machine = Machine.of(draw_nominal(base, rng))
    geometry = machine.draw_true(rng)
    rows = draw_campaign(machine, style, following_share, rng)
    weather = draw_weather(rows.t_s, rng)
    expansion = {
        group: machine.expansion_per_k[group] + rng.normal() * machine.description["expansion"][group]["u_per_k"]
        for group in GROUPS
    }
    heading, place, true_place, axes = draw_placing(machine, rng)
    level = rng.normal(size=3) * [LEVEL_SD_RAD, LEVEL_SD_RAD, 0]
    geometry = replace(geometry, station=np.concatenate([np.zeros(3), level]))
    station = Station(place, heading, true_place, axes, **draw_accuracy(rng, fine_ranges=fine_ranges))
    levels = draw_levels(rng)
    drift = draw_drift(levels, rows.t_s, rng)
    calm, strain = draw_on_machine(levels, machine, rows, expansion, rng)
    conditions = Conditions(
        drives_m=rows.drives_m,
        positions_m=rows.pose[:, :3].copy(),
        rotations=rotations_of(rows.pose[:, 3:]),
        payload_kg=rows.payload_kg,
        payload_centre_m=rows.payload_centre_m,
        part_c=weather.part_c,
        expansion_per_k=expansion,
        strut_strain=strain,
    )
    state, _ = settle(machine, geometry, conditions, calm)
    points = points_m(machine, geometry, rows.smr, state, calm)
    sights = station.sees(points, geometry, calm)
    scene = Scene(
        machine=machine,
        geometry=geometry,
        rows=rows,
        weather=weather,
        tables=draw_tables(machine, rng),
        calm=state,
        points_m=points,
        sights_m=sights,
        loads_n=drive_loads_n(machine, state),
    )
    covariances = station.covariances_m2(sights)
    variance = np.trace(covariances[rows.on_platform], axis1=1, axis2=2).mean() / 3
    return Rig(
        machine=machine,
        geometry=geometry,
        rows=rows,
        weather=weather,
        conditions=conditions,
        station=station,
        levels=levels,
        drift=drift,
        calm=calm,
        scene=scene,
        covariances_m2=covariances,
        sigma_m=float(np.sqrt(variance)),
    )
