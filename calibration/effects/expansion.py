"""Expansion coefficients that are not the stated ones: parts of another material, columns of two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import BasisSets, Effect, EffectInputs, EffectParameter, Textbook, varies
from calibration.effects.basis_functions import curve_over, rises_of_curve
from calibration.effects.thermal import COLUMN_WIDTH_M, FOLLOWING_TIME_CONSTANTS_S
from calibration.machine.description import PARTS, Machine
from calibration.model.payload import PayloadEntry

LEAST_CHANGE_K = 0.3  # a part whose temperature varies less shows its coefficient no better than its geometry
COEFFICIENT_WEIGHT = (
    0.006  # of each form: a material is stated wrongly more rarely than a part is warmer than its sensor
)
LATE_SHARE = 0.3  # of it: for growth that lags behind the sensor, or is no straight line over it
MIXED_SHARE = 0.1  # of it: for parts of several materials, since parts that are warmed unlike are far more frequent
PARTS_OF_COLUMNS = ("base", "drives")  # whose sensors may be on them
UPRIGHT_M = 0.5  # standard deviation of the height at which a column stays upright
LAYERS = 1.5  # of curvature, over difference of coefficients and width, of two layers alike
LEAST_ACROSS = 0.1  # of a way that goes along a column: less does not bend it


def expansion(inputs: EffectInputs, _: int) -> BasisSets:
    """A part's coefficient is not the stated one, as of another material: its growth goes with its own sensor.

    L = L0 (1 + alpha (T - T_ref)); alpha itself rises with temperature (Touloukian et al., Thermophysical Properties of
    Matter 12, Plenum 1975).
    """
    sets, bent_by = BasisSets(), list[str]()
    for part in PARTS:
        if (above_k := _above_reference_k(inputs, part)) is None:
            continue
        main = sets.add((f"growth.{part}", above_k), form="linear")
        about_mean = above_k - above_k.mean()
        bent = about_mean**2 / max(float(np.abs(about_mean).max()), 1e-9)
        rising = sets.add((f"growth.{part}", bent), form="rising")
        sets.add_set(main, rising, share=0.1, weight=COEFFICIENT_WEIGHT)
        # A part that grows along any smooth curve over its sensor, at once or late.
        sensor = inputs.machine.sensors[part]
        span_k = float(np.ptp(inputs.context.temperatures_c[sensor]))
        for tau_s in FOLLOWING_TIME_CONSTANTS_S:
            change_k = inputs.context.part_temperature_k(sensor, tau_s)
            curve = sets.add((f"growth.{part}", span_k * curve_over(change_k)))
            sets.add_set(curve, weight=LATE_SHARE * COEFFICIENT_WEIGHT, size=rises_of_curve())
        _add_mixed_materials(sets, inputs, part, above_k)
        if part in PARTS_OF_COLUMNS and sensor not in bent_by:
            bent_by.append(sensor)
            _add_bending_columns(sets, inputs, sensor)
    return sets


def _add_mixed_materials(sets: BasisSets, inputs: EffectInputs, part: str, above_k: Array) -> None:
    """Struts, or screws and scales, of several materials: a spare part is not of the one that is stated for all."""
    machine = inputs.machine
    if part == "struts":
        lengths = dict(zip((f"length.{name}" for name in machine.strut_names), machine.nominal.length_m, strict=True))
    elif part == "drives":
        lengths = dict(zip((f"travel.{name}" for name in machine.drive_names), inputs.context.drives.T, strict=True))
    else:
        return
    each = [sets.add((channel, length_m * above_k)) for channel, length_m in lengths.items()]
    weight = MIXED_SHARE * COEFFICIENT_WEIGHT
    for own in each:
        sets.add_set(own, weight=weight / len(each))
    sets.add_set([c for own in each for c in own], weight=weight)


def _add_bending_columns(sets: BasisSets, inputs: EffectInputs, sensor: str) -> None:
    """All columns alike are of two materials, as cast iron with a rail of steel: their difference of coefficients bends
    them, by 1.5 over the width for layers alike (Timoshenko, Analysis of Bi-Metal Thermostats, 1925). At which height
    each column stays upright is not known.
    """
    span_k = float(np.ptp(inputs.context.temperatures_c[sensor]))
    weight = LATE_SHARE * COEFFICIENT_WEIGHT
    for ways in _ways_to_bend(inputs):
        bends = [bend for a, way in enumerate(ways) if (bend := _Bend.of_drive(inputs, a, way)) is not None]
        together = [channel for bend in bends for channel in bend.about_low_end]
        if not together:
            continue
        for tau_s in FOLLOWING_TIME_CONSTANTS_S:
            change_k = inputs.context.part_temperature_k(sensor, tau_s)
            elsewhere = [c for bend in bends for c in sets.add_along(bend.upright_higher, change_k)]
            curve = sets.add_along(together, span_k * curve_over(change_k))
            sets.add_set(curve, elsewhere, share=UPRIGHT_M, weight=weight, size=rises_of_curve())


def _ways_to_bend(inputs: EffectInputs) -> list[Array]:
    """Directions (d, 3) in which the columns of all drives bend: each to the same side, or away from their middle."""
    machine, drives = inputs.machine, range(len(inputs.machine.drive_names))
    sides = sorted({side[-1] for a in drives for side, _, _ in inputs.leaning(a)})
    feet = np.stack([machine.nominal.base_joint_m[machine.strut_drive == a].mean(axis=0) for a in drives])
    return [*(np.tile(np.eye(3)["xyz".index(side)], (len(feet), 1)) for side in sides), feet - feet.mean(axis=0)]


@dataclass(frozen=True)
class _Bend:
    """How a column that is bent by its width of unit strain shifts and turns its slider (n,), by channel.

    about_low_end: upright where the slider is lowest. upright_higher: what comes to that for each metre by which it is
    upright higher; the small constant that then goes with the temperature is left out.
    """

    about_low_end: list[tuple[str, Array]]
    upright_higher: list[tuple[str, Array]]

    @classmethod
    def of_drive(cls, inputs: EffectInputs, drive: int, way: Array) -> _Bend | None:
        """Of one drive's column towards a direction (3,); None where that hardly goes across its guide."""
        leaning = inputs.leaning(drive)
        across = np.array([way["xyz".index(side[-1])] for side, _, _ in leaning])
        length = float(np.linalg.norm(across))
        if length < LEAST_ACROSS * max(float(np.linalg.norm(way)), 1e-9):
            return None
        h, bend = inputs.context.drives[:, drive] - inputs.machine.travel[drive, 0], cls([], [])
        for (side, turn, sign), part in zip(leaning, across / length, strict=True):
            curvature = part * LAYERS / COLUMN_WIDTH_M
            if part != 0.0:
                bend.about_low_end.extend([(side, 0.5 * curvature * h**2), (turn, sign * curvature * h)])
                bend.upright_higher.extend([(side, -curvature * h), (turn, np.full_like(h, -sign * curvature))])
        return bend


