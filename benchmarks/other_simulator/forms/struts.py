"""Forms of effects of struts: heat, softness, play."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.shapes import draw_instant, draw_sign, normalised, since, warming_up, within
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

GROWTH_M = 8e-5
SOFTENING, SOFTENING_INCLINED = 2.6, 3.5  # of the logarithm of the stiffness
YIELDING, YIELDING_WITH_LOAD = 30, 60  # fifths of the strut's own stretch, by the form's own law


@form(GROWTH_M)
def lags_sensor(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """It follows its sensor late."""
    shown = scene.weather.part_c["struts"]
    return Contribution(strut_m=normalised(lagging(scene.rows.t_s, shown, rng.uniform(20, 70) * 60) - shown))


@form(GROWTH_M)
def sun_patch(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The sun shines on it for a while."""
    begin = rng.uniform(0.1, 0.5)
    end = begin + rng.uniform(0.15, 0.4)
    warmth = lagging(scene.rows.t_s, within(scene.rows, begin, end), rng.uniform(6, 20) * 60)
    return Contribution(strut_m=normalised(warmth))


@form(GROWTH_M)
def joint_friction_heat(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Its joints are warmed by motion."""
    drive = int(scene.machine.drive_of_strut[strut])
    return Contribution(strut_m=scene.rows.warmth_of_motion(drive, rng.uniform(12, 45)))


@form(GROWTH_M)
def warm_up(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """It warms up as the day begins."""
    return Contribution(strut_m=warming_up(scene.rows, rng.uniform(0.3, 1.2)))


@form(GROWTH_M)
def draught_on_sensor(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The sensor shows a draught that the strut hardly feels."""
    weather = scene.weather
    return Contribution(
        strut_m=normalised(weather.lagging_air_c(50) - weather.lagging_air_c(4)) * draw_sign(rng),
    )


@form(SOFTENING)
def softer_by_factor(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Softer always."""
    return Contribution(ln_stiffness=-np.ones(len(scene.rows)))


@form(YIELDING)
def soft_in_tension(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Softer when it is pulled."""
    stiffness = scene.stiffness_n_per_m[strut]
    return lengthened(strut, lambda tension, amplitude: amplitude * np.maximum(tension, 0) / stiffness * 0.2)


@form(YIELDING_WITH_LOAD)
def yields_more_with_load(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Softer the more it holds."""
    stiffness, largest_n = scene.stiffness_n_per_m[strut], np.abs(scene.calm.tension_n[:, strut]).max()
    return lengthened(
        strut, lambda tension, amplitude: amplitude * 0.2 * tension / stiffness * np.abs(tension) / largest_n
    )


@form(SOFTENING)
def loosened_joint_bolt(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Softer from a moment on."""
    step_s = draw_instant(scene.rows, rng)
    return Contribution(ln_stiffness=-since(scene.rows, step_s), step_s=step_s)


@form(SOFTENING_INCLINED)
def softer_when_inclined(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Softer the steeper it stands."""
    upright = scene.calm.directions[:, strut] @ scene.machine.up
    upright = (upright - upright.min()) / (upright.max() - upright.min())
    return Contribution(ln_stiffness=-(upright**2))


@form()
def switches_with_force(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Play that lies on the side of the force."""
    even_n = rng.uniform(10, 60)
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.5 * np.tanh(tension / even_n))


@form()
def floats_at_small_force(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Play that a force has to press through."""
    through_n = rng.uniform(100, 400)
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.5 * np.clip(tension / through_n, -1, 1))


@form()
def rests_on_side_of_motion(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Play that friction leaves on the side of the last motion where the force is small."""
    even_n = rng.uniform(50, 200)
    friction_n = rng.uniform(0.8, 2) * even_n
    held_n = friction_n * scene.rows.side[:, int(scene.machine.drive_of_strut[strut])]
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.5 * np.tanh((tension + held_n) / even_n))


@form()
def wears_open(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Play that grows in the campaign."""
    even_n, width = rng.uniform(20, 80), 0.2 + 0.8 * scene.rows.elapsed
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.5 * width * np.tanh(tension / even_n))


@form()
def two_joints_one_after_other(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Two plays, of which the second takes a force."""
    even_n = rng.uniform(20, 60)
    second_n = rng.uniform(100, 400)

    def law(tension: Array, amplitude: float) -> Array:
        first, second = np.tanh(tension / even_n), np.tanh((tension - second_n) / even_n)
        return np.asarray(amplitude * 0.5 * (0.5 * first + 0.5 * second))

    return lengthened(strut, law)


def lengthened(strut: int, law: Callable[[Array, float], Array]) -> Contribution:
    """A strut that is longer by a law of its own tension (r,) and the amplitude."""
    return Contribution(
        under_load=lambda state, amplitude: Contribution(strut_m=law(state.tension_n[:, strut], amplitude))
    )


FORMS: dict[str, tuple[Form, ...]] = {
    "link_thermal_growth": (lags_sensor, sun_patch, joint_friction_heat, warm_up, draught_on_sensor),
    "link_stiffness": (
        softer_by_factor, soft_in_tension, yields_more_with_load, loosened_joint_bolt, softer_when_inclined,
    ),
    "joint_clearance": (
        switches_with_force, floats_at_small_force, rests_on_side_of_motion, wears_open, two_joints_one_after_other,
    ),
}  # fmt: skip
