"""Errors of the instrument: drift of its frame, refraction, reflectors that were removed and put back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import BasisSets, Effect, EffectInputs, EffectParameter, Textbook, strongest_onset
from calibration.effects.basis_functions import (
    any_course,
    cosine_basis,
    random_walk_basis,
    scale_to_symmetric,
    tensor_product,
)
from calibration.effects.context import ReadingContext
from calibration.effects.onsets import ONSET, untested_in_short_campaign
from calibration.recording.header import DRIFT_LEVER_M, HOUR_S

ONSETS = 12  # weight of a displacement at some moment, all moments together
SEVERAL_WEIGHT = 0.5  # of several displacements against one
WALK_TERMS, PART_WEIGHT = 40, 0.5  # of any course, and of one of a part of the coordinates
WARM_UP_S = (900.0, 2700.0)
AIR_S, AIR_WEIGHT = (0.0, 900.0, 3600.0), 0.5  # in which what carries the station takes up the air's warmth
PER_KELVIN = 0.93e-6  # decrease of the refractive index of air
TOWARDS_WARM = {"light.v": -1.0, "light.hz": 1.0}  # sign of an angle's error
SLOWLY_TERMS, SLOW_TERMS = 12, 5  # of a gradient that changes in time, and with the place
FINE_TERMS, PLUME_TERMS = 16, 4
PLUME_WEIGHT = 0.2
SIGHT_TERMS = 8  # of a smooth function of where the light passes
INDEX_DELAYS_S = (900.0, 3600.0)  # after which a station is told of the air anew
LEAST_INDEX_CHANGE = 0.2e-6  # of the refractivity: less is within the range scale's stated uncertainty
FRAME = ("rx", "ry", "rz", "x", "y", "z")


def drift(inputs: EffectInputs, _: int) -> BasisSets:
    """The station's frame turns and shifts: steadily, while warming up, with the air, in a step, or by any course."""
    sets, t = BasisSets(), inputs.context.elapsed_s

    def frame(shape: Array, form: str = "") -> list[int]:
        levers = [(k, DRIFT_LEVER_M if k[0] == "r" else 1.0) for k in FRAME]
        return [c for k, lever in levers for c in sets.add((f"station.{k}", shape / lever), form=form)]

    sets.add_set(frame(t / HOUR_S, "steady"))
    for tau_s in WARM_UP_S:
        sets.add_set(frame(1.0 - np.exp(-t / tau_s), "warming_up"))
    for with_air, _tau_s in inputs.context.relative_changes(("air",), AIR_S):  # the tripod and the floor
        sets.add_set(frame(with_air), weight=AIR_WEIGHT)
    for onset, prior in inputs.onsets([f"station.{k}" for k in FRAME]):
        sets.add_set(frame((t >= onset).astype(np.float64), "step"), weight=2.0 * prior, onset_s=onset)
    by_coordinate = dict(zip(FRAME, np.reshape(frame(random_walk_basis(t / HOUR_S, WALK_TERMS)), (6, -1)), strict=True))

    def walk(coordinates: Sequence[str], weight: float) -> None:
        sets.add_set([int(c) for k in coordinates for c in by_coordinate[k]], weight=weight)

    walk(FRAME, 2.0)
    walk(("rz",), PART_WEIGHT)  # legs that the sun shines on
    walk(("rx", "ry", "z"), PART_WEIGHT)  # a foot that sinks
    return sets


def refraction(inputs: EffectInputs, _: int) -> BasisSets:
    """Light bends towards cold air: the angle error grows with distance and depends on the light path and the time.
    Where the air is not what ranges are corrected for, their scale follows the weather.

    Everything seems further towards the warm air. A gradient that rises upwards therefore makes the vertical angle,
    which counts from the zenith, too small; one that rises clockwise makes the horizontal angle too large.
    """
    sets, t, p = BasisSets(), inputs.context.elapsed_s, inputs.sight_m
    across, height = scale_to_symmetric(p[:, 0]), scale_to_symmetric(p[:, 2])
    one = np.ones(len(t))
    any_time = np.column_stack([one, any_course(t, SLOWLY_TERMS)])
    finely = any_course(t, FINE_TERMS)
    temperatures = inputs.context.relative_changes(inputs.context.temperatures_c, (0.0,))
    angle_per_gradient = 0.5 * PER_KELVIN
    for channel, towards_warm in TOWARDS_WARM.items():
        uniform = sets.add((channel, angle_per_gradient * one), form="uniform")
        powers = np.stack([across, height, across * height, across**2, height**2, across**3, height**3], axis=1)
        bumps = np.stack([np.exp(-(((across - c) / 0.45) ** 2)) for c in (-0.8, -0.4, 0.0, 0.4, 0.8)], axis=1)
        varying = sets.add(
            (
                channel,
                angle_per_gradient * np.concatenate([powers, bumps, tensor_product(bumps, height[:, None])], axis=1),
            )
        )
        sets.add_set(uniform, varying, share=0.5, size=towards_warm)
        sets.add_set(varying)
        at_times = sets.add((channel, angle_per_gradient * any_time))
        elsewhere = tensor_product(any_time[:, :SLOW_TERMS], np.stack([across, height, across**2, height**2], axis=1))
        sets.add_set(at_times, sets.add((channel, angle_per_gradient * elsewhere)), share=0.5)
        if temperatures:  # a gradient is between two of them: below the air is as warm as the floor
            shapes = np.column_stack([one, *(change for change, _ in temperatures)])
            sets.add_set(sets.add((channel, angle_per_gradient * shapes)))
        for place in (across, height):
            along = sets.add((channel, angle_per_gradient * cosine_basis(place, SIGHT_TERMS, constant=True)))
            sets.add_set(along)
    of_ranges: list[list[int]] = []
    for channel, unit in (("light.range", PER_KELVIN), *((name, angle_per_gradient) for name in TOWARDS_WARM)):
        whole = sets.add((channel, unit * finely))
        for k, place in enumerate((across, height)):  # layers that come and go, plumes that stand at one place
            there = cosine_basis(place, PLUME_TERMS)
            plume = [*whole, *sets.add((channel, unit * tensor_product(finely, there)))]
            if channel == "light.range":  # what bends light is of another density, too
                of_ranges.append(plume)
                continue
            sets.add_set(plume, weight=PLUME_WEIGHT)
            sets.add_set((*plume, *of_ranges[k]), weight=PLUME_WEIGHT)
    _add_range_scale(sets, inputs.context)
    return sets


