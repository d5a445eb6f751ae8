"""Forms of effects of the station: its frame, its light, and a reflector that is displaced."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import walking, wandering
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.shapes import (
    draw_direction,
    draw_instant,
    draw_phase,
    draw_two_instants,
    logistic,
    normalised,
    sight_of,
    since,
    warming_up,
)
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight

Array = NDArray[np.float64]
Generator = np.random.Generator

UP = [0, 0, 1]  # in the station's frame
# Amplitudes of the air's forms: relative errors of distance, and curvatures in 1/m.
READ_WRONG, NOT_FOLLOWED, CURVATURE_PER_M = 8e-6, 4e-6, 1e-4


@form()
def turns_steadily(scene: Scene, place: int, rng: Generator) -> Contribution:
    """It turns in proportion to time."""
    turn = rng.normal(size=3) * [0.3, 0.3, 1]
    return Contribution(station_rad=scene.rows.elapsed[:, None] * turn / np.linalg.norm(turn) * 0.3)


@form()
def knocked(scene: Scene, place: int, rng: Generator) -> Contribution:
    """It is knocked."""
    step_s = draw_instant(scene.rows, rng)
    after, shift = since(scene.rows, step_s)[:, None], rng.normal(size=3)
    return Contribution(
        station_m=after * shift / np.linalg.norm(shift),
        station_rad=after * rng.normal(size=3) * [0.05, 0.05, 0.15],
        step_s=step_s,
    )


@form()
def warms_up(scene: Scene, place: int, rng: Generator) -> Contribution:
    """It moves as it warms up."""
    warmth, shift = warming_up(scene.rows, rng.uniform(0.3, 1.0))[:, None], rng.normal(size=3)
    return Contribution(station_m=warmth * shift / np.linalg.norm(shift), station_rad=warmth * rng.normal(size=3) * 0.1)


@form()
def tripod_follows_air(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Its tripod follows the air, mostly upwards."""
    air = scene.weather.lagging_air_c(15)
    warmth = normalised(air - air[0])[:, None]
    return Contribution(
        station_rad=warmth * rng.normal(size=3) * [0.3, 0.3, 0.1],
        station_m=warmth * rng.normal(size=3) * [0.2, 0.2, 0.8],
    )


@form()
def wanders(scene: Scene, place: int, rng: Generator) -> Contribution:
    """It walks at random, far beyond what is stated."""
    t_s = scene.rows.t_s
    return Contribution(
        station_m=normalised(walking(t_s, rng)), station_rad=0.2 * normalised(walking(t_s, rng))
    )  # fmt: skip


@form(READ_WRONG)
def air_temperature_read_wrong(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Distances follow an air that the station does not read."""
    sight, distances = sight_of(scene)
    off = scene.weather.lagging_air_c(30) - scene.weather.air_c.mean() + 0.3 * wandering(scene.rows.t_s, 3000, rng)
    return Contribution(sights_m=sight * (distances * (0.6 + 0.4 * normalised(off)))[:, None])


@form(NOT_FOLLOWED)
def pressure_not_followed(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Distances are those at the first pressure."""
    sight, distances = sight_of(scene)
    pressure = scene.weather.pressure_hpa
    return Contribution(sights_m=sight * (distances * normalised(pressure - pressure[0]))[:, None])


@form(CURVATURE_PER_M)
def vertical_gradient(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The air is warmer above, and more so when the floor is cold."""
    _, distances = sight_of(scene)
    gradient = 0.3 + normalised(scene.weather.lagging_air_c(10) - scene.weather.part_c["base"])
    return Contribution(sights_m=np.outer(gradient * distances**2 / 8, UP))


@form(CURVATURE_PER_M)
def warm_plume_of_heater(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A heater that goes on and off bends what is seen through its plume, to either side."""
    sight, distances = sight_of(scene)
    azimuth, width = np.arctan2(sight[:, 0], sight[:, 1]), 0.08
    middle = rng.uniform(np.quantile(azimuth, 0.2), np.quantile(azimuth, 0.8))
    on = logistic(20 * np.sin(2 * np.pi * scene.rows.hours / rng.uniform(0.4, 1.0) + draw_phase(rng)))
    off = (azimuth - middle) / width
    bent = on * (azimuth - middle) / width * np.exp(-(off**2) / 2)
    return Contribution(sights_m=across_sight(sight, distances) * (bent * distances / 4)[:, None])


@form(CURVATURE_PER_M)
def layers_come_and_go(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Layers of air bend upwards, more above, and to the side."""
    sight, distances = sight_of(scene)
    height = scene.sights_m[:, 2]
    upwards = normalised(wandering(scene.rows.t_s, 1500, rng)) * (1 + (height - height.mean()))
    aside = normalised(wandering(scene.rows.t_s, 1500, rng))
    return Contribution(
        sights_m=np.outer(upwards * distances**2 / 8, UP)
        + 0.4 * across_sight(sight, distances) * (aside * distances**2 / 8)[:, None]
    )


def _draw_shift(scene: Scene, rng: Generator) -> Array:
    """A unit shift of a reflector against the platform (r, 3), in the machine frame."""
    return scene.calm.rotations @ draw_direction(rng)


@form(name="knocked")
def reflector_knocked(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """It is knocked aside."""
    step_s = draw_instant(scene.rows, rng)
    return Contribution(
        points_m=_draw_shift(scene, rng) * ((scene.rows.t_s > step_s) & (scene.rows.smr == smr))[:, None], step_s=step_s
    )


@form()
def glue_creeps(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """Its glue creeps."""
    shift = _draw_shift(scene, rng)
    return Contribution(
        points_m=shift * (warming_up(scene.rows, rng.uniform(0.4, 2)) * (scene.rows.smr == smr))[:, None]
    )


@form()
def twice(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """It is knocked aside twice."""
    first_s, second_s = draw_two_instants(scene.rows, rng, (0.2, 0.45), (0.55, 0.8))
    shift = _draw_shift(scene, rng) * since(scene.rows, first_s)[:, None]
    shift = shift + _draw_shift(scene, rng) * since(scene.rows, second_s)[:, None]
    return Contribution(points_m=shift * (scene.rows.smr == smr)[:, None], step_s=first_s)


@form()
def out_and_back(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """It is put aside and back."""
    first_s, second_s = draw_two_instants(scene.rows, rng, (0.2, 0.4), (0.6, 0.85))
    t_s = scene.rows.t_s
    away = (t_s > first_s) & (t_s < second_s) & (scene.rows.smr == smr)
    return Contribution(points_m=_draw_shift(scene, rng) * away[:, None], step_s=first_s)


@form()
def slips_with_fast_moves(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """It slips on with some of the fast moves."""
    rows = scene.rows
    fast = rows.speed_m_per_s[1:] > np.quantile(rows.speed_m_per_s, 0.8)
    slips = (np.diff(rows.visit) > 0) * fast * (rng.random(len(rows) - 1) < 0.4)
    slipped = np.cumsum(np.r_[0, slips])
    share = slipped / max(slipped[-1], 1)
    return Contribution(points_m=_draw_shift(scene, rng) * (share * (rows.smr == smr))[:, None])


FORMS: dict[str, tuple[Form, ...]] = {
    "tracker_drift": (turns_steadily, knocked, warms_up, tripod_follows_air, wanders),
    "refraction": (
        air_temperature_read_wrong, pressure_not_followed, vertical_gradient, warm_plume_of_heater, layers_come_and_go,
    ),
    "smr_reseat": (reflector_knocked, glue_creeps, twice, out_and_back, slips_with_fast_moves),
}  # fmt: skip
