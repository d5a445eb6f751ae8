"""Basis sets of a textbook's form whose strength varies: the form times smooth functions of a coordinate.

Exact forms may leave nothing to see where their strength varies wholly: a softness that only creeps at rest, a payload
that drains. They would then be dropped before departures from them are tried (`calibration.diagnosis`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.effects.api import BasisSets, Effect, EffectInputs
from calibration.effects.departures import functions_it_varies_with

SHARE = 0.8  # standard deviation of what varies, over the form
ALONE_WEIGHT, TOGETHER_WEIGHT = 0.2, 0.2  # prior weight, against the exact form, of one coordinate and of all
MOST_FORMS = 4  # with more parameters the best of them has evidence enough by itself


def with_varying_strength(effect: Effect) -> Effect:
    """The effect with basis sets of its textbook's form times functions of all that it varies with."""
    if effect.textbook is None or not effect.varies_with:
        return effect
    forms = effect.forms

    def and_varying(inputs: EffectInputs, place: int) -> BasisSets:
        built = forms(inputs, place)
        _add(built, inputs, effect, place)
        return built

    return replace(effect, forms=and_varying)


def _add(built: BasisSets, inputs: EffectInputs, effect: Effect, place: int) -> None:
    assert effect.textbook is not None
    exact = {
        s.columns[0]: s for s in built.sets if len(s.columns) == 1 and built.named[s.columns[0]] == effect.textbook.form
    }
    if not 0 < len(exact) <= MOST_FORMS:
        return
    functions = list(functions_it_varies_with(inputs, effect, place).values())
    for column, basis_set in exact.items():
        groups = [
            built.add(*((channel, shape[:, None] * of_one) for channel, shape in built.contributions[column]))
            for of_one in functions
        ]
        together = [c for group in groups for c in group]
        choices = [(group, SHARE, ALONE_WEIGHT) for group in groups]
        choices.append((together, SHARE / np.sqrt(max(len(groups), 1)), TOGETHER_WEIGHT))
        for varying, share, weight in choices:
            if varying:
                built.sets.append(
                    replace(
                        basis_set,
                        columns=(column, *varying),
                        relative=(1.0, *(share,) * len(varying)),
                        weight=weight * basis_set.weight,
                    )
                )
