"""Forms of no effect of the list, of the ninth archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_mountings
from benchmarks.other_simulator.forms.memory import since_change_s
from benchmarks.other_simulator.forms.shapes import (
    draw_direction,
    draw_instant,
    draw_phase,
    draw_sign,
    level_direction,
    normalised,
    sight_of,
    since,
    with_platform,
)
from benchmarks.other_simulator.forms.traces import draw_stretches
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Equilibrium
from benchmarks.other_simulator.station import across_sight

Array = NDArray[np.float64]
Generator = np.random.Generator

SUCTION_N, BUOYANCY_N, SLING_N, MAGNETS_N = 1500.0, 3000.0, 3000.0, 2000.0
DIGIT_M = 4e-4  # largest step of what is written


@form()
def head_of_circle_fails_at_times(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The station's level circle sits beside its axis, which two reading heads opposite to each other make up for; at
    times one of them fails, and directions are off by a sine of a whole turn, in either sense to left and right."""
    sight, distances = sight_of(scene)
    azimuth = np.arctan2(sight[:, 0], sight[:, 1])
    right_at = float(np.median(azimuth)) + rng.uniform(-0.25, 0.25)
    fails = draw_stretches(scene.rows, (2, 5), (0.12, 0.3), rng)
    error = draw_sign(rng) * 2 * np.sin(azimuth - right_at) * fails
    return Contribution(sights_m=across_sight(sight, distances) * (error * distances / 4)[:, None])


