"""Departures from a form, and a strength that varies with something, against dense mixtures of all their ways."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis import departure_evidence
from calibration.diagnosis.basis_set_evidence import SIZES, evidence_of_basis_sets
from calibration.diagnosis.effect_inputs import inputs_of_readings
from calibration.diagnosis.one_way import loss_of_one_way
from calibration.effects.api import BasisSet, BasisSets, EffectParameter
from calibration.effects.basis_functions import cosine_basis, random_walk_basis, steps_over, tensor_product, wave_of
from calibration.effects.departures import functions_it_varies_with, functions_of_change, functions_of_coordinates
from tests.calibration.diagnosis.dense import HIGH, LOW, dense, explicit, log_density, with_forms_at
from tests.calibration.effects.general_functions import typical_inputs

PERIOD_M = EffectParameter("period_m", 1e-3, 0.1, "m", "of the wave")


def planted_with(small, likelihood, effect, strength, *, sign=0.0, by_visit=False, anew=False):
    """Likelihood with an effect of a strength (n,) planted on the readings, and what is found of it with departures."""
    inputs = inputs_of_readings(small, likelihood.channels, lambda *_: [], lambda *_: [])
    (form,) = effect.forms(inputs, 0).contributions
    ((channel, shape),) = form
    shift = explicit(small, likelihood, [((channel, shape * strength),)])[:, 0] * 8.0e-5
    planted = likelihood.on(replace(small, residual=small.residual + shift.reshape(-1, 3)))
    basis_sets = [BasisSet((0,), (1.0,), sign=sign)]
    (exact,) = evidence_of_basis_sets(planted.information_and_score([form]), basis_sets, LOW, HIGH)
    found = departure_evidence.with_departures(
        planted, inputs, effect, 0, exact, [form], LOW, by_visit=by_visit, anew=anew
    )
    return planted, found


@pytest.mark.parametrize(("by_visit", "varies_with"), [(False, ()), (True, ()), (False, ("payload", "rest"))])
def test_departures_have_the_evidence_of_a_dense_mixture(small, likelihood, by_visit, varies_with, monkeypatch):
    """As likely as one another: the exact form, a little of everything, one coordinate alone, and shares by visit; half
    as likely, all that the strength may depend on together, and each of it alone."""
    monkeypatch.setattr(departure_evidence, "SMOOTH_SHARES", (0.1,))
    monkeypatch.setattr(departure_evidence, "SHARES_BY_VISIT", (0.5,))
    few = ("travel.left", "payload")
    every = functions_of_coordinates
    monkeypatch.setattr(
        departure_evidence, "functions_of_coordinates", lambda *of: {name: every(*of)[name] for name in few}
    )
    inputs = inputs_of_readings(small, likelihood.channels, lambda *_: [], lambda *_: [])
    effect = replace(with_forms_at(0), differs_by_visit=True, varies_with=varies_with)
    arrival = small.context.arrival
    share = np.random.default_rng(6).uniform(0.0, 1.0, int(arrival.max()) + 1)[arrival]
    planted, found = planted_with(small, likelihood, effect, share, by_visit=by_visit)

    (form,) = effect.forms(inputs, 0).contributions
    ((channel, shape),) = form
    inverse = np.linalg.inv(dense(small))
    groups = {
        name: explicit(small, likelihood, [((channel, shape * f),) for f in functions.T])
        for name, functions in functions_of_coordinates(inputs, effect, 0).items()
        if name in few
    }
    visits = explicit(small, likelihood, [((channel, shape * (arrival == v)),) for v in np.unique(arrival)])
    column = explicit(small, likelihood, [form])

    def seen(columns):
        return np.einsum("ik,ij,jk->", columns, inverse, columns)

    def scaled(columns, part):
        return columns * part * min(1.0, np.sqrt(seen(column) / seen(columns)))

    ways = [(1.0, column)]
    ways.append((1.0, np.hstack([column, *(scaled(columns, 0.1 / np.sqrt(2.0)) for columns in groups.values())])))
    ways += [(0.5, np.hstack([column, scaled(columns, 0.1)])) for columns in groups.values()]
    expected = [
        explicit(small, likelihood, [((channel, shape * f),) for f in functions.T])
        for functions in functions_it_varies_with(inputs, effect, 0).values()
    ]
    for size in (0.4, 1.0) if expected else ():
        together = [scaled(columns, size / np.sqrt(len(expected))) for columns in expected]
        ways.append((0.25, np.hstack([column, *together])))
        ways += [(0.25 / len(expected), np.hstack([column, scaled(columns, size)])) for columns in expected]
    without_unexpected = [ways[0], *ways[4:]]
    if by_visit:
        ways.append((1.0, np.hstack([column, scaled(visits, 0.5)])))
    prior = sum(weight for weight, _ in ways)
    y, sizes = planted.linear.residual.ravel(), np.geomspace(LOW, HIGH, SIZES)
    without = log_density(y, dense(small))

    def evidence(columns):
        logs = [log_density(y, dense(small) + a * a * columns @ columns.T) for a in sizes]
        return np.logaddexp.reduce(logs) - np.log(SIZES) - without

    total = np.logaddexp.reduce([np.log(weight / prior) + evidence(columns) for weight, columns in ways])
    assert found.gain == pytest.approx(total - evidence(column), abs=1e-3)
    of_expected = np.logaddexp.reduce([np.log(weight) + evidence(columns) for weight, columns in without_unexpected])
    of_expected -= np.log(sum(weight for weight, _ in without_unexpected))
    assert found.unexpected == pytest.approx(0.0 if by_visit else max(total - of_expected, 0.0), abs=1e-3)
    assert (found.best.basis_set.departures[-1].coordinate == "visit") == by_visit
    assert len(found.contributions) == len(found.best.coefficients) == 1 + len(found.best.basis_set.departures)


@pytest.mark.parametrize(("least", "kept"), [(0.2, True), (-0.2, True), (-1.0, False)])
@pytest.mark.parametrize("sign", [0.0, 1.0])
def test_a_strength_whose_sign_mechanics_knows_does_not_turn(small, likelihood, least, kept, sign):
    """Growing with the load from `least` to 2: play that becomes negative is none, but for a little, as no function is
    exact; a size without a sign may."""
    effect = replace(with_forms_at(0), varies_with=("payload",))
    load = small.context.payload_kg / small.context.payload_kg.max()
    strength = least + (2.0 - least) * load
    _, found = planted_with(small, likelihood, effect, strength, sign=sign)
    expected = kept or sign == 0.0
    assert (found.unexpected < 2.0) is expected
    assert (max(found.best.basis_set.relative[1:]) >= 0.4) is expected


@pytest.mark.parametrize(("mean", "departs"), [(1.0, True), (0.03, False)])
def test_a_little_of_next_to_nothing_is_nothing(small, likelihood, mean, departs):
    """A size that the form itself does not bear out would make a small share of it anything."""
    along = np.cos(np.pi * (small.context.drives[:, 0] - small.context.drives[:, 0].min()) / 0.8)
    _, found = planted_with(small, likelihood, with_forms_at(0), mean + 0.2 * (along - along.mean()))
    along_travel = any(departure.coordinate == "travel.left" for departure in found.best.basis_set.departures)
    assert along_travel is departs
    assert (found.gain > 10.0) is departs


def test_what_scatters_about_zero_by_visit_is_no_share_of_a_form(small, likelihood):
    effect = replace(with_forms_at(0), differs_by_visit=True)
    arrival = small.context.arrival
    share = np.random.default_rng(6).uniform(-1.0, 1.0, int(arrival.max()) + 1)[arrival]
    _, found = planted_with(small, likelihood, effect, share, by_visit=True)
    assert all(departure.coordinate != "visit" for departure in found.best.basis_set.departures)


@pytest.mark.parametrize(("weight", "differs"), [(0.0, True), (0.5, True), (2.0, False)])
def test_what_the_weight_winds_up_is_no_other_one_at_each_visit(small, likelihood, weight, differs):
    """Only what comes with the side is left by a stop. Numbers for the visits would make the weight's anything."""

    def forms(inputs, place):
        out = BasisSets()
        out.add_set(out.add((f"travel.{inputs.drive(place)}", weight + inputs.context.direction[:, place])))
        return out

    effect, arrival = replace(with_forms_at(0), differs_by_visit=True, forms=forms), small.context.arrival
    share = np.random.default_rng(6).uniform(0.0, 1.0, int(arrival.max()) + 1)[arrival]
    _, found = planted_with(small, likelihood, effect, share, by_visit=True)
    assert any(departure.coordinate == "visit" for departure in found.best.basis_set.departures) is differs


