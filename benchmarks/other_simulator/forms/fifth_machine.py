"""Forms of the fifth archive of what carries the drives: columns and guides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from benchmarks.other_simulator.courses import lagging
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
    logistic,
    normalised,
    since,
    turned,
    wave,
)
from benchmarks.other_simulator.forms.traces import (
    BREAK_S,
    draw_stretches,
    draw_there_for_a_while,
    gaps_s,
    gathered_until,
)
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Equilibrium

Array = NDArray[np.float64]
Generator = np.random.Generator

PIECES = 30  # of a column, each with a warmth of its own


@form(columns.GROWTH_M)
def covers_closed_in_breaks(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its covers are open while somebody measures, and closed in breaks: it warms up behind them, and cools again."""
    rows, machine = scene.rows, scene.machine
    closed = (gaps_s(rows) > BREAK_S).astype(float)
    warmth = normalised(lagging(rows.t_s, closed, rng.uniform(12, 45) * 60))
    height = column_height(rows, drive)
    return Contribution(
        carriage_m=along(machine, drive, warmth * height) + across(machine, drive, 0.5 * warmth * height**2),
        carriage_rad=turned(machine, drive, -warmth * height),
    )


@form(columns.GROWTH_M)
def carriage_warms_it_where_it_stands(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its carriage with the motor warms the front of the piece before which it stands, and leaves that warm: above
    such pieces the column leans back."""
    rows, tau_s = scene.rows, rng.uniform(15, 45) * 60
    pieces = np.linspace(0, 1, PIECES)
    warm, slopes, shifts = np.zeros(PIECES), np.zeros(len(rows)), np.zeros(len(rows))
    for k, (passed_s, place) in enumerate(zip(gaps_s(rows), rows.raised[:, drive], strict=True)):
        left = np.exp(-passed_s / tau_s)
        warm = warm * left + (1 - left) * bump(pieces, place, 0.1)
        lean = np.cumsum(warm) / PIECES
        slopes[k] = np.interp(place, pieces, lean)
        shifts[k] = np.interp(place, pieces, np.cumsum(lean) / PIECES)
    scale = 1 / max(np.abs(shifts).max(), 1e-9)
    length_m = max(float(np.ptp(rows.commanded_m[:, drive])), 1e-3)
    return Contribution(
        carriage_m=across(scene.machine, drive, scale * shifts),
        carriage_rad=turned(scene.machine, drive, -scale * slopes / length_m),
    )


@form()
def levelled_by_someone_in_steps(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Someone turns the screw under its foot while others measure: up, back by a part, up again by less."""
    rows, machine = scene.rows, scene.machine
    begin_s = draw_instant(rows, rng, 0.15, 0.6)
    raised, step, turned_s = np.zeros(len(rows)), 1.0, begin_s
    for _ in range(int(rng.integers(3, 6))):
        raised += step * since(rows, turned_s)
        turned_s += rng.uniform(240, 900)
        step *= -rng.uniform(0.4, 0.9)
    tip = draw_sign(rng) * 0.6 * raised
    return Contribution(
        carriage_m=along(machine, drive, raised) + across(machine, drive, tip * column_height(rows, drive)),
        carriage_rad=None if machine.legs else turned(machine, drive, -tip),
        step_s=begin_s,
    )


@form()
def sinks_while_neighbour_stamps(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A press next door shakes its ground together: it sinks in those hours only, by less with each hundred blows."""
    rows = scene.rows
    stamped = np.cumsum(draw_stretches(rows, (2, 5), (0.06, 0.2), rng) * gaps_s(rows))
    sunk = np.log1p(stamped / rng.uniform(120, 900))
    sunk = sunk / max(sunk[-1], 1e-9)
    aside = rng.uniform(-0.6, 0.6) * sunk
    return Contribution(carriage_m=along(scene.machine, drive, -sunk) + across(scene.machine, drive, aside))


@form()
def weight_before_column_bends_it(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """What the carriage carries along the slide hangs before the column and bends it, the more the higher it is."""
    machine, height = scene.machine, column_height(scene.rows, drive)
    calm_n = scene.calm.carriage_force_n[:, drive] @ machine.axes[drive]
    largest_n, sign = np.abs(calm_n).max(), draw_sign(rng)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        moment = sign * amplitude * (state.carriage_force_n[:, drive] @ machine.axes[drive]) / largest_n
        return Contribution(
            carriage_m=across(machine, drive, moment * height**2),
            carriage_rad=turned(machine, drive, -2 * moment * height),
        )

    return Contribution(under_load=under_load)


@form()
def pad_under_its_foot_creeps(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its foot stands on a pad that gives way at once by a part and creeps for the rest: it shows the forces of the
    last minutes."""
    machine, height, t_s = scene.machine, column_height(scene.rows, drive), scene.rows.t_s
    largest_n = np.abs(sideways_n(machine, scene.calm, drive)).max()
    tau_s, at_once = float(np.exp(rng.uniform(np.log(60), np.log(1200)))), rng.uniform(0.1, 0.4)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        force = sideways_n(machine, state, drive)
        tip = amplitude * (at_once * force + (1 - at_once) * lagging(t_s, force, tau_s)) / largest_n
        return Contribution(
            carriage_m=across(machine, drive, tip * height), carriage_rad=turned(machine, drive, -tip)
        )  # fmt: skip

    return Contribution(under_load=under_load)


@form()
def chip_on_rail_until_wiped_off(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A chip sticks to the rail: the carriage is pushed aside where it runs over that, until somebody wipes it off."""
    there, step_s = draw_there_for_a_while(scene.rows, rng)
    pushed = bump(scene.rows.centred[:, drive], rng.uniform(-0.5, 0.5), rng.uniform(0.08, 0.25))
    return Contribution(carriage_m=across(scene.machine, drive, draw_sign(rng) * there * pushed), step_s=step_s)


@form()
def led_by_either_of_two_rails(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Two rails lead it, each crooked in its own way; the struts press it against the one or against the other."""
    force, place_m = sideways_n(scene.machine, scene.calm, drive), scene.rows.drives_m[:, drive]
    share = logistic((force - np.quantile(force, rng.uniform(0.35, 0.65))) / max(0.15 * force.std(), 1e-9))
    one, other = (wave(place_m, rng.uniform(0.25, 0.8), draw_phase(rng)) for _ in range(2))
    return Contribution(carriage_m=across(scene.machine, drive, share * one + (1 - share) * other))


@form()
def two_blocks_on_pulled_rail(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The rail is pulled to another side at each of its screws, and the two blocks stand on different pieces of it."""
    place_m, spacing_m, half_m = scene.rows.drives_m[:, drive], rng.uniform(0.1, 0.24), rng.uniform(0.06, 0.15)
    screws_m = np.arange(place_m.min() - 2 * spacing_m - half_m, place_m.max() + 3 * spacing_m + half_m, spacing_m)
    line = CubicSpline(screws_m, rng.normal(size=len(screws_m)))
    turn = normalised(line(place_m + half_m) - line(place_m - half_m))
    return Contribution(carriage_rad=4 * turned(scene.machine, drive, turn))


@form()
def cage_creeps_until_end_pushes_it_back(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The cage of its rollers creeps to one side with each way and leaves the carriage askew there; at an end of the
    travel a stop pushes it back."""
    rows, end = scene.rows, rng.uniform(0.75, 0.95)
    at_end = (np.abs(rows.centred[:, drive]) > end) & new_visit(rows)
    ways_m = np.diff(rows.way_m[:, drive], prepend=rows.way_m[0, drive])
    crept = np.tanh(gathered_until(rows, ways_m, np.cumsum(at_end)) / rng.uniform(1, 5))
    turn = draw_sign(rng) * crept * (0.6 + 0.4 * rows.centred[:, drive])
    return Contribution(carriage_rad=4 * turned(scene.machine, drive, turn))


FORMS: dict[str, tuple[Form, ...]] = {
    "column_thermal_growth": (covers_closed_in_breaks, carriage_warms_it_where_it_stands),
    "foundation_settling": (levelled_by_someone_in_steps, sinks_while_neighbour_stamps),
    "column_compliance": (weight_before_column_bends_it, pad_under_its_foot_creeps),
    "guide_straightness": (chip_on_rail_until_wiped_off, led_by_either_of_two_rails),
    "guide_angular": (two_blocks_on_pulled_rail, cage_creeps_until_end_pushes_it_back),
}  # fmt: skip
