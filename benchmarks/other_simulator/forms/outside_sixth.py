"""Forms of no effect of the list, of the sixth archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import new_visit
from benchmarks.other_simulator.forms.memory import in_jerks
from benchmarks.other_simulator.forms.shapes import (
    draw_direction,
    draw_sign,
    level_direction,
    logistic,
    normal_direction,
    normalised,
    sight_of,
    way_it_went,
    with_platform,
)
from benchmarks.other_simulator.forms.station import UP
from benchmarks.other_simulator.forms.traces import gaps_s
from benchmarks.other_simulator.machine import ON_FLOOR
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight

Array = NDArray[np.float64]
Generator = np.random.Generator

FOLDS_N, BRACKET_N, ROPE_N, CYLINDER_N = 900.0, 2000.0, 1500.0, 1500.0
FILLING = 0.15  # share of a cycle in which a compressor runs


@form(FOLDS_N)
def bellows_catch_fold_by_fold(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Worn bellows beside the platform catch on their rail at each fold: they push back more and more until a fold
    jumps over, to one side on the way out and to the other on the way back."""
    x_m = scene.calm.positions_m @ level_direction(scene.machine)
    fold = (x_m / rng.uniform(0.04, 0.12) + rng.uniform(0, 1)) % 1
    went = way_it_went(x_m)
    caught = np.where(went > 0, -fold, np.where(went < 0, 1 - fold, 0.0)) * (0.3 + 0.7 * scene.rows.elapsed)
    lever = -rng.uniform(0.05, 0.2) * scene.machine.up
    push = np.outer(caught, level_direction(scene.machine))
    return Contribution(force_n=push, moment_nm=np.cross(lever, push))


