"""The general functions of the effects are those of the list: what they change is changed on purpose."""

from __future__ import annotations

import difflib
from dataclasses import replace

import numpy as np

from calibration.effects.api import BasisSets, Effect, EffectParameter
from calibration.effects.catalogue import Catalogue
from tests.calibration.effects import general_functions
from tests.calibration.effects.general_functions import LIST, RENEW, listed, typical_inputs


def test_general_functions_are_those_of_the_list():
    kept, found = LIST.read_text(encoding="utf-8").splitlines(), listed(typical_inputs()).splitlines()
    changes = "\n".join(difflib.unified_diff(kept, found, "the list", "the effects", lineterm="", n=0))
    assert not changes, f"general functions have changed; if that is meant, `{RENEW}` writes the list anew:\n{changes}"


def test_the_list_says_what_a_function_is_of(monkeypatch):
    """Named columns do not count; of a product of two coordinates both do."""

    def forms(inputs, place):
        built, context = BasisSets(), inputs.context
        u = inputs.normalised_travel(place)
        built.add(("travel.left", u), form="law")
        built.add(("travel.left", context.dwell_s * u), ("turn.left.z", u))
        built.add(("travel.left", np.stack([context.torque[:, 1], context.torque[:, 1] ** 2], axis=1)))
        built.add(("travel.left", np.ones(len(context))))
        return built

    effect = Effect("made_here", "drive", EffectParameter("size_m", 1e-6, 1e-4, "m", "of it"), "all", (), forms)
    monkeypatch.setattr(general_functions, "load_catalogue", lambda: Catalogue((effect, replace(effect, name="b"))))
    first = listed(typical_inputs()).split("\n\n")[1]
    assert first.splitlines() == [
        "made_here",
        "   1 through travel.left + turn.left.z over rest, travel of left",
        "   1 through travel.left over nothing",
        "   2 through travel.left over torque of right",
    ]