@pytest.mark.parametrize("above", [0.5, 0.95])
def test_a_weight_comes_with_no_side_however_often_a_drive_comes_from_one(above):
    side = np.where(np.arange(200) < 200 * above, 1.0, -1.0)
    drives = SimpleNamespace(context=SimpleNamespace(direction=side[:, None]))
    for shape, comes in ((np.ones(200), False), (-side, True), (-side - 0.3, True), (1.0 + 0.3 * side, False)):
        form = (("travel.left", shape),)
        assert departure_evidence._comes_with_side(drives, with_forms_at(0), 0, form) is comes


def test_a_general_function_that_changes_has_the_evidence_of_a_dense_mixture(small, likelihood):
    """As likely as one another: that it stays as it is, and that it changes with one of the coordinates wholly, which
    has half of the prior that a form's would have."""
    inputs = inputs_of_readings(small, likelihood.channels, lambda *_: [], lambda *_: [])
    effect = replace(with_forms_at(0), functions_vary_with=("payload", "side"))
    q = small.context.drives[:, 0]
    curve = [(("travel.left", shape),) for shape in cosine_basis(q, 4).T]
    side, load = small.context.direction[:, 0], small.context.payload_kg / small.context.payload_kg.max()
    shift = explicit(small, likelihood, [(("travel.left", np.sin(3.0 * q) * side * (1.0 + 0.2 * load)),)])[:, 0]
    planted = likelihood.on(replace(small, residual=small.residual + 8.0e-5 * shift.reshape(-1, 3)))
    basis_sets = [BasisSet((0, 1, 2, 3), (1.0,) * 4)]
    (exact,) = evidence_of_basis_sets(planted.information_and_score(curve), basis_sets, LOW, HIGH)
    found = departure_evidence.with_departures(planted, inputs, effect, 0, exact, curve, LOW, by_visit=True)

    inverse, columns = np.linalg.inv(dense(small)), explicit(small, likelihood, curve)

    def seen(some):
        return np.einsum("ik,ij,jk->", some, inverse, some)

    # However stiff the struts are, as far as the readings leave that open.
    left_open = [
        u * explicit(small, likelihood, [((f"stiffened.{small.machine.strut_names[strut]}.travel.left", shape),)])
        for ((_, shape),) in curve
        for strut, u in small.u_of_ln_stiffness.items()
    ]
    assert len(left_open) == 16
    stiffened = np.hstack([columns, *left_open])
    ways = [(1.0, stiffened)]
    for functions in functions_of_change(inputs, effect, 0).values():
        products = [(("travel.left", shape * f),) for ((_, shape),) in curve for f in functions.T]
        changing = explicit(small, likelihood, products)
        for size in (0.4, 1.0):
            share = size * min(1.0, np.sqrt(seen(columns) / seen(changing)))
            ways.append((0.125, np.hstack([stiffened, share * changing])))
    y, sizes = planted.linear.residual.ravel(), np.geomspace(LOW, HIGH, SIZES)

    def evidence(some):
        return np.logaddexp.reduce([log_density(y, dense(small) + a * a * some @ some.T) for a in sizes])

    total = np.logaddexp.reduce([np.log(weight / 1.5) + evidence(some) for weight, some in ways])
    assert found.gain == pytest.approx(total - evidence(columns), abs=1e-3)
    assert found.unexpected == 0.0
    assert {departure.coordinate for departure in found.best.basis_set.departures} == {"stiffness", "side.left"}


