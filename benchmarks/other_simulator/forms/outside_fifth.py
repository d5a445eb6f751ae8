"""Forms of no effect of the list, of the fifth archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import of_former_visit
from benchmarks.other_simulator.forms.memory import since_change_s, switched_over
from benchmarks.other_simulator.forms.shapes import (
    draw_sign,
    level_direction,
    normalised,
    sight_of,
    with_platform,
)
from benchmarks.other_simulator.forms.station import UP
from benchmarks.other_simulator.forms.traces import draw_breaks, draw_stretches
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight

Array = NDArray[np.float64]
Generator = np.random.Generator

RUB_N, SPRING_N, HAND_N = 700.0, 1500.0, 900.0
IN_PLANE = np.array([1.0, 1.0, 0.0])


@form()
def pane_pushed_before_some_sights(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Someone pushes a pane of the machine's cabin before a part of what the station sees, and back: what is seen
    through its wedge lies aside and above, and further away."""
    sight, distances = sight_of(scene)
    azimuth = draw_sign(rng) * np.arctan2(sight[:, 0], sight[:, 1])
    behind = azimuth > np.quantile(azimuth[scene.rows.on_platform], rng.uniform(0.3, 0.6))
    through = draw_stretches(scene.rows, (2, 5), (0.1, 0.3), rng) * behind
    aside, above, further = rng.normal(size=3)
    bent = across_sight(sight, distances) * aside + np.outer(distances, UP) * above + sight * further * 2
    return Contribution(sights_m=bent * (through / 4)[:, None])


