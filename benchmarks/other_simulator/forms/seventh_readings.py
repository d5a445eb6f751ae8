"""Forms of effects of the station, of reflectors and of the rig as a whole, of the seventh archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_mountings
from benchmarks.other_simulator.forms.memory import since_change_s
from benchmarks.other_simulator.forms.rig import (
    COEFFICIENT_PER_K,
    DELAYED_M,
    MASS_KG,
    OFF_M,
    REFERENCE_M_PER_S,
    TABLE_M,
    delayed,
)
from benchmarks.other_simulator.forms.seventh_traces import of_each, way_since
from benchmarks.other_simulator.forms.shapes import (
    draw_direction,
    draw_instant,
    draw_phase,
    draw_sign,
    draw_two_instants,
    level_direction,
    logistic,
    normalised,
    sight_of,
    since,
    with_platform,
    within,
)
from benchmarks.other_simulator.forms.station import CURVATURE_PER_M, READ_WRONG, UP
from benchmarks.other_simulator.forms.traces import draw_stretches
from benchmarks.other_simulator.machine import GROUPS
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight
from benchmarks.other_simulator.tables import corrections_of, newest, oldest

Array = NDArray[np.float64]
Generator = np.random.Generator

TRIPOD_M = 1.2  # height
HOLES = (-1.0, -0.5, 0.5, 1.0)  # of those in the payload's adapter, over the largest distance
DRAINED = 0.8  # share of a payload, at most


@form()
def jolted_at_exchanges(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Whoever exchanges the payload walks past the tripod and jolts it, and it partly creeps back each time."""
    mounting, first_s = draw_mountings(scene.rows, rng)
    relaxed = 0.5 + 0.5 * np.exp(-since_change_s(scene.rows, mounting) / (rng.uniform(5, 25) * 60))
    shifts, turns = (of_each(mounting, rng.normal(size=(mounting.max() + 1, 3))) for _ in range(2))
    return Contribution(
        station_m=0.7 * shifts * relaxed[:, None],
        station_rad=turns * [0.08, 0.08, 0.15] * relaxed[:, None],
        step_s=first_s,
    )


