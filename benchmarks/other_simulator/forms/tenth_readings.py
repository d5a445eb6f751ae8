"""Forms of effects of the station, its reflectors and the rig as a whole, of the tenth archive."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_cycles, draw_mountings, new_visit
from benchmarks.other_simulator.forms.memory import dragged, since_change_s
from benchmarks.other_simulator.forms.rig import (
    COEFFICIENT_PER_K,
    DELAYED_M,
    MASS_KG,
    REFERENCE_M_PER_S,
    TABLE_M,
    delayed,
)
from benchmarks.other_simulator.forms.shapes import (
    draw_direction,
    draw_sign,
    level_direction,
    normalised,
    sight_of,
    with_platform,
)
from benchmarks.other_simulator.forms.station import CURVATURE_PER_M, READ_WRONG, UP
from benchmarks.other_simulator.forms.traces import draw_breaks, draw_stretches, gaps_s, gathered_until
from benchmarks.other_simulator.machine import rotations_of
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.tables import corrections_of, newest

Array = NDArray[np.float64]
Generator = np.random.Generator

STEP_M = 1e-4  # of numerical derivatives


@form()
def fan_of_its_head_comes_and_goes(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A thermostat in its head switches a fan: while that rests one cheek of the fork warms up, and the head nods and
    turns by that, again and again."""
    warmth = draw_cycles(scene.rows, (8, 25), (3, 9), rng)[:, None]
    turn = rng.normal(size=3) * [0.6, 0.6, 1]
    return Contribution(
        station_rad=warmth * 0.3 * turn / np.linalg.norm(turn), station_m=warmth * rng.uniform(-0.2, 0.2) * UP
    )


@form()
def asphalt_gives_way_to_machine(scene: Scene, place: int, rng: Generator) -> Contribution:
    """It stands on asphalt close to the machine: the floor dips to where the platform and its payload are, at once by
    a part and over minutes by more, and the station leans after it."""
    rows, machine = scene.rows, scene.machine
    aside_m = scene.calm.positions_m @ level_direction(machine)
    heavy = (aside_m - aside_m.mean()) * (1 + 2 * rows.payload_kg / machine.moving_mass_kg)
    share = rng.uniform(0.2, 0.5)
    dip = normalised(share * heavy + (1 - share) * 4 * lagging(rows.t_s, heavy, rng.uniform(4, 15) * 60))
    lean = 0.3 * np.array([rng.uniform(-0.4, 0.4), draw_sign(rng), rng.uniform(-0.3, 0.3)])
    return Contribution(station_rad=np.outer(dip, lean))


