"""Forms of the fourth archive of the station, of reflectors, and of what is stated of the rig as a whole."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import rig, station
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import of_former_visit
from benchmarks.other_simulator.forms.memory import since_change_s
from benchmarks.other_simulator.forms.rig import delayed
from benchmarks.other_simulator.forms.shapes import (
    bump,
    draw_instant,
    draw_sign,
    level_direction,
    logistic,
    normalised,
    sight_of,
    since,
)
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight
from benchmarks.other_simulator.tables import corrections_of, newest, oldest

Array = NDArray[np.float64]
Generator = np.random.Generator

LONG_PAUSE_S = 300.0  # in which somebody may look at the station's bubble
GATE_RANGES_PER_M = 0.05  # relative error of distance in the cold, over the curvature at the floor


@form()
def leg_slides_in_jerks(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A leg slides on a painted floor: it holds for a while, then gives way by a jerk, each time to the same side."""
    instants_s = [draw_instant(scene.rows, rng, 0.05, 0.95) for _ in range(int(rng.integers(4, 10)))]
    slid = np.sum([rng.exponential() * since(scene.rows, instant_s) for instant_s in instants_s], 0)
    azimuth, yaw = rng.uniform(0, 6.3), rng.uniform(-0.25, 0.25)
    aside = np.array([np.sin(azimuth), np.cos(azimuth), -0.2])
    tilt = np.array([0.08 * np.cos(azimuth), -0.08 * np.sin(azimuth), yaw])
    course = normalised(slid)
    return Contribution(station_m=np.outer(course, aside), station_rad=np.outer(course, tilt), step_s=min(instants_s))


@form()
def sinks_and_is_levelled_again(scene: Scene, place: int, rng: Generator) -> Contribution:
    """On soft ground it leans over, fast at first; in a long pause somebody sees its bubble and levels it again."""
    rows = scene.rows
    pauses = np.flatnonzero(np.diff(rows.t_s) > LONG_PAUSE_S)
    seen = pauses[rng.random(len(pauses)) < 0.6]
    times_s = sorted(rows.t_s[seen] + 1) if len(seen) else [draw_instant(rows, rng, 0.3, 0.7)]
    stretch = np.searchsorted(times_s, rows.t_s, "right")
    leaning = normalised(1 - np.exp(-since_change_s(rows, stretch) / (rng.uniform(15, 60) * 60)))
    azimuth = rng.uniform(0, 6.3)
    axis = np.array([np.cos(azimuth), np.sin(azimuth), rng.uniform(-0.3, 0.3)])
    return Contribution(station_rad=0.4 * np.outer(leaning, axis), station_m=0.2 * np.outer(-leaning, station.UP))


