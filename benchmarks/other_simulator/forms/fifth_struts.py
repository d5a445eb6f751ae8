"""Forms of the fifth archive of struts: heat, softness, play."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms import struts
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import new_visit, of_former_visit
from benchmarks.other_simulator.forms.shapes import draw_instant, normalised, since
from benchmarks.other_simulator.forms.struts import lengthened
from benchmarks.other_simulator.forms.traces import following
from benchmarks.other_simulator.scene import Scene
from benchmarks.other_simulator.state import Equilibrium

Array = NDArray[np.float64]
Generator = np.random.Generator


@form(struts.GROWTH_M)
def carriage_warms_it_through_its_joint(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Its carriage is warmed by the motor, and the heat soaks through the joint: warmest when the work is over."""
    rows = scene.rows
    carriage = rows.warmth_of_motion(int(scene.machine.drive_of_strut[strut]), rng.uniform(8, 20))
    joint = lagging(rows.t_s, carriage, rng.uniform(8, 20) * 60)
    return Contribution(strut_m=normalised(lagging(rows.t_s, joint, rng.uniform(10, 30) * 60)))


@form(struts.GROWTH_M)
def follows_air_faster_while_it_moves(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The wind of its own motion brings it to the air's temperature; at rest it follows that much later."""
    rows, weather = scene.rows, scene.weather
    way_m = np.linalg.norm(scene.calm.positions_m - of_former_visit(rows, scene.calm.positions_m), axis=1)
    wind = lagging(rows.t_s, way_m * rows.speed_m_per_s, 240.0)
    slow_s = rng.uniform(60, 150) * 60
    own = following(rows.t_s, weather.air_c, slow_s / (1 + rng.uniform(15, 40) * (wind / max(wind.max(), 1e-9)) ** 2))
    return Contribution(strut_m=normalised(own - weather.part_c["struts"]))


@form(struts.SOFTENING)
def glue_cracks_with_each_overload(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The glue of its end cracks on at each place where much pulls or presses on it: it is softer for all that
    follows."""
    tension = np.abs(scene.calm.tension_n[:, strut])
    over = np.maximum(tension - np.quantile(tension, rng.uniform(0.6, 0.9)), 0) * new_visit(scene.rows)
    cracked = np.cumsum(over ** rng.uniform(1, 2.5))
    return Contribution(ln_stiffness=-cracked / max(cracked[-1], 1e-12))


@form(struts.YIELDING_WITH_LOAD)
def sags_by_its_own_weight_when_slack(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Its own weight bends it down, most when it lies level, and a pull makes it straight: slack, it is softer."""
    stiffness, calm_n = scene.stiffness_n_per_m[strut], np.abs(scene.calm.tension_n[:, strut])
    taut_n, largest_n = float(np.quantile(calm_n, rng.uniform(0.2, 0.6))), calm_n.max()
    level = 1 - (scene.calm.directions[:, strut] @ scene.machine.up) ** 2

    def law(tension: Array, amplitude: float) -> Array:
        straight = tension**2 / (tension**2 + taut_n**2)
        return np.asarray(amplitude * 0.2 * largest_n / stiffness * level * (straight - 1))

    return lengthened(strut, law)


@form()
def housing_warms_ahead_of_its_pin(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The housing takes up the platform's warmth before its pin does: the fit opens as it gets warmer, and closes as
    it gets colder."""
    even_n, shown = rng.uniform(20, 80), scene.weather.part_c["platform"]
    ahead = scene.weather.lagging_air_c(rng.uniform(2, 8)) - lagging(scene.rows.t_s, shown, 1200.0)
    width = (ahead - ahead.min()) / max(float(np.ptp(ahead)), 1e-9)
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.5 * width * np.tanh(tension / even_n))


@form()
def filled_with_grease_by_someone(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Someone greases its worn joint: the grease fills the play, and further ways press it out again."""
    rows, even_n = scene.rows, rng.uniform(20, 80)
    step_s = draw_instant(rows, rng, 0.2, 0.6)
    way_m = rows.way_m[:, int(scene.machine.drive_of_strut[strut])]
    since_m = np.maximum(way_m - np.interp(step_s, rows.t_s, way_m), 0)
    width = 1 - since(rows, step_s) * np.exp(-since_m / max(rng.uniform(0.1, 0.4) * way_m[-1], 1e-9))

    def under_load(state: Equilibrium, amplitude: float) -> Contribution:
        return Contribution(strut_m=amplitude * 0.5 * width * np.tanh(state.tension_n[:, strut] / even_n))

    return Contribution(under_load=under_load, step_s=step_s)


FORMS: dict[str, tuple[Form, ...]] = {
    "link_thermal_growth": (carriage_warms_it_through_its_joint, follows_air_faster_while_it_moves),
    "link_stiffness": (glue_cracks_with_each_overload, sags_by_its_own_weight_when_slack),
    "joint_clearance": (housing_warms_ahead_of_its_pin, filled_with_grease_by_someone),
}  # fmt: skip
