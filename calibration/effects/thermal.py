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
    geometric_series,
)
from calibration.effects.basis_functions import (
    any_course,
    cosine_basis,
    curve_over,
    rises_of_curve,
    scale_to_symmetric,
)
from calibration.effects.heats import DUTY_M_PER_S, TIME_CONSTANTS_S, heats_of_drive, heats_of_motion

LAG_TIME_CONSTANTS_S = geometric_series(400.0, 5000.0, 4)
COLUMN_WIDTH_M = 0.4
PRETENSION_SHARES = (
    0.1,
    0.2,
    0.3,
    0.45,
    0.6,
)  # of the largest heat, absorbed by the stretch of a screw that was mounted under tension
FOLLOWING_TIME_CONSTANTS_S = (0.0, 600.0, 2500.0)  # of parts that follow a recorded temperature; 0: at once
SENSOR_WORDS = {  # in names of sensors, by the group of parts as machine files call it
    "struts": ("strut", "link", "rod", "leg"),
    "base": ("column", "base", "frame", "tower", "bed"),
    "drives": ("screw", "spindle", "nut"),
}
SCREW_TERMS = 48  # of any course in time of a screw
FINE_TERMS, FINE_WEIGHT = 24, 0.1  # of any course in time
FINEST_TERMS = 48  # of a strut, which is warm and cold again within minutes
HEIGHT_TIMES_S, HEIGHT_WEIGHT = (200.0, 600.0), 0.1  # in which a strut takes up the air's warmth where it hangs
CURVE_WEIGHT = 0.3  # what grows with a temperature may do so along any smooth curve
HEAT_WEIGHT = 0.1  # the same of what grows with the heat of its drive, which few recordings can tell
MOTION_WEIGHT = 0.3  # what grows with the heat of motion, in proportion
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


def _on_part(inputs: EffectInputs, part: str) -> list[str]:
    """Sensors that by their names are on a part."""
    words = SENSOR_WORDS[part]
    return [name for name in inputs.context.temperatures_c if any(word in name.lower() for word in words)]


def _warming(inputs: EffectInputs, sensor: str) -> tuple[list[tuple[Array, float]], list[tuple[Array, float]]]:
    """Temperatures above the sensor (n,) with time constants: parts that warm from the start, parts that lag."""
    t = inputs.context.elapsed_s
    rises = [(1.0 - np.exp(-t / tau), tau) for tau in TIME_CONSTANTS_S]
    lags = (
        [(inputs.context.thermal_lag_k(sensor, tau), tau) for tau in LAG_TIME_CONSTANTS_S]
        if sensor in inputs.context.temperatures_c
        else []
    )
    return rises, lags


def _untested_in_short_campaign(inputs: EffectInputs) -> str | None:
    return None if np.ptp(inputs.context.t_s) >= LEAST_S else "the campaign is too short for a part to warm"


