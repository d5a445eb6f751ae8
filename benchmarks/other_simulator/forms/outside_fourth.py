"""Forms of no effect of the list, of the fourth archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_cycles, new_visit, of_former_visit
from benchmarks.other_simulator.forms.memory import in_jerks, switched_over
from benchmarks.other_simulator.forms.shapes import (
    bump,
    draw_direction,
    draw_sign,
    level_direction,
    normal_direction,
    normalised,
    sight_of,
    with_platform,
)
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Equilibrium
from benchmarks.other_simulator.station import across_sight

Array = NDArray[np.float64]
Generator = np.random.Generator

FAN_N, RIM_NM = 1200.0, 1500.0
HALVES_M = 0.2  # height over which the joint of two halves opens by half as much again
IN_PLANE = np.array([1.0, 1.0, 0.0])
ALONG_X = np.array([1.0, 0.0, 0.0])


@form()
def shakes_where_it_resonates(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A pump shakes the platform in those poses, with that payload, in which its own frequency is the pump's."""
    rows, positions = scene.rows, scene.calm.positions_m
    height, aside = positions @ scene.machine.up, positions @ level_direction(scene.machine)
    own = 1 / np.sqrt(scene.machine.moving_mass_kg + rows.payload_kg)
    own = own / own.max() - 0.25 * normalised(height - height.mean()) + 0.15 * normalised(aside - aside.mean()) ** 2
    away = (own - np.quantile(own, rng.uniform(0.2, 0.8))) / rng.uniform(0.02, 0.06)
    shaken = np.sqrt(2) * np.sin(rng.uniform(0, 6.3, len(rows))) / np.sqrt(1 + away**2)
    return Contribution(points_m=np.outer(shaken * rows.on_platform, draw_direction(rng)))