@form()
def sun_on_one_tripod_leg(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The sun shines on one leg of the tripod for a while, and the station is tilted and lifted as it grows."""
    rows, begin, direction = scene.rows, rng.uniform(0.05, 0.5), draw_phase(rng)
    shining = within(rows, begin, begin + rng.uniform(0.15, 0.4))
    warmth = normalised(lagging(rows.t_s, shining, rng.uniform(6, 20) * 60))
    axis = np.array([np.cos(direction), np.sin(direction), 0.0])
    moved = TRIPOD_M * np.cross(axis, UP) + 0.4 * np.array(UP)
    return Contribution(station_rad=0.4 * np.outer(warmth, axis), station_m=0.4 * np.outer(warmth, moved))


@form(CURVATURE_PER_M)
def warm_layer_over_floor(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Warm air lies over the floor, and bends what is seen low above it so that it seems lower still."""
    weather, (_, distances), height = scene.weather, sight_of(scene), scene.sights_m[:, 2]
    layer = np.exp(-(height - height.min()) / rng.uniform(0.2, 0.6))
    warmth = 1 + 0.7 * normalised(weather.part_c["base"] - weather.lagging_air_c(rng.uniform(5, 20)))
    return Contribution(sights_m=np.outer(-warmth * layer * distances**2 / 8, UP))


@form(READ_WRONG)
def cold_tongue_from_door(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Cold air from a door drifts into one half of the sights now and then, lengthens distances and bends sights."""
    sight, distances = sight_of(scene)
    azimuth = np.arctan2(sight[:, 0], sight[:, 1])
    from_right = draw_sign(rng)
    reached = logistic(from_right * (azimuth - np.quantile(azimuth, rng.uniform(0.3, 0.7))) / 0.04)
    cold = normalised(lagging(scene.rows.t_s, draw_stretches(scene.rows, (2, 6), (0.06, 0.2), rng), 200.0)) * reached
    aside = -1.5 * from_right * across_sight(sight, distances)
    return Contribution(sights_m=(sight + aside) * (cold * distances)[:, None])


@form()
def put_back_otherwise_at_exchanges(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """The reflector is taken off at each exchange of the payload, and put back a little otherwise each time."""
    mounting, first_s = draw_mountings(scene.rows, rng)
    shifts = of_each(mounting, rng.normal(size=(mounting.max() + 1, 3)) * [1, 1, 0.5])
    return Contribution(points_m=with_platform(scene, shifts) * (scene.rows.smr == smr)[:, None], step_s=first_s)


@form()
def works_itself_home(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """The reflector is put back askew, and the machine's motion shakes it most of the way home into its nest."""
    rows, step_s = scene.rows, draw_instant(scene.rows, rng, 0.15, 0.6)
    askew = 0.2 + 0.8 * np.exp(-way_since(rows, step_s) / rng.uniform(0.1, 0.4))
    shift = scene.calm.rotations @ draw_direction(rng)
    return Contribution(
        points_m=shift * (askew * since(rows, step_s) * (rows.smr == smr))[:, None], step_s=step_s
    )  # fmt: skip


@form(DELAYED_M)
def queue_grows_until_flushed(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Readings wait in a queue that grows longer and longer until it is flushed, again and again."""
    turn = scene.rows.hours * 60 / rng.uniform(15, 60) + rng.uniform(0, 1)
    return delayed(scene, 0.15 + turn % 1)


@form(DELAYED_M)
def drives_polled_in_turn(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The drives are polled one after the other, each later than the one before, and not latched together."""
    delays = rng.permutation(np.linspace(0.2, 1, len(scene.machine.drives)))
    return Contribution(drives_m=-scene.rows.velocity_m_per_s / REFERENCE_M_PER_S * delays)


@form(COEFFICIENT_PER_K)
def same_wrong_alloy_everywhere(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The coefficient of one alloy was entered for the whole machine, which is of another."""
    return Contribution(expansion_per_k=dict.fromkeys(GROUPS, float(draw_sign(rng))))


@form(COEFFICIENT_PER_K)
def struts_and_base_interchanged(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The coefficients of struts and base were entered the wrong way round."""
    sign = float(draw_sign(rng))
    return Contribution(expansion_per_k={"struts": sign, "base": -sign})


@form(MASS_KG)
def tank_drains_while_carried(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Each payload is a tank that was weighed full and drains while it is carried."""
    rows = scene.rows
    mounting, _ = draw_mountings(rows, rng)
    carried = rows.payload > 0
    drained = np.minimum(since_change_s(rows, mounting) / (rng.uniform(10, 50) * 60), 1)
    lightest_kg = float(rows.payload_kg[carried].min(initial=MASS_KG))
    return Contribution(payload_kg=-drained * carried, largest=DRAINED * lightest_kg)


@form(OFF_M)
def hung_on_other_holes(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The payload is hung on other holes of its adapter each time that it is mounted."""
    mounting, _ = draw_mountings(scene.rows, rng)
    aside = rng.choice(HOLES, mounting.max() + 1)[mounting] * (scene.rows.payload > 0)
    return Contribution(payload_centre_m=np.outer(aside, level_direction(scene.machine)))


@form(TABLE_M)
def on_between_two_restarts(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A restart of the control switches tables on, and the next one switches them off again."""
    rows = scene.rows
    first_s, second_s = draw_two_instants(rows, rng, (0.1, 0.4), (0.55, 0.9))
    tables = newest(scene.tables) if rng.random() < 0.5 else oldest(scene.tables)
    on = since(rows, first_s) - since(rows, second_s)
    return Contribution(drives_m=corrections_of(tables, rows) * on[:, None], step_s=first_s)


@form(TABLE_M)
def on_with_reversed_sign(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The last tables are on, and the control takes off what they say should be added."""
    return Contribution(drives_m=-corrections_of(newest(scene.tables), scene.rows))


FORMS: dict[str, tuple[Form, ...]] = {
    "tracker_drift": (jolted_at_exchanges, sun_on_one_tripod_leg),
    "refraction": (warm_layer_over_floor, cold_tongue_from_door),
    "smr_reseat": (put_back_otherwise_at_exchanges, works_itself_home),
    "latency": (queue_grows_until_flushed, drives_polled_in_turn),
    "expansion_coefficient": (same_wrong_alloy_everywhere, struts_and_base_interchanged),
    "payload": (tank_drains_while_carried, hung_on_other_holes),
    "tables_left_on": (on_between_two_restarts, on_with_reversed_sign),
}