def _add_range_scale(sets: BasisSets, context: ReadingContext) -> None:
    """Ranges are corrected for the air of another time: of the campaign's begin, of a while ago, or of another place.

    The size is that of a gradient over the metre between sensor and light.
    """
    since_begin = context.air_refractivity - context.air_refractivity[int(np.argmin(context.t_s))]
    elsewhere = random_walk_basis(context.elapsed_s / HOUR_S, 12)
    other = sets.add(("light.range", PER_KELVIN * elsewhere))
    for error in (since_begin, *(context.refractivity_change(delay_s) for delay_s in INDEX_DELAYS_S)):
        if np.ptp(error) > LEAST_INDEX_CHANGE:
            scaled = sets.add(("light.range", PER_KELVIN * error / np.ptp(error)), form="late_air")
            sets.add_set(scaled, other, share=0.2, size=-1.0)
    sets.add_set(other)


def reseat(inputs: EffectInputs, smr: int) -> BasisSets:
    """One reflector is displaced from some time on, after payload exchanges or along any course, or is loose."""
    sets, context = BasisSets(), inputs.context
    name = [x.name for x in inputs.machine.smrs if x.on == "platform"][smr]
    channels = [c for c in inputs.channels if c.startswith(f"smr.{name}.")]
    t = context.elapsed_s

    def shift(shape: Array, form: str = "") -> list[int]:
        return [c for channel in channels for c in sets.add((channel, shape), form=form)]

    onsets = inputs.onsets(channels)
    for onset, prior in onsets:
        sets.add_set(shift((t >= onset).astype(np.float64), "step"), weight=prior * ONSETS, onset_s=onset)
    if len(onsets) > 1:  # put aside and back, or aside again
        steps = np.column_stack([(t >= onset).astype(np.float64) for onset, _ in onsets])
        sets.add_set(shift(steps), (), weight=SEVERAL_WEIGHT * onsets[0][1] * ONSETS, **strongest_onset(onsets))
    # Where it lies is calibrated, but not where it lies at each visit.
    sets.add_set(shift(np.ones(len(context)), "loose"))
    numbers = np.unique(context.exchanges)[1:]
    if numbers.size:
        put_back = shift((context.exchanges[:, None] == numbers).astype(np.float64), "exchanges")
        sets.add_set(put_back, weight=ONSETS / 2)
    sets.add_set(shift(any_course(t, 48)), (), weight=ONSETS / 2, **strongest_onset(onsets))
    return sets


EFFECTS = (
    Effect(
        name="tracker_drift",
        place="rig",
        size=EffectParameter("drift_m", 2e-6, 1e-3, "m", "at 3 m, in an hour or at once"),
        reveals="time, floor nests",
        confounded=("foundation_settling",),
        forms=drift,
        others=(ONSET,),
        untested=untested_in_short_campaign,
        declared=lambda nuisance: nuisance.drift_m,
        measured="norm of channels",
        textbook=Textbook("steady", "JCGM 200 (VIM), 4.21: instrumental drift"),
        order=150,
    ),
    Effect(
        name="refraction",
        place="rig",
        size=EffectParameter("gradient_k_per_m", 0.2, 60.0, "K/m", "of the air's temperature"),
        reveals="angles against height and distance, all reflectors and nests alike",
        confounded=("tracker_drift",),
        forms=refraction,
        others=(ONSET,),
        textbook=Textbook("uniform", "Rüeger, Electronic Distance Measurement: a uniform gradient along the path"),
        varies_with=("time", "course", "temperature"),
        order=160,
    ),
    Effect(
        name="smr_reseat",
        place="smr",
        size=EffectParameter("shift_m", 1e-6, 4e-4, "m", "of one reflector"),
        reveals="time, one reflector against the others",
        confounded=(),
        forms=reseat,
        others=(ONSET,),
        untested=untested_in_short_campaign,
        declared=lambda nuisance: nuisance.reseat_m,
        measured="range",
        textbook=Textbook("step", "Estler et al. 2002, CIRP Annals 51(2): a target that is put back"),
        differs_by_visit=True,
        anew_by_visit="loose",
        order=170,
    ),
)
