"""Forms of effects of columns, foundation and guides, of the seventh archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.columns import GROWTH_M, sideways_n
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.memory import dragged
from benchmarks.other_simulator.forms.seventh_traces import uneven_line
from benchmarks.other_simulator.forms.shapes import (
    across,
    along,
    column_height,
    draw_instant,
    draw_sign,
    logistic,
    normalised,
    since,
    turned,
)
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Equilibrium

Array = NDArray[np.float64]
Generator = np.random.Generator

TURN_PER_M = 4.0  # rad of a carriage for an amplitude of 1 m
SCRAPED_M, BLOCKS_M = (0.1, 0.22), (0.12, 0.3)


@form(GROWTH_M)
def foot_like_floor_head_like_air(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The column's foot is as warm as the floor and its head as the air, which a sensor halfway does not show."""
    weather, height, reach = scene.weather, column_height(scene.rows, drive), rng.uniform(0.25, 0.6)
    shown = weather.part_c["drives"]
    by_floor = reach * (1 - np.exp(-height / reach))
    foot_k, head_k = weather.part_c["base"] - shown, weather.lagging_air_c(rng.uniform(15, 45)) - shown
    return Contribution(
        carriage_m=along(scene.machine, drive, normalised(foot_k * by_floor + head_k * (height - by_floor)))
    )


@form(GROWTH_M)
def hydraulic_unit_warms_back(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A hydraulic unit on the column's back works whenever any drive moves, and warms and bends the column."""
    rows, machine, tau_min = scene.rows, scene.machine, rng.uniform(30, 90)
    warmth = normalised(np.sum([rows.warmth_of_motion(each, tau_min) for each in range(len(machine.drives))], 0))
    height = column_height(rows, drive)
    bent = draw_sign(rng) * warmth
    return Contribution(
        carriage_m=across(machine, drive, bent * height**2) + along(machine, drive, 0.5 * warmth * height),
        carriage_rad=turned(machine, drive, -2 * bent * height),
    )


@form()
def pads_sink_under_payload(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The pads under the foot give slowly under the payload, and do not come back all the way without it."""
    rows, machine = scene.rows, scene.machine
    carried = rows.payload_kg / max(rows.payload_kg.max(), 1)
    pressed = lagging(rows.t_s, carried, rng.uniform(5, 30) * 60)
    sunk = 0.6 * pressed + 0.4 * np.maximum.accumulate(pressed)
    aside = rng.uniform(-0.6, 0.6) * sunk * column_height(rows, drive)
    return Contribution(carriage_m=along(machine, drive, -sunk) + across(machine, drive, aside))


@form()
def grout_crumbles_in_jerks(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The grout under the foot crumbles, and the foot drops and tilts a little at each of several moments."""
    rows, machine = scene.rows, scene.machine
    steps_s = [draw_instant(rows, rng, 0.08, 0.9) for _ in range(int(rng.integers(4, 9)))]
    sunk = normalised(np.sum([rng.exponential() * since(rows, step_s) for step_s in steps_s], 0))
    tilted = rng.uniform(-0.8, 0.8) * sunk
    return Contribution(
        carriage_m=along(machine, drive, -sunk) + across(machine, drive, tilted * column_height(rows, drive)),
        carriage_rad=None if machine.legs else turned(machine, drive, -tilted),
        step_s=min(steps_s),
    )


@form()
def bolted_joints_slip(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The column's bolted joints slip under the sideways force, and slip back only when that has fallen enough."""
    machine, height = scene.machine, column_height(scene.rows, drive)
    calm_n = sideways_n(machine, scene.calm, drive)
    largest_n, held_n = np.abs(calm_n).max(), rng.uniform(0.15, 0.35) * np.ptp(calm_n)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        slipped = dragged(sideways_n(machine, state, drive), held_n) / largest_n
        return Contribution(carriage_m=across(machine, drive, amplitude * slipped * height**2))

    return Contribution(under_load=under_load)


@form()
def foot_gapes_under_moment(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The joint of foot and floor is stiff until the moment on it overcomes its bolts, and gapes beyond that."""
    machine, height = scene.machine, column_height(scene.rows, drive)
    calm = np.abs(sideways_n(machine, scene.calm, drive)) * height
    held = float(np.quantile(calm, rng.uniform(0.2, 0.6)))

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        moment = sideways_n(machine, state, drive) * height
        gaping = amplitude * np.sign(moment) * np.maximum(np.abs(moment) - held, 0) / (calm.max() - held)
        return Contribution(
            carriage_m=across(machine, drive, gaping * height), carriage_rad=turned(machine, drive, -gaping)
        )

    return Contribution(under_load=under_load)


@form()
def rails_meet_at_an_angle_otherwise(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Two straight rails meet at a small angle."""
    place, rounding = scene.rows.centred[:, drive] - rng.uniform(-0.4, 0.4), 0.06
    bent = rounding * np.logaddexp(0, place / rounding)
    return Contribution(carriage_m=across(scene.machine, drive, bent))


@form()
def uneven_as_scraped(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The guide is as uneven as hand scraping has left it."""
    uneven = uneven_line(scene.rows.drives_m[:, drive], rng.uniform(*SCRAPED_M), rng)
    return Contribution(carriage_m=across(scene.machine, drive, uneven))


@form()
def blocks_pass_step_one_by_one(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The rail has a step, and the carriage is turned while one of its blocks has passed it and the other has not."""
    place_m, apart_m = scene.rows.drives_m[:, drive], rng.uniform(*BLOCKS_M)
    beyond_m = place_m - np.quantile(place_m, rng.uniform(0.3, 0.7))
    between = logistic((beyond_m + apart_m / 2) / 0.008) - logistic((beyond_m - apart_m / 2) / 0.008)
    return Contribution(carriage_rad=TURN_PER_M * turned(scene.machine, drive, between))


@form()
def noses_over_at_rail_end(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The carriage noses over where the rail ends beyond its last support."""
    beyond = np.maximum(draw_sign(rng) * scene.rows.centred[:, drive] - rng.uniform(-0.1, 0.4), 0)
    return Contribution(carriage_rad=TURN_PER_M * turned(scene.machine, drive, normalised(beyond**2)))


FORMS: dict[str, tuple[Form, ...]] = {
    "column_thermal_growth": (foot_like_floor_head_like_air, hydraulic_unit_warms_back),
    "foundation_settling": (pads_sink_under_payload, grout_crumbles_in_jerks),
    "column_compliance": (bolted_joints_slip, foot_gapes_under_moment),
    "guide_straightness": (rails_meet_at_an_angle_otherwise, uneven_as_scraped),
    "guide_angular": (blocks_pass_step_one_by_one, noses_over_at_rail_end),
}
