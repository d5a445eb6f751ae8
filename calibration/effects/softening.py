"""Struts that become softer while the campaign runs."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import BasisSets, EffectInputs
from calibration.effects.basis_functions import scale_to_unit

LEAST_OWN = 0.05  # of the largest restraint of a strut by the others
ONSETS, SOFTENING_WEIGHT = 12, 0.5  # of a softness that sets in, against one that is there from the start
OVERLOADS = (0.6, 0.85)  # shares of the visits whose force does no harm


def add_softening(sets: BasisSets, inputs: EffectInputs, strut: int, strain_m: Array) -> None:
    """A strut that becomes softer, at a moment or by and by, as by bolts that work loose: it grows by its tension, of
    which the share by misfits of all struts is hardly known, and which falls the more the softer it becomes."""
    machine, elapsed_s = inputs.machine, inputs.context.elapsed_s
    name, drive = f"length.{machine.strut_names[strut]}", int(machine.strut_drive[strut])
    size = max(float(np.std(strain_m)), 1e-9)
    by_misfit = inputs.tension_response_n_per_m[:, strut]
    by_misfit = size * by_misfit / np.maximum(np.abs(by_misfit).max(axis=0), 1e-9)
    own = np.abs(by_misfit[:, strut] / size)
    carrying_nothing = strain_m / np.maximum(own, LEAST_OWN)  # it grows until the others carry its force
    courses = [((elapsed_s >= onset_s).astype(np.float64), prior * ONSETS) for onset_s, prior in inputs.onsets((name,))]
    courses.append((scale_to_unit(elapsed_s), 1.0))
    if drive >= 0 and "history" not in inputs.context.not_said:
        courses.append((scale_to_unit(inputs.context.way_m(drive)), 1.0))
        for least in OVERLOADS:
            worn = inputs.context.worn_beyond(np.abs(strain_m), least)
            courses.append((worn, 1.0 / len(OVERLOADS)))
    for course, weight in courses:
        softer, all_lost = (sets.add((name, course * strain)) for strain in (strain_m, carrying_nothing))
        misfits = sets.add((name, course[:, None] * by_misfit))
        loaded = sets.add((name, course * strain_m * inputs.payload_ratio))
        faster = sets.add((name, (course**2 - course)[:, None] * np.column_stack([strain_m, by_misfit])))
        flexible = (*all_lost, *misfits, *loaded, *faster)
        sets.add_set(softer, flexible, share=0.7, weight=SOFTENING_WEIGHT * weight)
