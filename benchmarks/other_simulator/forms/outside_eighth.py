"""Forms of no effect of the list, of the eighth archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_cycles, draw_mountings
from benchmarks.other_simulator.forms.shapes import (
    draw_phase,
    draw_sign,
    level_direction,
    normal_direction,
    normalised,
    sight_of,
    way_it_went,
    with_platform,
)
from benchmarks.other_simulator.forms.traces import draw_stretches, gaps_s
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.station import across_sight

Array = NDArray[np.float64]
Generator = np.random.Generator

BALANCER_N, COVER_N = 2500.0, 2500.0
PIVOT_BELOW_M = 1.2  # of a machine that rocks, below the machine frame


@form()
def graduation_of_circles(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The station's circles have short-wave errors of their graduation: of direction, many times in a turn."""
    sight, distances = sight_of(scene)
    azimuth, elevation = np.arctan2(sight[:, 0], sight[:, 1]), np.arcsin(sight[:, 2])
    level = np.sin(rng.integers(60, 180) * azimuth + draw_phase(rng))
    upright = rng.uniform(0.3, 1) * np.sin(rng.integers(60, 180) * elevation + draw_phase(rng))
    return Contribution(
        sights_m=across_sight(sight, distances) * (level * distances / 4)[:, None]
        + np.outer(upright * distances / 4, [0, 0, 1])
    )


