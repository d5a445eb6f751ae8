"""Forms of the third archive of the station, of reflectors, and of what is stated of the rig as a whole."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import rig, station
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_mountings, new_visit
from benchmarks.other_simulator.forms.rig import delayed
from benchmarks.other_simulator.forms.shapes import (
    draw_direction,
    draw_instant,
    draw_phase,
    draw_sign,
    level_direction,
    logistic,
    normalised,
    sight_of,
)
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight
from benchmarks.other_simulator.tables import corrections_of, newest

Array = NDArray[np.float64]
Generator = np.random.Generator

POOL_RANGES_PER_M = 0.03  # relative error of distance in the cold, over the curvature that its upper side makes


@form()
def bumped_at_each_change_of_payload(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Whoever changes the payload passes by the station and bumps it, each time another way."""
    mounting, first_s = draw_mountings(scene.rows, rng)
    count = int(mounting.max())
    shifts = np.cumsum(np.r_[np.zeros((1, 3)), rng.normal(size=(count, 3))], 0)
    turns = np.cumsum(np.r_[np.zeros((1, 3)), rng.normal(size=(count, 3)) * [0.1, 0.1, 0.3]], 0)
    return Contribution(station_m=0.5 * shifts[mounting], station_rad=0.5 * turns[mounting], step_s=first_s)


