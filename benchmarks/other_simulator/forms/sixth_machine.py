"""Forms of the sixth archive of what carries the drives: columns and guides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import columns
from benchmarks.other_simulator.forms.columns import sideways_n
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import new_visit
from benchmarks.other_simulator.forms.shapes import (
    across,
    along,
    bump,
    column_height,
    draw_instant,
    draw_phase,
    draw_sign,
    normalised,
    since,
    turned,
    wave,
)
from benchmarks.other_simulator.forms.traces import BREAK_S, draw_after_break, gaps_s
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Equilibrium

Array = NDArray[np.float64]
Generator = np.random.Generator


@form(columns.GROWTH_M)
def cold_floor_holds_its_foot_back(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its foot is as warm as the floor that it stands on and its sensor sits well above: the foot is behind, and more
    so on the side of its larger sole."""
    machine, part_c = scene.machine, scene.weather.part_c
    warmth, tip = normalised(part_c["base"] - part_c["drives"]), rng.uniform(-0.6, 0.6)
    return Contribution(
        carriage_m=along(machine, drive, warmth)
        + across(machine, drive, tip * warmth * column_height(scene.rows, drive)),
        carriage_rad=None if machine.legs else turned(machine, drive, -tip * warmth),
    )


@form(columns.GROWTH_M)
def strained_by_its_bed_until_shaken_free(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It is bolted to a bed that warms up later, and bends as the two pull at each other; fast moves shake the bolted
    joint free, bit by bit, and each change of warmth strains it anew."""
    rows, height = scene.rows, column_height(scene.rows, drive)
    ahead = scene.weather.lagging_air_c(rng.uniform(12, 35)) - scene.weather.part_c["base"]
    shaken = new_visit(rows) * rows.speed_m_per_s**2
    frees = np.exp(-rng.uniform(4, 15) * shaken / max(shaken.sum(), 1e-12))
    strain = np.zeros(len(rows))
    for k in range(1, len(rows)):
        strain[k] = frees[k] * (strain[k - 1] + ahead[k] - ahead[k - 1])
    strain = normalised(strain)
    return Contribution(
        carriage_m=across(scene.machine, drive, strain * height**2),
        carriage_rad=turned(scene.machine, drive, -2 * strain * height),
    )


@form()
def anchor_bolts_tightened_in_a_break(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """In a break someone tightens its anchor bolts: the foot is pulled down and askew at once, and comes up again by
    some of that as the bolts give way in their plugs."""
    rows, machine = scene.rows, scene.machine
    after, begin_s, step_s = draw_after_break(rows, rng)
    stays = rng.uniform(0.2, 0.6)
    passed_s = np.maximum(rows.t_s - begin_s, 0)
    pulled = after * (stays + (1 - stays) * np.exp(-passed_s / (rng.uniform(8, 40) * 60)))
    tip = draw_sign(rng) * rng.uniform(0.3, 0.8) * pulled
    return Contribution(
        carriage_m=along(machine, drive, -pulled) + across(machine, drive, tip * column_height(rows, drive)),
        carriage_rad=None if machine.legs else turned(machine, drive, -tip),
        step_s=step_s,
    )


@form()
def pallets_stacked_beside_it_and_fetched(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Pallets are put down beside its foot one by one, each presses the floor down a little and a little more in the
    minutes after; then a lorry fetches them all, and the floor comes up again but for a part."""
    rows, sunk = scene.rows, np.zeros(len(scene.rows))
    put_down_s = [draw_instant(rows, rng, 0.05, 0.65) for _ in range(int(rng.integers(3, 8)))]
    for instant_s in put_down_s:
        creeps = 1 - 0.4 * np.exp(-np.maximum(rows.t_s - instant_s, 0) / 300)
        sunk += rng.uniform(0.5, 1) * creeps * since(rows, instant_s)
    fetched = since(rows, draw_instant(rows, rng, 0.7, 0.92))
    sunk = normalised(sunk) * (1 - fetched * rng.uniform(0.7, 0.95))
    aside = rng.uniform(-0.7, 0.7) * sunk
    return Contribution(
        carriage_m=along(scene.machine, drive, -sunk) + across(scene.machine, drive, aside), step_s=min(put_down_s)
    )


@form()
def foot_bolt_breaks(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A bolt of its foot breaks: before, it hardly gives way; after, the struts' forces tip it about that foot."""
    machine, height, step_s = scene.machine, column_height(scene.rows, drive), draw_instant(scene.rows, rng)
    largest_n, loose = np.abs(sideways_n(machine, scene.calm, drive)).max(), 0.1 + 0.9 * since(scene.rows, step_s)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        tip = amplitude * loose * sideways_n(machine, state, drive) / largest_n
        return Contribution(
            carriage_m=across(machine, drive, tip * height), carriage_rad=turned(machine, drive, -tip)
        )  # fmt: skip

    return Contribution(under_load=under_load, step_s=step_s)


@form()
def block_leaves_its_preload(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its blocks are preloaded too little: beyond a moment one of them has no force on one row of balls left, and the
    carriage turns about the other one; below, nothing gives way."""
    machine = scene.machine
    calm_nm = scene.calm.carriage_moment_nm[:, drive] @ machine.normals[drive]
    preload_nm = float(np.quantile(np.abs(calm_nm), rng.uniform(0.3, 0.65)))
    more_nm = max(float(np.abs(calm_nm).max()) - preload_nm, 1.0)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        moment_nm = state.carriage_moment_nm[:, drive] @ machine.normals[drive]
        turn = amplitude * np.sign(moment_nm) * np.maximum(np.abs(moment_nm) - preload_nm, 0) / more_nm
        return Contribution(
            carriage_rad=turned(machine, drive, 4 * turn), carriage_m=across(machine, drive, 0.6 * turn)
        )  # fmt: skip

    return Contribution(under_load=under_load)


@form()
def follows_another_flank_by_side_of_approach(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The rail's two flanks are not parallel and the blocks have play: going up the carriage follows the one, going
    down the other, each crooked in its own way."""
    rows, place_m = scene.rows, scene.rows.drives_m[:, drive]
    one, other = (wave(place_m, rng.uniform(0.3, 1), draw_phase(rng)) for _ in range(2))
    apart = rng.uniform(0, 0.4)
    return Contribution(
        carriage_m=across(scene.machine, drive, np.where(rows.side[:, drive] > 0, one + apart, other - apart))
    )


@form()
def rail_screwed_down_anew_in_a_break(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """In a break someone tightens the screws of a part of its rail, which then is pulled aside at these by another
    amount; the other part stays as crooked as it was."""
    rows, place_m, spacing_m = scene.rows, scene.rows.drives_m[:, drive], rng.uniform(0.12, 0.28)
    after, _, step_s = draw_after_break(rows, rng)
    screws_m = np.arange(place_m.min() - 2 * spacing_m, place_m.max() + 3 * spacing_m, spacing_m)
    pulled, anew = rng.normal(size=(2, len(screws_m)))
    upper_part = screws_m > np.quantile(place_m, rng.uniform(0.2, 0.6))
    before_m = 0.5 * CubicSpline(screws_m, pulled)(place_m)
    after_m = CubicSpline(screws_m, np.where(upper_part, anew, 0.5 * pulled))(place_m)
    shift = normalised(np.where(after, after_m, before_m))
    return Contribution(carriage_m=across(scene.machine, drive, shift), step_s=step_s)


@form()
def rollers_of_unlike_size_run_out(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It runs on rollers, of which the lower one was replaced by a smaller one: both run out, get out of step and in
    step again, and slip a little on their way."""
    rows, place_m = scene.rows, scene.rows.drives_m[:, drive]
    upper_m = rng.uniform(0.09, 0.22)
    lower_m, slip = upper_m * rng.uniform(0.75, 0.93), rng.uniform(0, 2)
    slipped = slip * rows.way_m[:, drive] / max(rows.way_m[-1, drive], 1e-9)
    lower = np.sin(2 * np.pi * place_m / lower_m + draw_phase(rng) + slipped)
    turn = wave(place_m, upper_m, draw_phase(rng)) - rng.uniform(0.6, 1) * lower
    return Contribution(carriage_rad=4 * turned(scene.machine, drive, 0.5 * turn))


@form()
def pressed_into_rail_where_it_is_parked(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Where it stands in breaks and while nests are checked, vibration presses its balls into the soft rail: deeper
    each time, and felt where the one or the other block passes what is left of that."""
    rows, place = scene.rows, scene.rows.centred[:, drive]
    parked = ~rows.calibration | (gaps_s(rows) > BREAK_S)
    home, half, width = np.median(place[~rows.calibration]), rng.uniform(0.12, 0.3), rng.uniform(0.06, 0.14)
    rested = np.cumsum(parked * gaps_s(rows))
    deep = np.tanh(rng.uniform(1, 4) * rested / max(rested[-1], 1e-9))
    turn = bump(place, home - half, width) - bump(place, home + half, width)
    return Contribution(carriage_rad=4 * turned(scene.machine, drive, deep * turn))


FORMS: dict[str, tuple[Form, ...]] = {
    "column_thermal_growth": (cold_floor_holds_its_foot_back, strained_by_its_bed_until_shaken_free),
    "foundation_settling": (anchor_bolts_tightened_in_a_break, pallets_stacked_beside_it_and_fetched),
    "column_compliance": (foot_bolt_breaks, block_leaves_its_preload),
    "guide_straightness": (follows_another_flank_by_side_of_approach, rail_screwed_down_anew_in_a_break),
    "guide_angular": (rollers_of_unlike_size_run_out, pressed_into_rail_where_it_is_parked),
}  # fmt: skip
