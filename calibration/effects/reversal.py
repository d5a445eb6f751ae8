"""Errors that depend on the approach direction: backlash, and screw wind-up by friction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import (
    BasisSets,
    Coordinate,
    Effect,
    EffectInputs,
    EffectParameter,
    Textbook,
    varies,
)
from calibration.effects.basis_functions import (
    any_course,
    cosine_basis,
    curve_over,
    random_walk_basis,
    rises_of_curve,
    tensor_product,
)
from calibration.effects.departures import WARMTH_S
from calibration.effects.onsets import ONSET

LEAST_PAUSES, REST_TERMS, PAUSE_WEIGHT = 0.7, 4, 0.3  # of the logarithm of the rest before a motion
LOAD_TERMS = 3  # of any function of the load, or of what presses a carriage into its guides
ANY_LOAD_WEIGHT = 0.3  # what grows with the load is wind-up rather than play
FLANK_WEIGHT = 0.05  # of a load that says on which flank it lies, as under a counterweight
LEAST_N = 1e-9  # of what presses across a guide: less is nothing
LENGTH_TERMS = 3  # of any function of the length that is wound up
WARMTH_TERMS, WARMTH_WEIGHT = 2, 0.3  # of any function of what warms its grease
DRAG_TERMS, DRAG_WEIGHT = 6, 0.2  # of any function of the place by which something drags beside the weight
LEAST_WAY_M, RUN_IN_TERMS = 1e-9, 12  # of any course by which it does, in time or over the way that it has gone
ANY_FORCE_WEIGHT = 0.3  # what goes with a force may do so along any smooth curve
PRESSED_LEAST = 0.1  # variation of what presses on the nut, over its largest
LEAST_KG = 1e-9  # of what moves, where no mass is stated
FRICTION_SHARE = 0.1  # of the rated force: plausible, where friction is not seen in the torque
RATED_N = 6000.0  # force at rated torque, for the plausible range only: the torque's own scale is unknown


def _untested_from_one_side(inputs: EffectInputs) -> str | None:
    both = all(np.any(column > 0.0) and np.any(column < 0.0) for column in inputs.context.direction.T)
    return None if both else "every pose was approached from one side; measure both directions"


def backlash(inputs: EffectInputs, drive: int) -> BasisSets:
    """Half the play, opposite to the approach direction, of any width by load; or on the flank that is pressed."""
    sets, travel = BasisSets(), f"travel.{inputs.drive(drive)}"
    side = -0.5 * inputs.context.direction[:, drive]
    main = sets.add((travel, side), form="play")
    sets.add_set(main, sign=1.0)
    pull_n = inputs.pull_along_n(drive)
    if varies(pull_n, PRESSED_LEAST * float(np.abs(pull_n).max())):  # where hardly any load is left it lies by the side
        flank = cosine_basis(pull_n, LOAD_TERMS, roughness=1.0)
        by_load = sets.add((travel, np.column_stack([0.5 * flank, side[:, None] * flank])))
        sets.add_set(main, by_load, share=1.0, weight=FLANK_WEIGHT, sign=1.0)
    if varies(inputs.payload_ratio, PRESSED_LEAST):
        any_load = sets.add((travel, side[:, None] * cosine_basis(inputs.payload_ratio, LOAD_TERMS)))
        sets.add_set(main, any_load, share=0.6, weight=ANY_LOAD_WEIGHT, sign=1.0)
    return sets


def friction_windup(inputs: EffectInputs, drive: int) -> BasisSets:
    """The screw is wound up by its torque: the weight, and the friction that remained when the drive stopped.

    Friction grows with what presses on the nut, the weight above all (Coulomb). Torsion goes with the length between
    motor and nut, that of a coupling or a gear does not.
    """
    sets, travel, context = BasisSets(), f"travel.{inputs.drive(drive)}", inputs.context
    by_side = -FRICTION_SHARE * RATED_N * context.direction[:, drive]  # of friction that is not seen in the torque
    mass = inputs.machine.moving_mass_kg + context.payload_kg
    heaviest = max(float(mass.max()), LEAST_KG)
    along = cosine_basis(context.drives[:, drive], LENGTH_TERMS)
    by_torque: list[tuple[str, Array]] = []
    if _torque_varies(inputs):
        force = _torque_at_rest(inputs, drive) * RATED_N
        weight = _weight_share(inputs, drive, force)
        by_torque = [("torque", force), ("friction_in_torque", force - weight), ("weight_in_torque", weight)]
    by_weight: list[int] = []
    for form, wound in by_torque:
        by_weight = sets.add((travel, -wound), form=form)  # the last one
        sets.add_set(by_weight)
        any_way = sets.add((travel, -float(np.ptp(wound)) * _from_no_force(curve_over(wound), wound)))
        anywhere = sets.add((travel, -wound[:, None] * along))
        sets.add_set(any_way, anywhere, share=0.4, weight=ANY_FORCE_WEIGHT, size=rises_of_curve())
    if varies(mass / heaviest, PRESSED_LEAST):  # else nothing tells it from play
        sets.add_set(sets.add((travel, by_side * mass / heaviest), form="coulomb"))
    pull_n = inputs.pull_n[:, drive]
    across_n = np.linalg.norm(pull_n - np.outer(inputs.pull_along_n(drive), inputs.machine.nominal.axis[drive]), axis=1)
    if varies(across_n, PRESSED_LEAST * max(float(across_n.max()), LEAST_N)):  # struts press it into its guides
        any_press = cosine_basis(across_n, LOAD_TERMS, constant=True)
        sets.add_set(sets.add((travel, by_side[:, None] * any_press)))
    if not {"t_s", "history", "speed_m_per_s"} & context.not_said.keys():
        rested = np.log(context.pause_s() + 1.0)
        if varies(rested, LEAST_PAUSES):  # contacts grow firm while they rest
            firmer = cosine_basis(rested, REST_TERMS, constant=True)
            sets.add_set(sets.add((travel, by_side[:, None] * firmer)), weight=PAUSE_WEIGHT)
    _add_friction_of_grease(sets, inputs, drive)
    _add_friction_beside_load(sets, inputs, drive, by_weight)
    return sets


def _add_friction_beside_load(sets: BasisSets, inputs: EffectInputs, drive: int, by_weight: Sequence[int]) -> None:
    """What the load winds up, the weight in the torque or what the struts pull, and beside it friction of covers and
    seals, by any function of the place, of time or of the way as they run in, or of grease that the speed stirs and
    motions warm."""
    travel, context = f"travel.{inputs.drive(drive)}", inputs.context
    loads, pull_n = [by_weight] if by_weight else [], inputs.pull_along_n(drive)
    if varies(pull_n, PRESSED_LEAST * max(float(np.abs(pull_n).max()), LEAST_N)):
        loads.append(sets.add((travel, pull_n), form="pull"))
    dragged = -FRICTION_SHARE * RATED_N * context.direction[:, drive]
    one = np.ones(len(context))
    functions = [cosine_basis(context.drives[:, drive], DRAG_TERMS, constant=True)]
    if "t_s" not in context.not_said:
        functions.append(np.column_stack([one, any_course(context.elapsed_s, RUN_IN_TERMS)]))
    if "history" not in context.not_said:
        way_m = context.way_m(drive)
        gone = way_m / max(float(way_m.max()), LEAST_WAY_M)
        functions.append(np.column_stack([one, random_walk_basis(gone, RUN_IN_TERMS)]))
    if "speed_m_per_s" not in context.not_said:
        stirred = cosine_basis(context.speed_m_per_s, WARMTH_TERMS, constant=True)
        warm = [cosine_basis(course, WARMTH_TERMS) for course in _warmths(inputs, drive)]
        functions.append(tensor_product(stirred, np.column_stack([one, *warm])))
    for by_coordinate in functions:
        drag = sets.add((travel, dragged[:, None] * by_coordinate))
        for load in loads:
            sets.add_set((*load, *drag), weight=DRAG_WEIGHT)


def _add_friction_of_grease(sets: BasisSets, inputs: EffectInputs, drive: int) -> None:
    """Grease is stiff in the cold, and its drive's motions warm it: friction by any function of either, or of both."""
    functions = [cosine_basis(course, WARMTH_TERMS) for course in _warmths(inputs, drive)]
    if not functions:
        return
    travel = f"travel.{inputs.drive(drive)}"
    wound = -FRICTION_SHARE * RATED_N * inputs.context.direction[:, drive]
    constant = sets.add((travel, wound))
    for by_warmth in (*functions, np.concatenate(functions, axis=1)):
        thinner = sets.add((travel, wound[:, None] * by_warmth))
        sets.add_set((*constant, *thinner), weight=WARMTH_WEIGHT)


