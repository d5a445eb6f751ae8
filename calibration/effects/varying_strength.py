"""Basis sets of a textbook's form whose strength varies: the form times smooth functions of a coordinate, or from a
moment on.

Exact forms may leave nothing to see where their strength varies wholly: a softness that only creeps at rest, a payload
that drains. They would then be dropped before departures from them are tried (`calibration.diagnosis`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import BasisSet, BasisSets, Effect, EffectInputs
from calibration.effects.departures import functions_of_strength
from calibration.effects.onsets import ONSET

SHARE = 0.8  # standard deviation of what varies, over the form
WEIGHT = 0.2  # prior weight of a strength that varies with one coordinate, or with all, against the exact form
MOST_FORMS = 4  # with more variants the best of them has evidence enough by itself
ONSET_WEIGHT = 0.5  # of a strength that changes at a moment, as of what comes loose, is set anew or oiled


def with_varying_strength(effect: Effect) -> Effect:
    """The effect with basis sets of its textbook's form times functions of all that its strength varies with; where it
    has a parameter `onset_s`, also of another strength from that moment on."""
    textbook, exact_forms = effect.textbook, effect.forms
    if textbook is None or not effect.varies_with:
        return effect
    has_onset = any(parameter.name == ONSET.name for parameter in effect.others)

    def forms(inputs: EffectInputs, place: int) -> BasisSets:
        built = exact_forms(inputs, place)
        exact = {
            s.columns[0]: s for s in built.sets if len(s.columns) == 1 and built.named[s.columns[0]] == textbook.form
        }
        if len(exact) <= MOST_FORMS:
            _add(built, exact, functions_of_strength(inputs, effect, place))
            if has_onset and "t_s" not in inputs.context.not_said:
                _add_changing(built, exact, inputs, f"{effect.name}.{place}", textbook.form)
        return built

    return replace(effect, forms=forms)


def _add_changing(built: BasisSets, exact: Mapping[int, BasisSet], inputs: EffectInputs, name: str, form: str) -> None:
    """Of each column that is the form alone, the form with one strength until a moment and another one from it on."""
    t = inputs.context.elapsed_s
    for column, basis_set in exact.items():
        if ONSET.name in basis_set.parameters:  # what sets in at a moment already
            continue
        contributions = built.contributions[column]
        for onset_s, prior in inputs.strength_onsets(f"{name}.{column}", contributions):
            after = (t >= onset_s).astype(np.float64)
            both = np.column_stack([1.0 - after, after])
            until_and_from = built.add_along(contributions, both, form=f"{form}_changed")
            built.sets.append(
                replace(
                    basis_set,
                    columns=tuple(until_and_from),
                    relative=(1.0, 1.0),
                    spells=2,
                    parameters={**basis_set.parameters, ONSET.name: onset_s},
                    weight=ONSET_WEIGHT * prior * basis_set.weight,
                )
            )


def _add(built: BasisSets, exact: Mapping[int, BasisSet], functions: Sequence[Array]) -> None:
    """Of each column that is the form alone, the form times functions (n, k) of one coordinate each."""
    if not functions:
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
