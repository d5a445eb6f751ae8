"""Evidence and what belongs to it, against dense normal distributions without any of the engine's shortcuts."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from calibration.diagnosis import departure_evidence
from calibration.diagnosis.basis_set_evidence import (
    SIZES,
    InformationAndScore,
    evidence_of_basis_sets,
    log_evidence_of_sizes,
)
from calibration.diagnosis.effect_inputs import inputs_of_readings, strongest_onsets
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.ranking import include_cause, rank_effects, refit_cause
from calibration.effects.api import BasisSet
from calibration.effects.columns import ColumnsByChannel
from tests.calibration.diagnosis.dense import HIGH, LOW, dense, explicit, flat, log_density, with_forms_at


@pytest.fixture
def contributions(small):
    rng = np.random.default_rng(5)
    m = small.context
    return [
        (("travel.left", -0.5 * m.direction[:, 0]),),
        (("length.left_upper", rng.standard_normal(len(m))), ("pose.rz", rng.standard_normal(len(m)))),
        (("travel.left", m.drives[:, 0]), ("travel.right", m.dwell_s), ("travel.left", m.dwell_s)),
        (("light.v", np.ones(len(m))),),
        (("turn.right.z", m.elapsed_s / 3600.0), ("sideways.right.x", m.direction[:, 1])),
    ]


FORMS = (BasisSet((0,), (1.0,)), BasisSet((0, 1, 4), (1.0, 0.3, 0.1)), BasisSet((2, 3, 4), (1.0, 1.0, 0.5)))


@pytest.mark.parametrize("number", range(len(FORMS)))
def test_evidence_is_the_ratio_of_dense_densities(small, likelihood, contributions, number):
    form = FORMS[number]
    y, c = small.residual.ravel(), dense(small)
    h = explicit(small, likelihood, contributions)[:, form.columns] * form.relative
    logs = [log_density(y, c + a * a * h @ h.T) for a in np.geomspace(LOW, HIGH, SIZES)]
    expected = np.logaddexp.reduce(logs) - np.log(SIZES) - log_density(y, c)
    got = evidence_of_basis_sets(likelihood.information_and_score(contributions), FORMS, LOW, HIGH)[number]
    assert got.basis_set is form
    assert got.log_evidence == pytest.approx(expected, abs=1e-5, rel=1e-7)
    a = np.geomspace(LOW, HIGH, SIZES)[int(np.argmax(logs))]
    assert got.size == pytest.approx(a)
    # Coefficients and covariance are those of a joint regression with the prior of the best size.
    prior = np.diag((a * np.array(form.relative)) ** 2)
    h = explicit(small, likelihood, contributions)[:, form.columns]
    gain = prior @ h.T @ np.linalg.inv(c + h @ prior @ h.T)
    scale = np.sqrt(np.diag(prior))
    assert got.coefficients / scale == pytest.approx(gain @ y / scale, abs=1e-6)
    assert got.covariance / np.outer(scale, scale) == pytest.approx(
        (prior - gain @ h @ prior) / np.outer(scale, scale), abs=1e-6
    )


def test_the_density_is_that_of_another_library(small, likelihood):
    some = slice(0, 120)
    y, c = small.residual.ravel()[some], dense(small)[some, some]
    assert log_density(y, c) == pytest.approx(multivariate_normal(np.zeros(120), c).logpdf(y), rel=1e-9)


def test_nine_sizes_stand_for_the_whole_prior(likelihood, contributions):
    judged = likelihood.information_and_score(contributions[:1])
    logs = log_evidence_of_sizes(judged, np.geomspace(LOW, HIGH, 2001))
    coarse = evidence_of_basis_sets(judged, FORMS[:1], LOW, HIGH)[0].log_evidence
    assert coarse == pytest.approx(np.logaddexp.reduce(logs) - np.log(2001.0), abs=0.5)


@pytest.mark.parametrize(("columns", "rank"), [(1, 1), (2, 1), (7, 7), (60, 60), (60, 9)])
def test_evidence_of_sizes_is_that_of_normal_densities(columns, rank):
    """Of numbers with noise of one, with and without the columns; some of which may be alike."""
    rng = np.random.default_rng(columns + rank)
    h = rng.standard_normal((80, rank)) @ rng.standard_normal((rank, columns))
    y = h @ rng.standard_normal(columns) + rng.standard_normal(80)
    sizes = np.array([0.01, 0.5, 7.0])
    density = multivariate_normal.logpdf
    without = density(y, cov=np.eye(80))
    expected = [density(y, cov=np.eye(80) + size**2 * h @ h.T) - without for size in sizes]
    logs = log_evidence_of_sizes(InformationAndScore(h.T @ h, h.T @ y), sizes)
    np.testing.assert_allclose(logs, expected, rtol=1e-8)


def test_directions_that_are_left_out_hardly_count(wandering, small, likelihood, contributions):
    quick = MarginalLikelihood.of(linearise_recording(wandering))
    assert quick.q.shape[2] < likelihood.q.shape[2]
    here, there = (
        evidence_of_basis_sets(r.information_and_score(contributions), FORMS, LOW, HIGH) for r in (quick, likelihood)
    )
    for a, b in zip(here, there, strict=True):
        assert a.log_evidence == pytest.approx(b.log_evidence, abs=0.3, rel=2e-3)
        assert a.coefficients == pytest.approx(b.coefficients, abs=0.1 * np.sqrt(np.diag(b.covariance)).max())


def test_readings_of_a_sound_rig_are_explained_down_to_their_noise(small, likelihood):
    """Under the model the quadratic form is chi-squared with as many degrees of freedom as numbers."""
    count = small.residual.size
    assert small.residual.ravel() @ likelihood.weighted_residual.ravel() == pytest.approx(
        count, abs=5.0 * np.sqrt(2.0 * count)
    )


def test_given_is_a_fresh_dense_computation(small, likelihood, contributions):
    h = explicit(small, likelihood, contributions) * np.array([2e-5, 1e-5, 3e-6, 1e-6, 1e-5])
    y = small.residual.ravel()
    inverse = np.linalg.inv(dense(small, h))
    shaped = h.reshape(*small.residual.shape, -1)
    at_once, in_turn = likelihood.including(shaped), likelihood.including(shaped[:, :, :2]).including(shaped[:, :, 2:])
    some = np.random.default_rng(1).standard_normal((*small.residual.shape, 3))
    for other in (at_once, in_turn):
        np.testing.assert_allclose(other.weighted_residual.ravel(), inverse @ y, atol=1e-7)
        np.testing.assert_allclose(flat(other.apply(some)), inverse @ flat(some), atol=1e-7)
        q = flat(other.q)
        np.testing.assert_allclose(np.eye(len(q)) - q @ q.T, inverse, atol=1e-7)
        judged = other.information_and_score(contributions)
        h1 = explicit(small, likelihood, contributions)
        assert judged.information == pytest.approx(h1.T @ inverse @ h1, rel=1e-5, abs=1e-6 * judged.information.max())
        assert judged.score == pytest.approx(h1.T @ inverse @ y, rel=1e-5, abs=1e-6 * np.abs(judged.score).max())


def test_giving_does_not_change_the_former_readout(likelihood, small, contributions):
    before = likelihood.information_and_score(contributions)
    likelihood.including(np.ones((*small.residual.shape, 1))).information_and_score(contributions)
    after = likelihood.information_and_score(contributions)
    assert np.array_equal(before.information, after.information)
    assert np.array_equal(before.score, after.score)


def test_judge_is_what_explicit_columns_give(small, likelihood, contributions):
    h = explicit(small, likelihood, contributions)
    inverse = np.linalg.inv(dense(small))
    judged = likelihood.information_and_score(contributions)
    np.testing.assert_allclose(flat(likelihood.columns(contributions)), h, rtol=1e-9, atol=1e-9 * np.abs(h).max())
    scale = np.sqrt(np.diag(h.T @ inverse @ h))
    assert judged.information / np.outer(scale, scale) == pytest.approx(
        h.T @ inverse @ h / np.outer(scale, scale), abs=1e-7
    )
    assert judged.score / scale == pytest.approx(h.T @ inverse @ small.residual.ravel() / scale, abs=1e-6)


def test_readings_that_are_alike_count_together(small, likelihood):
    """Columns with one row for each group of readings against the same columns at all readings."""
    group = np.random.default_rng(6).integers(0, 12, len(small.rows))
    shapes = np.random.default_rng(7).standard_normal((12, 3))
    of_groups = likelihood.grouped("travel.left", group)
    plain = likelihood.information_and_score([(("travel.left", shape[group]),) for shape in shapes.T])
    together = InformationAndScore(shapes.T @ of_groups.information @ shapes, of_groups.score @ shapes)
    assert_alike(together, plain)


def test_judge_through_is_judge(small, likelihood):
    shapes = np.random.default_rng(2).standard_normal((len(small.rows), 3))
    channels = [("travel.left", 2.0), ("smr.P1.x", 0.5), ("station.rz", 3.0)]
    contributions = [((name, unit * shapes[:, k]),) for name, unit in channels for k in range(3)]
    through, plain = (
        likelihood.kept_information_and_score(ColumnsByChannel.through(channels, shapes)),
        likelihood.information_and_score(contributions),
    )
    assert_alike(through, plain)


def test_what_is_kept_follows_the_causes_that_are_included(small, likelihood):
    rng = np.random.default_rng(4)
    shapes = rng.standard_normal((len(small.rows), 4))
    contributions = [
        (("travel.left", shapes[:, 0]), ("smr.P1.x", shapes[:, 1])),
        (("travel.left", shapes[:, 2]), ("travel.left", shapes[:, 3])),
        (("station.rz", shapes[:, 3]),),
    ]
    columns = ColumnsByChannel.of(contributions)
    first = likelihood.including(rng.standard_normal((*small.residual.shape, 2)))
    second = first.including(likelihood.columns(contributions[:1]))
    for model in (second, first, likelihood, second):
        assert_alike(model.kept_information_and_score(columns), model.information_and_score(contributions))
    assert (
        second.information_and_score(contributions).information[0, 0]
        < 0.9 * (first.information_and_score(contributions).information[0, 0])
    )


def assert_alike(one: InformationAndScore, other: InformationAndScore) -> None:
    assert one.information == pytest.approx(other.information, abs=1e-9 * other.information.max())
    assert one.score == pytest.approx(other.score, abs=1e-9 * np.abs(other.score).max())


@pytest.mark.parametrize("causes", [0, 1, 2])
def test_by_visit_is_judge_of_single_visits(small, likelihood, causes):
    arrival, rng = small.context.arrival, np.random.default_rng(7)
    for _ in range(causes):
        likelihood = likelihood.including(rng.standard_normal((*small.residual.shape, 2)))
    contributions = [(("travel.right", (arrival == v).astype(float)),) for v in range(int(arrival.max()) + 1)]
    information, score = likelihood.information_by_visit("travel.right")
    judged = likelihood.information_and_score(contributions)
    assert information == pytest.approx(np.diag(judged.information), rel=1e-9, abs=1e-9 * information.max())
    assert score == pytest.approx(judged.score, rel=1e-9, abs=1e-9 * np.abs(score).max())


@pytest.mark.parametrize("places", [(), (1,), (0, 1)])
def test_an_effect_is_ranked_at_the_places_where_it_can_be(small, likelihood, places):
    inputs = inputs_of_readings(small, likelihood.channels, lambda *_: [], lambda *_: [])
    causes = rank_effects(likelihood, inputs, [with_forms_at(*places)])
    assert [set(cause.places) for cause in causes] == ([{("left", "right")[i] for i in places}] if places else [])
    assert all(sum(cause.places.values()) == pytest.approx(1.0) for cause in causes)


@pytest.mark.parametrize("planted", [(0,), (0, 1)])
def test_an_effect_is_found_at_all_its_places_at_once(small, likelihood, planted, monkeypatch):
    """By dense densities: one place or both with even odds, the second given the first in its most likely size; and
    at both with an eighth: with one coefficient, or with two that are correlated or are not."""
    monkeypatch.setattr(departure_evidence, "SMOOTH_SHARES", ())
    inputs = inputs_of_readings(small, likelihood.channels, lambda *_: [], lambda *_: [])
    effect = with_forms_at(0, 1)
    (one,), (other,) = (effect.forms(inputs, place).contributions for place in (0, 1))
    h = explicit(small, likelihood, [one, other])
    shift = h[:, planted] @ np.array([8.0e-5, 4.0e-5])[: len(planted)]
    there = replace(small, residual=small.residual + shift.reshape(-1, 3))
    with_effect = likelihood.on(there)
    y, c = there.residual.ravel(), dense(small)
    sizes = np.geomspace(effect.smallest_size(small.recording.file.nuisance), HIGH, SIZES)

    def over_sizes(column, covariance):
        logs = np.array([log_density(y, covariance + a * a * np.outer(column, column)) for a in sizes])
        return np.logaddexp.reduce(logs) - np.log(SIZES) - log_density(y, covariance), sizes[int(np.argmax(logs))]

    (first, size), (second, _) = over_sizes(h[:, 0], c), over_sizes(h[:, 1], c)
    further, _ = over_sizes(h[:, 1], c + size * size * np.outer(h[:, 0], h[:, 0]))
    expected = np.logaddexp.reduce([first - np.log(4.0), second - np.log(4.0), *([first + further - np.log(2.0)])])
    both, each = np.outer(h.sum(axis=1), h.sum(axis=1)), h @ h.T

    def alike_over_sizes(correlation):
        shared = correlation * both + (1.0 - correlation) * each
        return np.logaddexp.reduce([log_density(y, c + a * a * shared) for a in sizes]) - np.log(SIZES)

    alike = np.logaddexp.reduce([alike_over_sizes(rho) for rho in (0.0, 0.9, 1.0)]) - log_density(y, c) - np.log(3.0)
    (cause,) = rank_effects(with_effect, inputs, [effect])
    assert [part.place for part in cause.parts] == [("left", "right")[place] for place in planted]
    assert all(not part.further for part in cause.parts)
    one_by_one = expected if len(planted) > 1 else np.logaddexp(first, second) - np.log(4.0)
    assert cause.log_evidence == pytest.approx(np.logaddexp(one_by_one, alike - np.log(8.0)), abs=1e-3)
    included = include_cause(with_effect, cause)
    parts = np.concatenate([
        likelihood.columns(part.contributions) * part.prior_deviations for part in cause.parts
    ], axis=2)  # fmt: skip
    np.testing.assert_allclose(
        included.weighted_residual.ravel(), np.linalg.solve(dense(small, flat(parts)), y), atol=1e-6
    )
    again = refit_cause(with_effect, inputs, cause.parts[-1], {"left"})
    assert again.place == "right"


@pytest.mark.parametrize("unit", [1.0, 1e9])
def test_the_time_of_a_change_is_found_in_any_unit_of_its_channel(small, unit):
    """A step of the residual after the twentieth arrival, in a channel that moves readings little per unit."""
    rng, context = np.random.default_rng(4), small.context
    order = np.argsort(context.t_s)
    response = rng.standard_normal(small.residual.shape) / unit
    after = context.t_s >= context.history.arrived_s[20] + 1e-6
    observed = SimpleNamespace(
        linear=SimpleNamespace(context=context),
        response=lambda _: response,
        weighted_residual=unit * response * after[:, None] + 0.1 * rng.standard_normal(response.shape),
    )
    onset_s, prior = strongest_onsets(observed, ["any"])[0]
    first = order[np.flatnonzero(after[order])[0]]
    last = order[np.flatnonzero(after[order])[0] - 1]
    assert onset_s == pytest.approx(0.5 * (context.t_s[first] + context.t_s[last]) - context.start_s)
    assert 0.0 < prior < 0.1


def test_a_change_that_goes_back_is_found_beside_the_first(small):
    """Between the fifteenth and the thirtieth arrival; each moment against least squares with two steps."""
    rng, context = np.random.default_rng(5), small.context
    order = np.argsort(context.t_s)
    response = rng.standard_normal(small.residual.shape)
    begins, ends = context.history.arrived_s[[15, 30]] + 1e-6
    away = ((context.t_s >= begins) & (context.t_s < ends))[:, None]
    read = response * away + 0.1 * rng.standard_normal(response.shape)
    observed = SimpleNamespace(
        linear=SimpleNamespace(context=context), response=lambda _: response, weighted_residual=read
    )
    onsets = [onset_s + context.start_s for onset_s, _ in strongest_onsets(observed, ["any"])]
    in_time = context.t_s[order]
    rows = np.searchsorted(in_time, (begins, ends))
    wanted = 0.5 * (in_time[rows - 1] + in_time[rows])
    assert all(np.min(np.abs(np.array(onsets) - at)) < 1e-6 for at in wanted)

    def left(*steps_s: float) -> float:
        shapes = [np.ones(len(context.t_s)), *((context.t_s >= at).astype(float) for at in steps_s)]
        columns = np.stack([(response * shape[:, None]).ravel() for shape in shapes], axis=1)
        return float(np.sum((read.ravel() - columns @ np.linalg.lstsq(columns, read.ravel(), rcond=None)[0]) ** 2))

    first, candidates = onsets[0], onsets[-2:]  # the last two are the likeliest beside the first
    arrivals = context.history.arrived_s[1:]
    allowed = [at for at in arrivals if all(abs(at - other) > 60.0 for other in onsets[:-2])]
    assert left(first, candidates[0]) <= min(left(first, at) for at in allowed) + 1e-6


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_sign_that_mechanics_knows_is_half_a_prior(sign):
    """Against the integral over the coefficient, for one size: a half normal prior has twice the density."""
    information, score, size = 2.0, 1.5, 0.8
    columns = InformationAndScore(np.array([[information]]), np.array([score]))
    low, high = size * (1.0 - 1e-9), size * (1.0 + 1e-9)
    (got,) = evidence_of_basis_sets(columns, [BasisSet((0,), (1.0,), sign=sign)], low, high)
    x = sign * np.linspace(0.0, 12.0 * size, 200_001)
    density = 2.0 * np.exp(score * x - 0.5 * information * x**2 - 0.5 * (x / size) ** 2) / (size * np.sqrt(2.0 * np.pi))
    assert got.log_evidence == pytest.approx(np.log(np.sum(density) * abs(x[1])), abs=1e-4)
