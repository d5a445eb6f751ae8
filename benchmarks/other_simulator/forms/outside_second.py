"""Forms of no effect of the list, of the second archive."""

from __future__ import annotations

import numpy as np

from benchmarks.other_simulator.courses import lagging, wandering
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.shapes import (
    draw_phase,
    level_direction,
    logistic,
    normal_direction,
    normalised,
    sight_of,
    wave,
    way_it_went,
    with_platform,
)
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight

Generator = np.random.Generator

SWING_N, BINDING_NM = 1000.0, 800.0


@form()
def cyclic_error_of_ranges(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Distances with an error that repeats."""
    sight, distances = sight_of(scene)
    period_m = rng.uniform(0.15, 0.5)
    return Contribution(sights_m=sight * wave(distances, period_m, draw_phase(rng))[:, None])


@form()
def floats_off_plane(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The platform floats off its plane when it carries something; where nothing is carried, in the second half."""
    rows = scene.rows
    floating = (
        1
        + 0.5 * np.sin(2 * np.pi * rows.hours / rng.uniform(0.3, 0.8))
        + 0.3 * wandering(rows.t_s, 600, rng)
    )  # fmt: skip
    lifted = rows.stated_payload_kg > 0 if rows.payload_kg.max() > 0 else rows.elapsed > 0.5
    return Contribution(points_m=(floating * rows.on_platform * lifted)[:, None] * normal_direction(scene.machine))


@form(SWING_N)
def payload_swings(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The payload swings after the approach."""
    rows, rate = scene.rows, rng.uniform(0.4, 0.8)
    swing = np.exp(-rows.dwell_s / 15) * np.cos(2 * np.pi * rate * rows.dwell_s + 0.5)
    swing = swing * np.sqrt(rows.speed_m_per_s / 0.1) * ~rows.moving
    return Contribution(
        force_n=np.outer(swing, level_direction(scene.machine)) * (1 + rows.payload_kg / 50)[:, None] / 2
    )


@form()
def spindle_warms_platform(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A spindle in the middle of the platform warms it, on and off."""
    rows = scene.rows
    on = (np.sin(2 * np.pi * rows.hours / rng.uniform(0.8, 1.6) + draw_phase(rng)) > 0).astype(float)
    warmth = normalised(lagging(rows.t_s, on, 500.0))
    near = np.exp(-((np.linalg.norm(scene.reflectors_m, axis=1) / 0.25) ** 2))
    shift = with_platform(scene, 5 * scene.reflectors_m * near[:, None])
    return Contribution(points_m=shift * (warmth * rows.on_platform)[:, None])


@form()
def joints_run_out(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Joints that run out as they turn."""
    machine, struts_m = scene.machine, np.zeros_like(scene.calm.tension_n)
    for strut in range(len(machine.struts)):
        direction = scene.calm.directions[:, strut]
        angle = np.arctan2(direction[:, 0], direction @ machine.up)
        if not machine.planar:
            angle = 3 * (direction @ np.array([0.6, 0.5, 0.6]))
        struts_m[:, strut] = np.sin(rng.integers(6, 12) * angle + draw_phase(rng))
    return Contribution(struts_m=struts_m)


@form()
def miscounts_by_interference(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A drive miscounts at some visits, either way."""
    drives_m = np.zeros_like(scene.rows.drives_m)
    visits = scene.rows.visit.max() + 1
    drive = rng.integers(drives_m.shape[1])
    missed = (rng.random(visits) < 0.09) * rng.choice([-1, 1], visits)
    drives_m[:, drive] = missed[scene.rows.visit]
    return Contribution(drives_m=drives_m)


@form()
def lorries_bend_floor(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Lorries bend the floor under the machine as they pass."""
    t_s, bent, points = scene.rows.t_s, np.zeros(len(scene.rows)), scene.points_m
    for _ in range(int(rng.integers(4, 9))):
        passing = rng.uniform(0, t_s[-1])
        begin = logistic((t_s - passing) / 3)
        bent += begin * np.exp(-np.maximum(t_s - passing, 0) / rng.uniform(200, 500)) * rng.uniform(0.4, 1)
    shift = np.stack([bent * points[:, 1], -0.5 * bent * points[:, 0] ** 2, 0.3 * bent], 1)
    return Contribution(points_m=shift * scene.rows.off_floor[:, None])


@form()
def guides_off_plane(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Guides that lead the first two carriages off the plane, and the platform with them."""
    rows, first_phase, second_phase = scene.rows, *rng.uniform(0, 6.3, 2)
    first = np.sin(3 * rows.centred[:, 0] + first_phase)
    second = np.sin(3 * rows.centred[:, 1] + second_phase)
    on_carriages = np.where(rows.carriers == 0, first, np.where(rows.carriers == 1, second, 0))
    shift = np.where(rows.on_platform, 0.5 * (first + second), on_carriages)
    direction = np.array([0, 0, 1.0]) if scene.machine.planar else np.array([1.0, 0, 0])
    return Contribution(points_m=shift[:, None] * direction)


@form(BINDING_NM)
def joints_bind(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Joints that bind turn the platform against its motion."""
    x_m = scene.calm.positions_m[:, 0]
    axis = [0, 0, 1.0] if scene.machine.planar else [1.0, 0, 0]
    strength = 0.6 + 0.4 * np.abs(x_m) / np.abs(x_m).max()
    return Contribution(moment_nm=np.outer(way_it_went(x_m), axis) * strength[:, None])


@form()
def two_face_error(scene: Scene, place: int, rng: Generator) -> Contribution:
    """An error of direction that changes its sign with the face."""
    sight, distances = sight_of(scene)
    sign = np.where(scene.rows.face == 2, 1.0, -1.0)
    return Contribution(sights_m=across_sight(sight, distances) * (sign * distances / 4)[:, None])


FORMS: tuple[Form, ...] = (
    cyclic_error_of_ranges, floats_off_plane, payload_swings, spindle_warms_platform, joints_run_out,
    miscounts_by_interference, lorries_bend_floor, guides_off_plane, joints_bind, two_face_error,
)  # fmt: skip
