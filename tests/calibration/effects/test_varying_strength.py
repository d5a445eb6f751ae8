"""Basis sets of a textbook's form whose strength varies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.effects.api import BasisSets, Effect, EffectParameter, Textbook
from calibration.effects.varying_strength import with_varying_strength
from tests.calibration.effects.general_functions import typical_inputs


@pytest.fixture(scope="module")
def inputs():
    return typical_inputs(20)


def pulled(count: int):
    """Forms of an effect: so many columns of its textbook's form, one in a basis set each, and one of another form."""

    def forms(inputs, place):
        sets = BasisSets()
        for power in range(count):
            shape = (1.0 + inputs.payload_ratio) ** (1 + power)
            sets.add_set(sets.add(("travel.left", shape), form="pull"), sign=-1.0, tau_s=float(power))
        sets.add_set(sets.add(("travel.left", inputs.context.dwell_s), form="other"))
        return sets

    return forms


def effect(count: int = 2, **changes) -> Effect:
    return replace(
        Effect(
            name="pull", place="drive", size=EffectParameter("size", 1e-9, 1.0, "m", "any"), reveals="anything",
            confounded=(), forms=pulled(count), textbook=Textbook("pull", "a source"), varies_with=("rest", "side"),
        ),
        **changes,
    )  # fmt: skip


def test_each_form_is_multiplied_by_functions_of_each_coordinate_and_of_all(inputs):
    plain, built = effect().forms(inputs, 0), with_varying_strength(effect()).forms(inputs, 0)
    assert built.sets[: len(plain.sets)] == plain.sets
    added = built.sets[len(plain.sets) :]
    assert len(added) == 2 * 3
    for of_form, basis_set in zip(sorted([*range(2)] * 3), added, strict=True):
        assert basis_set.columns[0] == of_form
        assert (basis_set.sign, basis_set.parameters["tau_s"]) == (-1.0, float(of_form))
        shapes = [dict(built.contributions[column])["travel.left"] for column in basis_set.columns]
        # What varies is the form's strength: over the form it is a function of rest and side alone.
        side, rest = inputs.context.direction[:, 0], inputs.context.dwell_s
        for row in range(len(side)):
            alike = (side == side[row]) & (rest == rest[row])
            for shape in shapes[1:]:
                np.testing.assert_allclose((shape / shapes[0])[alike], (shape / shapes[0])[row], rtol=1e-9)
        assert all(built.named[column] == "" for column in basis_set.columns[1:])
        together = np.sqrt(np.sum(np.square(basis_set.relative[1:])))
        assert basis_set.relative[0] == 1.0
        assert 0.3 < together < 1.5


def test_a_side_from_which_every_pose_was_approached_adds_no_other_columns(inputs):
    """A twin asks for other sides; the campaign's columns must be the same then."""
    one_side = replace(inputs.context, direction=np.ones_like(inputs.context.direction))
    built = with_varying_strength(effect()).forms(replace(inputs, context=one_side), 0)
    assert [s.columns for s in built.sets] == [s.columns for s in with_varying_strength(effect()).forms(inputs, 0).sets]
    assert all(np.all(np.isfinite(shape)) for column in built.contributions for _, shape in column)


@pytest.mark.parametrize("changes", [{"textbook": None}, {"varies_with": ()}, {"forms": pulled(5)}])
def test_others_stay_as_they_are(inputs, changes):
    """Without a textbook's form or a coordinate; and with so many variants that the best has evidence by itself."""
    alone = effect(**changes)
    assert with_varying_strength(alone).forms(inputs, 0).sets == alone.forms(inputs, 0).sets


TIMES = ("time",)
ONSET_OF_IT = EffectParameter("onset_s", 10.0, 1e4, "s", "its own")


def test_a_form_has_another_strength_from_the_moments_on_at_which_it_is_asked_to_change(inputs):
    """Of each of its columns, by a name of its own; what the form is elsewhere or of another effect is not asked."""
    asked = {}

    def strength_onsets(name, column):
        asked[name] = column
        return [(300.0, 0.5), (900.0, 0.1)]

    plain = effect().forms(inputs, 1)
    changing = with_varying_strength(effect(varies_with=TIMES, others=(ONSET_OF_IT,)))
    built = changing.forms(replace(inputs, strength_onsets=strength_onsets), 1)
    assert sorted(asked) == ["pull.1.0", "pull.1.1"]
    assert all(column == built.contributions[int(name[-1])] for name, column in asked.items())
    found = [s for s in built.sets if "onset_s" in s.parameters]
    assert [s.columns[1] - s.columns[0] for s in found] == [1] * 4
    assert [s.parameters["onset_s"] for s in found] == [300.0, 900.0] * 2
    assert [s.parameters["tau_s"] for s in found] == [0.0, 0.0, 1.0, 1.0]
    assert [s.weight / found[0].weight for s in found] == pytest.approx([1.0, 0.2, 1.0, 0.2])
    assert found[0].weight < 0.5 * plain.sets[0].weight
    for number, basis_set in zip((0, 0, 1, 1), found, strict=True):
        (_, form), (_, until), (_, from_then) = (built.contributions[c][0] for c in (number, *basis_set.columns))
        after = inputs.context.elapsed_s >= basis_set.parameters["onset_s"]
        np.testing.assert_array_equal(until, np.where(after, 0.0, form))
        np.testing.assert_array_equal(from_then, np.where(after, form, 0.0))
        assert (basis_set.relative, basis_set.main, basis_set.sign) == ((1.0, 1.0), basis_set.columns, -1.0)
        assert basis_set.spells == 2
        assert {built.named[c] for c in basis_set.columns} == {"pull_changed"}  # a formula, which may be left out
    assert not [s for s in built.without_forms({"pull_changed"}).sets if "onset_s" in s.parameters]


def test_what_has_no_onset_or_sets_in_already_is_not_asked_when_it_changes(inputs):
    def strength_onsets(name, column):
        raise AssertionError(name)

    def sets_in(inputs, place):
        sets = pulled(2)(inputs, place)
        sets.sets = [replace(s, parameters={"onset_s": 100.0}) for s in sets.sets]
        return sets

    for changes in ({}, {"others": (ONSET_OF_IT,), "forms": sets_in}):
        varying = with_varying_strength(effect(varies_with=TIMES, **changes))
        varying.forms(replace(inputs, strength_onsets=strength_onsets), 0)
