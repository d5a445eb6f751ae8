"""Forms of effects of columns, foundation and guides, of the tenth archive."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.columns import GROWTH_M, sideways_n
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.memory import dragged
from benchmarks.other_simulator.forms.screws import draw_lead
from benchmarks.other_simulator.forms.shapes import (
    across,
    along,
    column_height,
    draw_phase,
    draw_sign,
    load_share,
    normalised,
    turned,
    wave,
)
from benchmarks.other_simulator.rows import Rows
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Equilibrium

Array = NDArray[np.float64]
Generator = np.random.Generator


def _fading(rows: Rows, amounts: Array, tau_s: float) -> Array:
    """Sum (r,) of what each reading brings, of which each fades with a time constant."""
    out = np.zeros(len(rows))
    for k in range(1, len(rows)):
        out[k] = out[k - 1] * np.exp(-(rows.t_s[k] - rows.t_s[k - 1]) / tau_s) + amounts[k]
    return out


@form(GROWTH_M)
def gas_of_balancer_inside_it(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The balancing cylinder stands inside the hollow column: its gas gets hot as the carriage goes down and presses it
    together, and cold as it goes up, and the wall takes that over within minutes."""
    rows, raised = scene.rows, scene.rows.raised[:, drive]
    gas = _fading(rows, -np.diff(raised, prepend=raised[0]), rng.uniform(3, 10) * 60)
    warmth = normalised(lagging(rows.t_s, gas, rng.uniform(4, 15) * 60))
    return Contribution(carriage_m=along(scene.machine, drive, warmth * column_height(rows, drive)))


