"""Forms of the third archive of what carries the platform: struts, columns, guides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import columns, struts
from benchmarks.other_simulator.forms.columns import sideways_n
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_cycles, new_visit
from benchmarks.other_simulator.forms.shapes import across, along, bump, column_height, draw_phase, normalised, turned
from benchmarks.other_simulator.forms.struts import lengthened
from benchmarks.other_simulator.machine import Machine
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Equilibrium

Array = NDArray[np.float64]
Generator = np.random.Generator


@form(struts.GROWTH_M)
def air_conditioner_blows_on_it(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """An air conditioner that its thermostat switches blows on it, and not on its sensor."""
    return Contribution(strut_m=-draw_cycles(scene.rows, (12, 35), (3, 8), rng))


@form(struts.GROWTH_M)
def warmer_the_higher_it_hangs(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The air is warmer above: a thin tube follows the air at the height at which it has been in the last minutes."""
    machine, state = scene.machine, scene.calm
    joint = state.positions_m + state.rotations @ machine.nominal.platform_joint_m[strut]
    middle = joint - state.directions[:, strut] * machine.nominal.strut_length_m[strut] / 2
    warmth = lagging(scene.rows.t_s, middle @ machine.up, rng.uniform(3, 9) * 60)
    return Contribution(strut_m=normalised(warmth - warmth.mean()))