def _warmths(inputs: EffectInputs, drive: int) -> list[Array]:
    """Courses (n,) that a drive's grease may follow: the recorded temperatures' mean, and what its motions warm."""
    context = inputs.context
    temperature = [context.mean_temperature_c()] if context.temperatures_c else []
    if {"t_s", "history"} & context.not_said.keys():
        return temperature
    return temperature + [context.motion_heat(drive, tau_s) for tau_s in WARMTH_S]


def _from_no_force(curves: Array, force_n: Array) -> Array:
    """Curves (n, k) whose trend over the force begins where there is none, as nothing is wound up there."""
    straight = np.column_stack([np.ones_like(force_n), force_n])
    return np.asarray(curves - np.linalg.lstsq(straight, curves, rcond=None)[0][0])


def _weight_share(inputs: EffectInputs, drive: int, force_n: Array) -> Array:
    """The part (n,) of the forces on a drive that goes with payload and place, and not with the direction."""
    u, load, side = inputs.normalised_travel(drive), inputs.payload_ratio, inputs.context.direction[:, drive]
    columns = np.stack([np.ones_like(u), load, u, u**2, load * u, side], axis=1)
    coefficients = np.linalg.lstsq(columns, force_n, rcond=None)[0]
    return np.asarray(columns[:, :-1] @ coefficients[:-1])


