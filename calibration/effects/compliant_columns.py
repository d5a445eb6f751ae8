"""Columns and carriages that give way under the struts' forces, which are those of the fitted model."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import BasisSets, EffectInputs, varies
from calibration.effects.basis_functions import cosine_basis

LEVER_M = 0.25
LOAD_TERMS, LOAD_WEIGHT = 3, 0.1  # of any function of the load, against proportion
FORCE_TERMS = 3  # of any function of a column's force, and of its place
UNEVEN_TERMS, UNEVEN_WEIGHT = 14, 0.3  # of what is softer between its bolts
LEAST_LOAD_CHANGE = 0.1  # of the payload over the largest one
CREEP_TIMES_S = (400.0, 1600.0)
PASSED_WEIGHT = 0.05  # of a force on another column that bends this one
BED_WEIGHT = 0.1  # of weights that bend the bed below all columns
HUNG_WEIGHT = 0.2  # of a weight that hangs before its column and bends it


def compliance(inputs: EffectInputs, drive: int) -> BasisSets:
    """The column or the carriage on it yields: across the guide, in rotation, along the screw."""
    sets, u = BasisSets(), inputs.normalised_travel(drive)
    higher = np.stack([u, u**2], axis=1)
    axis = inputs.machine.nominal.axis[drive]
    pull = inputs.pull_n[:, drive]
    directions = [(c, pull @ np.eye(3)["xyz".index(c[-1])]) for c in inputs.channels_of_drive("sideways", drive)]
    directions += [(c, inputs.moment_nm[:, drive] / LEVER_M**2) for c in inputs.channels_of_drive("turn", drive)]
    directions += [(f"travel.{inputs.drive(drive)}", pull @ axis)]
    # By any function of the load, at once or as a part that creeps.
    loads = [
        cosine_basis(load, LOAD_TERMS)
        for load in (inputs.payload_ratio, *inputs.once("creeping", lambda: _creeping_loads(inputs)))
        if varies(load, LEAST_LOAD_CHANGE)
    ]
    _add_passed_on(sets, inputs, drive)
    _add_hung_before(sets, inputs, drive)
    for channel, force in directions:
        size = max(float(np.std(force)), 1.0)
        mean = force.mean()
        main = sets.add((channel, force), form="force")
        loaded = sets.add((channel, mean * (inputs.payload_ratio - 0.5)), form="payload")
        placed = sets.add((channel, force[:, None] * higher), form="force_by_travel")
        anyhow = sets.add(
            (
                channel,
                np.column_stack(
                    [force[:, None] * cosine_basis(u, FORCE_TERMS), size * cosine_basis(force, FORCE_TERMS)]
                ),
            )
        )
        bent = np.stack([(force - mean) ** 2 / size, (force - mean) ** 3 / size**2], axis=1)
        hard = sets.add((channel, bent), form="force_bent")
        sets.add_set(main, sign=1.0)
        sets.add_set(main, placed, share=0.6, sign=1.0)
        sets.add_set(main, anyhow, share=0.6, sign=1.0)
        uneven = sets.add((channel, force[:, None] * cosine_basis(u, UNEVEN_TERMS, roughness=0.5)))
        sets.add_set(main, uneven, share=0.8, weight=UNEVEN_WEIGHT, sign=1.0)
        sets.add_set(main, (*placed, *hard, *loaded), share=0.2, sign=1.0)
        typical = float(np.sqrt(np.mean(force**2)))
        for load in loads:
            sets.add_set(sets.add((channel, typical * load)), weight=LOAD_WEIGHT)
    return sets


def _add_passed_on(sets: BasisSets, inputs: EffectInputs, drive: int) -> None:
    """A crossbeam passes on to a column what bends another one, the more the higher the carriage stands there."""
    h = inputs.height_m(drive)
    for other in inputs.other_drives(drive):
        where = cosine_basis(inputs.normalised_travel(other), FORCE_TERMS, constant=True)
        for side, turn, sign in inputs.leaning(drive):
            force = inputs.pull_n[:, other, "xyz".index(side[-1])]
            passed = force[:, None] * where
            sets.add_set(sets.add((side, sign * passed * h[:, None]), (turn, passed)), weight=PASSED_WEIGHT)


def _add_hung_before(sets: BasisSets, inputs: EffectInputs, drive: int) -> None:
    """What pulls along the axis hangs before the column and bends it, the more the higher the carriage stands; or all
    that hangs on the columns bends the bed between them, on which they lean."""
    h, pull = inputs.height_m(drive), inputs.pull_along_n(drive)
    for side, turn, sign in inputs.leaning(drive):
        moment = sets.add((side, 0.5 * sign * pull * h**2), (turn, pull * h), form="hung_before")
        elsewhere = sets.add((side, sign * pull * h), (turn, pull))  # bent from another height on
        sets.add_set(moment, elsewhere, share=0.5, weight=HUNG_WEIGHT)
        on_bed = [elsewhere] + [
            sets.add((side, sign * inputs.pull_along_n(other) * h), (turn, inputs.pull_along_n(other)))
            for other in inputs.other_drives(drive)
        ]
        sets.add_set([c for columns in on_bed for c in columns], weight=BED_WEIGHT)


def _creeping_loads(inputs: EffectInputs) -> list[Array]:
    """The payload (n,) over the largest one as a part feels it that creeps (Findley, Lai, Onaran, Creep and Relaxation
    of Nonlinear Viscoelastic Materials: Kelvin's element), with several time constants."""
    if "t_s" in inputs.context.not_said:
        return []
    return [inputs.context.lagging(inputs.payload_ratio, tau_s) for tau_s in CREEP_TIMES_S]
