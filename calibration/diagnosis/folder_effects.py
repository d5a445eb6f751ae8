"""Kinds of errors that a machine's former fit left alone, as possible causes of what that fit leaves.

Each kind is one effect with a column for each of its unknowns; the size is the root of the sum of squares of their
changes. Their plausible range is counted in standard deviations of the tolerances.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from calibration.diagnosis.channel_responses import UNKNOWN_CHANNEL
from calibration.effects.api import BasisSets, Effect, EffectInputs, EffectParameter
from calibration.model.model import Unknown

LEAST_SIGMAS, MOST_SIGMAS = 0.1, 300.0  # of a tolerance: nobody stated it, and the readings alone tell kinds apart
OF_GEOMETRY = "geometry."
OF_INSTRUMENT = "instrument."


def effects_of_unknowns(unknowns: Sequence[Unknown], of_machine: Sequence[str]) -> Iterator[Effect]:
    """An effect for each kind and unit, named as `identify` names the kind; of_machine: the machine's kinds."""
    for kind in dict.fromkeys(unknown.name.partition(".")[0] for unknown in unknowns):
        of_kind = [unknown for unknown in unknowns if unknown.name.partition(".")[0] == kind]
        for unit in dict.fromkeys(unknown.unit for unknown in of_kind):
            some = [unknown for unknown in of_kind if unknown.unit == unit]
            prefix = OF_GEOMETRY if kind in of_machine else OF_INSTRUMENT
            yield _effect(f"{prefix}{kind if len(some) > 1 else some[0].name}", some)


def _effect(name: str, unknowns: Sequence[Unknown]) -> Effect:
    sigma = float(np.sqrt(np.mean([unknown.sigma**2 for unknown in unknowns])))

    def forms(inputs: EffectInputs, _: int) -> BasisSets:
        sets, one = BasisSets(), np.ones(len(inputs.context))
        columns = [c for u in unknowns for c in sets.add((f"{UNKNOWN_CHANNEL}{u.name}", one * u.sigma / sigma))]
        sets.add_set(columns)
        return sets

    unit = unknowns[0].unit
    named = {"m": "change_m", "rad": "change_rad"}.get(unit, "change")
    meaning = "root of the sum of squares of the changes of all its unknowns"
    return Effect(
        name=name,
        place="rig",
        size=EffectParameter(named, LEAST_SIGMAS * sigma, MOST_SIGMAS * sigma, unit, meaning),
        reveals="readings that the former fit does not close",
        confounded=(),
        forms=forms,
    )
