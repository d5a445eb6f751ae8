"""Forms of no effect of the list, of the seventh archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_mountings
from benchmarks.other_simulator.forms.memory import switched_over
from benchmarks.other_simulator.forms.seventh_traces import of_each
from benchmarks.other_simulator.forms.shapes import (
    draw_direction,
    draw_instant,
    draw_phase,
    draw_sign,
    level_direction,
    normal_direction,
    normalised,
    sight_of,
    since,
    way_it_went,
    with_platform,
)
from benchmarks.other_simulator.forms.traces import draw_stretches
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight

Array = NDArray[np.float64]
Generator = np.random.Generator

BALANCER_N, BUFFER_N, LOOP_N, LOADER_N = 1500.0, 2500.0, 900.0, 1200.0
GRADUATION_RAD = (0.08, 0.3)


@form(BALANCER_N)
def pneumatic_balancer_leaks(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A pneumatic balancer that holds up the platform leaks, until a compressor fills it again."""
    turn = scene.rows.hours * 60 / rng.uniform(6, 25) + rng.uniform(0, 1)
    return Contribution(force_n=np.outer(0.5 - turn % 1, scene.machine.up))


@form(BUFFER_N)
def buffer_pushes_back(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A rubber buffer beside the workspace pushes the platform back where it comes too near."""
    level = draw_sign(rng) * level_direction(scene.machine)
    x_m = scene.calm.positions_m @ level
    pressed = np.maximum(x_m - np.quantile(x_m, rng.uniform(0.55, 0.8)), 0)
    return Contribution(force_n=np.outer(-normalised(pressed**1.3), level))


@form()
def plates_of_platform_slip(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The platform's two plates slip on each other at a moment; one holds the joints, the other all reflectors."""
    step_s, turn = draw_instant(scene.rows, rng), rng.uniform(-1, 1)
    normal = normal_direction(scene.machine)
    turned = np.cross(normal, scene.reflectors_m) * turn / scene.platform_reach_m
    slipped = with_platform(scene, draw_direction(rng) * [1, 1, 0.1] + turned)
    after = since(scene.rows, step_s) * scene.rows.on_platform
    return Contribution(points_m=slipped * after[:, None], step_s=step_s)


@form()
def graduation_of_station(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The graduation of the station's horizontal circle has an error that repeats over its divisions."""
    sight, distances = sight_of(scene)
    azimuth, period_rad = np.arctan2(sight[:, 0], sight[:, 1]), rng.uniform(*GRADUATION_RAD)
    error = np.sin(2 * np.pi * azimuth / period_rad + draw_phase(rng))
    return Contribution(sights_m=across_sight(sight, distances) * (error * distances / 4)[:, None])


@form(LOOP_N)
def cable_loop_flips_over(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A stiff loop of cables flips over as the platform goes across, and flips back only well on its way back."""
    machine = scene.machine
    x_m = scene.calm.positions_m @ level_direction(machine)
    low_m, high_m = np.quantile(x_m, [rng.uniform(0.15, 0.35), rng.uniform(0.65, 0.85)])
    lies = switched_over(x_m, low_m, high_m)
    return Contribution(force_n=np.outer(lies, draw_sign(rng) * level_direction(machine) - 0.3 * machine.up))


@form()
def clamping_spreads_platform(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The payload's clamps spread or squeeze the platform in its width, differently each time they are tightened."""
    mounting, first_s = draw_mountings(scene.rows, rng)
    spread = 4 * of_each(mounting, rng.uniform(-1, 1, mounting.max() + 1))
    level = level_direction(scene.machine)
    joints = np.outer(scene.machine.nominal.platform_joint_m @ level, level)
    reflectors = with_platform(scene, np.outer(scene.reflectors_m @ level, level))
    return Contribution(
        joints_m=spread[:, None, None] * joints,
        points_m=reflectors * (spread * scene.rows.on_platform)[:, None],
        step_s=first_s,
    )


@form()
def glass_reflectors_at_an_angle(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Reflectors of glass change the path of light that falls on them at an angle."""
    sight, _ = sight_of(scene)
    facing = sight[scene.rows.on_platform].mean(0) + rng.normal(size=3) * 0.1
    slant = 1 - (sight @ (facing / np.linalg.norm(facing))) ** 2
    return Contribution(sights_m=sight * (normalised(slant) * scene.rows.off_floor)[:, None])


@form()
def brackets_of_slider_reflectors_warp(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The motors warm the thin brackets that hold the carriages' reflectors, and the brackets warp."""
    rows, tau_min, points_m = scene.rows, rng.uniform(10, 40), np.zeros_like(scene.points_m)
    for drive in range(len(scene.machine.drives)):
        on = rows.carriers == drive
        way = rng.uniform(0.3, 1) * scene.machine.up + rng.uniform(-1, 1) * level_direction(scene.machine)
        points_m[on] = np.outer(rows.warmth_of_motion(drive, tau_min)[on], way)
    return Contribution(points_m=points_m)


@form(LOADER_N)
def loader_leans_on_platform(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A loading arm was left in contact with the platform for some stretches of time, and leans on it."""
    leaning = draw_stretches(scene.rows, (2, 5), (0.08, 0.25), rng)
    way = draw_sign(rng) * level_direction(scene.machine) - rng.uniform(0, 0.8) * scene.machine.up
    return Contribution(force_n=np.outer(leaning, way))


@form()
def tips_out_of_plane(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The platform tips out of its plane, by how high it stands and by whether it went up or down."""
    machine, rows = scene.machine, scene.rows
    height_m = scene.calm.positions_m @ machine.up
    tip = 0.6 * normalised(height_m - height_m.mean()) + 0.4 * way_it_went(height_m)
    arm = scene.reflectors_m @ machine.up / scene.platform_reach_m + 0.5
    return Contribution(points_m=np.outer(tip * arm * rows.on_platform, normal_direction(machine)))


FORMS: tuple[Form, ...] = (
    pneumatic_balancer_leaks, buffer_pushes_back, plates_of_platform_slip, graduation_of_station,
    cable_loop_flips_over, clamping_spreads_platform, glass_reflectors_at_an_angle,
    brackets_of_slider_reflectors_warp, loader_leans_on_platform, tips_out_of_plane,
)  # fmt: skip