@pytest.mark.parametrize(
    ("columns", "with_what", "a_visit", "changes"),
    [(61, "side", 50.0, False), (41, "time", 50.0, False), (40, "time", 50.0, True), (40, "time", 0.5, False)],
)
def test_a_function_of_many_columns_does_not_change(
    small, likelihood, monkeypatch, columns, with_what, a_visit, changes
):
    """Nor one of fewer with a coordinate of three terms, nor one with more products than half of the visits."""
    monkeypatch.setattr(departure_evidence, "MOST_PRODUCTS_A_VISIT", a_visit)
    inputs = inputs_of_readings(small, likelihood.channels, lambda *_: [], lambda *_: [])
    effect = replace(with_forms_at(0), functions_vary_with=(with_what,))
    curve = [(("travel.left", shape),) for shape in cosine_basis(small.context.drives[:, 0], columns).T]
    basis_sets = [BasisSet(tuple(range(columns)), (1.0,) * columns)]
    (exact,) = evidence_of_basis_sets(likelihood.information_and_score(curve), basis_sets, LOW, HIGH)
    found = departure_evidence.with_departures(likelihood, inputs, effect, 0, exact, curve, LOW, by_visit=False)
    assert (found.best is not exact) == changes
    assert (found.gain != 0.0) == changes


