"""Forms of the fourth archive of what carries the platform: struts, columns, guides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import columns, struts
from benchmarks.other_simulator.forms.columns import sideways_n
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_mountings, of_former_visit
from benchmarks.other_simulator.forms.memory import dragged, since_change_s
from benchmarks.other_simulator.forms.shapes import (
    across,
    along,
    bump,
    column_height,
    draw_instant,
    draw_sign,
    logistic,
    normalised,
    since,
    turned,
)
from benchmarks.other_simulator.forms.struts import lengthened
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Equilibrium

Array = NDArray[np.float64]
Generator = np.random.Generator


@form(struts.GROWTH_M)
def payload_comes_from_cold_store(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Each payload comes from a cold store: the cold reaches the strut some minutes after it is mounted, and goes."""
    rows, (mounting, _) = scene.rows, draw_mountings(scene.rows, rng)
    mounted = (mounting > 0) & (rows.payload > 0 if rows.payload.max() > 0 else True)
    share = since_change_s(rows, mounting) / (rng.uniform(6, 18) * 60)
    return Contribution(strut_m=-share * np.exp(1 - share) * mounted)


@form(struts.GROWTH_M)
def radiant_heater_lit_by_someone(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Someone who is cold lights a radiant heater: a strut takes up the more of it the more it stands across it."""
    rows, aside = scene.rows, draw_sign(rng) * rng.uniform(0.5, 1)
    heater = np.array([aside, -np.sqrt(1 - aside**2), 0])
    across_it = 1 - (scene.calm.directions[:, strut] @ heater) ** 2
    lit = since(rows, draw_instant(rows, rng, 0.1, 0.6))
    return Contribution(strut_m=normalised(lagging(rows.t_s, lit * across_it, rng.uniform(3, 10) * 60)))


@form(struts.YIELDING)
def gives_way_once_preload_is_overcome(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Its joints are preloaded: stiff as stated up to that force, and softer for all force above it."""
    stiffness = scene.stiffness_n_per_m[strut]
    preload_n = float(np.quantile(np.abs(scene.calm.tension_n[:, strut]), rng.uniform(0.3, 0.7)))

    def law(tension: Array, amplitude: float) -> Array:
        above_n = np.maximum(np.abs(tension) - preload_n, 0)
        return np.asarray(amplitude * 0.2 * np.sign(tension) * above_n / stiffness)

    return lengthened(strut, law)


@form(struts.SOFTENING)
def rubber_stiffer_in_the_cold(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Its bushing of rubber is soft when it is warm and stiff when it is cold."""
    warmth = scene.weather.lagging_air_c(rng.uniform(8, 30))
    return Contribution(ln_stiffness=-(warmth - warmth.min()) / max(float(np.ptp(warmth)), 1e-9))


@form()
def nut_of_pin_comes_off(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The nut that keeps its pin comes off: hardly any play before, all of it after."""
    rows, even_n = scene.rows, rng.uniform(20, 80)
    step_s = draw_instant(rows, rng)
    width = 0.1 + 0.9 * since(rows, step_s)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        return Contribution(strut_m=amplitude * 0.5 * width * np.tanh(state.tension_n[:, strut] / even_n))

    return Contribution(under_load=under_load, step_s=step_s)


@form()
def pressed_through_its_grease(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Grease fills the play: where the force has turned, the pin is at first where it lay, and sinks over at rest."""
    rows, even_n = scene.rows, rng.uniform(20, 80)
    left = np.exp(-rows.dwell_s / rng.uniform(4, 20))

    def law(tension: Array, amplitude: float) -> Array:
        lies = np.tanh(tension / even_n)
        return np.asarray(amplitude * 0.5 * (lies + (of_former_visit(rows, lies) - lies) * left))

    return lengthened(strut, law)


@form(columns.GROWTH_M)
def cabinet_on_its_back(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The cabinet with the amplifiers of all drives hangs on its back, and warms that side as they work."""
    machine, height, tau_min = scene.machine, column_height(scene.rows, drive), rng.uniform(15, 50)
    each = [scene.rows.warmth_of_motion(one, tau_min) for one in range(len(machine.drives))]
    warmth = normalised(np.sum(each, 0))
    return Contribution(
        carriage_m=across(machine, drive, -warmth * height**2) + along(machine, drive, 0.4 * warmth * height),
        carriage_rad=turned(machine, drive, 2 * warmth * height),
    )


@form(columns.GROWTH_M)
def rail_ahead_of_column_bends_it(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its rail is warmed by the blocks and its body much later: both bend like two metals, back after some rest."""
    machine, rows = scene.machine, scene.rows
    rail = rows.warmth_of_motion(drive, rng.uniform(4, 10))
    ahead = normalised(rail - 1.2 * rows.warmth_of_motion(drive, rng.uniform(50, 120)))
    place, half_m = rows.centred[:, drive], float(np.ptp(rows.commanded_m[:, drive])) / 2
    return Contribution(
        carriage_m=across(machine, drive, ahead * place**2),
        carriage_rad=turned(machine, drive, -2 * ahead * place / half_m),
    )


@form()
def fork_lift_at_each_change(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The fork lift that brings a payload presses its foot down, each time by less than the time before."""
    mounting, first_s = draw_mountings(scene.rows, rng)
    sinks = np.r_[0, rng.uniform(0.5, 1, mounting.max()) * rng.uniform(0.5, 0.9) ** np.arange(mounting.max())]
    sunk = normalised(np.cumsum(sinks))[mounting]
    return Contribution(
        carriage_m=along(scene.machine, drive, -sunk) + across(scene.machine, drive, 0.4 * draw_sign(rng) * sunk),
        step_s=first_s,
    )


@form()
def air_mount_leaks_and_is_refilled(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It stands on an air mount that leaks: it sinks, steadily, until its valve opens and lifts it within seconds."""
    leaked = (scene.rows.hours * 60 / rng.uniform(14, 50) + rng.uniform(0, 1)) % 1
    aside = rng.uniform(-0.4, 0.4) * leaked
    return Contribution(
        carriage_m=along(scene.machine, drive, -leaked) + across(scene.machine, drive, aside)
    )  # fmt: skip


@form()
def rail_on_its_two_ends(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Its rail lies on its two ends only, and gives way as a beam does: most in the middle, where it does not turn."""
    machine, rows, margin = scene.machine, scene.rows, rng.uniform(0.02, 0.15)
    x = margin + (1 - 2 * margin) * rows.raised[:, drive]
    length_m = float(np.ptp(rows.commanded_m[:, drive])) / (1 - 2 * margin)
    sag, slope = 16 * x**2 * (1 - x) ** 2, 32 * x * (1 - x) * (1 - 2 * x) / length_m
    largest_n = np.abs(sideways_n(machine, scene.calm, drive)).max()

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        force = amplitude * sideways_n(machine, state, drive) / largest_n
        return Contribution(
            carriage_m=across(machine, drive, force * sag), carriage_rad=turned(machine, drive, -force * slope)
        )  # fmt: skip

    return Contribution(under_load=under_load)


@form()
def joint_of_foot_holds_former_bend(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Friction in its bolted foot holds it as former forces have bent it, until the force has changed by enough."""
    machine, height = scene.machine, column_height(scene.rows, drive)
    calm_n = sideways_n(machine, scene.calm, drive)
    needed_n, largest_n = rng.uniform(0.4, 1.0) * calm_n.std(), np.abs(calm_n).max()

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        tip = amplitude * dragged(sideways_n(machine, state, drive), needed_n) / largest_n
        return Contribution(
            carriage_m=across(machine, drive, tip * height), carriage_rad=turned(machine, drive, -tip)
        )  # fmt: skip

    return Contribution(under_load=under_load)


@form()
def rails_meet_at_an_angle(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Two rails, each of them straight, that were set up at an angle to one another."""
    return Contribution(
        carriage_m=across(
            scene.machine, drive, np.abs(scene.rows.centred[:, drive] - rng.uniform(-0.5, 0.5))
        )
    )  # fmt: skip


@form()
def worn_deeper_by_each_pass(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A soft rail wears where a bad block runs over one stretch: each way over it makes that stretch deeper."""
    rows = scene.rows
    stretch = bump(rows.centred[:, drive], rng.uniform(-0.5, 0.5), rng.uniform(0.25, 0.5))
    worn = np.cumsum(stretch * np.diff(rows.way_m[:, drive], prepend=rows.way_m[0, drive]))
    return Contribution(carriage_m=across(scene.machine, drive, stretch * worn / max(worn[-1], 1e-9)))


@form()
def straddles_joint_of_rails(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """While one of its blocks is on the next rail, which is set aside, and the other not yet, it stands askew."""
    place, middle, half = scene.rows.centred[:, drive], rng.uniform(-0.4, 0.4), rng.uniform(0.15, 0.35)
    steep = rng.uniform(0.015, 0.04)
    askew = logistic((place - middle + half) / steep) - logistic((place - middle - half) / steep)
    return Contribution(carriage_rad=4 * turned(scene.machine, drive, askew))


@form()
def floats_on_its_oil_by_speed_and_side(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A plain guide that floats on its oil: its leading edge rises with speed, and sinks back while it rests."""
    rows = scene.rows
    floats = np.sqrt(np.minimum(rows.speed_m_per_s, 0.3) / 0.1) * np.exp(-rows.dwell_s / rng.uniform(5, 20))
    return Contribution(carriage_rad=4 * turned(scene.machine, drive, rows.side[:, drive] * (0.15 + floats)))


FORMS: dict[str, tuple[Form, ...]] = {
    "link_thermal_growth": (payload_comes_from_cold_store, radiant_heater_lit_by_someone),
    "link_stiffness": (gives_way_once_preload_is_overcome, rubber_stiffer_in_the_cold),
    "joint_clearance": (nut_of_pin_comes_off, pressed_through_its_grease),
    "column_thermal_growth": (cabinet_on_its_back, rail_ahead_of_column_bends_it),
    "foundation_settling": (fork_lift_at_each_change, air_mount_leaks_and_is_refilled),
    "column_compliance": (rail_on_its_two_ends, joint_of_foot_holds_former_bend),
    "guide_straightness": (rails_meet_at_an_angle, worn_deeper_by_each_pass),
    "guide_angular": (straddles_joint_of_rails, floats_on_its_oil_by_speed_and_side),
}  # fmt: skip
