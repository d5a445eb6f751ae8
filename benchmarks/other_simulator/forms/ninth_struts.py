"""Forms of effects of struts, of the ninth archive: heat, softness, play."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import lagging
from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.history import new_visit
from benchmarks.other_simulator.forms.shapes import normalised
from benchmarks.other_simulator.forms.struts import GROWTH_M, SOFTENING, YIELDING, lengthened
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator


@form(GROWTH_M)
def return_hose_tied_along_it(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """The return hose of the hydraulics is tied along it: the oil warms up as all drives work, and the tube with it
    some minutes later."""
    rows, oil_min = scene.rows, rng.uniform(20, 50)
    oil = np.mean([rows.warmth_of_motion(drive, oil_min) for drive in range(len(scene.machine.drives))], 0)
    return Contribution(strut_m=normalised(lagging(rows.t_s, oil, rng.uniform(5, 15) * 60)))


@form(GROWTH_M)
def as_warm_as_what_it_is_bolted_to(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """A thick tube of aluminium takes its warmth from platform and carriage through its ends; the sensor sits on its
    thin cover, which shows something between that and the air."""
    part_c, share = scene.weather.part_c, rng.uniform(0.3, 0.7)
    ends = share * part_c["platform"] + (1 - share) * part_c["drives"]
    return Contribution(strut_m=normalised(ends - part_c["struts"]))


@form(SOFTENING)
def nylon_bushing_takes_up_moisture(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """A bushing of nylon takes up the air's moisture within an hour or two, and is the softer the damper it is."""
    damp = lagging(scene.rows.t_s, scene.weather.humidity_percent, rng.uniform(0.3, 1.5) * 3600)
    damp = (damp - damp.min()) / max(float(np.ptp(damp)), 1e-9)
    return Contribution(ln_stiffness=-(rng.uniform(0.2, 0.5) + 0.5 * damp))


@form(YIELDING)
def balls_give_most_at_small_force(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Its ball joints have lost their preload: the contact of ball and cup gives most with the first newtons and less
    with each further one, as such contacts do."""
    stiffness = scene.stiffness_n_per_m[strut]
    typical_n = float(np.abs(scene.calm.tension_n[:, strut]).mean()) + 1.0

    def law(tension: Array, amplitude: float) -> Array:
        share = np.abs(tension) / typical_n
        smooth = np.sqrt(share**2 + 0.01)  # no step of the slope where the force turns
        return np.asarray(amplitude * 0.2 * tension / stiffness * smooth ** (-1 / 3))

    return lengthened(strut, law)


@form()
def hammered_wider_by_changes_of_force(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """Each large change of its force hammers the bore: the play widens with these changes, and not with time."""
    even_n = rng.uniform(20, 80)
    blow_n = np.abs(np.diff(scene.calm.tension_n[:, strut], prepend=scene.calm.tension_n[0, strut]))
    blow_n = np.where(new_visit(scene.rows), blow_n, 0.0)
    hard_n = np.quantile(blow_n[blow_n > 0], rng.uniform(0.5, 0.8)) if (blow_n > 0).any() else 0.0
    hammered = np.cumsum(np.maximum(blow_n - hard_n, 0))
    width = rng.uniform(0.1, 0.3) + 0.8 * hammered / max(hammered[-1], 1e-9)
    return lengthened(strut, lambda tension, amplitude: amplitude * 0.5 * width * np.tanh(tension / even_n))


@form()
def ring_in_its_play_takes_a_set(scene: Scene, strut: int, rng: Generator) -> Contribution:
    """A ring of rubber fills the play: the force presses through it, and where that lasts the ring takes a set and
    leaves the pin on the side to which it was pressed."""
    t_s, through_n = scene.rows.t_s, rng.uniform(80, 300)
    tau_s, set_share = rng.uniform(8, 30) * 60, rng.uniform(0.4, 0.9)

    def law(tension: Array, amplitude: float) -> Array:
        set_n = set_share * lagging(t_s, tension, tau_s)
        return np.asarray(amplitude * 0.5 * np.tanh((tension + set_n) / through_n))

    return lengthened(strut, law)


FORMS: dict[str, tuple[Form, ...]] = {
    "link_thermal_growth": (return_hose_tied_along_it, as_warm_as_what_it_is_bolted_to),
    "link_stiffness": (nylon_bushing_takes_up_moisture, balls_give_most_at_small_force),
    "joint_clearance": (hammered_wider_by_changes_of_force, ring_in_its_play_takes_a_set),
}