def test_a_function_has_half_as_many_products_as_visits(small, likelihood):
    inputs = inputs_of_readings(small, likelihood.channels, lambda *_: [], lambda *_: [])
    effect = replace(with_forms_at(0), functions_vary_with=("payload",))
    half = len(np.unique(small.context.arrival)) // 2
    assert half < departure_evidence.MOST_CHANGING
    assert departure_evidence._functions_of_change(inputs, effect, 0, half).keys() == {"payload"}
    assert not departure_evidence._functions_of_change(inputs, effect, 0, half + 1)


def test_a_course_that_changes_with_the_load_must_not_turn_either(small, likelihood):
    """One that seems to turn because another load is on at the end does not, once the load is said to change it."""
    inputs = inputs_of_readings(small, likelihood.channels, lambda *_: [], lambda *_: [])
    effect = replace(with_forms_at(0), functions_vary_with=("payload",))
    t, load = small.context.elapsed_s / small.context.elapsed_s.max(), small.context.payload_kg
    course = random_walk_basis(t, 8)
    columns = [(("travel.left", shape),) for shape in course.T]
    there_and_back = np.sin(np.pi * t) * (load / load.max() - 0.2)
    shift = explicit(small, likelihood, [(("travel.left", there_and_back),)])[:, 0]
    planted = likelihood.on(replace(small, residual=small.residual + 3.0e-4 * shift.reshape(-1, 3)))
    information = planted.information_and_score(columns)

    def gain(*one_way):
        basis_sets = [BasisSet(tuple(range(8)), (1.0,) * 8, one_way=one_way)]
        (exact,) = evidence_of_basis_sets(information, basis_sets, LOW, HIGH)
        found = departure_evidence.with_departures(planted, inputs, effect, 0, exact, columns, LOW, by_visit=False)
        return found.gain, loss_of_one_way(exact), loss_of_one_way(found.best)

    free, _, _ = gain()
    held, loss, loss_of_best = gain(steps_over(small.context.elapsed_s, course))
    assert free > 10.0
    assert loss > 1000.0
    assert 10.0 < loss_of_best < 0.1 * loss  # most of the turning was the load's
    assert held - free == pytest.approx(loss - loss_of_best, abs=1.0)


