"""Errors that depend on the approach direction: backlash, and screw wind-up by friction."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import BasisSets, Effect, EffectInputs, EffectParameter, geometric_series, varies
from calibration.effects.basis_functions import cosine_basis

DWELL_TIMES_S = geometric_series(1.5, 15.0, 3)
RATED_N = 6000.0  # force at rated torque, for the plausible range only: the torque's own scale is unknown


def _untested_from_one_side(inputs: EffectInputs) -> str | None:
    both = all(np.any(column > 0.0) and np.any(column < 0.0) for column in inputs.context.direction.T)
    return None if both else "every pose was approached from one side; measure both directions"


def backlash(inputs: EffectInputs, drive: int) -> BasisSets:
    """Half the play, opposite to the approach direction; its width may depend on position, payload and dwell."""
    sets, travel = BasisSets(), f"travel.{inputs.drive(drive)}"
    side = -0.5 * inputs.context.direction[:, drive]
    rest = np.stack([np.exp(-inputs.context.dwell_s / tau) for tau in DWELL_TIMES_S], axis=1)
    main = sets.add((travel, side))
    place = sets.add((travel, side[:, None] * cosine_basis(inputs.context.drives[:, drive], 6, roughness=1.0)))
    load = sets.add((travel, side * (inputs.payload_ratio - 0.5)))
    resting = [sets.add((travel, side * column)) for column in rest.T]
    sets.add_set(main)
    sets.add_set(main, place, share=0.5)
    sets.add_set(main, load, share=0.7)
    for column in resting:
        sets.add_set((*main, *column))
    sets.add_set(main, (*place, *load, *resting[1]), share=0.3)
    return sets


def friction_windup(inputs: EffectInputs, drive: int) -> BasisSets:
    """The screw is wound up by its torque: the weight, and the friction that remained when the drive stopped."""
    sets, travel = BasisSets(), f"travel.{inputs.drive(drive)}"
    force = _torque_at_rest(inputs, drive) * RATED_N
    force = force - force.mean()
    size = max(float(np.std(force)), 1.0)
    main = sets.add((travel, -force))
    bent = sets.add((travel, np.stack([force**2 / size, force**3 / size**2], axis=1)))
    sets.add_set(main)
    sets.add_set(main, bent, share=0.2)
    return sets


def _torque_at_rest(inputs: EffectInputs, drive: int) -> Array:
    """Torque (n,) at rest; for readings on the fly it is predicted from payload and approach direction."""
    context = inputs.context
    torque, at_rest = context.torque[:, drive], ~context.moving
    if np.all(at_rest) or not np.any(at_rest):
        return torque
    regressors = np.stack([np.ones(len(torque)), inputs.payload_ratio, context.direction[:, drive]], axis=1)
    coefficients = np.linalg.lstsq(regressors[at_rest], torque[at_rest], rcond=None)[0]
    return np.where(at_rest, torque, regressors @ coefficients)


def _untested_without_torque(inputs: EffectInputs) -> str | None:
    if not varies(inputs.context.torque, 1e-3):
        return "the recording holds no varied torque"
    return _untested_from_one_side(inputs)


EFFECTS = (
    Effect(
        name="backlash",
        place="drive",
        size=EffectParameter("width_m", 1e-6, 5e-4, "m", "whole play of the drive"),
        reveals="both directions of approach",
        confounded=("friction_windup", "servo_settling"),
        forms=backlash,
        untested=_untested_from_one_side,
        declared=lambda nuisance: 2.0 * nuisance.reversal_m,
        order=40,
    ),
    Effect(
        name="friction_windup",
        place="drive",
        size=EffectParameter("windup_m_per_n", 5e-10, 2e-7, "m/N", "axial displacement a force, at 6 kN rated force"),
        reveals="torque: both directions and payloads",
        confounded=("backlash", "column_compliance"),
        forms=friction_windup,
        untested=_untested_without_torque,
        order=50,
    ),
)