@form(GROWTH_M)
def braking_resistor_on_its_flank(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The resistor that takes up what the drive gives back is screwed to its flank at half height: each way down with
    a load heats it, and the column bends there and grows; ways up make no heat."""
    rows, machine = scene.rows, scene.machine
    sinks = np.maximum(-np.diff(rows.raised[:, drive], prepend=rows.raised[0, drive]), 0)
    heat = _fading(rows, sinks * np.abs(load_share(scene, drive)), rng.uniform(8, 25) * 60)
    warmth, side = normalised(lagging(rows.t_s, heat, rng.uniform(3, 10) * 60)), draw_sign(rng)
    above = np.maximum(column_height(rows, drive) - rng.uniform(0.6, 0.9), 0)
    return Contribution(
        carriage_m=across(machine, drive, 1.5 * side * warmth * above) + along(machine, drive, 0.6 * warmth),
        carriage_rad=turned(machine, drive, -1.5 * side * warmth),
    )


@form()
def tank_beside_it_filled_and_emptied(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """On the same slab stands a tank that is filled steadily, stays full and is emptied faster than it was filled: the
    foot next to it sinks and leans over to it with the weight, and soft soil is late by some minutes."""
    rows, machine = scene.rows, scene.machine
    begins = rng.uniform(0.0, 0.3)
    full, drained = begins + rng.uniform(0.15, 0.35), begins + rng.uniform(0.45, 0.7)
    level = np.interp(rows.elapsed, [begins, full, drained, drained + rng.uniform(0.05, 0.15)], [0, 1, 1, 0])
    sunk = lagging(rows.t_s, level, rng.uniform(2, 20) * 60)
    lean = draw_sign(rng) * rng.uniform(0.4, 1) * sunk
    return Contribution(
        carriage_m=along(machine, drive, -sunk) + across(machine, drive, lean * column_height(rows, drive)),
        carriage_rad=turned(machine, drive, -lean),
    )


@form()
def hydraulic_jack_left_below_it(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The jack by which its foot was levelled is still below it with its valve closed: the oil in it expands with the
    air's warmth by far more than steel, and what seeps past its piston goes with the weight on it."""
    rows, machine, weather = scene.rows, scene.machine, scene.weather
    oil_c = weather.lagging_air_c(rng.uniform(15, 60))
    pressed = 1 + rows.payload_kg / machine.moving_mass_kg
    seeped = np.cumsum(pressed * np.diff(rows.t_s, prepend=rows.t_s[0]))
    lift = normalised(oil_c - oil_c[0]) - rng.uniform(0.1, 0.7) * seeped / seeped[-1]
    aside = rng.uniform(-0.5, 0.5) * lift
    return Contribution(carriage_m=along(machine, drive, lift) + across(machine, drive, aside))


@form()
def oil_film_softer_as_it_warms(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its carriage floats between two films of oil fed through orifices: as the oil warms up by motion it escapes more
    easily, the pockets lose pressure, and the same force presses the carriage further aside."""
    rows, machine = scene.rows, scene.machine
    soft = rng.uniform(0.1, 0.35) + rows.warmth_of_motion(drive, rng.uniform(8, 35))
    largest_n = max(float(np.abs(sideways_n(machine, scene.calm, drive) * soft).max()), 1e-6)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        pressed = amplitude * sideways_n(machine, state, drive) * soft / largest_n
        return Contribution(carriage_m=across(machine, drive, pressed))

    return Contribution(under_load=under_load)


@form()
def head_comes_to_lie_on_gallery(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A gallery stands a fraction of a millimetre beside its head: it bends freely until the head lies on that, and
    from there on only by what gallery and column give way together."""
    machine, height = scene.machine, column_height(scene.rows, drive)
    calm = sideways_n(machine, scene.calm, drive) * height**2
    middle = float(np.median(calm))
    spread, side = max(float(np.abs(calm - middle).max()), 1e-6), draw_sign(rng)
    gap, behind = rng.uniform(-0.2, 0.3), rng.uniform(0.0, 0.2)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        free = side * (sideways_n(machine, state, drive) * height**2 - middle) / spread
        bent = side * amplitude * np.where(free > gap, gap + behind * (free - gap), free)
        return Contribution(
            carriage_m=across(machine, drive, bent), carriage_rad=turned(machine, drive, -1.5 * bent / height)
        )

    return Contribution(under_load=under_load)


@form()
def ground_with_wheel_that_wore(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It was ground in a few strokes: in each the wheel wore, so that the guide rises to its end, and was dressed
    before the next one, which begins low again; the edges between them are blended by a few centimetres."""
    place, strokes = scene.rows.centred[:, drive], int(rng.integers(2, 5))
    edges = np.linspace(-1.05, 1.05, strokes + 1) + np.r_[0, rng.uniform(-0.15, 0.15, strokes - 1), 0]
    height = np.zeros(len(place))
    for low, high in pairwise(edges):
        share = (place - low) / (high - low)
        blended = np.clip(share / 0.06, 0, 1) * np.clip((1 - share) / 0.06, 0, 1)
        height += rng.uniform(0.6, 1) * np.clip(share, 0, 1) ** rng.uniform(0.7, 1.4) * blended
    line = np.polyval(np.polyfit(place, height, 1), place)
    return Contribution(carriage_m=across(scene.machine, drive, draw_sign(rng) * normalised(height - line)))


@form()
def rail_buckles_from_screw_to_screw_when_warm(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The blocks warm the rail, which cannot become longer than its cold bed: between its screws it goes aside, in each
    field to the other side, as the root of what it is too long by; cold it is nearly straight."""
    rows = scene.rows
    warm = np.sqrt(np.maximum(rows.warmth_of_motion(drive, rng.uniform(8, 30)), 0))
    field_m = rng.uniform(0.12, 0.3)
    aside = wave(rows.drives_m[:, drive], 2 * field_m, draw_phase(rng)) * (rng.uniform(0.05, 0.25) + warm)
    return Contribution(carriage_m=across(scene.machine, drive, normalised(aside)))


@form()
def bent_screw_tilts_it_each_turn(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A bent screw holds its nut stiffly near its bearings: there it tilts the carriage to and fro in each turn, and
    only swings along with it midway, where it gives way."""
    place, lead_m = scene.rows.centred[:, drive], draw_lead(scene, drive, rng)
    stiff = rng.uniform(0.2, 0.4) + np.abs(place - rng.uniform(-0.3, 0.3)) ** 1.5
    angle = normalised(stiff * wave(scene.rows.drives_m[:, drive], lead_m, draw_phase(rng)))
    return Contribution(carriage_rad=4 * turned(scene.machine, drive, angle), period_m=lead_m)


@form()
def heavy_cover_draws_its_nose_round(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A heavy apron beside the guide hangs on its nose and sticks: after each reversal the carriage turns on with its
    way until the apron slides, and then stays turned until it goes back."""
    rows = scene.rows
    place_m, half_m = rows.commanded_m[:, drive], rng.uniform(0.06, 0.25)
    drawn = (place_m - dragged(place_m, half_m)) / half_m
    heavier = 1 + rng.uniform(-0.4, 0.4) * rows.centred[:, drive]
    return Contribution(carriage_rad=4 * draw_sign(rng) * turned(scene.machine, drive, drawn * heavier))


FORMS: dict[str, tuple[Form, ...]] = {
    "column_thermal_growth": (gas_of_balancer_inside_it, braking_resistor_on_its_flank),
    "foundation_settling": (tank_beside_it_filled_and_emptied, hydraulic_jack_left_below_it),
    "column_compliance": (oil_film_softer_as_it_warms, head_comes_to_lie_on_gallery),
    "guide_straightness": (ground_with_wheel_that_wore, rail_buckles_from_screw_to_screw_when_warm),
    "guide_angular": (bent_screw_tilts_it_each_turn, heavy_cover_draws_its_nose_round),
}