@pytest.mark.parametrize("late", [0.0, 0.3])
def test_a_wave_times_functions_of_its_phase_is_a_wave_of_any_form(late):
    """A sawtooth, as of periods that are counted and nothing in between, whose counter switches late in either
    direction; what its first harmonic alone explains is far less."""
    inputs, period_m = typical_inputs(240), 0.011
    q, side = inputs.context.drives[:, 0], inputs.context.direction[:, 0]
    law = 2.0 * ((q / period_m - late * side) % 1.0) - 1.0
    effect = replace(with_forms_at(0), varies_with=("phase",), others=(PERIOD_M,))
    form, by_side = functions_it_varies_with(inputs, effect, 0, period_m).values()
    wave = wave_of(q, period_m)

    def left(*families):
        columns = np.column_stack([np.ones_like(q), wave, *(tensor_product(wave, family) for family in families)])
        return float(np.var(law - columns @ np.linalg.lstsq(columns, law, rcond=None)[0]) / np.var(law))

    assert left(form, by_side) < 0.06  # of which the harmonics above the eleventh have some 0.05
    assert left() > 0.3
    assert left(form) > 0.3 or late == 0.0
    assert functions_it_varies_with(inputs, effect, 0).keys() == set()
    assert functions_it_varies_with(typical_inputs(160), effect, 0, period_m).keys() == set()  # at too few positions


def test_no_wave_of_any_form_is_play():
    """Which a wave by side times itself would be, in its mean."""
    inputs, period_m = typical_inputs(240), 0.011
    effect = replace(with_forms_at(0), varies_with=("phase",), others=(PERIOD_M,))
    by_side = functions_it_varies_with(inputs, effect, 0, period_m)["phase by side.left"]
    columns, play = (
        tensor_product(wave_of(inputs.context.drives[:, 0], period_m), by_side),
        inputs.context.direction[:, 0],
    )
    left = play - columns @ np.linalg.lstsq(columns, play, rcond=None)[0]
    assert np.sum(left**2) > 0.3 * np.sum(play**2)


def test_what_is_anew_at_each_visit_is_more_than_what_is_seen_of_its_form(small, likelihood):
    """A zero is calibrated, so that next to nothing is seen of it; where it lies at each visit is not."""
    inputs = inputs_of_readings(small, likelihood.channels, lambda *_: [], lambda *_: [])
    arrival, effect = small.context.arrival, replace(with_forms_at(0), differs_by_visit=True)
    form = (("travel.left", np.ones(len(arrival))),)
    anew = np.random.default_rng(6).uniform(-1.0, 1.0, int(arrival.max()) + 1)[arrival]
    shift = 8.0e-5 * explicit(small, likelihood, [(("travel.left", anew),)])[:, 0]
    planted = likelihood.on(replace(small, residual=small.residual + shift.reshape(-1, 3)))
    (exact,) = evidence_of_basis_sets(planted.information_and_score([form]), [BasisSet((0,), (1.0,))], LOW, HIGH)
    found = departure_evidence.with_departures(planted, inputs, effect, 0, exact, [form], LOW, by_visit=True, anew=True)
    assert {departure.coordinate for departure in found.best.basis_set.departures} == {"visit"}
    visits = len(found.best.basis_set.departures)
    assert min(found.best.basis_set.relative[-visits:]) >= 1.0


def test_what_is_anew_at_each_visit_need_be_no_share_of_its_form(small, likelihood):
    """Scattering about zero, and far more than what is seen of the form in its mean."""
    effect = replace(with_forms_at(0), differs_by_visit=True)
    arrival = small.context.arrival
    anew = np.random.default_rng(6).uniform(-1.0, 1.0, int(arrival.max()) + 1)[arrival]
    _, found = planted_with(small, likelihood, effect, anew, by_visit=True, anew=True)
    assert {departure.coordinate for departure in found.best.basis_set.departures} == {"visit"}
    assert found.gain > 100.0
    _, only_once = planted_with(small, likelihood, effect, np.ones(len(arrival)), by_visit=True, anew=True)
    assert "visit" not in {departure.coordinate for departure in only_once.best.basis_set.departures}
