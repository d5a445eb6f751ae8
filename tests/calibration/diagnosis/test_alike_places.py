"""An effect at all of its places alike: its evidence by a covariance between them, and when it is told."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis import alike_places, levels_and_causes, ranking
from calibration.diagnosis.alike_places import CORRELATIONS, alike_at_all_places
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.findings import effect_summary
from calibration.diagnosis.findings.effect_summary import summarise_effect
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.place_evidence import evidence_by_place, smallest_size
from calibration.diagnosis.ranking import rank_effects
from calibration.diagnosis.search import search_causes
from calibration.diagnosis.settings import VERDICT
from calibration.diagnosis.twin.joint_fit import JointFit
from calibration.diagnosis.verdict import presence_probability
from calibration.effects.catalogue import load_catalogue
from mock_devices.effects import EffectChoice
from tests.calibration.diagnosis.campaigns import plant, recorded
from tests.calibration.effects.general_functions import typical_inputs

GROWTH = load_catalogue().effect("link_thermal_growth")
STRUTS = ("left_upper", "left_lower", "right_upper", "right_lower")


def measured(*rises_k: float) -> tuple[MarginalLikelihood, object]:
    """A campaign in which struts grow warm by so much, in order."""
    choices = [EffectChoice("link_thermal_growth", rise, strut) for strut, rise in zip(STRUTS, rises_k, strict=False)]
    likelihood = MarginalLikelihood.of(linearise_recording(recorded(plant(100, *choices)), judge=False))
    return likelihood, inputs_of_recording(likelihood, periodograms(likelihood))


@pytest.fixture(scope="module")
def warm():
    """All struts alike."""
    return measured(2.0, 2.0, 2.0, 2.0)


def only_set(number, effect=GROWTH):
    """The growth of struts, or another effect, with a single one of its basis sets."""

    def forms(of, place):
        built = effect.forms(of, place)
        built.sets = [replace(built.sets[number], weight=1.0)]
        return built

    return replace(effect, forms=forms)


def correlated(columns, relative, correlation, size):
    """Log evidence and mean coefficients of columns at four places, from their prior covariance."""
    covariance = size**2 * np.kron(
        correlation * np.ones((4, 4)) + (1.0 - correlation + 1e-9) * np.eye(4), np.diag(np.square(relative))
    )
    precision = np.linalg.inv(covariance) + columns.information
    mean = np.linalg.solve(precision, columns.score)
    grown = np.eye(len(mean)) + covariance @ columns.information
    return 0.5 * columns.score @ mean - 0.5 * np.linalg.slogdet(grown)[1], mean


@pytest.mark.parametrize("columns", [1, 6])
def test_evidence_is_that_of_correlated_places_and_one_basis_set(warm, columns, monkeypatch):
    """On a machine whose stiffnesses are known."""
    monkeypatch.setattr(alike_places, "stiffnesses_left_open", lambda _: {})
    likelihood, inputs = warm
    low, sets = smallest_size(likelihood, GROWTH), GROWTH.basis_sets(inputs, 0).sets
    number = next(k for k, each in enumerate(sets) if len(each.columns) == columns)
    found = alike_at_all_places(likelihood, inputs, only_set(number), low, [np.zeros(1)] * 4)
    at_place = [GROWTH.basis_sets(inputs, place).contributions for place in range(4)]
    columns = likelihood.information_and_score([each[c] for each in at_place for c in sets[number].columns])
    sizes = low * (GROWTH.size.high / low) ** np.linspace(0.0, 1.0, 9)
    logs = np.array(
        [[correlated(columns, sets[number].relative, rho, size)[0] for size in sizes] for rho in CORRELATIONS]
    )
    assert found.log_evidence == pytest.approx(np.logaddexp.reduce(logs.ravel()) - math.log(logs.size), abs=1e-3)
    assert [part.place for part in found.parts] == list(STRUTS)
    likeliest = CORRELATIONS[int(np.argmax(np.logaddexp.reduce(logs, axis=1)))]
    _, mean = correlated(columns, sets[number].relative, likeliest, found.parts[0].best.size)
    np.testing.assert_allclose(np.concatenate([part.best.coefficients for part in found.parts]), mean, atol=1e-4)


def test_what_all_struts_do_is_told_where_no_single_one_shows_it(warm):
    likelihood, inputs = warm
    (cause,) = rank_effects(likelihood, inputs, [GROWTH])
    assert cause.alike
    assert sorted(part.place for part in cause.parts) == sorted(STRUTS)
    alone = [place.log_evidence for place in evidence_by_place(likelihood, inputs, GROWTH, STRUTS)]
    assert cause.log_evidence > 2.0 * max(alone)
    found = search_causes(likelihood, inputs, load_catalogue().effects)
    assert {part.effect.name for part in found.causes} == {"link_thermal_growth"}
    assert len(found.causes) == 4  # none of them is lost where each is asked for beside the others
    for part in found.causes:
        assert part.best.coefficients[0] == pytest.approx(2.0, abs=4.0 * math.sqrt(part.best.covariance[0, 0]) + 0.5)


@pytest.mark.parametrize(("strongest", "asked"), [(1500.0, True), (6000.0, False)])
def test_all_places_are_asked_for_though_the_sum_of_each_alone_is_far_below_the_strongest(warm, strongest, asked):
    """Each alone has less than what all have together: 187 and 324."""
    likelihood, inputs = warm
    (cause,) = rank_effects(likelihood, inputs, [GROWTH], explained=strongest / VERDICT.min_gain_share)
    assert cause.alike is asked


def test_own_coefficients_are_tried_of_what_explains_most_in_common_or_at_each_place(warm, monkeypatch):
    likelihood, inputs = warm
    low, tried, real = smallest_size(likelihood, GROWTH), [], alike_places._spread_over_places
    monkeypatch.setattr(alike_places, "LIKELIEST", 1)
    monkeypatch.setattr(
        alike_places,
        "_spread_over_places",
        lambda of, its, built, number, *rest: tried.append(number) or real(of, its, built, number, *rest),
    )
    count = len(GROWTH.basis_sets(inputs, 0).sets)
    at_each = [np.eye(count)[1]] * 4
    found = alike_at_all_places(likelihood, inputs, GROWTH, low, at_each)
    assert len(tried) == 2
    assert 1 in tried
    for number in tuple(tried):
        alone = alike_at_all_places(likelihood, inputs, only_set(number), low, [np.zeros(1)] * 4)
        assert found.log_evidence > alone.log_evidence - math.log(14.0)


def test_struts_that_are_warmed_unlike_are_likelier_than_struts_of_several_materials():
    """Both say the same, each strut another share of what the sensor reads: their priors tell them apart."""
    inputs = typical_inputs()
    growth = GROWTH.basis_sets(inputs, 0)
    (of_sensor,) = (s.weight for s in growth.sets if [growth.named[c] for c in s.columns] == [""])
    expansion = load_catalogue().effect("expansion_coefficient").basis_sets(inputs, 0)
    each = [f"length.{strut}" for strut in inputs.machine.strut_names]
    (of_materials,) = (
        s.weight for s in expansion.sets if [expansion.contributions[c][0][0] for c in s.columns] == each
    )
    every = sum(s.weight for s in growth.sets) * len(CORRELATIONS) * math.exp(ranking.ALIKE_PRIOR)
    assert of_sensor / every > of_materials


def test_no_place_is_lost_that_has_little_beside_the_others():
    likelihood, inputs = measured(0.7, 0.7, 0.7, 0.7)
    found = search_causes(likelihood, inputs, [GROWTH])
    assert sorted(part.place for part in found.causes) == sorted(STRUTS)


def test_one_strut_is_one_strut():
    likelihood, inputs = measured(4.0)
    (cause,) = rank_effects(likelihood, inputs, [GROWTH])
    assert not cause.alike
    assert [part.place for part in cause.parts] == ["left_upper"]


def test_what_all_places_explain_hardly_better_is_the_model_error_of_one():
    """Growth of one strut by 20 K: at all four it would have 0.7 % more of log evidence than the form that is exact, as
    none is; and less than one for which the others yield as stiffly as they may."""
    likelihood, inputs = measured(20.0)
    (cause,) = rank_effects(likelihood, inputs, [GROWTH])
    places = evidence_by_place(likelihood, inputs, GROWTH, STRUTS)
    together = ranking._alike(likelihood, inputs, GROWTH, places, 6.0)
    one = max(place.log_evidence for place in places)
    assert 0.0 < together.log_evidence - ranking.ALIKE_PRIOR - one < 0.03 * one
    assert [part.place for part in cause.parts] == ["left_upper"]


def test_places_without_the_same_basis_sets_are_not_alike(warm):
    likelihood, inputs = warm
    calls = iter(range(9))

    def forms(of, place):
        built = GROWTH.forms(of, place)
        built.sets = built.sets[next(calls) % 2 :]
        return built

    assert alike_at_all_places(likelihood, inputs, replace(GROWTH, forms=forms), 0.1, [np.zeros(1)] * 4) is None


def courses(inputs):
    """The growth of struts along any course in time: one basis set of many columns."""
    built = GROWTH.basis_sets(inputs, 0)
    return max(range(len(built.sets)), key=lambda k: len(built.sets[k].columns))


def at_each_place(likelihood, inputs, number):
    """Whitened columns (4, n, w, k) of a basis set."""
    built = [GROWTH.basis_sets(inputs, place) for place in range(4)]
    return np.stack([likelihood.columns([of.contributions[c] for c in of.sets[number].columns]) for of in built])


@pytest.fixture(scope="module")
def quiet():
    return measured()


@pytest.mark.parametrize("shares", [(1.0, 1.0, 1.0, 1.0), (0.5, 1.6, 0.7, 1.2)])
def test_one_course_at_all_places_is_told_with_the_share_of_each(quiet, shares):
    """A heater that goes on and off: where it warms struts unlike, by other shares. What these are the platform's three
    coordinates do not say of four struts, but what the platform does is as if they were known."""
    likelihood, inputs = quiet
    linear, number, rng = likelihood.linear, courses(inputs), np.random.default_rng(3)
    growth, each = only_set(number), at_each_place(likelihood, inputs, number)
    course = rng.normal(size=each.shape[3]) * 10.0 / np.sqrt(each.shape[3])
    shift = np.tensordot(shares, each @ course, 1)
    heated = likelihood.on(replace(linear, residual=linear.residual + shift))
    low = smallest_size(likelihood, GROWTH)
    found = alike_at_all_places(heated, inputs, growth, low, [np.zeros(1)] * 4)
    assert found.in_common
    coefficients = np.stack([part.best.coefficients for part in found.parts])
    if len(set(shares)) == 1:  # which need not be said
        np.testing.assert_allclose(coefficients, coefficients[[0] * 4], rtol=1e-12)
    predicted = np.einsum("pnwk,pk->nw", each, coefficients)
    left = likelihood.linear.after_calibration(predicted - shift)
    assert np.sqrt(np.mean(left**2)) < 0.25
    (cause,) = rank_effects(heated, inputs, [growth])
    assert (cause.alike, cause.in_common) == (True, True)
    strongest = coefficients[STRUTS.index(cause.place)]
    joined = np.tensordot(coefficients @ strongest / (strongest @ strongest), each * cause.prior_deviations, 1)
    np.testing.assert_allclose(
        ranking.include_cause(heated, cause).weighted_residual,
        heated.including(joined).weighted_residual,
        atol=1e-6 * float(np.abs(heated.weighted_residual).max()),
    )


def test_parts_that_have_their_course_in_common_are_one_cause_again(quiet):
    likelihood, inputs = quiet
    linear, each = likelihood.linear, at_each_place(likelihood, inputs, courses(inputs))
    shift = np.sum(each, axis=0) @ np.random.default_rng(5).normal(size=each.shape[3])
    heated = likelihood.on(replace(linear, residual=linear.residual + shift))
    found = search_causes(heated, inputs, [GROWTH])
    assert sorted(part.place for part in found.causes if part.in_common) == sorted(STRUTS)
    together = ranking.as_found(found.causes)
    assert [len(cause.parts) for cause in together if cause.in_common] == [4]
    assert len(found.likelihoods) == len(found.causes) + 1
    given = heated
    for cause in together:
        given = ranking.include_cause(given, cause)
    np.testing.assert_allclose(found.likelihoods[-1].weighted_residual, given.weighted_residual, atol=1e-8)


def test_the_twin_has_one_course_for_all_places(warm):
    """With the nonlinear model: each place's share of one course, and what it does there within the U of its size."""
    likelihood, inputs = warm
    (growth,) = rank_effects(likelihood, inputs, [only_set(courses(inputs))])
    assert growth.in_common
    found = JointFit(likelihood, growth.parts).solution.coefficients
    np.testing.assert_allclose(np.abs(np.corrcoef(np.stack(found))), np.ones((4, 4)), atol=1e-9)
    for coefficients, part in zip(found, growth.parts, strict=True):
        does, told = (likelihood.columns(part.contributions) @ c for c in (coefficients, part.best.coefficients))
        assert np.linalg.norm(does - told) < 0.3 * np.linalg.norm(told)


