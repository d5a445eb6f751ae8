"""Forms of effects of the guides: out of straight, and turning the carriage, in the plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.departures import Contribution
from benchmarks.other_simulator.forms.form import Form, form
from benchmarks.other_simulator.forms.shapes import across, bump, draw_phase, logistic, turned, wave
from benchmarks.other_simulator.scene import Scene

Array = NDArray[np.float64]
Generator = np.random.Generator


def _aside(scene: Scene, drive: int, shift: Array) -> Contribution:
    return Contribution(carriage_m=across(scene.machine, drive, shift))


def _turns(scene: Scene, drive: int, angle: Array) -> Contribution:
    return Contribution(carriage_rad=4 * turned(scene.machine, drive, angle))


@form()
def bow(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A bow."""
    return _aside(scene, drive, scene.rows.centred[:, drive] ** 2)


@form()
def s_shape(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Bent one way, then the other."""
    place = scene.rows.centred[:, drive]
    return _aside(scene, drive, place**3 - 0.6 * place)


@form()
def joint_of_rails(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Two rails that do not meet."""
    return _aside(scene, drive, logistic((scene.rows.centred[:, drive] - rng.uniform(-0.4, 0.4)) / 0.03))


@form()
def wave_of_screws(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A wave of the distance of the screws that hold it."""
    period_m = rng.uniform(0.12, 0.5)
    return _aside(scene, drive, wave(scene.rows.drives_m[:, drive], period_m, draw_phase(rng)))


@form()
def local_dent(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """A dent."""
    middle, width = rng.uniform(-0.5, 0.5), rng.uniform(0.15, 0.3)
    return _aside(scene, drive, bump(scene.rows.centred[:, drive], middle, width))


@form(name="bow")
def angular_bow(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Turns as on a bow of third order."""
    return _turns(scene, drive, scene.rows.centred[:, drive] ** 2 - 0.3)


@form()
def proportional(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Turns on its way, a little more at the ends."""
    place = scene.rows.centred[:, drive]
    return _turns(scene, drive, place + 0.25 * place**3)


@form(name="wave")
def angular_wave(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Rocks to and fro."""
    period_m = rng.uniform(0.15, 0.6)
    return _turns(scene, drive, wave(scene.rows.drives_m[:, drive], period_m, draw_phase(rng)))


@form()
def kink(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Turns at one place."""
    return _turns(scene, drive, logistic((scene.rows.centred[:, drive] - rng.uniform(-0.4, 0.4)) / 0.06))


@form()
def twist_and_wave(scene: Scene, drive: int, rng: Generator) -> Contribution:
    """Turns on its way and rocks."""
    place = scene.rows.centred[:, drive]
    rocking = 0.5 * np.cos(np.pi * place * rng.uniform(1, 2) + draw_phase(rng))
    return _turns(scene, drive, 0.6 * place + rocking)


FORMS: dict[str, tuple[Form, ...]] = {
    "guide_straightness": (bow, s_shape, joint_of_rails, wave_of_screws, local_dent),
    "guide_angular": (angular_bow, proportional, angular_wave, kink, twist_and_wave),
}