@form()
def posts_swing_after_stop(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The reflectors of the platform stand on slender posts, of which each swings in its own time after a stop."""
    rows, positions = scene.rows, scene.calm.positions_m
    came = (positions - of_former_visit(rows, positions)) * IN_PLANE
    came = came / np.maximum(np.linalg.norm(came, axis=1)[:, None], 1e-6)
    rates, strengths = rng.uniform(0.3, 1.2, (2, len(scene.machine.reflectors)))
    swing = np.cos(2 * np.pi * rates[rows.smr] * rows.dwell_s + 0.5) * np.exp(-rows.dwell_s / rng.uniform(6, 18))
    stop = strengths[rows.smr] * np.sqrt(rows.speed_m_per_s / 0.1) * rows.on_platform * ~rows.moving
    return Contribution(points_m=came * (swing * stop)[:, None])


@form()
def halves_of_platform_pulled_apart(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Two halves of the platform are bolted together: the struts' pull opens that joint once it is above the bolts'
    preload, more above than below."""
    machine = scene.machine
    joints, reflectors = machine.nominal.platform_joint_m, scene.reflectors_m
    joint_signs, reflector_signs = np.sign(joints[:, 0]), np.where(reflectors[:, 0] >= 0, 1.0, -1.0)
    wider_at_joints = joint_signs * (1 + 0.5 * joints[:, 1] / HALVES_M)
    wider_at_reflectors = reflector_signs * (1 + 0.5 * reflectors[:, 1] / HALVES_M) * scene.rows.on_platform

    def pull_n(state: Equilibrium) -> Array:
        return np.asarray(-(state.tension_n * state.directions[:, :, 0]) @ joint_signs / 2)

    calm_n = pull_n(scene.calm)
    preload_n, more_n = np.quantile(calm_n, rng.uniform(0.2, 0.6)), max(float(np.ptp(calm_n)), 1e-9)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        opened = amplitude * np.maximum(pull_n(state) - preload_n, 0) / more_n
        return Contribution(
            joints_m=opened[:, None, None] * wider_at_joints[:, None] * ALONG_X,
            points_m=with_platform(scene, np.outer(opened * wider_at_reflectors, ALONG_X)),
        )

    return Contribution(under_load=under_load)


@form()
def circle_divided_unevenly(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The station's horizontal circle has marks that are off, each by itself: directions jump from mark to mark."""
    sight, distances = sight_of(scene)
    azimuth = np.arctan2(sight[:, 0], sight[:, 1])
    sector = ((azimuth - azimuth.min()) / rng.uniform(0.008, 0.03)).astype(int)
    off = rng.normal(size=sector.max() + 1)[sector]
    return Contribution(sights_m=across_sight(sight, distances) * (off * distances / 4)[:, None])


@form()
def distance_begins_anew_after_broken_beam(scene: Scene, place: int, rng: Generator) -> Contribution:
    """People walk through the beam: after that the station begins its distances anew, a little longer or shorter."""
    rows, (sight, _) = scene.rows, sight_of(scene)
    broken = new_visit(rows) & (rng.random(len(rows)) < 1 / rng.uniform(8, 25))
    stretch = np.cumsum(broken)
    off = rng.normal(size=stretch[-1] + 1)[stretch]
    return Contribution(sights_m=sight * off[:, None])


@form()
def plate_of_reflectors_slips_at_hard_stops(scene: Scene, place: int, rng: Generator) -> Contribution:
    """All reflectors of the platform stand on one plate, which slips and turns on it at hard stops, to where that
    stop throws it."""
    rows, positions = scene.rows, scene.calm.positions_m
    came = (positions - of_former_visit(rows, positions)) * IN_PLANE
    came = came / np.maximum(np.linalg.norm(came, axis=1)[:, None], 1e-6)
    hard = (new_visit(rows) * rows.speed_m_per_s**3)[:, None]
    slipped = np.cumsum(hard * came, 0)
    turned = np.cumsum(hard[:, 0] * rng.normal(size=len(rows)))
    turn = np.outer(2 * normalised(turned), normal_direction(scene.machine))
    shift = normalised(slipped) + np.cross(turn, with_platform(scene, scene.reflectors_m))
    return Contribution(points_m=shift * rows.on_platform[:, None])


@form()
def snaps_over_between_two_rests(scene: Scene, place: int, rng: Generator) -> Contribution:
    """More struts than needed hold the platform under stress: it snaps over well to one side of the middle, stays so,
    and snaps back well to the other side."""
    level = level_direction(scene.machine)
    aside = scene.calm.positions_m @ level
    aside = (aside - np.median(aside)) / aside.std()
    rest = switched_over(aside, -rng.uniform(0.3, 1.0), rng.uniform(0.3, 1.0))
    turn = np.outer(rng.uniform(1, 3) * rest, normal_direction(scene.machine))
    shift = np.outer(rest, level) * rng.uniform(0.3, 1) + np.cross(turn, with_platform(scene, scene.reflectors_m))
    return Contribution(points_m=shift * scene.rows.on_platform[:, None])


@form(FAN_N)
def fan_blows_on_payload(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A fan that its thermostat switches blows on the payload as on a sail, where its stream passes."""
    rows, level = scene.rows, level_direction(scene.machine)
    aside, height = scene.calm.positions_m @ level, scene.calm.positions_m @ scene.machine.up
    place_of_stream = rng.uniform(-0.6, 0.6)
    within = bump(normalised(height - height.mean()), place_of_stream, 0.5)
    nearer = np.exp(draw_sign(rng) * normalised(aside - aside.mean()))
    on = draw_cycles(rows, (8, 30), (0.2, 0.5), rng) > 0
    sail = 0.15 + 0.85 * rows.payload_kg / max(rows.payload_kg.max(), 1)
    blown = normalised(within * nearer * on * sail)
    lever = -rng.uniform(0.1, 0.35) * normal_direction(scene.machine)
    return Contribution(force_n=np.outer(blown, level), moment_nm=np.outer(blown, lever))


@form(RIM_NM)
def joints_run_against_their_rim(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Ball joints that were mounted askew reach their rim at the steepest angles, and then turn the platform."""
    machine = scene.machine
    upright = scene.calm.directions @ machine.up
    turns = np.zeros(len(scene.rows))
    for strut, joint in enumerate(machine.nominal.platform_joint_m):
        limit = np.quantile(upright[:, strut], rng.uniform(0.55, 0.9))
        turns += np.sign(joint[0]) * np.maximum(upright[:, strut] - limit, 0)
    return Contribution(moment_nm=np.outer(normalised(turns), normal_direction(machine)))


@form()
def plate_creaks_as_it_warms(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A thin plate on a thick frame makes the platform: it warms first, friction holds it, and it gets longer and
    shorter in jerks, with its joints and reflectors."""
    ahead = scene.weather.lagging_air_c(rng.uniform(3, 8)) - scene.weather.part_c["platform"]
    jerks = in_jerks(ahead, float(np.ptp(ahead)) / rng.uniform(3, 6))
    longer = 4 * normalised(jerks - jerks[0])
    joints = scene.machine.nominal.platform_joint_m * ALONG_X
    return Contribution(
        joints_m=longer[:, None, None] * joints,
        points_m=with_platform(scene, scene.reflectors_m * ALONG_X) * (longer * scene.rows.on_platform)[:, None],
    )


FORMS: tuple[Form, ...] = (
    shakes_where_it_resonates, posts_swing_after_stop, halves_of_platform_pulled_apart, circle_divided_unevenly,
    distance_begins_anew_after_broken_beam, plate_of_reflectors_slips_at_hard_stops, snaps_over_between_two_rests,
    fan_blows_on_payload, joints_run_against_their_rim, plate_creaks_as_it_warms,
)  # fmt: skip
