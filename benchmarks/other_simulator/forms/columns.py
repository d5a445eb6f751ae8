"""Forms of effects of the columns that carry drives: heat, settling, giving way under the struts' forces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.shapes import (
    across,
    along,
    column_height,
    draw_instant,
    logistic,
    normalised,
    since,
    turned,
    warming_up,
    within,
)
from benchmarks.other_simulator.machine import Machine
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Equilibrium

Array = NDArray[np.float64]
Generator = np.random.Generator

GROWTH_M = 1e-4


@form(GROWTH_M)
def grows_lagging(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It follows its sensor late, and the air besides."""
    rows, machine, air = scene.rows, scene.machine, scene.weather.air_c
    shown = scene.weather.part_c["drives"]
    late = lagging(rows.t_s, shown, rng.uniform(40, 120) * 60)
    warmth = normalised(late - shown + 0.3 * (air - air.mean()))
    return Contribution(carriage_m=along(machine, drive, warmth * column_height(rows, drive)))


@form(GROWTH_M)
def bends_by_one_sided_air(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """One side of it follows the air sooner than the other."""
    warmth = normalised(scene.weather.lagging_air_c(25) - scene.weather.lagging_air_c(90))
    height = column_height(scene.rows, drive)
    return Contribution(
        carriage_m=across(scene.machine, drive, warmth * height**2),
        carriage_rad=turned(scene.machine, drive, -2 * warmth * height),
    )


@form(GROWTH_M)
def motor_heats_head(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The motor warms its head."""
    warmth = scene.rows.warmth_of_motion(drive, rng.uniform(30, 80))
    bent = 0.5 * warmth * column_height(scene.rows, drive)
    return Contribution(carriage_m=along(scene.machine, drive, warmth) + across(scene.machine, drive, bent))


@form(GROWTH_M)
def warm_up_lift(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It warms up as the day begins."""
    lift = warming_up(scene.rows, rng.uniform(0.5, 2)) * (0.5 + 0.5 * column_height(scene.rows, drive))
    return Contribution(carriage_m=along(scene.machine, drive, lift))


@form(GROWTH_M)
def sun_on_one_side(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The sun shines on one side of it for a while."""
    begin = rng.uniform(0.1, 0.5)
    shining = within(scene.rows, begin, begin + rng.uniform(0.2, 0.4))
    warmth = normalised(lagging(scene.rows.t_s, shining, 1500.0))
    height = column_height(scene.rows, drive)
    return Contribution(
        carriage_m=across(scene.machine, drive, warmth * height**2)
        + along(scene.machine, drive, 0.3 * warmth * height)
    )  # fmt: skip


@form()
def sudden_sink(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The foot sinks at once."""
    step_s = draw_instant(scene.rows, rng)
    return Contribution(carriage_m=along(scene.machine, drive, -since(scene.rows, step_s)), step_s=step_s)


@form()
def creep_after_loading(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The foot creeps to its place."""
    sink = -warming_up(scene.rows, rng.uniform(0.3, 1.5))
    shift = rng.uniform(-0.5, 0.5) * scene.rows.elapsed
    return Contribution(carriage_m=along(scene.machine, drive, sink) + across(scene.machine, drive, shift))


@form()
def log_of_time(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The foot sinks by the logarithm of time."""
    hours = scene.rows.hours
    sink = -np.log1p(hours / 0.1) / np.log1p(hours[-1] / 0.1)
    return Contribution(carriage_m=along(scene.machine, drive, sink))


@form()
def foot_tips(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The foot tips over; a leg's only shifts."""
    rows, machine = scene.rows, scene.machine
    tip = logistic((rows.elapsed - rng.uniform(0.3, 0.7)) / rng.uniform(0.03, 0.15))
    return Contribution(
        carriage_m=across(machine, drive, tip * column_height(rows, drive)),
        carriage_rad=None if machine.legs else turned(machine, drive, -tip),
    )


@form()
def shifts_sideways_at_a_blow(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The foot is knocked aside."""
    step_s = draw_instant(scene.rows, rng)
    shift = since(scene.rows, step_s)
    return Contribution(
        carriage_m=across(scene.machine, drive, shift) - along(scene.machine, drive, 0.3 * shift), step_s=step_s
    )


def sideways_n(machine: Machine, state: Equilibrium, drive: int) -> Array:
    """What the struts press on a carriage across its slide, in the plane (r,)."""
    return state.carriage_force_n[:, drive] @ machine.sideways[drive]


def _along_n(machine: Machine, state: Equilibrium, drive: int) -> Array:
    return state.carriage_force_n[:, drive] @ machine.axes[drive]


def _turning_nm(machine: Machine, state: Equilibrium, drive: int) -> Array:
    return state.carriage_moment_nm[:, drive] @ machine.normals[drive]


@form()
def cantilever(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It bends like a beam that is clamped at its foot."""
    machine, height = scene.machine, column_height(scene.rows, drive)
    largest_n = np.abs(sideways_n(machine, scene.calm, drive)).max()

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        force = sideways_n(machine, state, drive)
        return Contribution(
            carriage_m=across(machine, drive, amplitude * force / largest_n * height**3),
            carriage_rad=turned(machine, drive, -1.5 * amplitude * force / largest_n * height**2),
        )

    return Contribution(under_load=under_load)


@form()
def carriage_sideways(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The carriage gives way sideways."""
    machine = scene.machine
    largest_n = np.abs(sideways_n(machine, scene.calm, drive)).max()
    return Contribution(
        under_load=lambda state, amplitude: Contribution(
            carriage_m=across(machine, drive, amplitude * sideways_n(machine, state, drive) / largest_n)
        )
    )


@form()
def carriage_pitches_on_its_blocks(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """The carriage pitches, and gives way sideways."""
    machine = scene.machine
    largest_nm = max(np.abs(_turning_nm(machine, scene.calm, drive)).max(), 1)
    largest_n = np.abs(sideways_n(machine, scene.calm, drive)).max()

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        pitch = 4 * amplitude * _turning_nm(machine, state, drive) / largest_nm
        shift = 0.5 * amplitude * sideways_n(machine, state, drive) / largest_n
        return Contribution(
            carriage_rad=turned(machine, drive, pitch), carriage_m=across(machine, drive, shift)
        )  # fmt: skip

    return Contribution(under_load=under_load)


@form()
def all_ways_nonlinear(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It gives way along and across, as contacts do: less with each newton."""
    machine = scene.machine
    largest_n = np.abs(scene.calm.carriage_force_n[:, drive]).max()

    def contact(force_n: Array) -> Array:
        return np.sign(force_n) * (np.abs(force_n) / largest_n) ** (2 / 3)

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        shift = amplitude * contact(sideways_n(machine, state, drive))
        sink = 0.6 * amplitude * contact(_along_n(machine, state, drive))
        return Contribution(carriage_m=across(machine, drive, shift) + along(machine, drive, sink))

    return Contribution(under_load=under_load)


@form()
def frame_sags_axially(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """It gives way along the slide, the more the higher the carriage stands."""
    machine, raised = scene.machine, scene.rows.raised[:, drive]
    largest_n = np.abs(_along_n(machine, scene.calm, drive)).max()
    return Contribution(
        under_load=lambda state, amplitude: Contribution(
            carriage_m=along(
                machine, drive, amplitude * _along_n(machine, state, drive) / largest_n * (0.6 + 0.4 * raised)
            )
        )
    )


FORMS: dict[str, tuple[Form, ...]] = {
    "column_thermal_growth": (
        grows_lagging, bends_by_one_sided_air, motor_heats_head, warm_up_lift, sun_on_one_side,
    ),
    "foundation_settling": (
        sudden_sink, creep_after_loading, log_of_time, foot_tips, shifts_sideways_at_a_blow,
    ),
    "column_compliance": (
        cantilever, carriage_sideways, carriage_pitches_on_its_blocks, all_ways_nonlinear, frame_sags_axially,
    ),
}  # fmt: skip
