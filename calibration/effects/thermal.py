"""Thermal growth of parts that are warmer than their sensor reads: struts, columns, screws."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import (
    BasisSets,
    Effect,
    EffectInputs,
    EffectParameter,
    Textbook,
)
from calibration.effects.basis_functions import (
    any_course,
    cosine_basis,
    curve_over,
    rises_of_curve,
    rises_of_walk,
)
from calibration.effects.heats import DUTY_M_PER_S, TIME_CONSTANTS_S, heats_of_motion, heats_of_torque

COLUMN_WIDTH_M = 0.4
FOLLOWING_TIME_CONSTANTS_S = (0.0, 600.0, 2500.0)  # of parts that follow a recorded temperature; 0: at once
SENSOR_WORDS = {  # in names of sensors, by the group of parts as machine files call it
    "struts": ("strut", "link", "rod", "leg"),
    "base": ("column", "base", "frame", "tower", "bed"),
    "drives": ("screw", "spindle", "nut"),
}
SCREW_TERMS = 48  # of any course in time of a screw
FINE_TERMS, FINE_WEIGHT = 24, 0.1  # of any course in time
FINEST_TERMS = 96  # of a strut, which is warm and cold again within minutes
CURVE_WEIGHT = 0.3  # what grows with recorded temperatures: with any mixture, or along any smooth curve
HEAT_WEIGHT = 0.3  # what grows with heats of a drive, in proportion
LEAST_S = 900.0  # a shorter campaign shows no warming

_LUMPED = "Incropera, DeWitt, Fundamentals of Heat and Mass Transfer: lumped capacitance, uniform linear expansion"
_RISE = EffectParameter("rise_k", 0.1, 40.0, "K", "how much warmer than its sensor the part becomes")
_TAU = EffectParameter("tau_s", 200.0, 8000.0, "s", "time constant of the part")


def _followed(inputs: EffectInputs, part: str) -> list[tuple[Array, float]]:
    """Changes (n,) of recorded temperatures over their ranges, at once and with time constants.

    A part follows the sensors that by their names are on it; without any such sensor it may follow each of them.
    """
    sensors = _on_part(inputs, part) or list(inputs.context.temperatures_c)
    return inputs.context.relative_changes(sensors, FOLLOWING_TIME_CONSTANTS_S)


def _mixed(inputs: EffectInputs, part: str) -> Array | None:
    """Changes (n, k) of which a part may follow any mixture: of its own sensors and of the air, at once and late. None
    if nothing varies."""
    sensors = dict.fromkeys([*(_on_part(inputs, part) or [inputs.machine.sensors[part]]), "air"])
    changes = inputs.context.relative_changes(sensors, FOLLOWING_TIME_CONSTANTS_S)
    return np.stack([change for change, _ in changes], axis=1) if changes else None


def _of_own_sensor(inputs: EffectInputs, part: str) -> Array | None:
    """Change (n,) of a part's own sensor over its range, of which it may grow by more or less than is stated: at each
    place another share. None if it hardly varies."""
    changes = inputs.context.relative_changes([inputs.machine.sensors[part]], (0.0,))
    return changes[0][0] if changes else None


def _on_part(inputs: EffectInputs, part: str) -> list[str]:
    """Sensors that by their names are on a part."""
    words = SENSOR_WORDS[part]
    return [name for name in inputs.context.temperatures_c if any(word in name.lower() for word in words)]


def _untested_in_short_campaign(inputs: EffectInputs) -> str | None:
    return None if np.ptp(inputs.context.t_s) >= LEAST_S else "the campaign is too short for a part to warm"


def _add_thermal_sets(
    sets: BasisSets,
    contributions: tuple[tuple[str, Array], ...],
    inputs: EffectInputs,
    part: str,
    form: str,
    heats: Sequence[Array],
) -> None:
    """Basis sets of one geometry: a part that warms from the start, that goes on and off in any course, that follows
    any mixture of recorded temperatures, and of the heats of its drive.

    form: name of what warms from the start.
    """
    t = inputs.context.elapsed_s
    rest = sets.add_along(contributions, cosine_basis(inputs.context.t_s, 5))
    for tau in TIME_CONSTANTS_S:
        rising = sets.add_along(contributions, 1.0 - np.exp(-t / tau), form=form)
        sets.add_set(rising, rest, share=0.1, tau_s=tau)
    course, before = sets.add_along(contributions, any_course(t, FINE_TERMS)), len(sets.sets)
    sets.add_set(course, weight=FINE_WEIGHT, size=rises_of_walk(FINE_TERMS))
    sets.mark_as_courses(since=before)
    if (mixed := _mixed(inputs, part)) is not None:
        sets.add_set(sets.add_along(contributions, mixed), weight=CURVE_WEIGHT)
    if (own := _of_own_sensor(inputs, part)) is not None:
        sets.add_set(sets.add_along(contributions, own), weight=CURVE_WEIGHT)
    if heats:
        sets.add_set(sets.add_along(contributions, np.column_stack(heats)), weight=HEAT_WEIGHT)


def link_growth(inputs: EffectInputs, strut: int) -> BasisSets:
    """A strut grows by alpha l dT; its joints may be warmed by the motions of its drive."""
    sets, machine = BasisSets(), inputs.machine
    drive = int(machine.strut_drive[strut])
    heats = heats_of_motion(inputs, drive) if drive >= 0 else ()
    grown = np.full(len(inputs.context), machine.expansion_per_k["struts"] * machine.nominal.length_m[strut])
    channel = f"length.{machine.strut_names[strut]}"
    _add_thermal_sets(sets, ((channel, grown),), inputs, "struts", "warming", [heat for heat, _ in heats])
    if "t_s" not in inputs.context.not_said:
        finest = any_course(inputs.context.elapsed_s, FINEST_TERMS)
        course = sets.add((channel, grown[:, None] * finest))
        sets.add_set(course, weight=FINE_WEIGHT, size=rises_of_walk(FINEST_TERMS))
    return sets


def column_growth(inputs: EffectInputs, drive: int) -> BasisSets:
    """A column grows from its foot and takes the guide with it, or bends where one side is warmer.

    Its temperature may vary along its height; it may be heated by its drive and by the carriage's motions too.
    """
    sets, alpha = BasisSets(), inputs.machine.expansion_per_k["base"]
    h = inputs.height_m(drive)
    travel = f"travel.{inputs.drive(drive)}"
    of_motion, of_torque = heats_of_motion(inputs, drive, shortest_s=_TAU.low), heats_of_torque(inputs, drive)
    heats = [heat for heat, _ in (*of_motion, *of_torque)]
    _add_thermal_sets(sets, ((travel, alpha * h),), inputs, "base", "warming", heats)
    # Warmer at any height, c1 + c2 z + c3 z^2: growths by h, h^2 and h^3 follow one course each. The size is that in
    # the middle of the travel.
    middle = float(inputs.machine.travel[drive].mean() + (h - inputs.context.drives[:, drive])[0])
    powers = np.stack([alpha * h, 0.5 * alpha * h**2, alpha * h**3 / 3.0], axis=1)
    rises = tuple(rise * middle**k for k in range(3) for rise in rises_of_curve())
    for course in (inputs.context.elapsed_s, *(following for following, _ in _followed(inputs, "base"))):
        curves = [sets.add_along(((travel, power),), curve_over(course)) for power in powers.T]
        sets.add_set([c for columns in curves for c in columns], weight=CURVE_WEIGHT, size=rises)
    if (mixed := _mixed(inputs, "base")) is not None:  # foot and head follow temperatures of their own
        foot_and_head = [sets.add_along(((travel, power),), mixed) for power in powers.T[:2]]
        of_mixture = tuple(middle**k for k in range(2) for _ in range(mixed.shape[1]))
        sets.add_set([c for columns in foot_and_head for c in columns], weight=CURVE_WEIGHT, size=of_mixture)
    for side, turn, sign in inputs.leaning(drive):
        bent = alpha / COLUMN_WIDTH_M
        bending = ((side, 0.5 * sign * bent * h**2), (turn, bent * h))
        _add_thermal_sets(sets, bending, inputs, "base", "bending_warming", heats)
    return sets


def screw_growth(inputs: EffectInputs, drive: int) -> BasisSets:
    """A screw is heated by its drive, warms with what surrounds it, or follows temperatures; an end of it stays."""
    sets, alpha = BasisSets(), inputs.machine.expansion_per_k["drives"]
    travel, x = f"travel.{inputs.drive(drive)}", inputs.context.drives[:, drive] - inputs.machine.travel[drive, 0]
    span = float(inputs.machine.travel[drive, 1] - inputs.machine.travel[drive, 0])
    u = inputs.normalised_travel(drive)
    for tau in TIME_CONSTANTS_S:
        heat = inputs.context.motion_heat(drive, tau) / DUTY_M_PER_S
        warm = alpha * heat
        low = sets.add((travel, warm * x), form="friction_heat")
        high = sets.add((travel, warm * (x - span)), form="friction_heat_upper_end_fixed")
        bend = sets.add(
            (travel, span * alpha * heat[:, None] * np.stack([0.5 * u**2, 0.5 * u**3, 0.3 * np.ones_like(u)], axis=1))
        )
        sets.add_set(low, bend, share=0.5, tau_s=tau)
        sets.add_set(high, tau_s=tau)
    along, means = span * _along_screw(u), _means_along_screw()
    of_motion, of_torque = heats_of_motion(inputs, drive, shortest_s=_TAU.low), heats_of_torque(inputs, drive)
    # Warmest anywhere along the screw, heated by any power of the speed, in any time.
    every = [sets.add((travel, alpha * heat[:, None] * along)) for heat, _ in of_motion]
    for warmed, (_, tau) in zip(every, of_motion, strict=True):
        sets.add_set(warmed, weight=HEAT_WEIGHT, size=means, tau_s=tau)
    if every:
        sets.add_set([c for warmed in every for c in warmed], weight=HEAT_WEIGHT, size=len(every) * means)

    def whichever_end_stays(courses: Array, form: str = "") -> list[int]:
        ends = [alpha * courses * (x - end)[:, None] for end in (0.0, span)]
        return sets.add((travel, np.concatenate(ends, axis=1)), form=form)

    if of_torque:
        sets.add_set(whichever_end_stays(np.column_stack([heat for heat, _ in of_torque])), weight=HEAT_WEIGHT)
    if (mixed := _mixed(inputs, "drives")) is not None:
        sets.add_set(whichever_end_stays(mixed), weight=CURVE_WEIGHT)
    if (own := _of_own_sensor(inputs, "drives")) is not None:
        sets.add_set(whichever_end_stays(own[:, None]), weight=CURVE_WEIGHT)
    t = inputs.context.elapsed_s
    for tau in TIME_CONSTANTS_S:
        warming = whichever_end_stays((1.0 - np.exp(-t / tau))[:, None], "warming")
        sets.add_set(warming, size=(1.0, 1.0), tau_s=tau)
    heats = [inputs.context.motion_heat(drive, tau) for tau in TIME_CONSTANTS_S[1::3]]
    for course in (t, *heats, *(following for following, _ in _followed(inputs, "drives"))):
        sets.add_set(whichever_end_stays(curve_over(course)), weight=CURVE_WEIGHT, size=2 * rises_of_curve())
    finely = whichever_end_stays(any_course(t, SCREW_TERMS))  # cooled by what goes on and off
    before = len(sets.sets)
    sets.add_set(finely, weight=FINE_WEIGHT, size=2 * rises_of_walk(SCREW_TERMS))
    sets.mark_as_courses(since=before)
    return sets


def _along_screw(u: Array) -> Array:
    """Polynomials (n, 5) of the coordinate on [-1, 1], of a size that falls with their order: warm anywhere."""
    return np.column_stack([np.ones_like(u), u, u**2 - 0.5, 0.5 * (u**3 - u), 0.3 * (u**4 - u**2)])


@cache
def _means_along_screw() -> tuple[float, ...]:
    """Their means over the travel: by how much a screw is warmer on the whole."""
    return tuple(_along_screw(np.linspace(-1.0, 1.0, 1001)).mean(axis=0).tolist())


EFFECTS = (
    Effect(
        name="link_thermal_growth",
        place="strut",
        size=_RISE,
        reveals="time, a temperature swing",
        confounded=("joint_clearance", "column_thermal_growth"),
        forms=link_growth,
        others=(_TAU,),
        untested=_untested_in_short_campaign,
        declared=lambda nuisance: nuisance.temperature_k,
        measured="sum",
        textbook=Textbook("warming", _LUMPED),
        varies_with=("time", "way", "temperature"),
        order=10,
    ),
    Effect(
        name="column_thermal_growth",
        place="drive",
        size=_RISE,
        reveals="time, a temperature swing, reflectors on the sliders",
        confounded=("foundation_settling", "screw_thermal_growth"),
        forms=column_growth,
        others=(_TAU,),
        untested=_untested_in_short_campaign,
        declared=lambda nuisance: nuisance.temperature_k,
        measured="sum",
        textbook=Textbook("warming", _LUMPED),
        varies_with=("own travel", "time"),
        order=20,
    ),
    Effect(
        name="screw_thermal_growth",
        place="drive",
        size=_RISE,
        reveals="time and the way moved, drive coordinate, reflectors on the sliders",
        confounded=("column_thermal_growth",),
        forms=screw_growth,
        others=(_TAU,),
        untested=_untested_in_short_campaign,
        declared=lambda nuisance: nuisance.temperature_k,
        measured="sum",
        textbook=Textbook("friction_heat", _LUMPED),
        varies_with=("own travel", "time"),
        functions_vary_with=("own travel",),
        order=30,
    ),
)