def _above_reference_k(inputs: EffectInputs, part: str) -> Array | None:
    """By how much (n,) a part is warmer than at reference temperature; None if it hardly varies."""
    sensor = inputs.machine.sensors[part]
    recorded = inputs.context.temperatures_c.get(sensor)
    if recorded is None or not varies(recorded, LEAST_CHANGE_K):
        return None
    return np.asarray(recorded - inputs.machine.reference_temperature_c)


def _largest_u_expansion(machine: Machine, _: Sequence[PayloadEntry]) -> float:
    return max(machine.u_expansion_per_k.values(), default=0.0)


def _untested_at_one_temperature(inputs: EffectInputs) -> str | None:
    if any(_above_reference_k(inputs, part) is not None for part in PARTS):
        return None
    return f"no part's temperature varied by {LEAST_CHANGE_K} K; let the shop warm or cool"


EFFECTS = (
    Effect(
        name="expansion_coefficient",
        place="rig",
        size=EffectParameter("coefficient_per_k", 3e-7, 1.5e-5, "1/K", "true less stated, of one part"),
        reveals="a temperature swing, all struts or all drives alike",
        confounded=("link_thermal_growth", "column_thermal_growth", "screw_thermal_growth"),
        forms=expansion,
        untested=_untested_at_one_temperature,
        textbook=Textbook("linear", "Touloukian et al., Thermophysical Properties of Matter 12: linear expansion"),
        stated_u=_largest_u_expansion,
        varies_with=("time", "temperature"),
        functions_vary_with=("time",),
        order=210,
    ),
)
