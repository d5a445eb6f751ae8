"""Forms of no effect of the list, of the third archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_mountings, new_visit, of_former_visit
from benchmarks.other_simulator.forms.shapes import (
    draw_direction,
    level_direction,
    normal_direction,
    normalised,
    sight_of,
    with_platform,
)
from benchmarks.other_simulator.machine import ON_PLATFORM
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight

Array = NDArray[np.float64]
Generator = np.random.Generator

TORQUE_NM, PRESS_N = 800.0, 1500.0
IN_PLANE = np.array([1.0, 1.0, 0.0])


@form()
def rocks_on_rubber_mounts(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The whole machine leans on its rubber mounts, slowly, to the side to which its platform carries the mass."""
    rows, level = scene.rows, level_direction(scene.machine)
    aside = scene.calm.positions_m @ level
    moment = (scene.machine.moving_mass_kg + rows.payload_kg) * (aside - aside.mean())
    lean = normalised(lagging(rows.t_s, moment, rng.uniform(30, 200)))
    axis = np.cross(scene.machine.up, level)
    return Contribution(points_m=np.cross(axis, scene.points_m) * (lean * rows.off_floor)[:, None])


@form()
def reflectors_exchanged(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Two reflectors of unlike optical depth change places as the payload is changed: one reads longer, one shorter."""
    rows, (sight, _) = scene.rows, sight_of(scene)
    mounting, first_s = draw_mountings(rows, rng)
    one, other = rng.choice(np.flatnonzero(scene.machine.carriers == ON_PLATFORM), 2, replace=False)
    deeper = ((rows.smr == one).astype(float) - (rows.smr == other)) * (mounting % 2)
    return Contribution(sights_m=sight * deeper[:, None], step_s=first_s)


@form()
def frame_sways_after_stop(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The frame sways as a whole after the stop, along the way that the platform came."""
    rows, level = scene.rows, level_direction(scene.machine)
    aside = scene.calm.positions_m @ level
    came = aside - of_former_visit(rows, aside)
    fading = np.exp(-rows.dwell_s / rng.uniform(5, 15)) * ~rows.moving
    swing = np.cos(2 * np.pi * rng.uniform(0.25, 0.6) * rows.dwell_s) * fading
    strength = np.sign(came) * np.sqrt(np.minimum(np.abs(came), 0.4) * rows.speed_m_per_s / 0.02)
    height = scene.points_m @ scene.machine.up
    higher = (height - height.min()) / max(float(np.ptp(height)), 1e-9)
    return Contribution(points_m=np.outer(swing * strength * (0.5 + 0.5 * higher) * rows.off_floor, level))


@form()
def platform_warps_at_each_clamping(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Each clamping of a payload warps the platform anew, with its joints and reflectors."""
    mounting, first_s = draw_mountings(scene.rows, rng)
    warps = 4 * rng.normal(size=(mounting.max() + 1, 3, 3)) * np.outer(IN_PLANE, IN_PLANE)
    warps[0] = 0
    joints = np.einsum("mij,sj->msi", warps, scene.machine.nominal.platform_joint_m)[mounting]
    reflectors = np.einsum("rij,rj->ri", warps[mounting], scene.reflectors_m)
    return Contribution(
        joints_m=joints, points_m=with_platform(scene, reflectors) * scene.rows.on_platform[:, None], step_s=first_s
    )


@form()
def station_stops_short_after_slew(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The station's head has not come round wholly: it lacks some of the way from the reflector that it read before."""
    sight, distances = sight_of(scene)
    azimuth, t_s = np.arctan2(sight[:, 0], sight[:, 1]), scene.rows.t_s
    slew, passed_s = np.diff(azimuth, prepend=azimuth[0]), np.diff(t_s, prepend=t_s[0])
    lacks = -np.tanh(slew / rng.uniform(0.05, 0.2)) * np.exp(-passed_s / rng.uniform(6, 20))
    return Contribution(sights_m=across_sight(sight, distances) * (lacks * distances / 4)[:, None])


@form(TORQUE_NM)
def torque_comes_and_goes(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Something that turns on the platform is started, stopped and reversed: its torque turns the platform."""
    rows = scene.rows
    changed = new_visit(rows) & (rng.random(len(rows)) < 1 / rng.uniform(4, 12))
    stretch = np.cumsum(changed)
    torque = rng.choice([-1.0, 0.0, 0.6, 1.0], stretch[-1] + 1)[stretch]
    return Contribution(moment_nm=np.outer(torque, normal_direction(scene.machine)))


@form(PRESS_N)
def presses_against_forgotten_clamp(scene: Scene, place: int, rng: Generator) -> Contribution:
    """On one side of the workspace the platform runs against something soft, which presses back and turns it."""
    direction = draw_direction(rng) * IN_PLANE
    direction = direction / np.linalg.norm(direction)
    place_m = scene.calm.positions_m @ direction
    pressed = normalised(np.maximum(place_m - np.quantile(place_m, rng.uniform(0.5, 0.75)), 0))
    lever = rng.uniform(-0.2, 0.2) * normal_direction(scene.machine)
    return Contribution(force_n=np.outer(-pressed, direction), moment_nm=np.outer(pressed, lever))


@form()
def stands_anew_at_each_visit(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The platform does not repeat: at each visit it stands a little aside and turned, and stays so until the next."""
    rows = scene.rows
    visits = int(rows.visit.max()) + 1
    shift = (rng.normal(size=(visits, 3)) * IN_PLANE)[rows.visit]
    turn = np.outer(2 * rng.normal(size=visits)[rows.visit], normal_direction(scene.machine))
    shift = shift + np.cross(turn, with_platform(scene, scene.reflectors_m))
    return Contribution(points_m=shift * rows.on_platform[:, None])


@form()
def chain_pulls_brackets_to_its_side(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Cable chains pull at the brackets of the carriages' reflectors, by way and height; carriages do not feel it."""
    rows, points_m = scene.rows, np.zeros_like(scene.points_m)
    for drive, axis in enumerate(scene.machine.axes):
        raised = rows.raised[:, drive]
        pull = -rows.side[:, drive] * (0.3 + 0.7 * raised) - 0.4 * np.abs(rows.centred[:, drive]) ** 3
        aside = 0.5 * rng.choice([-1, 1]) * raised**2 * rows.side[:, drive]
        shift = np.outer(pull, axis) + np.outer(aside, scene.machine.sideways[drive])
        points_m += shift * (rows.carriers == drive)[:, None]
    return Contribution(points_m=points_m)


@form()
def drawn_to_former_pose(scene: Scene, place: int, rng: Generator) -> Contribution:
    """What covers the platform on all sides has set itself at the former pose, draws towards that, and gives in."""
    rows, positions = scene.rows, scene.calm.positions_m
    back = of_former_visit(rows, positions) - positions
    length = np.linalg.norm(back, axis=1)[:, None]
    drawn = back / np.maximum(length, 1e-9) * np.tanh(length / rng.uniform(0.1, 0.3))
    left = 0.3 + 0.7 * np.exp(-rows.dwell_s / rng.uniform(4, 12))
    return Contribution(points_m=drawn * (left * rows.on_platform * ~rows.moving)[:, None])


FORMS: tuple[Form, ...] = (
    rocks_on_rubber_mounts, reflectors_exchanged, frame_sways_after_stop, platform_warps_at_each_clamping,
    station_stops_short_after_slew, torque_comes_and_goes, presses_against_forgotten_clamp, stands_anew_at_each_visit,
    chain_pulls_brackets_to_its_side, drawn_to_former_pose,
)  # fmt: skip
