"""Forms of no effect of the list, of the tenth archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import new_visit
from benchmarks.other_simulator.forms.memory import dragged, since_change_s
from benchmarks.other_simulator.forms.shapes import (
    draw_phase,
    draw_sign,
    level_direction,
    normal_direction,
    normalised,
    sight_of,
    with_platform,
)
from benchmarks.other_simulator.forms.traces import draw_stretches
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight

Array = NDArray[np.float64]
Generator = np.random.Generator

BELLOWS_N, JET_N, CONDUIT_NM = 3000.0, 1500.0, 1200.0
UP = [0, 0, 1]  # in the station's frame


@form()
def walks_over_the_floor_as_a_whole(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The machine stands on its levelling feet without anchors: hard stops push all of it, bed and columns and
    platform, over the floor and past the floor's nests, by jerks to the side of the stop, further one way."""
    rows, machine = scene.rows, scene.machine
    aside_m = scene.calm.positions_m @ level_direction(machine)
    towards = np.sign(np.diff(aside_m, prepend=aside_m[0]))
    hard = np.maximum(rows.speed_m_per_s / max(float(rows.speed_m_per_s.max()), 1e-6) - rng.uniform(0.1, 0.4), 0)
    jerks = np.where(towards > 0, 1.0, -rng.uniform(0.2, 0.6)) * (hard + 0.02) * new_visit(rows)
    way = draw_sign(rng) * normalised(np.cumsum(jerks * rng.uniform(0.3, 1, len(rows))))
    turn = rng.uniform(-0.3, 0.3) * way[:, None] * normal_direction(machine)
    shift = np.outer(way, level_direction(machine)) + np.cross(turn, scene.points_m)
    return Contribution(points_m=shift * rows.off_floor[:, None])


