"""What of the ranking is refined, on hand-made evidence just below and just above each threshold."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.diagnosis import place_evidence, ranking
from calibration.diagnosis.basis_set_evidence import BasisSetEvidence
from calibration.diagnosis.departure_evidence import DepartingEvidence
from calibration.diagnosis.place_evidence import PlaceEvidence, refine
from calibration.effects.api import BasisSet, Departure
from calibration.recording.header import DisturbanceLevels
from tests.calibration.diagnosis.hand_made import CATALOGUE, INPUTS, MACHINE

LIKELIHOOD = SimpleNamespace(linear=SimpleNamespace(machine=None, levels=DisturbanceLevels(), payloads=()))


def departing(gain: float, *coordinates: str, unexpected: float = 0.0) -> DepartingEvidence:
    """Evidence of a basis set that departs with some coordinates."""
    basis_set = BasisSet((0,), (1.0,), departures=tuple(Departure(0, name, 0) for name in coordinates))
    return DepartingEvidence(gain, unexpected, BasisSetEvidence(basis_set, 0.0, 1.0, np.zeros(1), np.zeros((1, 1))), ())


def place(name: str, log_evidence: float) -> PlaceEvidence:
    return PlaceEvidence(name, log_evidence, SimpleNamespace(), ())


def refined_of(monkeypatch, logs, laws, *, thorough=False):
    """Effects that are refined, and the ranking; `laws`: names that have any curves."""
    refined = []
    effects = [
        replace(CATALOGUE.effect(name), curves=lambda *_, any_law=name in laws: ("a law",) if any_law else ())
        for name in logs
    ]
    monkeypatch.setattr(
        ranking, "evidence_by_place", lambda _, __, effect, ___: [place("left_upper", logs[effect.name])]
    )
    monkeypatch.setattr(ranking, "_at_several_places", lambda _, __, cause, by_visit: cause)
    monkeypatch.setattr(
        ranking,
        "refine",
        lambda _, __, effect, places, by_visit: refined.append(effect.name) or places,
    )
    return refined, ranking.rank_effects(None, INPUTS, effects, thorough=thorough)


@pytest.mark.parametrize(("strongest", "limit"), [(100.0, 60.0), (9.0, 6.0)])
@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_effects_are_refined_above_three_fifths_of_the_strongest_evidence_and_six(monkeypatch, strongest, limit, side):
    logs = {"column_compliance": strongest, "joint_clearance": limit + side}
    refined, ranked = refined_of(monkeypatch, logs, laws=("joint_clearance",))
    other = ["joint_clearance"] if side > 0.0 else []
    assert refined == ["column_compliance", *other]
    assert [c.unrefined for c in ranked] == [False, not other and limit + side > 6.0]


def test_a_thorough_ranking_refines_all_that_would_be_enough_for_a_cause(monkeypatch):
    logs = {"column_compliance": 100.0, "joint_clearance": 6.1, "refraction": 5.9}
    refined, ranked = refined_of(monkeypatch, logs, laws=(), thorough=True)
    assert refined == ["column_compliance", "joint_clearance"]
    assert not any(cause.unrefined for cause in ranked)


@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_where_a_law_leads_those_of_all_others_are_fitted_above_six(monkeypatch, side):
    """A basis set of play may explain a tenth of what its curve does."""
    logs = {"link_stiffness": 100.0, "joint_clearance": 6.0 + side, "backlash": 20.0}
    refined, _ = refined_of(monkeypatch, logs, laws=("link_stiffness", "joint_clearance"))
    assert refined == ["link_stiffness", *(["joint_clearance"] if side > 0.0 else [])]


@pytest.mark.parametrize(("strongest", "limit"), [(100.0, 80.0), (10.0, 5.0), (1.0, -4.0)])
@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_curves_are_fitted_at_places_with_four_fifths_of_the_best_or_five_less(monkeypatch, strongest, limit, side):
    tried = []
    effect = replace(CATALOGUE.effect("joint_clearance"), curves=lambda _, index: tried.append(index) or ())
    monkeypatch.setattr(place_evidence, "fit_curves", lambda *_: None)
    monkeypatch.setattr(place_evidence, "with_departures", lambda *_, **__: departing(0.0))
    places = [place("left_upper", strongest), place("right_lower", limit + side)]
    refine(LIKELIHOOD, INPUTS, effect, places, by_visit=False)
    assert tried == ([0, 3] if side > 0.0 else [0])


def test_a_cause_keeps_what_unexpected_departures_add_at_its_likeliest_place(monkeypatch):
    found = departing(9.0, "rest", "time", unexpected=4.0)
    monkeypatch.setattr(place_evidence, "with_departures", lambda *_, **__: found)
    effect = CATALOGUE.effect("column_compliance")
    places = [place("left", 100.0), place("right", 20.0)]
    cause = ranking._cause(effect, refine(LIKELIHOOD, INPUTS, effect, places, by_visit=True))
    assert cause.place == "left"
    assert cause.log_evidence == pytest.approx(109.0)
    assert cause.departure_gain == 4.0
    assert cause.differs_with == ("rest", "time")


def test_each_place_of_a_cause_keeps_what_its_departures_add():
    effect = CATALOGUE.effect("column_compliance")
    first, second = (
        ranking._cause(effect, [replace(place(name, 100.0), departure_gain=gain)])
        for name, gain in (("left", 9.0), ("right", 4.0))
    )
    assert [part.departure_gain for part in replace(first, further=(second,)).parts] == [9.0, 4.0]


def sets_of(*entries) -> SimpleNamespace:
    """Basis sets by the form of their columns, how many these are, and the period."""
    named = [form for form, count, _ in entries for _ in range(count)]
    firsts = np.cumsum([0, *(count for _, count, _ in entries)])
    sets = [
        BasisSet(tuple(range(first, first + count)), (1.0,) * count, {"period_m": period_m} if period_m else {})
        for first, (_, count, period_m) in zip(firsts.tolist(), entries, strict=False)
    ]
    return SimpleNamespace(named=named, sets=sets)


@pytest.mark.parametrize(
    ("logs", "others"),
    [
        ([100.0, 90.0, 60.0, 50.0, 40.0], [2]),  # 1 has the period of the best, 3 would be one too many
        ([100.0, 90.0, 29.0, 29.0, 20.0], []),  # less than a share of the best
        ([50.0, 40.0, 30.0, 20.0, 100.0], [0]),  # beside a general function
        ([100.0, -np.inf, -np.inf, -np.inf, -np.inf], []),
    ],
)
def test_departures_begin_from_the_likeliest_other_forms_and_periods(logs, others):
    built = sets_of(("sine", 2, 1.0e-3), ("sine", 2, 1.001e-3), ("sine", 2, 2.0e-3), ("sine", 2, 3.0e-3), ("", 14, 0.0))
    effect = CATALOGUE.effect("encoder_interpolation")
    assert place_evidence._other_forms(effect, built, np.array(logs)) == others


@pytest.mark.parametrize(
    ("name", "anew", "others"), [("smr_reseat", "loose", [3]), ("joint_clearance", "anywhere", [3, 4])]
)
def test_departures_of_what_is_anew_at_each_visit_begin_from_the_form_that_is(name, anew, others):
    """From this one alone if its strength depends on nothing else."""
    built = sets_of(("", 48, 0.0), ("step", 3, 0.0), ("step", 3, 0.0), (anew, 3, 0.0), ("exchanges", 3, 0.0))
    effect = CATALOGUE.effect(name)
    assert place_evidence._other_forms(effect, built, np.array([100.0, 5.0, 4.0, -3.0, 50.0])) == others


def test_beside_waves_of_two_periods_each_may_depart_alone():
    """Two waves are too many columns to depart from; the stronger one may have any form."""
    built = sets_of(("sine", 4, 8.0e-3), ("sine", 2, 8.0e-3), ("sine", 2, 5.0e-3))
    effect = CATALOGUE.effect("screw_periodic_error")
    assert place_evidence._other_forms(effect, built, np.array([300.0, 280.0, 120.0])) == [1]


@pytest.mark.parametrize(("gain_of_other", "log_evidence"), [(20.0, 101.0), (70.0, 130.0)])
def test_the_form_that_explains_most_once_it_departs_is_taken(monkeypatch, gain_of_other, log_evidence):
    gains = {100.0: 1.0, 60.0: gain_of_other}
    other = place("left", 60.0)
    first = replace(place("left", 100.0), others=(other,))
    entries = {id(first.best): 100.0, id(other.best): 60.0}
    monkeypatch.setattr(place_evidence, "with_departures", lambda *of, **_: departing(gains[entries[id(of[4])]]))
    (refined,) = refine(LIKELIHOOD, INPUTS, CATALOGUE.effect("backlash"), [first], by_visit=False)
    assert refined.log_evidence == pytest.approx(log_evidence)


@pytest.mark.parametrize(("form", "anew"), [("loose", True), ("step", False), ("", False)])
def test_only_one_form_of_a_reflector_is_anew_at_each_visit(monkeypatch, form, anew):
    asked = []
    monkeypatch.setattr(place_evidence, "with_departures", lambda *_, anew, **__: asked.append(anew) or departing(0.0))
    at_first = replace(place("P1", 100.0), form=form)
    refine(LIKELIHOOD, INPUTS, CATALOGUE.effect("smr_reseat"), [at_first], by_visit=True)
    assert asked == [anew]
    assert place_evidence._form(sets_of(("loose", 3, 0.0)), BasisSet((0, 1, 2), (1.0,) * 3)) == "loose"
    assert place_evidence._form(sets_of(("loose", 1, 0.0), ("step", 1, 0.0)), BasisSet((0, 1), (1.0,) * 2)) == ""


def test_numbers_for_the_visits_are_tried_at_the_two_places_that_they_would_explain_most_at(monkeypatch):
    shifts = {
        "length.left_upper": 3.0,
        "length.left_lower": 90.0,
        "length.right_upper": 40.0,
        "length.right_lower": 50.0,
    }
    asked = []
    monkeypatch.setattr(place_evidence, "evidence_of_shifts_by_visit", lambda _, channels: shifts[min(channels)])
    monkeypatch.setattr(
        place_evidence, "with_departures", lambda *of, anew, **_: asked.append((of[3], anew)) or departing(0.0)
    )
    effect = CATALOGUE.effect("joint_clearance")
    names = effect.places(MACHINE)
    places = [
        replace(
            place(name, -1.0),
            others=(replace(place(name, -2.0), form="anywhere", contributions=(((f"length.{name}", np.ones(1)),),)),),
        )
        for name in names
    ]
    refine(LIKELIHOOD, INPUTS, replace(effect, curves=lambda *_: ()), places, by_visit=True)
    assert sorted(number for number, anew in asked if anew) == sorted(map(names.index, ("left_lower", "right_lower")))
