"""Forms of effects of struts, of the eighth archive: heat, softness, play."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import draw_cycles
from benchmarks.other_simulator.forms.shapes import normalised
from benchmarks.other_simulator.forms.struts import GROWTH_M, YIELDING, YIELDING_WITH_LOAD, lengthened
from benchmarks.other_simulator.forms.traces import draw_stretches, following
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator


@form(GROWTH_M)
def radiant_heater_above_as_well(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """A radiant heater under the roof shines on it whenever the hall's thermostat calls; its sensor is in the shade."""
    return Contribution(strut_m=draw_cycles(scene.rows, (25, 70), (8, 20), rng))


@form(GROWTH_M)
def blown_cold_by_nozzle(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Compressed air blows on it at times: it cools within minutes, and is slow to warm again in still air."""
    blown = draw_stretches(scene.rows, (2, 5), (0.06, 0.2), rng)
    tau_s = np.where(blown > 0, rng.uniform(3, 7), rng.uniform(18, 40)) * 60
    return Contribution(strut_m=-normalised(following(scene.rows.t_s, blown, tau_s)))


@form(YIELDING_WITH_LOAD)
def lifts_off_beyond_preload(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Its bearings are preloaded too little: beyond the preload one row is idle, and the other one gives way alone."""
    stiffness, force_n = scene.stiffness_n_per_m[strut], np.abs(scene.calm.tension_n[:, strut])
    preload_n = float(np.quantile(force_n, rng.uniform(0.15, 0.5)))

    def law(tension: Array, amplitude: float) -> Array:
        beyond_n = np.maximum(np.abs(tension) - preload_n, 0)
        return np.asarray(amplitude * 0.2 * np.sign(tension) * beyond_n / stiffness)

    return lengthened(strut, law)


@form(YIELDING)
def glued_ends_creep(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The glue between its tube and its ends gives way: a part at once, more within minutes, and back as slowly."""
    stiffness, t_s = scene.stiffness_n_per_m[strut], scene.rows.t_s
    tau_s, at_once = rng.uniform(1.5, 8) * 60, rng.uniform(0.25, 0.5)

    def law(tension: Array, amplitude: float) -> Array:
        felt_n = at_once * tension + (1 - at_once) * lagging(t_s, tension, tau_s)
        return np.asarray(amplitude * 0.2 * felt_n / stiffness)

    return lengthened(strut, law)


@form()
def oval_bore(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """A bore that is worn oval: much play at some angles of the strut, little at others."""
    direction = scene.calm.directions[:, strut]
    upright = direction @ scene.machine.up
    inclined = (upright - upright.min()) / (upright.max() - upright.min())
    turn = np.pi * (inclined - rng.uniform(0.1, 0.9)) * rng.uniform(0.8, 1.2)
    width, even_n = 0.15 + 0.85 * np.cos(turn) ** 2, rng.uniform(20, 80)
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.5 * width * np.tanh(tension / even_n))


@form()
def sinks_through_grease(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Play that is full of stiff grease: moves part its faces, and the force needs seconds to bring them together."""
    rows, even_n = scene.rows, rng.uniform(30, 120)
    pressed = 1 - 0.9 * np.exp(-rows.dwell_s / rng.uniform(2, 6))
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.5 * pressed * np.tanh(tension / even_n))


FORMS: dict[str, tuple[Form, ...]] = {
    "link_thermal_growth": (radiant_heater_above_as_well, blown_cold_by_nozzle),
    "link_stiffness": (lifts_off_beyond_preload, glued_ends_creep),
    "joint_clearance": (oval_bore, sinks_through_grease),
}