@form()
def plate_of_reflectors_creeps_under_payload(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Reflectors stand on the payload's adapter of plastic, and not on the platform: with each payload it turns and
    sinks at once by a part and on for half an hour, and without one comes back as slowly."""
    rows = scene.rows
    mass = rows.stated_payload_kg / max(float(rows.stated_payload_kg.max()), 1.0)
    share = rng.uniform(0.2, 0.5)
    given = share * mass + (1 - share) * lagging(rows.t_s, mass, rng.uniform(10, 45) * 60)
    angle = draw_sign(rng) * given[:, None] * normal_direction(scene.machine)
    turned = np.cross(angle, scene.reflectors_m / scene.platform_reach_m)
    sunk = -rng.uniform(0.1, 0.6) * np.outer(given, scene.machine.up)
    return Contribution(points_m=with_platform(scene, turned + sunk) * rows.on_platform[:, None])


@form()
def distance_creeps_until_next_check(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The distance meter is set by the nests at each check, and then creeps off as its reference warms up, fast at
    first and always the same way, until the next check sets it again."""
    sight, _ = sight_of(scene)
    rows = scene.rows
    since_s = since_change_s(rows, rows.nest_check)
    crept = draw_sign(rng) * (1 - np.exp(-since_s / (rng.uniform(8, 35) * 60)))
    return Contribution(sights_m=2 * sight * crept[:, None])


@form()
def balls_of_its_standing_axis(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The station's standing axis runs on balls, one of which is too large: as the head turns, the axis tilts to and
    fro at each ball's place, and the cage slips with each long turn, so that the place changes."""
    sight, distances = sight_of(scene)
    azimuth = np.arctan2(sight[:, 0], sight[:, 1])
    slips = rng.uniform(0.0, 0.15) * np.cumsum(np.abs(np.diff(azimuth, prepend=azimuth[0])))
    turn = rng.uniform(18, 45) * azimuth + slips
    above, aside = np.sin(turn + draw_phase(rng)), rng.uniform(0.2, 0.6) * np.sin(turn + draw_phase(rng))
    return Contribution(
        sights_m=np.outer(above * distances / 4, UP) + across_sight(sight, distances) * (aside * distances / 4)[:, None]
    )


@form(BELLOWS_N)
def bellows_breathe_through_a_hole(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A closed bellows below the platform breathes through a hole that is half stopped up: after each way down its air
    pushes the platform up, and after each way up it sucks it down, for half a minute or more."""
    machine, rows = scene.machine, scene.rows
    height_m = scene.calm.positions_m @ machine.up
    pressed = lagging(rows.t_s, height_m, rng.uniform(15, 70)) - height_m
    push = np.outer(normalised(pressed), machine.up)
    lever = np.broadcast_to(draw_sign(rng) * rng.uniform(0.03, 0.2) * level_direction(machine), push.shape)
    return Contribution(force_n=push, moment_nm=np.cross(lever, push))


@form()
def block_of_joints_slips_to_and_fro(scene: Scene, place: int, rng: Generator) -> Contribution:
    """One block on the platform carries the joints of one drive, and its bolts have lost their tension: it follows the
    force of its struts up and down only when that has changed by enough, and stays where it was pressed."""
    machine = scene.machine
    struts = np.flatnonzero(machine.drive_of_strut == rng.integers(len(machine.drives)))
    pull_n = (scene.calm.tension_n[:, struts, None] * scene.calm.directions[:, struts]).sum(1)
    along = draw_sign(rng) * rng.uniform(0.4, 1) * machine.up + rng.uniform(-0.6, 0.6) * level_direction(machine)
    along /= np.linalg.norm(along)
    force_n = pull_n @ along
    force_n = (force_n - force_n.mean()) / max(float(np.ptp(force_n)) / 2, 1e-6)
    slipped = dragged(force_n, rng.uniform(0.4, 0.8))
    joints_m = np.zeros((len(scene.rows), len(machine.struts), 3))
    joints_m[:, struts] = -(slipped - slipped[0])[:, None, None] * along
    return Contribution(joints_m=joints_m)


@form(CONDUIT_NM)
def stiff_conduit_turns_platform(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A conduit that is as stiff as a spring is led from one strut onto the platform and clamped on both: where the
    strut leans far from how the conduit was bent it turns the platform, more than in proportion, and the conduit takes
    a set where it has been for a while."""
    machine, rows = scene.machine, scene.rows
    strut = int(rng.integers(len(machine.struts)))
    lean = scene.calm.directions[:, strut] @ level_direction(machine)
    bent = lean - rng.uniform(0.3, 0.7) * lagging(rows.t_s, lean, rng.uniform(3, 15) * 60)
    bent = bent - np.quantile(bent, rng.uniform(0.2, 0.8))
    return Contribution(moment_nm=np.outer(normalised(bent * np.abs(bent)), normal_direction(machine)))


@form()
def ball_of_another_size_in_the_list(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Parts of the campaign were run by a program whose list has some reflectors as balls of another size: these come
    out nearer to the station and higher above their nests, the others as ever."""
    sight, _ = sight_of(scene)
    rows = scene.rows
    by_other = draw_stretches(rows, (2, 5), (0.12, 0.3), rng)
    wrong = rng.choice([0.0, 1.0, 1.0], len(scene.machine.reflectors))
    wrong[rng.choice(np.flatnonzero(scene.machine.carriers == -1))] = 1.0
    off = draw_sign(rng) * by_other * wrong[rows.smr] * rows.off_floor
    return Contribution(sights_m=np.outer(off, UP) * rng.uniform(0.5, 1) - sight * off[:, None])


@form(JET_N)
def air_knife_pushes_platform_back(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A blade of air on the platform's side blows chips off the table's edge: it pushes back while it is on, and the
    more the nearer it is to that edge, as the air dams up before it."""
    machine, rows, positions = scene.machine, scene.rows, scene.calm.positions_m
    side = draw_sign(rng)
    blows_to = side * level_direction(machine)
    gap_m = (positions @ blows_to).max() - positions @ blows_to + rng.uniform(0.03, 0.15)
    on = draw_stretches(rows, (3, 6), (0.1, 0.3), rng)
    push = -np.outer(on * (0.3 + 0.7 * normalised(1 / gap_m)), blows_to + rng.uniform(-0.5, 0.5) * machine.up)
    lever = np.broadcast_to(rng.uniform(-0.2, 0.2) * machine.up, push.shape)
    return Contribution(force_n=push, moment_nm=np.cross(lever, push))


@form()
def cable_hangs_before_some_sights(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The cable of a crane's pendant hangs down before the machine: where it covers one half of the beam the station
    aims by the other half, to the left on the one side of it and to the right on the other."""
    sight, distances = sight_of(scene)
    azimuth = np.arctan2(sight[:, 0], sight[:, 1])
    hangs_at = np.quantile(azimuth[scene.rows.on_platform], rng.uniform(0.2, 0.8))
    swings = rng.uniform(0, 0.003) * np.sin(2 * np.pi * scene.rows.t_s / rng.uniform(3, 8) + draw_phase(rng))
    off = (azimuth - hangs_at - swings) / rng.uniform(0.012, 0.03)
    aim = 2 * off * np.exp(-(off**2))
    return Contribution(sights_m=across_sight(sight, distances) * aim[:, None])


FORMS: tuple[Form, ...] = (
    walks_over_the_floor_as_a_whole, plate_of_reflectors_creeps_under_payload, distance_creeps_until_next_check,
    balls_of_its_standing_axis, bellows_breathe_through_a_hole, block_of_joints_slips_to_and_fro,
    stiff_conduit_turns_platform, ball_of_another_size_in_the_list, air_knife_pushes_platform_back,
    cable_hangs_before_some_sights,
)  # fmt: skip
