"""Forms of effects of struts, of the seventh archive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_cycles
from benchmarks.other_simulator.forms.shapes import normalised
from benchmarks.other_simulator.forms.struts import GROWTH_M, YIELDING, lengthened
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

SOFTENING_BEYOND = 5.0  # of the logarithm of the stiffness that stretch over force gives, far beyond the preload
CYCLE_MIN, STRUT_TAU_MIN = (15.0, 50.0), (4.0, 12.0)


@form(GROWTH_M)
def cabinet_exhaust_blows_on_it(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Warm air from the control cabinet, whose fan goes on and off, blows on the strut."""
    return Contribution(strut_m=draw_cycles(scene.rows, CYCLE_MIN, STRUT_TAU_MIN, rng))


@form(GROWTH_M)
def radiant_heater_above(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """A radiant heater above that was switched on warms the strut, the more the flatter it lies."""
    machine, rows = scene.machine, scene.rows
    flat = 1 - (scene.calm.directions[:, strut] @ machine.up) ** 2
    shining = (rows.elapsed > rng.uniform(0.05, 0.4)).astype(float)
    warmth = lagging(rows.t_s, shining * flat / flat.max(), rng.uniform(8, 25) * 60)
    return Contribution(strut_m=normalised(warmth))


@form(SOFTENING_BEYOND)
def preload_overcome(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The strut's joints are clamped between springs, and give once the force exceeds the springs' preload."""
    force_n = np.abs(scene.calm.tension_n[:, strut])
    preload_n = np.quantile(force_n, rng.uniform(0.05, 0.5))
    return Contribution(ln_stiffness=-np.maximum(1 - preload_n / np.maximum(force_n, 1), 0))


@form(YIELDING)
def plastic_insert_creeps(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """A plastic insert at the strut's end gives slowly, so that its stretch is that of the forces just before."""
    t_s, stiffness, tau_s = scene.rows.t_s, scene.stiffness_n_per_m[strut], rng.uniform(20, 150)
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.2 * lagging(t_s, tension, tau_s) / stiffness)


@form()
def lies_by_chance_when_unloaded(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The pin lies on the side of the force, but anywhere in its play, by its friction, where the force is small."""
    visits = scene.rows.visit
    even_n = rng.uniform(0.3, 1.2) * float(np.median(np.abs(scene.calm.tension_n[:, strut])))
    chance = rng.uniform(-1, 1, visits.max() + 1)[visits]

    def law(tension: Array, amplitude: float) -> Array:
        pressed = np.tanh(tension / even_n)
        return np.asarray(amplitude * 0.5 * (pressed + (1 - np.abs(pressed)) * chance))

    return lengthened(strut, law)


@form()
def grease_squeezed_out_at_rest(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Motion drags grease into the play, and the force squeezes it out again at rest."""
    even_n, tau_s = rng.uniform(20, 100), rng.uniform(2, 7)
    pressed_out = 1 - 0.8 * np.exp(-scene.rows.dwell_s / tau_s)
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.5 * pressed_out * np.tanh(tension / even_n))


FORMS: dict[str, tuple[Form, ...]] = {
    "link_thermal_growth": (cabinet_exhaust_blows_on_it, radiant_heater_above),
    "link_stiffness": (preload_overcome, plastic_insert_creeps),
    "joint_clearance": (lies_by_chance_when_unloaded, grease_squeezed_out_at_rest),
}