@form(station.CURVATURE_PER_M)
def drives_warm_air_before_them(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The motors warm the air before their columns while they work: what is seen through it is bent away from it."""
    sight, distances = sight_of(scene)
    azimuth, width = np.arctan2(sight[:, 0], sight[:, 1]), rng.uniform(0.06, 0.15)
    count, bent = len(scene.machine.drives), np.zeros(len(scene.rows))
    for drive, middle in enumerate(np.quantile(azimuth, np.linspace(0.05, 0.95, count))):
        bent += scene.rows.warmth_of_motion(drive, rng.uniform(8, 25)) * bump(azimuth, middle, width)
    aside = 0.4 * draw_sign(rng) * bent
    return Contribution(
        sights_m=np.outer(bent * distances**2 / 8, station.UP)
        + across_sight(sight, distances) * (aside * distances**2 / 8)[:, None]
    )


@form(station.CURVATURE_PER_M)
def gate_lets_cold_in(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Each time that the gate is opened cold air flows in along the floor, and mixes with the rest within minutes."""
    rows, (sight, distances) = scene.rows, sight_of(scene)
    height = scene.sights_m[:, 2]
    cold = np.zeros(len(rows))
    for _ in range(int(rng.integers(2, 6))):
        opened_s = draw_instant(rows, rng, 0.02, 0.95)
        passed_s = np.maximum(rows.t_s - opened_s, 0)
        cold += rng.uniform(0.4, 1) * (1 - np.exp(-passed_s / 60)) * np.exp(-passed_s / rng.uniform(300, 1200))
    low = logistic((np.median(height) - height) / rng.uniform(0.1, 0.3))
    bent = np.outer(-cold * low * distances**2 / 8, station.UP)
    return Contribution(sights_m=bent + sight * (GATE_RANGES_PER_M * cold * (0.4 + 0.6 * low) * distances)[:, None])


@form()
def carried_to_floor_nests_and_back(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """Someone has one reflector too few, and takes this one to the floor's nests at each check: it never lies as
    before."""
    rows = scene.rows
    seats = np.r_[np.zeros((1, 3)), rng.normal(size=(int(rows.nest_check.max()), 3))]
    shift = np.einsum("rij,rj->ri", scene.calm.rotations, seats[rows.nest_check])
    second = int(np.argmax(rows.nest_check > rows.nest_check[0]))
    step_s = float(rows.t_s[second - 1] + rows.t_s[second]) / 2 if second else None
    return Contribution(points_m=0.6 * shift * (rows.smr == smr)[:, None], step_s=step_s)


@form()
def sinks_while_its_glue_is_warm(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """It was stuck on with wax: it sinks while the platform is warm, and keeps its place while that is cold."""
    rows, platform_c = scene.rows, scene.weather.part_c["platform"]
    warm = normalised(platform_c - platform_c.mean())
    sunk = np.cumsum(np.exp(rng.uniform(2.5, 4) * warm) * np.diff(rows.t_s, prepend=rows.t_s[0]))
    way = -scene.machine.up + 0.4 * draw_sign(rng) * level_direction(scene.machine)
    return Contribution(points_m=np.outer(sunk / max(sunk[-1], 1e-9) * (rows.smr == smr), way))


@form(rig.DELAYED_M)
def buffer_fills_in_each_move(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Positions wait in a buffer that is emptied at rest and fills while something moves: later after a longer way."""
    under_way_s = scene.rows.approach_m.max(1) / scene.rows.speed_m_per_s
    return delayed(scene, 1 - np.exp(-under_way_s / rng.uniform(1, 6)))


@form(rig.DELAYED_M)
def later_with_each_lost_telegram(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Each lost telegram puts the numbers off by one more; they are brought together again at the floor's nests."""
    rows = scene.rows
    lost = np.cumsum(rng.random(len(rows)) < 1 / rng.uniform(15, 60)).astype(float)
    for check in np.unique(rows.nest_check):
        lost[rows.nest_check == check] -= lost[rows.nest_check == check][0]
    return delayed(scene, draw_sign(rng) * normalised(lost))


@form(rig.COEFFICIENT_PER_K)
def struts_of_two_deliveries(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Every other strut is of another delivery: one half expands by more than is stated, the other half by less."""
    machine, sign = scene.machine, draw_sign(rng)
    signs = sign * np.where(np.arange(len(machine.struts)) % 2, -rng.uniform(0.2, 1), 1.0)
    warmer = scene.weather.part_c["struts"] - machine.reference_c
    return Contribution(struts_m=np.outer(warmer, signs * machine.nominal.strut_length_m))


@form(rig.COEFFICIENT_PER_K)
def metal_ends_of_struts_not_counted(scene: Scene, place: int, rng: Generator) -> Contribution:
    """What is stated is the coefficient of the struts' tubes: their metal ends expand by more, and are as warm as the
    platform at one end and as the carriage at the other."""
    part_c, reference_c = scene.weather.part_c, scene.machine.reference_c
    at_platform = rng.uniform(0.6, 0.9)
    warmer = at_platform * part_c["platform"] + (1 - at_platform) * part_c["drives"] - reference_c
    return Contribution(struts_m=np.outer(warmer, scene.machine.nominal.strut_length_m))


@form(rig.MASS_KG)
def plates_on_the_other_payload(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Plates that belong to the heaviest payload are mounted with the next one; with a single one, without any."""
    payloads = scene.rows.payloads
    if len(payloads) == 1:  # nothing is ever mounted
        return Contribution()
    heavy = int(np.argmax([one.mass_kg for one in payloads]))
    other = int(np.argsort([one.mass_kg for one in payloads])[-2])
    moved = (scene.rows.payload == other).astype(float) - (scene.rows.payload == heavy)
    return Contribution(payload_kg=moved, largest=0.9 * payloads[heavy].mass_kg)


@form(rig.OFF_M)
def filling_lies_where_last_stop_threw_it(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Payloads with a loose filling: each stop throws it on, and it lies there until the next move."""
    rows, level = scene.rows, level_direction(scene.machine)
    aside = scene.calm.positions_m @ level
    thrown = np.tanh((aside - of_former_visit(rows, aside)) / rng.uniform(0.05, 0.25))
    return Contribution(payload_centre_m=np.outer(thrown * (rows.payload > 0), level))


@form(rig.TABLE_M)
def new_tables_added_to_old_ones(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The last tables were added to the first ones instead of taking their place; there have to be both."""
    if len(oldest(scene.tables)) == len(scene.tables):
        return Contribution()
    return Contribution(drives_m=corrections_of([*newest(scene.tables), *oldest(scene.tables)], scene.rows))


@form(rig.TABLE_M)
def on_for_one_side_of_approach(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The control keeps a table for each side of approach; the last ones were left on for one of them."""
    on = scene.rows.side == draw_sign(rng)
    return Contribution(drives_m=corrections_of(newest(scene.tables), scene.rows) * on)


FORMS: dict[str, tuple[Form, ...]] = {
    "tracker_drift": (leg_slides_in_jerks, sinks_and_is_levelled_again),
    "refraction": (drives_warm_air_before_them, gate_lets_cold_in),
    "smr_reseat": (carried_to_floor_nests_and_back, sinks_while_its_glue_is_warm),
    "latency": (buffer_fills_in_each_move, later_with_each_lost_telegram),
    "expansion_coefficient": (struts_of_two_deliveries, metal_ends_of_struts_not_counted),
    "payload": (plates_on_the_other_payload, filling_lies_where_last_stop_threw_it),
    "tables_left_on": (new_tables_added_to_old_ones, on_for_one_side_of_approach),
}  # fmt: skip