@form(BRACKET_N)
def bracket_of_carriage_is_bent_away(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A bracket was mounted too near to one carriage: where that stands far above the platform both touch; each
    contact bends the bracket away by a part, and the next one comes later."""
    rows, machine = scene.rows, scene.machine
    drive = int(rng.integers(len(machine.drives)))
    above_m = rows.commanded_m[:, drive] - scene.calm.positions_m @ machine.up
    begins_m, gives, first = (
        float(np.quantile(above_m, rng.uniform(0.35, 0.65))),
        rng.uniform(0.02, 0.1),
        new_visit(rows),
    )
    pressed = np.zeros(len(rows))
    for k, reaches_m in enumerate(above_m):
        pressed[k] = max(reaches_m - begins_m, 0.0)
        begins_m += gives * pressed[k] * first[k]
    lever = machine.nominal.platform_joint_m[machine.drive_of_strut == drive].mean(0)
    push = np.outer(normalised(pressed), -machine.up)
    return Contribution(force_n=push, moment_nm=np.cross(lever, push))


@form(ROPE_N)
def balancing_rope_pulls_askew(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A rope over a pulley helps to carry the platform, but the pulley hangs beside the middle and turns hard: it
    pulls to there, more while the rope gets longer than while it gets shorter."""
    machine, positions = scene.machine, scene.calm.positions_m
    level = level_direction(machine) * draw_sign(rng) * rng.uniform(0.2, 0.6)
    way = positions.mean(0) + rng.uniform(0.6, 1.5) * machine.up + level - positions
    length_m = np.linalg.norm(way, axis=1)
    pull = way / length_m[:, None] * (1 + rng.uniform(0.15, 0.4) * way_it_went(length_m))[:, None]
    pull = pull - pull.mean(0)
    lever = rng.uniform(0.05, 0.2) * machine.up + draw_sign(rng) * 0.1 * level_direction(machine)
    return Contribution(force_n=pull, moment_nm=np.cross(lever, pull))


@form(CYLINDER_N)
def balance_cylinder_breathes_with_compressor(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A pneumatic cylinder that stands askew below the platform: its pressure falls as air leaks and rises while the
    compressor runs, and it pushes along its rod, which leans by where the platform is."""
    machine, positions, rows = scene.machine, scene.calm.positions_m, scene.rows
    aside = level_direction(machine) * draw_sign(rng) * rng.uniform(0.2, 0.7)
    rod = positions - positions.mean(0) + rng.uniform(0.6, 1.2) * machine.up + aside
    length_m = np.linalg.norm(rod, axis=1)
    cycle = (rows.hours * 60 / rng.uniform(4, 20) + rng.uniform(0, 1)) % 1
    pressure = np.where(cycle < 1 - FILLING, 1 - cycle / (1 - FILLING), (cycle - 1 + FILLING) / FILLING) - 0.5
    push = rod / length_m[:, None] * (pressure * length_m.min() / length_m)[:, None]
    lever = draw_sign(rng) * rng.uniform(0.05, 0.2) * level_direction(machine)
    return Contribution(force_n=push, moment_nm=np.cross(lever, push))


@form()
def bolted_ends_of_platform_slip_past_each_other(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The platform's two ends are bolted together in the middle; where the struts push the one up and the other down
    by enough that joint slips at once, and keeps its place until they do so the other way."""
    machine, calm = scene.machine, scene.calm
    joints, reflectors = machine.nominal.platform_joint_m, scene.reflectors_m
    joint_signs = np.sign(joints[:, 0])
    reflector_signs = np.tanh(reflectors[:, 0] / (0.2 * np.abs(joints[:, 0]).max())) * scene.rows.on_platform
    shear_n = -(calm.tension_n * (calm.directions @ machine.up)) @ joint_signs
    slipped = normalised(in_jerks(shear_n - np.median(shear_n), rng.uniform(0.5, 1.3) * float(shear_n.std())))
    return Contribution(
        joints_m=slipped[:, None, None] * joint_signs[:, None] * machine.up,
        points_m=with_platform(scene, np.outer(slipped * reflector_signs, machine.up)),
    )


@form()
def payload_tips_platform_out_of_plane(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A payload hangs before the plane: it tips the platform out of it, more where the struts lie flat and hold it
    badly, and its upper reflectors come forward as its lower ones go back."""
    rows, machine, calm = scene.rows, scene.machine, scene.calm
    hangs = rows.payload_kg / max(float(rows.payload_kg.max()), 1.0)
    flat = np.exp(rng.uniform(1, 2) * normalised(-np.abs(calm.directions @ machine.up).mean(1)))
    pivot = rng.uniform(-0.1, 0.1) * machine.up - rng.uniform(0, 0.15) * normal_direction(machine)
    tipped = np.cross(level_direction(machine), scene.reflectors_m - pivot) / scene.platform_reach_m
    return Contribution(
        points_m=2 * with_platform(scene, tipped) * (normalised(hangs * flat) * rows.on_platform)[:, None]
    )


@form()
def sight_jumps_as_focus_turns_round(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The station's focusing lens has play: after it went out to a farther reflector its sight points elsewhere than
    after it came in to a nearer one, and all is as before for a reflector at the same distance."""
    sight, distances = sight_of(scene)
    went, play_m, above = np.zeros(len(distances)), rng.uniform(0.01, 0.06), rng.uniform(-1, 1)
    for k, change_m in enumerate(np.diff(distances), 1):
        went[k] = np.clip(went[k - 1] + 2 * change_m / play_m, -1, 1)
    shift = across_sight(sight, distances) * (went * distances)[:, None] + np.outer(above * went * distances, UP)
    return Contribution(sights_m=shift / 4)


@form()
def distance_meter_sleeps_in_pauses(scene: Scene, place: int, rng: Generator) -> Contribution:
    """To save its laser the distance meter goes to sleep when it is not asked for some time: woken up it measures
    too long, by how cold it has become, and is right again only after several readings."""
    sight, _ = sight_of(scene)
    sleeps_s, cools_s, warms_s = rng.uniform(6, 10), rng.uniform(8, 60), rng.uniform(8, 60)
    cold, off = 0.0, np.zeros(len(scene.rows))
    for k, gap_s in enumerate(gaps_s(scene.rows)):
        cold *= np.exp(-min(gap_s, sleeps_s) / warms_s)
        cold = 1 - (1 - cold) * np.exp(-max(gap_s - sleeps_s, 0.0) / cools_s)
        off[k] = cold
    return Contribution(sights_m=sight * normalised(off)[:, None])


@form()
def posts_of_reflectors_each_of_its_own_stuff(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Reflectors of platform and carriages stand on posts of whatever was at hand, thick and thin, upright and
    leaning: each follows the air in its own time, in its own direction and by as much as it likes."""
    rows, weather, points = scene.rows, scene.weather, np.zeros_like(scene.points_m)
    for smr in np.flatnonzero(scene.machine.carriers != ON_FLOOR):
        ahead = weather.lagging_air_c(float(np.exp(rng.uniform(0, 4)))) - weather.part_c["platform"].mean()
        points[rows.smr == smr] = np.outer(rng.uniform(0.2, 1) * ahead, draw_direction(rng))[rows.smr == smr]
    return Contribution(points_m=normalised(points))


@form()
def reflectors_touched_as_they_are_read(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Someone turns reflectors to the station by hand and does not let go of all of them: those of the platform are
    pushed away as they are read, one more than another, where the platform is low enough to be reached."""
    rows = scene.rows
    height = scene.calm.positions_m @ scene.machine.up
    within_reach = logistic(
        (np.quantile(height, rng.uniform(0.4, 0.8)) - height) / (0.15 * float(np.ptp(height)) + 1e-9)
    )
    soft = rng.uniform(0.3, 1, len(scene.machine.reflectors))[rows.smr]
    touched = (rng.random(len(rows)) < rng.uniform(0.3, 0.7)) * rng.gamma(2.0, 0.3, len(rows))
    pushed = within_reach * soft * touched * rows.on_platform * ~rows.moving
    return Contribution(points_m=np.outer(pushed, draw_direction(rng)))


FORMS: tuple[Form, ...] = (
    bellows_catch_fold_by_fold, bracket_of_carriage_is_bent_away, balancing_rope_pulls_askew,
    balance_cylinder_breathes_with_compressor, bolted_ends_of_platform_slip_past_each_other,
    payload_tips_platform_out_of_plane, sight_jumps_as_focus_turns_round, distance_meter_sleeps_in_pauses,
    posts_of_reflectors_each_of_its_own_stuff, reflectors_touched_as_they_are_read,
)  # fmt: skip