@form()
def prisms_seen_slantwise(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Reflectors of solid glass, none of which quite faces the station: the more slantwise light comes in, the longer
    is its way through the glass.
    """
    sight, _ = sight_of(scene)
    towards = -sight.mean(0) / np.linalg.norm(sight.mean(0))
    faces = towards + rng.normal(size=(len(scene.machine.reflectors), 3)) * rng.uniform(0.25, 0.45)
    faces /= np.linalg.norm(faces, axis=1)[:, None]
    cosine = np.clip(-(sight * faces[scene.rows.smr]).sum(1), 0.3, 1)
    longer = normalised((1 - cosine**2) / cosine) * scene.rows.off_floor
    return Contribution(sights_m=sight * longer[:, None])


@form()
def mist_in_the_beam(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Mist of coolant drifts through the beam at times and scatters it: distances come out too long, each by another
    amount.
    """
    sight, _ = sight_of(scene)
    mist = draw_stretches(scene.rows, (2, 5), (0.08, 0.25), rng)
    return Contribution(sights_m=sight * (mist * rng.exponential(1.0, len(mist)) * scene.rows.off_floor)[:, None])


@form()
def station_still_turning(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The station reads before its head has come to rest: directions are still a little towards the former target."""
    sight, _ = sight_of(scene)
    back = np.roll(scene.sights_m, 1, axis=0) - scene.sights_m
    back[0] = 0.0
    back -= (back * sight).sum(1)[:, None] * sight
    left = back * np.exp(-gaps_s(scene.rows) / rng.uniform(1.2, 3))[:, None]
    return Contribution(sights_m=left / np.linalg.norm(left, axis=1).max())


@form()
def oil_pulses_float_carriages(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Pulses of a central lubrication float the carriages aside on their rails, until the oil has been pressed out."""
    rows, machine = scene.rows, scene.machine
    period_min = rng.uniform(10, 35)
    since_min = (rows.hours * 60 + rng.uniform(0, period_min)) % period_min
    floating = np.exp(-since_min / rng.uniform(1.5, 5))
    struts_m, points_m = np.zeros_like(scene.calm.tension_n), np.zeros((len(rows), 3))
    for drive in range(len(machine.drives)):
        shift = draw_sign(rng) * rng.uniform(0.5, 1) * np.outer(floating, machine.sideways[drive])
        points_m += shift * (rows.carriers == drive)[:, None]
        for strut in np.flatnonzero(machine.drive_of_strut == drive):
            # a base end that is moved is to the platform what a longer strut is
            struts_m[:, strut] = (scene.calm.directions[:, strut] * shift).sum(1)
    return Contribution(struts_m=struts_m, points_m=points_m)


@form()
def plate_of_reflectors_is_loose(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The plate that carries the platform's reflectors is loose: it stays behind and turns by the platform's last move
    aside, which the struts do not see.
    """
    rows, machine = scene.rows, scene.machine
    level = level_direction(machine)
    went = way_it_went(scene.calm.positions_m @ level)
    arms = with_platform(scene, scene.reflectors_m)
    turn = np.cross(np.broadcast_to(normal_direction(machine), arms.shape), arms) * draw_sign(rng) * rng.uniform(1, 3)
    return Contribution(points_m=(turn - level) * (went * rows.on_platform)[:, None])


@form()
def rocks_on_its_mounts(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The machine stands on soft mounts: as a whole it leans to the side that the platform and its payload go to."""
    rows, machine = scene.rows, scene.machine
    level = level_direction(machine)
    lever_kg_m = (scene.calm.positions_m @ level) * (machine.moving_mass_kg + rows.payload_kg)
    axis = np.cross(machine.up, level)
    arms = scene.points_m + PIVOT_BELOW_M * machine.up
    return Contribution(
        points_m=np.cross(np.broadcast_to(axis, arms.shape), arms)
        * (normalised(lever_kg_m) * rows.off_floor)[:, None]
    )  # fmt: skip


@form(BALANCER_N)
def balancer_on_failing_regulator(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A pneumatic balancer pulls the platform up: its pressure goes up and down with the compressor, and its seal
    holds back whichever way it goes.
    """
    rows, up = scene.rows, scene.machine.up
    pressure = draw_cycles(rows, (6, 25), (2, 8), rng)
    friction = rng.uniform(0.1, 0.3) * way_it_went(scene.calm.positions_m @ up)
    lever = np.broadcast_to(level_direction(scene.machine) * rng.uniform(-0.15, 0.15), (len(rows), 3))
    force = np.outer(pressure - friction, up)
    return Contribution(force_n=force, moment_nm=np.cross(lever, force))


@form()
def clamping_spreads_platform_as_well(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Bolting a payload down spreads the platform and moves its joints, each time otherwise; without one it is slack
    again.
    """
    rows, machine = scene.rows, scene.machine
    mounting, first_s = draw_mountings(rows, rng)
    joints = machine.nominal.platform_joint_m
    outwards = joints / np.linalg.norm(joints, axis=1)[:, None]
    pulled = rng.normal(size=(int(mounting.max()) + 1, len(joints), 3)) * 0.5 * [1, 1, 0 if machine.planar else 1]
    moved = (outwards + pulled) * rng.uniform(0.5, 1, len(pulled))[:, None, None]
    return Contribution(joints_m=moved[mounting] * (rows.payload > 0)[:, None, None], step_s=first_s)


@form(COVER_N)
def leans_on_a_cover(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A bent cover stands in one corner of the workspace: the platform leans on it there, the more the further in."""
    machine = scene.machine
    way = rng.uniform(0.6, 1) * draw_sign(rng) * level_direction(machine) + rng.uniform(-0.8, 0.8) * machine.up
    way = way / np.linalg.norm(way)
    depth_m = scene.calm.positions_m @ way
    pressed = np.maximum(depth_m - np.quantile(depth_m, rng.uniform(0.5, 0.75)), 0)
    force = np.outer(-pressed / pressed.max(), way)
    lever = np.broadcast_to(machine.up * rng.uniform(-0.15, 0.15), force.shape)
    return Contribution(force_n=force, moment_nm=np.cross(lever, force))


FORMS: tuple[Form, ...] = (
    graduation_of_circles, prisms_seen_slantwise, mist_in_the_beam, station_still_turning, oil_pulses_float_carriages,
    plate_of_reflectors_is_loose, rocks_on_its_mounts, balancer_on_failing_regulator, clamping_spreads_platform_as_well,
    leans_on_a_cover,
)  # fmt: skip