def _add_thermal_sets(
    sets: BasisSets,
    contributions: tuple[tuple[str, Array], ...],
    inputs: EffectInputs,
    part: str,
    prefix: str = "",
    heats: Sequence[tuple[Array, float]] = (),
    motions: Sequence[tuple[Array, float]] = (),
) -> None:
    """Basis sets of one geometry: one time constant, two stages, a decaying pulse of heat, a lag behind the sensor.

    prefix: of the names of their forms, for any geometry but the textbook's. heats: of a drive that is on the part;
    motions: the heat that its motions leave.
    """
    rises, lags = _warming(inputs, inputs.machine.sensors[part])
    t = inputs.context.elapsed_s

    def through(shapes: Array, form: str = "") -> list[int]:
        return sets.add_along(contributions, shapes, form=f"{prefix}{form}" if form else "")

    rest = through(cosine_basis(inputs.context.t_s, 5))
    rising = [through(rise, "warming") for rise, _ in rises]
    later = [through(rise, "second_stage") for rise, _ in rises[2:]]
    lagging = [through(lag, "lagging") for lag, _ in lags]
    for column, (_, tau) in zip((*rising, *lagging), (*rises, *lags), strict=True):
        sets.add_set(column, rest, share=0.1, tau_s=tau)
    for fast, slow, (_, tau) in zip(rising, later, rises, strict=False):
        sets.add_set((*fast, *slow), rest, share=0.1, tau_s=tau)
    for _, tau in rises:
        pulse = through(t / tau * np.exp(1.0 - t / tau), "pulse")
        sets.add_set(pulse, rest, share=0.1, weight=0.5, tau_s=tau)
    for lag, (_, tau) in zip(lagging, lags, strict=True):
        sets.add_set((*rising[2], *lag), rest, share=0.1, weight=0.5, tau_s=tau)
    finely = any_course(t, FINE_TERMS)
    sets.add_set(through(finely), weight=FINE_WEIGHT)  # something beside it that goes on and off
    course = through(curve_over(inputs.context.elapsed_s))
    sets.add_set(course, weight=CURVE_WEIGHT, size=rises_of_curve(), tau_s=float(np.median(TIME_CONSTANTS_S)))
    for following, tau in _followed(inputs, part):
        column, tau_s = through(following, "following"), max(tau, _TAU.low)
        sets.add_set(column, rest, share=0.1, tau_s=tau_s)
        sets.add_set(through(curve_over(following)), weight=CURVE_WEIGHT, size=rises_of_curve(), tau_s=tau_s)
    if (mixed := _mixed(inputs, part)) is not None:
        sets.add_set(through(mixed), weight=CURVE_WEIGHT)
    for heat, tau in heats:
        sets.add_set(through(curve_over(heat)), weight=HEAT_WEIGHT, size=rises_of_curve(), tau_s=tau)
    left = [through(heat) for heat, _ in motions]
    for column, (_, tau) in zip(left, motions, strict=True):
        sets.add_set(column, rest, share=0.1, weight=MOTION_WEIGHT, tau_s=max(tau, _TAU.low))
    if left:  # by any power of the speed, in any time
        sets.add_set([c for columns in left for c in columns], weight=MOTION_WEIGHT)


def link_growth(inputs: EffectInputs, strut: int) -> BasisSets:
    """A strut grows by alpha l dT; its joints may be warmed by the motions of its drive."""
    sets, machine = BasisSets(), inputs.machine
    drive = int(machine.strut_drive[strut])
    motions = heats_of_motion(inputs, drive) if drive >= 0 else ()
    grown = np.full(len(inputs.context), machine.expansion_per_k["struts"] * machine.nominal.length_m[strut])
    channel = f"length.{machine.strut_names[strut]}"
    _add_thermal_sets(sets, ((channel, grown),), inputs, "struts", motions=motions)
    if "t_s" not in inputs.context.not_said:
        t = inputs.context.elapsed_s
        finest = any_course(t, FINEST_TERMS)
        sets.add_set(sets.add((channel, grown[:, None] * finest)), weight=FINE_WEIGHT)
        for tau_s in HEIGHT_TIMES_S:  # air is warmer above, and a strut follows that where its drives have carried it
            hung = [scale_to_symmetric(inputs.context.lagging(q, tau_s)) for q in inputs.context.drives.T]
            where = sets.add((channel, grown[:, None] * np.column_stack(hung)))
            sets.add_set(where, weight=HEIGHT_WEIGHT, tau_s=tau_s)
    return sets


def column_growth(inputs: EffectInputs, drive: int) -> BasisSets:
    """A column grows from its foot and takes the guide with it, or bends where one side is warmer.

    Its temperature may vary along its height; it may be heated by its drive and by the carriage's motions too.
    """
    sets, alpha = BasisSets(), inputs.machine.expansion_per_k["base"]
    h = inputs.height_m(drive)
    travel, heats = f"travel.{inputs.drive(drive)}", heats_of_drive(inputs, drive)
    motions = heats_of_motion(inputs, drive, shortest_s=_TAU.low)
    _add_thermal_sets(sets, ((travel, alpha * h),), inputs, "base", heats=heats, motions=motions)
    _add_thermal_sets(sets, ((travel, 0.5 * alpha * h**2),), inputs, "base", "warmer_above_")
    # Warmer at any height, c1 + c2 z + c3 z^2: growths by h, h^2 and h^3 follow one course each. The size is that in
    # the middle of the travel.
    middle = float(inputs.machine.travel[drive].mean() + (h - inputs.context.drives[:, drive])[0])
    powers = np.stack([alpha * h, 0.5 * alpha * h**2, alpha * h**3 / 3.0], axis=1)
    rises = tuple(rise * middle**k for k in range(3) for rise in rises_of_curve())
    for course in (inputs.context.elapsed_s, *(following for following, _ in _followed(inputs, "base"))):
        curves = [sets.add_along(((travel, power),), curve_over(course)) for power in powers.T]
        sets.add_set([c for columns in curves for c in columns], weight=CURVE_WEIGHT, size=rises)
    for side, turn, sign in inputs.leaning(drive):
        bent = alpha / COLUMN_WIDTH_M
        _add_thermal_sets(
            sets, ((side, 0.5 * sign * bent * h**2), (turn, bent * h)), inputs, "base", "bending_", motions=motions
        )
        _add_thermal_sets(
            sets, ((side, -0.5 * sign * bent * h**2), (turn, bent * h)), inputs, "base", "leaning_", motions=motions
        )
    return sets