@form(struts.SOFTENING)
def bolts_work_loose_by_motion(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Its bolts work loose by motion, once that has been enough to overcome their preload."""
    way_m = scene.rows.way_m[:, int(scene.machine.drive_of_strut[strut])]
    share = way_m / max(way_m[-1], 1e-9)
    holds = rng.uniform(0.1, 0.4)
    return Contribution(ln_stiffness=-np.maximum(share - holds, 0) / (1 - holds))


@form(struts.YIELDING)
def bushing_gives_way_slowly(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """A bushing of plastic gives way to its force little by little, and comes back so: it shows former forces."""
    stiffness, t_s = scene.stiffness_n_per_m[strut], scene.rows.t_s
    tau_s = float(np.exp(rng.uniform(np.log(60), np.log(900))))
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.2 / stiffness * lagging(t_s, tension, tau_s))


@form()
def worn_at_some_angles(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """A pin that has worn its bore where it works most: the play is there at some angles of the strut only."""
    even_n = rng.uniform(20, 60)
    upright = scene.calm.directions[:, strut] @ scene.machine.up
    angle = normalised(upright - (upright.max() + upright.min()) / 2)
    width = 0.1 + 0.9 * bump(angle, rng.uniform(-0.6, 0.6), rng.uniform(0.3, 0.5))
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.5 * width * np.tanh(tension / even_n))


@form()
def lies_where_it_was_until_pressed_over(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """A spring is to close the play, but some forces overcome it; friction holds the joint where it lay before."""
    tension = scene.calm.tension_n[:, strut]
    spring_n, even_n = float(np.median(tension)), rng.uniform(20, 60)
    needed_n, lies = rng.uniform(0.5, 1.2) * tension.std(), np.ones(len(tension))
    for k in range(1, len(tension)):
        over = abs(tension[k] - spring_n) > needed_n
        lies[k] = np.sign(tension[k] - spring_n) if over else lies[k - 1]
    held_n = needed_n * lies - spring_n
    return lengthened(strut, lambda pull, amplitude: amplitude * 0.5 * np.tanh((pull + held_n) / even_n))


@form(columns.GROWTH_M)
def aggregate_warms_its_foot(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A hydraulic unit beside its foot runs now and then: the column leans from its foot on, and rises a little."""
    warmth = draw_cycles(scene.rows, (35, 90), (12, 25), rng)
    return Contribution(
        carriage_m=across(scene.machine, drive, warmth * column_height(scene.rows, drive))
        + along(scene.machine, drive, 0.3 * warmth),
        carriage_rad=turned(scene.machine, drive, -warmth),
    )


@form(columns.GROWTH_M)
def warmer_under_the_roof(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Warm air gathers under the roof: each piece of it grows the more the higher it is, which one sensor misses."""
    warmth = normalised(scene.weather.lagging_air_c(rng.uniform(20, 50)) - scene.weather.part_c["base"])
    return Contribution(carriage_m=along(scene.machine, drive, warmth * column_height(scene.rows, drive) ** 2))


@form()
def sinks_while_it_carries_much(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its shims are pressed together for good: fast while much load is on this foot, hardly at all otherwise."""
    rows, load = scene.rows, np.abs(scene.loads_n[:, drive])
    pressed = np.cumsum((load / load.max()) ** rng.uniform(3, 6) * np.diff(rows.t_s, prepend=rows.t_s[0]))
    pressed = pressed / pressed[-1]
    return Contribution(
        carriage_m=along(scene.machine, drive, -pressed) + across(scene.machine, drive, 0.3 * pressed)
    )  # fmt: skip


@form()
def walks_with_fast_moves(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It stands on levelling feet and walks aside with the jerk of each fast move."""
    rows = scene.rows
    walked = np.cumsum(new_visit(rows) * rows.speed_m_per_s**2)
    walked = walked / max(walked[-1], 1e-12)
    return Contribution(
        carriage_m=across(scene.machine, drive, walked) + along(scene.machine, drive, -0.2 * walked)
    )  # fmt: skip


@form()
def rocks_on_its_foot(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The joint at its foot opens when the struts tip it to one side, and holds better to the other."""
    machine, height = scene.machine, column_height(scene.rows, drive)
    largest_n = np.abs(sideways_n(machine, scene.calm, drive)).max()
    middle_n = float(np.median(sideways_n(machine, scene.calm, drive)))

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        force = sideways_n(machine, state, drive)
        opened = 0.25 * force + 0.75 * np.maximum(force - middle_n, 0)
        return _tips(machine, drive, amplitude * opened / largest_n * height, height)

    return Contribution(under_load=under_load)


@form()
def crossbeam_passes_force_on(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The crossbeam between the heads passes on what bends the other column: it counts how high both carriages are."""
    machine, other = scene.machine, (drive + 1) % len(scene.machine.drives)
    own, others = column_height(scene.rows, drive), column_height(scene.rows, other)
    largest_n = np.abs(sideways_n(machine, scene.calm, other)).max()

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        force = sideways_n(machine, state, other)
        return _tips(machine, drive, 0.7 * amplitude * force / largest_n * others**2, own)

    return Contribution(under_load=under_load)


def _tips(machine: Machine, drive: int, angle: Array, height: Array) -> Contribution:
    """A column that is turned as a whole about its foot, by angles (r,)."""
    return Contribution(
        carriage_m=across(machine, drive, angle * height), carriage_rad=turned(machine, drive, -angle)
    )  # fmt: skip


@form()
def pulled_to_each_screw(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The rail is pulled to a bed that was not scraped: at each screw to another side."""
    place_m, spacing_m = scene.rows.drives_m[:, drive], rng.uniform(0.1, 0.24)
    screws_m = np.arange(place_m.min() - spacing_m, place_m.max() + 2 * spacing_m, spacing_m)
    line = CubicSpline(screws_m, rng.normal(size=len(screws_m)))
    return Contribution(carriage_m=across(scene.machine, drive, normalised(line(place_m))))


@form()
def balls_come_and_go(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The carriage is lifted as each ball comes under load; they slip, so that this moves along as it travels."""
    rows, period_m = scene.rows, rng.uniform(0.01, 0.03)
    slipped = rng.uniform(0.5, 2) * rows.way_m[:, drive] / max(rows.way_m[-1, drive], 1e-9)
    lifted = np.sin(2 * np.pi * (rows.drives_m[:, drive] / period_m + slipped) + draw_phase(rng))
    return Contribution(carriage_m=across(scene.machine, drive, lifted))


@form()
def blocks_pass_dent_in_turn(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its two blocks pass a dent one after the other: it turns one way, then the other."""
    place, middle, half = scene.rows.centred[:, drive], rng.uniform(-0.35, 0.35), rng.uniform(0.18, 0.32)
    width = rng.uniform(0.1, 0.2)
    turn = bump(place, middle - half, width) - bump(place, middle + half, width)
    return Contribution(carriage_rad=4 * turned(scene.machine, drive, turn))


@form()
def skews_by_side_of_motion(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The screw pulls beside the guides: the carriage skews against its motion, most where they are worn."""
    worn = bump(scene.rows.centred[:, drive], rng.uniform(-0.4, 0.4), rng.uniform(0.35, 0.6))
    turn = scene.rows.side[:, drive] * (0.35 + 0.65 * worn)
    return Contribution(carriage_rad=4 * turned(scene.machine, drive, turn))


FORMS: dict[str, tuple[Form, ...]] = {
    "link_thermal_growth": (air_conditioner_blows_on_it, warmer_the_higher_it_hangs),
    "link_stiffness": (bolts_work_loose_by_motion, bushing_gives_way_slowly),
    "joint_clearance": (worn_at_some_angles, lies_where_it_was_until_pressed_over),
    "column_thermal_growth": (aggregate_warms_its_foot, warmer_under_the_roof),
    "foundation_settling": (sinks_while_it_carries_much, walks_with_fast_moves),
    "column_compliance": (rocks_on_its_foot, crossbeam_passes_force_on),
    "guide_straightness": (pulled_to_each_screw, balls_come_and_go),
    "guide_angular": (blocks_pass_dent_in_turn, skews_by_side_of_motion),
}  # fmt: skip
