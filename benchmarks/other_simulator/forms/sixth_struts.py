"""Forms of the sixth archive of struts: heat, softness, play."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import struts
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import of_former_visit
from benchmarks.other_simulator.forms.memory import dragged
from benchmarks.other_simulator.forms.shapes import draw_instant, draw_phase, normalised, since
from benchmarks.other_simulator.forms.struts import lengthened
from benchmarks.other_simulator.forms.traces import draw_after_break, gathered_until
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator


@form(struts.GROWTH_M)
def sensor_comes_off_and_hangs_in_air(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """From a moment on its sensor hangs beside it and shows what is faster than the strut: right at that moment, and
    off by what has changed since."""
    rows, shown = scene.rows, scene.weather.part_c["struts"]
    step_s = draw_instant(rows, rng, 0.1, 0.5)
    behind = lagging(rows.t_s, shown, rng.uniform(40, 120) * 60) - shown
    return Contribution(strut_m=normalised((behind - np.interp(step_s, rows.t_s, behind)) * since(rows, step_s)))


@form(struts.GROWTH_M)
def splashed_and_cold_until_dry(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Someone hoses down the machine now and then: the wet strut is colder than its covered sensor until it is dry,
    and colder in dry air than in damp."""
    rows, wet = scene.rows, np.zeros(len(scene.rows))
    for _ in range(int(rng.integers(2, 6))):
        passed_s = rows.t_s - draw_instant(rows, rng, 0.03, 0.9)
        splash = rng.uniform(0.4, 1) * np.exp(-np.maximum(passed_s, 0) / (rng.uniform(6, 25) * 60))
        wet = np.maximum(wet, splash * (passed_s > 0))
    dryness = 1 - scene.weather.humidity_percent / 100
    return Contribution(strut_m=-normalised(lagging(rows.t_s, wet * dryness, rng.uniform(2, 8) * 60)))


@form(struts.SOFTENING)
def bolts_tightened_in_a_break(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The bolts of its end are loose; in a break someone tightens them, and they work loose again as it moves."""
    rows = scene.rows
    after, _, step_s = draw_after_break(rows, rng)
    way_m = rows.way_m[:, int(scene.machine.drive_of_strut[strut])]
    again_m = gathered_until(rows, np.diff(way_m, prepend=way_m[0]), after.astype(int))
    loose = 1 - np.exp(-again_m / max(rng.uniform(0.2, 1) * way_m[-1], 1e-9))
    return Contribution(ln_stiffness=-np.where(after, loose, 1.0), step_s=step_s)


@form(struts.YIELDING)
def slips_in_its_clamp_with_force(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Its clamp slips a little with each change of force and keeps that until the force has turned back by enough:
    pulling and letting go are two ways."""
    stiffness = scene.stiffness_n_per_m[strut]
    needed_n = rng.uniform(0.3, 0.9) * max(float(scene.calm.tension_n[:, strut].std()), 1e-9)
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.2 * dragged(tension, needed_n) / stiffness)


@form()
def thrown_over_by_hard_stops(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """A hard stop throws the platform on along the strut through the play, by the square of its speed; after a gentle
    one the force alone decides."""
    rows, positions, tension = scene.rows, scene.calm.positions_m, scene.calm.tension_n[:, strut]
    came = positions - of_former_visit(rows, positions)
    came = came / np.maximum(np.linalg.norm(came, axis=1)[:, None], 1e-6)
    along_it = (came * scene.calm.directions[:, strut]).sum(1)
    thrown_n = rng.uniform(1, 3) * np.abs(tension).mean() * along_it * (rows.speed_m_per_s / 0.1) ** 2
    even_n = rng.uniform(20, 80)
    return lengthened(strut, lambda pull, amplitude: amplitude * 0.5 * np.tanh((pull + thrown_n) / even_n))


@form()
def oval_pin_creeps_round_in_its_bore(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """A pin that is not held creeps round in its worn, oval bore as the strut swings: much play and little take turns
    with the way."""
    way_m, even_n = scene.rows.way_m[:, int(scene.machine.drive_of_strut[strut])], rng.uniform(20, 80)
    turn = way_m / max(way_m[-1], 1e-9) * rng.uniform(2.5, 8) + draw_phase(rng)
    width = 0.08 + 0.92 * np.sin(turn) ** 2
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.5 * width * np.tanh(tension / even_n))


FORMS: dict[str, tuple[Form, ...]] = {
    "link_thermal_growth": (sensor_comes_off_and_hangs_in_air, splashed_and_cold_until_dry),
    "link_stiffness": (bolts_tightened_in_a_break, slips_in_its_clamp_with_force),
    "joint_clearance": (thrown_over_by_hard_stops, oval_pin_creeps_round_in_its_bore),
}  # fmt: skip