def screw_growth(inputs: EffectInputs, drive: int) -> BasisSets:
    """A screw is heated by its motion, or follows a temperature; which end is fixed says how that moves the slider."""
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
        limited = [
            sets.add((travel, alpha * np.maximum(heat - k * heat.max(), 0.0) * x), form="pretension")
            for k in PRETENSION_SHARES
        ]
        every = [c for columns in limited for c in columns]
        sets.add_set(low, (*bend, *every), share=0.5, tau_s=tau)
        sets.add_set(high, tau_s=tau)
        sets.add_set((*low, *every), bend, share=0.3, tau_s=tau)
        for columns in limited:
            sets.add_set(columns, tau_s=tau)
        sets.add_set(bend, share=0.5, tau_s=tau)
    rises, _ = _warming(inputs, inputs.machine.sensors["drives"])
    courses = [("warming", *rise) for rise in rises] + [("following", *f) for f in _followed(inputs, "drives")]
    for form, warmer, tau in courses:
        low = sets.add((travel, alpha * warmer * x), form=form)
        high = sets.add((travel, alpha * warmer * (x - span)), form=f"{form}_upper_end_fixed")
        bend = sets.add((travel, span * alpha * warmer[:, None] * np.stack([0.5 * u**2, 0.5 * u**3], axis=1)))
        sets.add_set(low, bend, share=0.3, tau_s=max(tau, _TAU.low))
        sets.add_set(high, tau_s=max(tau, _TAU.low))
    # Whatever its course over time or a temperature, and wherever the point of the screw that stays.
    heats = [inputs.context.motion_heat(drive, tau) for tau in TIME_CONSTANTS_S[1::3]]
    of_any = (inputs.context.elapsed_s, *heats, *(following for following, _ in _followed(inputs, "drives")))
    by_torque = [heat for heat, _ in heats_of_drive(inputs, drive)]
    every, along, means = [], span * _along_screw(u), _means_along_screw()
    for heat, tau in heats_of_motion(inputs, drive, shortest_s=_TAU.low):  # warmest anywhere along the screw
        warmed = sets.add((travel, alpha * heat[:, None] * along))
        sets.add_set(warmed, weight=MOTION_WEIGHT, size=means, tau_s=tau)
        every += warmed
    if every:  # heated by any power of the speed, in any time
        sets.add_set(every, weight=MOTION_WEIGHT, size=(len(every) // len(means)) * means)
    if (mixed := _mixed(inputs, "drives")) is not None:
        ends = [c for end in (0.0, span) for c in sets.add((travel, alpha * mixed * (x - end)[:, None]))]
        sets.add_set(ends, weight=CURVE_WEIGHT)
    finely = alpha * any_course(inputs.context.elapsed_s, SCREW_TERMS)  # cooled by what goes on and off
    ends = [column for end in (0.0, span) for column in sets.add((travel, finely * (x - end)[:, None]))]
    sets.add_set(ends, weight=FINE_WEIGHT)
    for course, weight in (*((c, CURVE_WEIGHT) for c in of_any), *((c, HEAT_WEIGHT) for c in by_torque)):
        curves = alpha * curve_over(course)
        ends = [column for end in (0.0, span) for column in sets.add((travel, curves * (x - end)[:, None]))]
        sets.add_set(ends, weight=weight, size=2 * rises_of_curve())
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
        order=30,
    ),
)