@form()
def twists_while_sun_is_on_it(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Legs on which the sun shines twist the head on and on; clouds interrupt that, and nothing turns it back."""
    rows = scene.rows
    sunny = np.sin(2 * np.pi * rows.hours / rng.uniform(0.7, 2) + draw_phase(rng)) > rng.uniform(-0.2, 0.5)
    twisted = np.cumsum(sunny * np.diff(rows.t_s, prepend=rows.t_s[0]))
    axis = np.array([*rng.normal(size=2) * 0.1, draw_sign(rng)])
    return Contribution(station_rad=0.3 * np.outer(twisted / max(twisted[-1], 1.0), axis))


@form(station.CURVATURE_PER_M)
def warm_wall_bends_light(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Beside one end of the machine stands a wall that is warmer than the air: what passes it is bent away from it."""
    sight, distances = sight_of(scene)
    azimuth = np.arctan2(sight[:, 0], sight[:, 1])
    side = draw_sign(rng)
    from_wall = (side * azimuth).max() - side * azimuth
    warmth = normalised(scene.weather.lagging_air_c(90) - scene.weather.lagging_air_c(10))
    bent = -side * np.exp(-from_wall / rng.uniform(0.06, 0.2)) * (0.4 + 0.6 * warmth)
    return Contribution(sights_m=across_sight(sight, distances) * (bent * distances**2 / 8)[:, None])


@form(station.CURVATURE_PER_M)
def cold_air_pools_on_floor(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Cold air gathers on the floor and rises like water in a basin: what passes below its surface is bent down, and
    its distances are too long."""
    sight, distances = sight_of(scene)
    height = scene.sights_m[:, 2]
    low, high = np.quantile(height[scene.rows.off_floor], [0.15, rng.uniform(0.5, 0.8)])
    surface = low + (high - low) * scene.rows.elapsed ** rng.uniform(0.6, 1.5)
    below = logistic((surface - height) / rng.uniform(0.04, 0.12))
    bent = np.outer(-below * distances**2 / 8, station.UP)
    return Contribution(sights_m=bent + sight * (POOL_RANGES_PER_M * below * distances)[:, None])


@form()
def dirt_in_nest_at_each_mounting(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """It is taken off while the payload is changed; then there is other dirt in its nest."""
    mounting, first_s = draw_mountings(scene.rows, rng)
    seats = np.r_[np.zeros((1, 3)), rng.normal(size=(mounting.max(), 3))]
    shift = np.einsum("rij,rj->ri", scene.calm.rotations, seats[mounting])
    return Contribution(points_m=0.6 * shift * (scene.rows.smr == smr)[:, None], step_s=first_s)


@form()
def loose_from_a_moment(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """Its holder comes loose: after that it lies elsewhere at each visit, on one line more than across it."""
    rows, step_s = scene.rows, draw_instant(scene.rows, rng)
    line, visits = draw_direction(rng), int(rows.visit.max()) + 1
    lies = rng.uniform(-0.5, 1.2, visits)[:, None] * line + 0.2 * rng.normal(size=(visits, 3))
    shift = np.einsum("rij,rj->ri", scene.calm.rotations, lies[rows.visit])
    loose = (rows.t_s > step_s) & (rows.smr == smr)
    return Contribution(points_m=shift * loose[:, None], step_s=step_s)


@form(rig.DELAYED_M)
def beats_with_cycle(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Station and control each keep a cycle of their own: the delay runs through one cycle, and begins anew."""
    return delayed(scene, (scene.rows.hours * 60 / rng.uniform(8, 40) + rng.uniform(0, 1)) % 1)


@form(rig.DELAYED_M)
def drives_read_one_after_other(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Drives that are polled one after the other over a slow line: each is read so much later than the one before."""
    late = rng.permutation(np.linspace(rng.uniform(0, 0.3), 1, len(scene.machine.drives)))
    return Contribution(drives_m=delayed(scene, 1.0).drives_m * late)


@form(rig.COEFFICIENT_PER_K)
def spare_strut_of_other_material(scene: Scene, place: int, rng: Generator) -> Contribution:
    """One strut was replaced by one of another material than the file states for all."""
    machine, struts_m = scene.machine, np.zeros_like(scene.calm.tension_n)
    strut = rng.integers(len(machine.struts))
    warmer = scene.weather.part_c["struts"] - machine.reference_c
    struts_m[:, strut] = draw_sign(rng) * machine.nominal.strut_length_m[strut] * warmer
    return Contribution(struts_m=struts_m)


@form(rig.COEFFICIENT_PER_K)
def scales_of_two_materials(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Scales of two makes: one expands by more than is stated, the others by less."""
    signs = -np.ones(len(scene.machine.drives)) * rng.uniform(0.3, 1)
    signs[rng.integers(len(signs))] = 1
    warmer = scene.weather.part_c["drives"] - scene.machine.reference_c
    return Contribution(drives_m=scene.rows.drives_m * warmer[:, None] * signs * draw_sign(rng))


@form(rig.MASS_KG)
def chips_gather_until_cleared(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Chips and coolant gather on the platform until somebody clears it as the payload is changed."""
    rows = scene.rows
    mounting, _ = draw_mountings(rows, rng)
    begins_s = np.array([rows.t_s[mounting == one].min() for one in np.unique(mounting)])
    since_s = rows.t_s - begins_s[np.unique(mounting, return_inverse=True)[1]]
    return Contribution(payload_kg=normalised(since_s))


@form(rig.OFF_M)
def slides_with_fast_moves(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Every payload lies loosely: it slides on with each fast move, and is put back in its place at the next change."""
    rows, (mounting, _) = scene.rows, draw_mountings(scene.rows, rng)
    slid = np.cumsum(new_visit(rows) * rows.speed_m_per_s**2)
    for one in np.unique(mounting):
        slid[mounting == one] -= slid[mounting == one][0]
    aside = level_direction(scene.machine) * draw_sign(rng)
    return Contribution(payload_centre_m=np.outer(normalised(slid) * (rows.payload > 0), aside))


@form(rig.TABLE_M)
def on_with_one_payload(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The last tables belong to the parameters of one payload, and come on with that."""
    carried = int(rng.choice(np.unique(scene.rows.payload)))
    on = (scene.rows.payload == carried)[:, None]
    return Contribution(drives_m=corrections_of(newest(scene.tables), scene.rows) * on)


@form(rig.TABLE_M)
def one_drive_of_each_generation(scene: Scene, place: int, rng: Generator) -> Contribution:
    """An update was broken off: one drive still has its first table, and the others have their last."""
    drive, last = int(rng.integers(len(scene.machine.drives))), max(one.generation for one in scene.tables)
    on = [one for one in scene.tables if one.generation == (1 if one.drive == drive else last)]
    if last == 1:  # no tables are older than others
        on = []
    return Contribution(drives_m=corrections_of(on, scene.rows))


FORMS: dict[str, tuple[Form, ...]] = {
    "tracker_drift": (bumped_at_each_change_of_payload, twists_while_sun_is_on_it),
    "refraction": (warm_wall_bends_light, cold_air_pools_on_floor),
    "smr_reseat": (dirt_in_nest_at_each_mounting, loose_from_a_moment),
    "latency": (beats_with_cycle, drives_read_one_after_other),
    "expansion_coefficient": (spare_strut_of_other_material, scales_of_two_materials),
    "payload": (chips_gather_until_cleared, slides_with_fast_moves),
    "tables_left_on": (on_with_one_payload, one_drive_of_each_generation),
}  # fmt: skip