@form()
def light_by_way_of_wet_floor(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Where the floor is wet a part of the light comes back by way of it, as from a mirror: distances are too long and
    too short in turn, by how much longer that way is, which goes with the height; once it is dry they are nearly
    right."""
    sight, distances = sight_of(scene)
    below_m = -scene.sights_m[:, 2].min() + rng.uniform(0.1, 0.4)  # height of the station above the floor
    longer_m = 2 * max(below_m, 0.5) * (scene.sights_m[:, 2] + max(below_m, 0.5)) / distances
    wet = np.maximum(draw_stretches(scene.rows, (2, 4), (0.25, 0.5), rng), rng.uniform(0, 0.2))
    error = np.sin(2 * np.pi * longer_m / rng.uniform(0.12, 0.4) + draw_phase(rng)) * scene.rows.off_floor
    return Contribution(sights_m=sight * (error * wet)[:, None])


@form(DIGIT_M)
def exported_with_too_few_digits(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Readings went through a text file with too few digits: each coordinate of the station's frame is rounded to whole
    steps, which is nowhere more than half of one."""
    origin_m = rng.uniform(0, 1e-3, 3)
    sights_m = scene.sights_m + origin_m

    def rounded(_: Equilibrium, amplitude: float) -> Contribution:
        if amplitude == 0:
            return Contribution()
        return Contribution(sights_m=amplitude * np.round(sights_m / amplitude) - sights_m)

    return Contribution(under_load=rounded)


@form()
def frame_of_platform_shears(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The platform is a welded frame without a diagonal: where the struts push its upper side one way and its lower
    side the other it shears, with its joints and reflectors, and stands square again without that."""
    machine, calm = scene.machine, scene.calm
    level, up = level_direction(machine), machine.up
    joints = machine.nominal.platform_joint_m
    heights = joints @ up if np.ptp(joints @ up) > 1e-3 else joints @ np.cross(up, level)
    heights = heights - heights.mean()
    reach = float(np.abs(heights).max())
    of_reflectors = scene.reflectors_m @ up / reach * scene.rows.on_platform

    def shear_n(state: Equilibrium) -> Array:
        return np.asarray(-(state.tension_n * (state.directions @ level)) @ (heights / reach))

    largest_n = max(float(np.abs(shear_n(calm)).max()), 1e-6)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        sheared = amplitude * shear_n(state) / largest_n
        return Contribution(
            joints_m=sheared[:, None, None] * (heights / reach)[:, None] * level,
            points_m=with_platform(scene, np.outer(sheared * of_reflectors, level)),
        )

    return Contribution(under_load=under_load)


@form(SUCTION_N)
def suction_hose_shortens_while_on(scene: Scene, place: int, rng: Generator) -> Contribution:
    """While the extraction runs the air presses its ribbed hose together: it pulls the platform to where it is fixed
    under the roof, by the same force wherever that is; while it is off the hose is slack."""
    machine, rows = scene.machine, scene.rows
    runs = draw_stretches(rows, (2, 5), (0.12, 0.3), rng)
    fixed = rng.uniform(0.8, 1.6) * machine.up + draw_sign(rng) * rng.uniform(0.3, 1.2) * level_direction(machine)
    way = scene.calm.positions_m.mean(0) + fixed - scene.calm.positions_m
    pull = way / np.linalg.norm(way, axis=1)[:, None] * runs[:, None]
    lever = np.broadcast_to(draw_sign(rng) * rng.uniform(0.05, 0.2) * level_direction(machine), pull.shape)
    return Contribution(force_n=pull, moment_nm=np.cross(lever, pull))


@form(BUOYANCY_N)
def dips_into_its_bath(scene: Scene, place: int, rng: Generator) -> Contribution:
    """What the platform holds dips into a bath and is lifted by what it displaces: from the surface down, the more the
    deeper; the surface sinks as the bath loses water, until someone fills it up."""
    machine, rows = scene.machine, scene.rows
    height_m = scene.calm.positions_m @ machine.up
    turn = (rows.hours / rng.uniform(0.7, 2.0) + rng.uniform(0, 1)) % 1
    surface_m = np.quantile(height_m, rng.uniform(0.4, 0.8)) - rng.uniform(0.05, 0.3) * float(np.ptp(height_m)) * turn
    lift = np.outer(normalised(np.maximum(surface_m - height_m, 0)), machine.up)
    lever = np.broadcast_to(rng.uniform(-0.15, 0.15) * level_direction(machine), lift.shape)
    return Contribution(force_n=lift, moment_nm=np.cross(lever, lift))


@form(SLING_N)
def forgotten_sling_goes_taut(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A sling of the crane that brought the platform was left on its hook: it is slack until the platform is further
    from the hook than it is long, and then pulls back to there like a spring."""
    machine, positions = scene.machine, scene.calm.positions_m
    hook = positions.mean(0) + rng.uniform(0.6, 1.2) * machine.up
    hook = hook + draw_sign(rng) * rng.uniform(0, 0.5) * level_direction(machine)
    way = hook - positions
    distance_m = np.linalg.norm(way, axis=1)
    taut = normalised(np.maximum(distance_m - np.quantile(distance_m, rng.uniform(0.4, 0.75)), 0))
    pull = way / distance_m[:, None] * taut[:, None]
    lever = np.broadcast_to(rng.uniform(-0.2, 0.2) * level_direction(machine), pull.shape)
    return Contribution(force_n=pull, moment_nm=np.cross(lever, pull))


@form()
def hot_workpiece_spreads_platform(scene: Scene, place: int, rng: Generator) -> Contribution:
    """What is carried comes hot from a furnace: it spreads the platform, where it is clamped more than elsewhere, with
    joints and reflectors, until it has cooled; without a payload the platform cools by itself."""
    rows, machine = scene.rows, scene.machine
    mounting, first_s = draw_mountings(rows, rng)
    heat = np.exp(-since_change_s(rows, mounting) / (rng.uniform(20, 60) * 60)) * (rows.payload > 0)
    warmth = normalised(lagging(rows.t_s, heat, rng.uniform(4, 15) * 60))
    clamped = draw_direction(rng) * [1, 1, 0.2] * scene.platform_reach_m * rng.uniform(0.2, 0.7)

    def spread(points: Array) -> Array:
        off = points - clamped
        near = np.exp(-((np.linalg.norm(off, axis=1) / scene.platform_reach_m) ** 2) / 4)
        return np.asarray(off / scene.platform_reach_m * (0.4 + near)[:, None])

    joints = spread(machine.nominal.platform_joint_m)
    if machine.planar:
        joints[:, 2] = 0.0
    return Contribution(
        joints_m=warmth[:, None, None] * joints,
        points_m=with_platform(scene, spread(scene.reflectors_m)) * (warmth * rows.on_platform)[:, None],
        step_s=first_s,
    )


@form(MAGNETS_N)
def magnets_of_table_draw_platform(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The table behind the platform has rows of magnets to hold workpieces, and someone left them on: what is of steel
    on the platform is drawn to the nearest row, to either side, and not at all midway between two."""
    machine, positions = scene.machine, scene.calm.positions_m
    level, up = level_direction(machine), machine.up
    pitch_m, other_m = rng.uniform(0.12, 0.3, 2)
    aside = np.sin(2 * np.pi * (positions @ level) / pitch_m + draw_phase(rng))
    above = rng.uniform(0.2, 0.8) * np.sin(2 * np.pi * (positions @ up) / other_m + draw_phase(rng))
    pull = np.outer(aside, level) + np.outer(above, up)
    lever = np.broadcast_to(-rng.uniform(0, 0.2) * up, pull.shape)
    return Contribution(force_n=pull, moment_nm=np.cross(lever, pull))


@form()
def seat_of_one_joint_slips(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The platform runs into something, and the seat of one joint slips on it under its bolts: from then on the joint
    is fast again, at another place, whatever the force."""
    machine = scene.machine
    step_s, strut = draw_instant(scene.rows, rng), int(rng.integers(len(machine.struts)))
    joints_m = np.zeros((len(scene.rows), len(machine.struts), 3))
    slipped = draw_direction(rng) * [1, 1, 0 if machine.planar else 1]
    joints_m[:, strut] = np.outer(since(scene.rows, step_s), slipped / np.linalg.norm(slipped))
    return Contribution(joints_m=joints_m, step_s=step_s)


FORMS: tuple[Form, ...] = (
    head_of_circle_fails_at_times, light_by_way_of_wet_floor, exported_with_too_few_digits, frame_of_platform_shears,
    suction_hose_shortens_while_on, dips_into_its_bath, forgotten_sling_goes_taut, hot_workpiece_spreads_platform,
    magnets_of_table_draw_platform, seat_of_one_joint_slips,
)  # fmt: skip
