"""Forms of no effect of the list, of the first archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.shapes import (
    bump,
    draw_direction,
    draw_sign,
    level_direction,
    logistic,
    normalised,
    sight_of,
    way_it_went,
    with_platform,
)
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

DRAG_N, HOSE_N, MAGNET_N = 500.0, 1200.0, 1500.0
CHIP_M = 4e-4


@form(DRAG_N)
def cable_chain_drag(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A cable chain drags behind, pulls back and hangs down."""
    x_m = scene.calm.positions_m[:, 0]
    sign = way_it_went(x_m)
    x = (x_m - x_m.mean()) / np.abs(x_m - x_m.mean()).max()
    pull = np.outer(-sign * (0.7 + 0.3 * x) - 0.5 * np.abs(x), level_direction(scene.machine))
    return Contribution(force_n=pull + np.outer(-0.3 * np.abs(x), scene.machine.up))


@form(HOSE_N)
def hose_pulls(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A hose pulls to one corner, the more the further away."""
    positions = scene.calm.positions_m
    x = (positions - positions.mean(0)) / 0.3
    distance = np.linalg.norm(x - [1, 1, 0], axis=1)
    to_corner = (np.array([1.0, 1, 0]) - x) / np.maximum(distance, 0.2)[:, None]
    return Contribution(force_n=to_corner * (distance**2)[:, None] / 4)


@form()
def crane_tilts_machine(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A crane stands beside the machine for a while and tilts it against the floor's nests."""
    elapsed, begin = scene.rows.elapsed, rng.uniform(0.2, 0.6)
    there = logistic((elapsed - begin) / 0.01) - logistic((elapsed - begin - rng.uniform(0.1, 0.3)) / 0.01)
    axis = np.array([0.3, 0, 1.0]) if scene.machine.planar else np.r_[rng.normal(size=2), 0]
    return Contribution(points_m=np.cross(axis, scene.points_m) * (there * scene.rows.off_floor)[:, None])


@form()
def platform_swells_with_moisture(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The platform swells with the air's moisture."""
    humidity = scene.weather.humidity_percent
    moisture = normalised(lagging(scene.rows.t_s, humidity, 1800.0) - humidity[0])
    return Contribution(
        points_m=with_platform(scene, scene.reflectors_m * 4) * (moisture * scene.rows.on_platform)[:, None],
        joints_m=4 * scene.machine.nominal.platform_joint_m[None] * moisture[:, None, None],
    )


@form()
def neighbour_vibrates(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A neighbour shakes the platform, on and off."""
    on = logistic(30 * np.sin(2 * np.pi * scene.rows.hours / rng.uniform(0.5, 1.5) + rng.uniform(0, 6)))
    direction = draw_direction(rng)
    shaken = np.sqrt(2) * np.sin(rng.uniform(0, 6.3, len(scene.rows)))
    return Contribution(points_m=(shaken * on * scene.rows.on_platform)[:, None] * direction)


@form(CHIP_M)
def chip_in_one_place(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A chip lies at one place of a drive's travel."""
    drives_m = np.zeros_like(scene.rows.drives_m)
    drive, middle = rng.integers(drives_m.shape[1]), rng.uniform(-0.5, 0.5)
    drives_m[:, drive] = bump(scene.rows.centred[:, drive], middle, 0.035)
    return Contribution(drives_m=drives_m)


@form()
def platform_bends_under_payload(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The platform bends under its payload."""
    load = scene.rows.payload_kg / max(scene.rows.payload_kg.max(), 1)
    bent = 1 - 2 * (scene.reflectors_m[:, 0] / scene.platform_reach_m) ** 2
    shift = with_platform(scene, bent[:, None] * scene.machine.up)
    return Contribution(points_m=shift * (load * scene.rows.on_platform)[:, None])


@form()
def platform_bends_warm_above(scene: Scene, place: int, rng: Generator) -> Contribution:
    """The platform is warmer above than below, and bends."""
    warmth = normalised(scene.weather.lagging_air_c(5) - scene.weather.part_c["platform"])
    reach, reflectors = scene.platform_reach_m, scene.reflectors_m
    bent = (reflectors[:, 0] / reach) ** 2 - 0.5
    shift = bent[:, None] * scene.machine.up + 0.3 * reflectors[:, 1:2] / reach * np.array([0, 0, 1.0])
    return Contribution(points_m=with_platform(scene, shift) * (warmth * scene.rows.on_platform)[:, None])


@form(MAGNET_N)
def magnet_attracts_platform(scene: Scene, place: int, rng: Generator) -> Contribution:
    """A magnet beside the workspace attracts the platform."""
    positions = scene.calm.positions_m
    aside = np.array([0.6, 0.1, 0 if scene.machine.planar else 0.1]) * draw_sign(rng)
    way = positions.mean(0) + aside - positions
    distance = np.linalg.norm(way, axis=1)
    return Contribution(force_n=way / distance[:, None] * ((0.35 / distance) ** 3)[:, None])


@form()
def eccentric_reflectors(scene: Scene, place: int, rng: Generator) -> Contribution:
    """Reflectors whose optical centre depends on where they are seen from."""
    sight, _ = sight_of(scene)
    azimuth, elevation = np.arctan2(sight[:, 0], sight[:, 1]), np.arcsin(sight[:, 2])
    phase = rng.uniform(0, 6.3, len(scene.machine.reflectors))[scene.rows.smr]
    shift = np.stack(
        [
            np.sin(14 * azimuth + phase),
            np.cos(11 * elevation + phase),
            0.5 * np.sin(9 * (azimuth + elevation) + phase),
        ],
        1,
    )
    return Contribution(points_m=shift * scene.rows.off_floor[:, None])


FORMS: tuple[Form, ...] = (
    cable_chain_drag, hose_pulls, crane_tilts_machine, platform_swells_with_moisture, neighbour_vibrates,
    chip_in_one_place, platform_bends_under_payload, platform_bends_warm_above, magnet_attracts_platform,
    eccentric_reflectors,
)  # fmt: skip