@form(READ_WRONG)
def its_thermometer_over_a_radiator(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Its thermometer hangs over a radiator, whose valve opens and closes: distances are corrected for an air that is
    nowhere on the way, by turns more and less."""
    sight, distances = sight_of(scene)
    shown = draw_cycles(scene.rows, (15, 50), (3, 12), rng)
    return Contribution(sights_m=sight * (distances * shown)[:, None])


@form(CURVATURE_PER_M)
def jet_of_warm_air_as_a_lens(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A fan heater blows a flat jet of warm air across what it sees: light above the jet's middle is bent up and light
    below it down, most at its edges and not at all far from it, whenever the heater runs."""
    sight, distances = sight_of(scene)
    height_m = scene.sights_m[:, 2]
    middle_m, half_m = np.quantile(height_m, rng.uniform(0.25, 0.75)), rng.uniform(0.1, 0.3)
    runs = draw_stretches(scene.rows, (2, 5), (0.15, 0.35), rng)
    runs = lagging(scene.rows.t_s, runs, rng.uniform(0.5, 4) * 60)
    off = (height_m - middle_m) / half_m
    bent = off * np.exp(-(off**2)) * runs * distances**2 / 4
    return Contribution(sights_m=np.outer(bent, UP) + sight * rng.uniform(0, 0.1) * np.abs(bent)[:, None])


@form()
def drops_out_at_hard_stops(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """Its nest's magnet is too weak: at some of the hardest stops it drops out, hangs on its string, and whoever puts
    it back finds some dirt in the nest, each time other."""
    rows = scene.rows
    hard = rows.speed_m_per_s >= np.quantile(rows.speed_m_per_s, rng.uniform(0.5, 0.8))
    drops = np.cumsum(new_visit(rows) & hard & (rng.random(len(rows)) < rng.uniform(0.08, 0.3)))
    seats = np.stack([draw_direction(rng) * rng.uniform(0.3, 1) for _ in range(int(drops[-1]) + 1)])
    seats[0] = 0.0
    return Contribution(points_m=with_platform(scene, seats[drops]) * (rows.smr == smr)[:, None])


@form()
def bedded_in_putty_each_time(scene: Scene, smr: int, rng: Generator) -> Contribution:
    """It is pressed into fresh putty after each break: high at first, and then, as the putty gives, on its way down and
    aside until it lies on the bottom a quarter of an hour later."""
    rows = scene.rows
    breaks, first_s = draw_breaks(rows, rng)
    high = np.exp(-since_change_s(rows, breaks) / (rng.uniform(4, 20) * 60))
    pressed = rng.uniform(0.5, 1, int(breaks[-1]) + 1)[breaks]
    lifted = np.outer(high * pressed * (breaks > 0), draw_direction(rng))
    return Contribution(points_m=with_platform(scene, lifted) * (rows.smr == smr)[:, None], step_s=first_s)


@form(DELAYED_M)
def wakes_up_for_each_reading(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The card that latches the drives falls asleep when nothing is asked of it: the longer since the reading before,
    the longer it needs to answer, up to some limit."""
    asleep = 1 - np.exp(-gaps_s(scene.rows) / rng.uniform(8, 40))
    return delayed(scene, draw_sign(rng) * (rng.uniform(0, 0.2) + asleep))


@form(DELAYED_M)
def level_circle_is_read_later(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The station's two circles have electronics of their own, and that of the level one is older: of a reflector on
    its way what lies across is of another moment than what lies above."""
    rows, machine = scene.rows, scene.machine
    position_m, rotations = rows.pose[:, :3], rotations_of(rows.pose[:, 3:])
    moves = [axis for axis in machine.free if axis < 3]
    columns = []
    for axis in moves:
        step = STEP_M * np.eye(3)[axis]
        ahead, behind = (machine.drives_at(position_m + sign * step, rotations) for sign in (1, -1))
        columns.append((ahead - behind) / (2 * STEP_M))
    speeds = np.einsum("rnd,rd->rn", np.linalg.pinv(np.stack(columns, 2)), rows.velocity_m_per_s)
    level = level_direction(machine)
    across = speeds @ level[moves] * rows.on_platform / REFERENCE_M_PER_S
    return Contribution(points_m=draw_sign(rng) * np.outer(across, level))


@form(COEFFICIENT_PER_K)
def liners_push_once_play_is_used_up(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Struts have liners of a metal that grows more than what was stated, with a little play between their end caps:
    small changes of warmth move the liner only, larger ones the whole strut, and turning back it has the play again."""
    off_k = scene.weather.part_c["struts"] - scene.machine.reference_c
    play_k = rng.uniform(0.15, 0.35) * float(np.ptp(off_k))
    shares = rng.uniform(0.7, 1, len(scene.machine.struts))
    pushed_k = dragged(off_k - off_k[0], play_k)
    return Contribution(struts_m=np.outer(pushed_k, scene.machine.nominal.strut_length_m * shares))


@form(COEFFICIENT_PER_K)
def rods_that_compensate_come_late(scene: Scene, place: int, rng: Generator) -> Contribution:
    """In each strut a rod of another metal takes back what the tube grows by, which nobody stated: it sits inside and
    warms later, so that the strut has the stated coefficient in the first minutes and a smaller one afterwards."""
    off_k = scene.weather.part_c["struts"] - scene.machine.reference_c
    inside_k = lagging(scene.rows.t_s, off_k, rng.uniform(15, 70) * 60)
    return Contribution(struts_m=-np.outer(inside_k, scene.machine.nominal.strut_length_m))


@form(MASS_KG)
def weighed_with_scales_that_lack_a_share(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The crane's scales show too little or too much by the same share of whatever hangs on them: each payload is off
    by a part of its mass, and its centre, which was found by weighing both ends, is off with it."""
    stated_kg = scene.rows.stated_payload_kg
    off = draw_sign(rng) * stated_kg / max(float(stated_kg.max()), 1.0)
    aside = draw_sign(rng) * rng.uniform(0.001, 0.004) * level_direction(scene.machine)  # for each kilogram
    return Contribution(payload_kg=off, payload_centre_m=np.outer(off, aside), largest=0.8 * float(stated_kg.max()))


@form(MASS_KG)
def plates_fall_off_at_stops(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The payload's plates are not bolted: at some hard stops one falls off one side of it, which is a share of what
    is carried; when the payload is changed somebody finds them and puts them back on."""
    rows = scene.rows
    mounting, _ = draw_mountings(rows, rng)
    carried = rows.payload > 0
    hard = rows.speed_m_per_s >= np.quantile(rows.speed_m_per_s, rng.uniform(0.2, 0.6))
    falls = new_visit(rows) & hard & carried & (rng.random(len(rows)) < rng.uniform(0.08, 0.25))
    gone = normalised(np.minimum(gathered_until(rows, falls * rng.uniform(0.5, 1, len(rows)), mounting), 4.0))
    gone = gone * rows.payload_kg / max(float(rows.payload_kg.max()), 1.0)
    aside = draw_sign(rng) * rng.uniform(0.001, 0.004) * level_direction(scene.machine)  # for each kilogram
    return Contribution(
        payload_kg=-gone, payload_centre_m=np.outer(gone, aside), largest=0.9 * float(rows.payload_kg.max())
    )


@form(TABLE_M)
def looked_up_from_another_zero(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The last tables are on, and the drives have been given another zero since they were made: each place gets what
    was meant for one a hand or two further along."""
    shift_m = draw_sign(rng) * rng.uniform(0.06, 0.25)
    shifted = [replace(table, own_m=table.own_m + shift_m) for table in newest(scene.tables)]
    return Contribution(drives_m=corrections_of(shifted, scene.rows))


@form(TABLE_M)
def taken_for_an_error_by_kelvin(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The last tables lie in that part of the control which makes up for warmth: it multiplies them by how much warmer
    the columns are than when it was switched on, to either sign."""
    shown_c = scene.weather.part_c["drives"]
    warmer = normalised(shown_c - shown_c[0] - rng.uniform(-0.2, 0.2))
    return Contribution(drives_m=corrections_of(newest(scene.tables), scene.rows) * warmer[:, None])


FORMS: dict[str, tuple[Form, ...]] = {
    "tracker_drift": (fan_of_its_head_comes_and_goes, asphalt_gives_way_to_machine),
    "refraction": (its_thermometer_over_a_radiator, jet_of_warm_air_as_a_lens),
    "smr_reseat": (drops_out_at_hard_stops, bedded_in_putty_each_time),
    "latency": (wakes_up_for_each_reading, level_circle_is_read_later),
    "expansion_coefficient": (liners_push_once_play_is_used_up, rods_that_compensate_come_late),
    "payload": (weighed_with_scales_that_lack_a_share, plates_fall_off_at_stops),
    "tables_left_on": (looked_up_from_another_zero, taken_for_an_error_by_kelvin),
}
