"""An effect of a recording: a form at its places, brought to a wanted size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.other_simulator.forms.catalogue import FORMS
from benchmarks.other_simulator.forms.form import Form
from benchmarks.other_simulator.machine import ON_PLATFORM, Machine
from benchmarks.other_simulator.rig import Part, Rig
from benchmarks.other_simulator.sizes import Size, Sizes

DRIVE, STRUT, RIG, REFLECTOR = "drive", "strut", "rig", "smr"
KIND_OF_PLACE = {
    "link_thermal_growth": STRUT, "link_stiffness": STRUT, "joint_clearance": STRUT, "smr_reseat": REFLECTOR,
    "tracker_drift": RIG, "refraction": RIG, "latency": RIG, "expansion_coefficient": RIG, "payload": RIG,
    "tables_left_on": RIG, "outside": RIG,
}  # fmt: skip
WANTED = (1.3, 9.0)  # visible length of shifts
VISIBLE, MOST_RAW = (0.7, 12.0), 100
ROUNDS, CLOSE = 4, 0.05


@dataclass(frozen=True)
class Effect:
    """A form at some places of a rig, for an amplitude of one."""

    name: str
    form: Form
    places: list[str]
    parts: list[Part]
    reflector: int | None  # that alone is moved
    step_s: float | None
    period_m: float | None
    share_shown: float  # of what a drive is off that its own columns show

    @property
    def of_rig(self) -> bool:
        """Whether it belongs to the rig as a whole."""
        return KIND_OF_PLACE.get(self.name) == RIG

    def sized(self, amplitude: float) -> list[Part]:
        """Its parts with an amplitude, in the unit of the form."""
        return [(contribution, place, amplitude * weight) for contribution, place, weight in self.parts]


def draw_effect(rig: Rig, name: str, form: str, rng: np.random.Generator) -> Effect:
    """A form of an effect at drawn places, with drawn constants: more often than not the same at all places."""
    numbers, weights, places = _draw_places(rig.machine, name, rng)
    # Struts grow alike whatever is drawn, so that what is one heat is one course.
    alike = bool(rng.random() < 0.6) or name == "link_thermal_growth"
    seed = int(rng.integers(1 << 31))
    chosen = FORMS[name][form]
    kind = KIND_OF_PLACE.get(name, DRIVE)
    parts: list[Part] = []
    for k, (number, weight) in enumerate(zip(numbers, weights, strict=True)):
        own = np.random.default_rng(seed if alike else seed + 17 * k)
        place = number if kind in (DRIVE, STRUT) else None
        parts.append((chosen.contribution(rig.scene, number, own), place, weight))
    first = parts[0][0]
    share_shown = float(rng.choice([0, 0, 0.3])) if name == "servo_settling" else 0.0
    reflector = numbers[0] if kind == REFLECTOR else None
    return Effect(name, chosen, places, parts, reflector, first.step_s, first.period_m, share_shown)


def bring_to_size(rig: Rig, sizes: Sizes, effect: Effect, wanted: float) -> tuple[float, Size] | None:
    """Amplitude at which the visible size is about the wanted one, and its sizes; None if the effect cannot show it."""
    own = [part.largest / weight for part, _, weight in effect.parts if part.largest is not None]
    largest = min([effect.form.largest, *own])
    amplitude = largest / 20
    for _ in range(ROUNDS):
        size = size_of(rig, sizes, effect, amplitude)
        if size is None or size.visible_length < 1e-4:
            return None
        most = amplitude * MOST_RAW / max(size.raw_length, 1e-9)
        better = min(amplitude * wanted / size.visible_length, largest, most)
        if abs(better / amplitude - 1) < CLOSE:
            break
        amplitude = better
    size = size_of(rig, sizes, effect, amplitude)
    if size is None or not VISIBLE[0] <= size.visible_length <= VISIBLE[1]:
        return None
    return amplitude, size


def size_of(rig: Rig, sizes: Sizes, effect: Effect, amplitude: float) -> Size | None:
    """Sizes of an effect by itself; None if the machine does not find its balance."""
    with np.errstate(over="ignore", invalid="ignore"):  # of a machine that falls apart
        seen, _ = rig.simulate(effect.sized(amplitude))
    if not np.isfinite(seen).all():
        return None
    return sizes.of(seen - rig.scene.sights_m, effect.reflector, effect.share_shown)


def _draw_places(machine: Machine, effect: str, rng: np.random.Generator) -> tuple[list[int], list[float], list[str]]:
    """Numbers, weights and names of the places; an effect of the rig has the number 0, which its forms do not use."""
    kind = KIND_OF_PLACE.get(effect, DRIVE)
    if kind == RIG:
        return [0], [1.0], ["rig"]
    if kind == REFLECTOR:
        smr = int(rng.choice(np.flatnonzero(machine.carriers == ON_PLATFORM)))
        return [smr], [1.0], [machine.reflectors[smr]]
    names = machine.struts if kind == STRUT else machine.drives
    drawn, count = rng.random(), len(names)
    if drawn < (0.55 if kind == STRUT else 0.4):
        number = int(rng.integers(count))
        return [number], [1.0], [names[number]]
    if kind == STRUT:
        weights = rng.uniform(0.8, 1.2, count)
    elif drawn < 0.8:
        weights = rng.uniform(0.85, 1.15, count)
    else:
        weights = np.exp(rng.uniform(np.log(0.25), 0, count))
    return list(range(count)), list(weights), list(names)