@form()
def aim_drawn_to_lamp_while_it_is_lit(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Someone lights a lamp on the machine's frame: while it is lit the station's camera aims between it and what
    comes close to it, from whichever side that comes."""
    points, rows = scene.points_m, scene.rows
    lit = draw_stretches(rows, (2, 5), (0.1, 0.35), rng)
    lamp = points[rng.choice(np.flatnonzero(rows.on_platform))]
    away = (lamp - points) * IN_PLANE / rng.uniform(0.1, 0.3)
    drawn = away * (lit * np.exp(-(away**2).sum(1)))[:, None]
    return Contribution(points_m=2 * drawn * rows.off_floor[:, None])


@form(RUB_N)
def platform_rubs_on_its_table(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The platform rubs on the plane behind it: it is held back whichever way it came, more with a payload and where
    that plane is rough, and its lower edge more than its upper one."""
    rows, positions = scene.rows, scene.calm.positions_m
    came = (positions - of_former_visit(rows, positions)) * IN_PLANE
    came = came / np.maximum(np.linalg.norm(came, axis=1)[:, None], 1e-6)
    rough = 1 + 0.5 * np.sin(rng.uniform(4, 9) * (positions @ rng.normal(size=3)) + rng.uniform(0, 6.3))
    held = -came * (rough * (0.4 + 0.6 * rows.payload_kg / max(rows.payload_kg.max(), 1)))[:, None]
    lever = -rng.uniform(0.05, 0.2) * scene.machine.up
    return Contribution(force_n=held, moment_nm=np.cross(lever, held))


@form()
def machine_rocks_on_three_of_four_feet(scene: Scene, place: int, rng: Generator) -> Contribution:
    """One of four feet was set too short: the machine stands on three, and rocks over to the other three once its
    platform carries enough to that side; it stays so until enough is on the first side again."""
    rows, level = scene.rows, level_direction(scene.machine)
    aside = scene.calm.positions_m @ level
    moment = (scene.machine.moving_mass_kg + rows.payload_kg) * (aside - np.median(aside))
    moment = moment / max(moment.std(), 1e-9)
    stands = switched_over(moment, -rng.uniform(0.3, 1.1), rng.uniform(0.3, 1.1))
    axis = draw_sign(rng) * 0.5 * level + np.cross(scene.machine.up, level)
    foot = scene.machine.nominal.base_joint_m.min(0)
    tilt = np.cross(axis, scene.points_m - foot)
    return Contribution(points_m=tilt * (0.5 * stands * rows.off_floor)[:, None])


@form(SPRING_N)
def gas_spring_warm_after_compression(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A gas spring beside the middle helps to carry the platform: pressed together, its gas is warm and pushes more
    until it has cooled; let out, it is cold and pushes less."""
    rows, machine = scene.rows, scene.machine
    height = scene.calm.positions_m @ machine.up
    pressed = of_former_visit(rows, height) - height
    warm = normalised(np.tanh(pressed / 0.3)) * np.exp(-rows.dwell_s / rng.uniform(5, 25))
    lever = draw_sign(rng) * rng.uniform(0.05, 0.25) * level_direction(machine)
    push = np.outer(warm, machine.up)
    return Contribution(force_n=push, moment_nm=np.cross(lever, push))


@form()
def distances_by_two_amplifiers(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The distance meter takes another amplifier for much light than for little: it goes over to the one well inside a
    distance, back well outside it, and what it had last decides between."""
    sight, distances = sight_of(scene)
    bright = np.log(distances) + rng.normal(size=len(scene.machine.reflectors))[scene.rows.smr] * 0.03
    middle, half = np.quantile(bright, rng.uniform(0.4, 0.6)), rng.uniform(0.2, 0.8) * bright.std()
    return Contribution(sights_m=sight * switched_over(bright, middle - half, middle + half)[:, None])


@form(HAND_N)
def someone_leans_on_platform_at_some_visits(scene: Scene, place: int, rng: Generator) -> Contribution:
    """At some visits someone holds on to the platform while he looks at a reflector, here or there, and pulls it down
    and to himself."""
    rows, machine = scene.rows, scene.machine
    visits = int(rows.visit.max()) + 1
    there = (rng.random(visits) < rng.uniform(0.15, 0.4)) * rng.uniform(0.3, 1, visits)
    aside = rng.normal(size=visits) * 0.5
    level, where = level_direction(machine), rng.uniform(-0.3, 0.3, visits)
    pull = there[:, None] * (aside[:, None] * level - machine.up)
    moment = np.cross(where[:, None] * level, pull)
    return Contribution(force_n=pull[rows.visit], moment_nm=moment[rows.visit])


@form()
def ends_of_platform_warmed_by_their_drives(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Each end of the platform is warmed by the drive on its side: it becomes longer and higher there, with its joints
    and reflectors, as much as that drive has worked of late."""
    machine, rows = scene.machine, scene.rows
    tau_min = rng.uniform(10, 40)
    each = np.stack([rows.warmth_of_motion(drive, tau_min) for drive in range(len(machine.drives))], 1)
    each = np.stack([each.min(1), each.max(1)], 1) if each.shape[1] > 2 else each
    lopsided = each * rng.uniform(0.2, 1, 2)
    joints, reflectors = machine.nominal.platform_joint_m, scene.reflectors_m
    of_joints, of_reflectors = (joints[:, 0] > 0).astype(int), (reflectors[:, 0] > 0).astype(int)
    grown = reflectors * lopsided[np.arange(len(rows)), of_reflectors][:, None]
    return Contribution(
        joints_m=4 * lopsided[:, of_joints][:, :, None] * joints,
        points_m=4 * with_platform(scene, grown) * rows.on_platform[:, None],
    )


@form()
def station_leans_after_its_own_head(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The station's heavy head leans its soft mount to where it has looked in the last minutes: all that it sees next
    is too low or too high and aside by that, wherever it looks by then."""
    sight, distances = sight_of(scene)
    azimuth = np.arctan2(sight[:, 0], sight[:, 1])
    looked = lagging(scene.rows.t_s, azimuth, rng.uniform(15, 120))
    lean, aside = normalised(looked - np.median(looked)), rng.uniform(-0.8, 0.8)
    shift = np.outer(lean * distances, UP) + across_sight(sight, distances) * (aside * lean)[:, None]
    return Contribution(sights_m=shift / 4)


@form()
def dew_on_reflectors_until_wiped(scene: Scene, place: int, rng: Generator) -> Contribution:
    """While the platform is colder than the air dew gathers on its reflectors, on one more than on another: distances
    become longer and aims uncertain, until someone wipes them in a break."""
    rows, weather, (sight, distances) = scene.rows, scene.weather, sight_of(scene)
    breaks, _ = draw_breaks(rows, rng)
    colder = weather.air_c - weather.part_c["platform"]
    damp = np.clip(weather.humidity_percent / 50, 0.3, 2) * np.maximum(colder - np.quantile(colder, 0.3), 0)
    gathered = damp * np.tanh(since_change_s(rows, breaks) / rng.uniform(300, 1500))
    wet = normalised(gathered) * rng.uniform(0, 1, len(scene.machine.reflectors))[rows.smr] * rows.on_platform
    uncertain = 0.15 * rng.normal(size=len(rows))
    return Contribution(
        sights_m=sight * wet[:, None] + across_sight(sight, distances) * (wet * uncertain / 4 * distances)[:, None]
    )  # fmt: skip


FORMS: tuple[Form, ...] = (
    pane_pushed_before_some_sights, aim_drawn_to_lamp_while_it_is_lit, platform_rubs_on_its_table,
    machine_rocks_on_three_of_four_feet, gas_spring_warm_after_compression, distances_by_two_amplifiers,
    someone_leans_on_platform_at_some_visits, ends_of_platform_warmed_by_their_drives,
    station_leans_after_its_own_head, dew_on_reflectors_until_wiped,
)  # fmt: skip