def _torque_at_rest(inputs: EffectInputs, drive: int) -> Array:
    """Torque (n,) at rest; for readings on the fly it is predicted from payload and approach direction."""
    context = inputs.context
    torque, at_rest = context.torque[:, drive], ~context.moving
    if np.all(at_rest) or not np.any(at_rest):
        return torque
    regressors = np.stack([np.ones(len(torque)), inputs.payload_ratio, context.direction[:, drive]], axis=1)
    coefficients = np.linalg.lstsq(regressors[at_rest], torque[at_rest], rcond=None)[0]
    return np.where(at_rest, torque, regressors @ coefficients)


def _torque_varies(inputs: EffectInputs) -> bool:
    return "torque" not in inputs.context.not_said and varies(inputs.context.torque, 1e-3)


def _untested_without_force(inputs: EffectInputs) -> str | None:
    """Friction that is not seen in a torque is told from play by what presses on the nut."""
    if not _torque_varies(inputs) and not varies(inputs.payload_ratio, PRESSED_LEAST):
        return "the recording holds neither a varied torque nor a varied payload"
    return _untested_from_one_side(inputs)


VARIES_WITH: tuple[Coordinate, ...] = (
    "own travel", "other travel", "approach", "payload", "rest", "speed", "time", "course", "way",
    "warmth", "temperature",
)  # fmt: skip

EFFECTS = (
    Effect(
        name="backlash",
        place="drive",
        size=EffectParameter("width_m", 1e-6, 5e-4, "m", "whole play of the drive"),
        reveals="both directions of approach",
        confounded=("friction_windup", "servo_settling"),
        forms=backlash,
        others=(ONSET,),
        untested=_untested_from_one_side,
        declared=lambda nuisance: 2.0 * nuisance.reversal_m,
        textbook=Textbook("play", "ISO 230-2: reversal value, half of it either side"),
        differs_by_visit=True,
        varies_with=VARIES_WITH,
        order=40,
    ),
    Effect(
        name="friction_windup",
        place="drive",
        size=EffectParameter("windup_m_per_n", 5e-10, 2e-7, "m/N", "axial displacement a force, at 6 kN rated force"),
        reveals="torque: both directions and payloads",
        confounded=("backlash", "column_compliance"),
        forms=friction_windup,
        others=(ONSET,),
        untested=_untested_without_force,
        textbook=Textbook("torque", "Slocum, Precision Machine Design: wind-up of a screw, Hooke's law"),
        differs_by_visit=True,
        varies_with=VARIES_WITH,
        order=50,
    ),
)