def test_functions_of_a_place_s_own_drive_are_none_that_places_have_in_common(quiet):
    """Any course along each drive's own travel, whose coefficients are the same by chance at most."""
    _, inputs = quiet
    error = load_catalogue().effect("screw_cumulative_error")
    built = [error.basis_sets(inputs, place) for place in range(2)]
    numbers = alike_places._joined(built).numbers
    assert max(len(built[0].sets[k].columns) for k in numbers) <= alike_places.MOST_COLUMNS
    wide = [k for k, s in enumerate(built[0].sets) if len(s.columns) > alike_places.MOST_COLUMNS]
    assert wide
    assert max(len(GROWTH.basis_sets(inputs, 0).sets[k].columns) for k in alike_places._joined(
        [GROWTH.basis_sets(inputs, place) for place in range(4)]
    ).numbers) == 96  # fmt: skip


@pytest.mark.parametrize("effect", ["screw_thermal_growth", "column_thermal_growth"])
def test_a_course_is_had_in_common_whatever_each_place_makes_of_it(quiet, effect):
    """Oil that flows through all screws, or air about all columns: each grows by where its carriage stands."""
    likelihood, inputs = quiet
    growth = load_catalogue().effect(effect)
    built = [growth.basis_sets(inputs, place) for place in range(2)]
    number = next(k for k, of_course in enumerate(built[0].sets) if of_course.courses)
    each = [likelihood.columns([of.contributions[c] for c in of.sets[number].columns]) for of in built]
    course = np.random.default_rng(3).normal(size=each[0].shape[2])
    course *= 4.0 / np.sqrt(np.mean((sum(each) @ course) ** 2))
    grown = likelihood.on(replace(likelihood.linear, residual=likelihood.linear.residual + sum(each) @ course))
    only = only_set(number, growth)
    found = alike_at_all_places(grown, inputs, only, smallest_size(likelihood, growth), [np.zeros(1)] * 2)
    (each_for_itself,) = rank_effects(grown, inputs, [only])
    assert found.in_common
    assert found.log_evidence > each_for_itself.log_evidence + 10.0


