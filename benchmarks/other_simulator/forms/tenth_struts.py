"""Forms of effects of struts, of the tenth archive: heat, softness, play."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.shapes import draw_phase, draw_sign, level_direction, normalised
from benchmarks.other_simulator.forms.struts import GROWTH_M, SOFTENING, YIELDING_WITH_LOAD, lengthened
from benchmarks.other_simulator.forms.traces import draw_after_break, draw_stretches, following
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator

NEEDLES_RAD = (0.06, 0.16)  # from one needle of a joint's bearing to the next


def _lean_rad(scene: Scene, strut: int) -> Array:
    """Angle (r,) between a strut and the downward direction, to one side."""
    direction = scene.calm.directions[:, strut]
    return np.arctan2(direction @ level_direction(scene.machine), -direction @ scene.machine.up)


@form(GROWTH_M)
def wrapped_in_foam_in_a_break(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Against draughts someone wraps it in foam in a break, and not the tube beside it that the sensor is on: before
    that it follows the air sooner than what is shown, and afterwards far later."""
    rows, weather = scene.rows, scene.weather
    after, _, step_s = draw_after_break(rows, rng)
    bare_min = rng.uniform(4, 9)
    tau_s = np.where(after, rng.uniform(90, 240), bare_min) * 60
    own_c = following(rows.t_s, weather.lagging_air_c(bare_min), tau_s)
    return Contribution(strut_m=normalised(own_c - weather.part_c["struts"]), step_s=step_s)


@form(GROWTH_M)
def cable_of_tool_in_its_bore(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The cable of the tool on the platform is led through its bore: it warms by the square of the current, which is
    larger the heavier the payload that the tool works against."""
    rows = scene.rows
    works = draw_stretches(rows, (3, 6), (0.1, 0.25), rng)
    current = rng.uniform(0.4, 0.7) + rows.stated_payload_kg / max(float(rows.stated_payload_kg.max()), 1.0)
    cable = lagging(rows.t_s, works * current**2, rng.uniform(2, 5) * 60)
    return Contribution(strut_m=normalised(lagging(rows.t_s, cable, rng.uniform(6, 20) * 60)))


@form(SOFTENING)
def floats_on_oil_of_weak_pump(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Its joints float on oil, which comes from the pump that serves the guides as well: while drives move a lot the
    pressure falls, and with it the stiffness, and it needs minutes to be there again."""
    rows, minutes = scene.rows, rng.uniform(1.5, 6)
    drawn = sum(rows.warmth_of_motion(drive, minutes) for drive in range(len(scene.machine.drives)))
    return Contribution(ln_stiffness=-(rng.uniform(0.1, 0.3) + 0.8 * normalised(np.asarray(drawn))))


@form(YIELDING_WITH_LOAD)
def disc_springs_until_they_are_flat(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Disc springs below the head of its end's bolt are too weak: force to the one side presses them together, ever
    less the flatter they are, until it is carried by solid metal; force to the other side does not reach them."""
    stiffness, tension_n = scene.stiffness_n_per_m[strut], scene.calm.tension_n[:, strut]
    side = 1.0 if np.median(tension_n) > 0 else -1.0
    flat_n = float(np.quantile(np.abs(tension_n), rng.uniform(0.4, 0.9))) + 10.0

    def law(tension: Array, amplitude: float) -> Array:
        pressed_n = flat_n * (1 - np.exp(-np.clip(side * tension, 0, None) / flat_n))
        return np.asarray(amplitude * 0.2 * side * pressed_n / stiffness)

    return lengthened(strut, law)


@form()
def needles_have_dented_their_race(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """In years of standing still and shaking the needles of its joint have dented the race: as the strut leans they
    drop into the next dents and climb out of them, pressed that way by which the force goes."""
    step_rad, even_n, depth = rng.uniform(*NEEDLES_RAD), rng.uniform(30, 150), rng.uniform(0.8, 2)
    phase = np.pi * _lean_rad(scene, strut) / step_rad + draw_phase(rng)
    dropped = np.abs(np.cos(phase)) ** depth  # sharp where a needle goes over the land between two dents
    return lengthened(strut, lambda tension, amplitude: amplitude * dropped * np.tanh(tension / even_n))


@form()
def rod_end_screws_round_in_its_thread(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The locknut of its rod end is loose: each swing of the strut takes the rod end along by friction, in one sense
    more than in the other, and the thread makes it longer or shorter by that; force lies on either flank of it."""
    swing = np.diff(_lean_rad(scene, strut), prepend=_lean_rad(scene, strut)[0])
    back, grips_rad, even_n = rng.uniform(0.5, 0.8), rng.uniform(0.02, 0.1), rng.uniform(30, 150)
    taken = np.sign(swing) * np.clip(np.abs(swing) - grips_rad, 0, None) * np.where(swing > 0, 1.0, back)
    screwed, flank = draw_sign(rng) * normalised(np.cumsum(taken)), rng.uniform(0.1, 0.3)
    return lengthened(strut, lambda tension, amplitude: amplitude * (screwed + flank * np.tanh(tension / even_n)))


FORMS: dict[str, tuple[Form, ...]] = {
    "link_thermal_growth": (wrapped_in_foam_in_a_break, cable_of_tool_in_its_bore),
    "link_stiffness": (floats_on_oil_of_weak_pump, disc_springs_until_they_are_flat),
    "joint_clearance": (needles_have_dented_their_race, rod_end_screws_round_in_its_thread),
}
