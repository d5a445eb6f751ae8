"""Basis sets of a textbook's form whose strength varies: the form times smooth functions of a coordinate.

Exact forms may leave nothing to see where their strength varies wholly: a softness that only creeps at rest, a payload
that drains. They would then be dropped before departures from them are tried (`calibration.diagnosis`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import BasisSets, Effect, EffectInputs
from calibration.effects.departures import functions_of_strength

SHARE = 0.8  # standard deviation of what varies, over the form
WEIGHT = 0.2  # prior weight of a strength that varies with one coordinate, or with all, against the exact form
MOST_FORMS = 4  # with more variants the best of them has evidence enough by itself


def with_varying_strength(effect: Effect) -> Effect:
    """The effect with basis sets of its textbook's form times functions of all that its strength varies with."""
    textbook, exact_forms = effect.textbook, effect.forms
    if textbook is None or not effect.varies_with:
        return effect

    def forms(inputs: EffectInputs, place: int) -> BasisSets:
        built = exact_forms(inputs, place)
        _add(built, textbook.form, functions_of_strength(inputs, effect, place))
        return built

    return replace(effect, forms=forms)


def _add(built: BasisSets, form: str, functions: Sequence[Array]) -> None:
    """Of each column that is the form alone; functions (n, k) of one coordinate each."""
    exact = {s.columns[0]: s for s in built.sets if len(s.columns) == 1 and built.named[s.columns[0]] == form}
    if len(exact) > MOST_FORMS or not functions:
        return
    for column, basis_set in exact.items():
        alone = [
            built.add(*((channel, shape[:, None] * of_one) for channel, shape in built.contributions[column]))
            for of_one in functions
        ]
        together = [c for columns in alone for c in columns]
        each = SHARE / float(np.sqrt(len(alone)))
        for varying, share in (*((columns, SHARE) for columns in alone), (together, each)):
            built.sets.append(
                replace(
                    basis_set,
                    columns=(column, *varying),
                    relative=(1.0, *(share,) * len(varying)),
                    weight=WEIGHT * basis_set.weight,
                )
            )