def test_what_alike_places_add_is_counted_once(warm):
    """The first part has the evidence of all; a further effect at two places of its own has that of both."""
    likelihood, inputs = warm
    (growth,) = rank_effects(likelihood, inputs, [GROWTH])
    assert growth.alike
    ranking_of_all = {"backlash": 0.9, "link_thermal_growth": 0.05, "none": 0.03, "unknown": 0.02}
    told = [
        summarise_effect(parts, [], ranking_of_all, likelihood, inputs, explained=9000.0, main=False).probability
        for parts in (growth.parts, growth.parts[:1])
    ]
    assert told[0] == pytest.approx(told[1])
    assert told[0] == pytest.approx(presence_probability(growth.log_evidence, 9000.0, ranking_of_all))
    apart = [replace(part, alike=False, in_common=False, log_evidence=300.0) for part in growth.parts[:2]]
    summary = summarise_effect(apart, [], ranking_of_all, likelihood, inputs, explained=9000.0, main=False)
    assert summary.probability == pytest.approx(presence_probability(600.0, 9000.0, ranking_of_all))


def test_levels_of_disturbances_meet_one_course_for_all_places(warm, monkeypatch):
    likelihood, inputs = warm
    (growth,) = rank_effects(likelihood, inputs, [only_set(courses(inputs))])
    assert growth.in_common
    asked = []
    monkeypatch.setattr(levels_and_causes, "LevelPosterior", lambda linear, included=None: asked.append(included))
    searched = levels_and_causes.SearchOfLevelsAndCauses(likelihood, inputs, [GROWTH])
    searched._posterior_with(growth.parts)
    assert asked[-1].shape[2] == len(growth.contributions)


def test_a_place_is_not_asked_beside_a_free_course_at_each_of_the_others(warm, monkeypatch):
    """Of what has its course in common; a further effect stands beside it once, however many places it is at."""
    likelihood, inputs = warm
    (growth,) = rank_effects(likelihood, inputs, [only_set(courses(inputs))])
    assert growth.in_common
    asked, real = [], effect_summary.include_cause
    monkeypatch.setattr(effect_summary, "include_cause", lambda of, cause: asked.append(cause) or real(of, cause))
    other = rank_effects(likelihood, inputs, [load_catalogue().effect("latency")])[0]
    ranking_of_all = {"link_thermal_growth": 0.9, "none": 0.05, "unknown": 0.05}
    summarise_effect(growth.parts, [other], ranking_of_all, likelihood, inputs, explained=100.0, main=True)
    assert [cause.effect.name for cause in asked] == ["latency"] * 4
    asked.clear()
    summarise_effect([other], growth.parts, ranking_of_all, likelihood, inputs, explained=100.0, main=False)
    assert [len(cause.parts) for cause in asked] == [4]
