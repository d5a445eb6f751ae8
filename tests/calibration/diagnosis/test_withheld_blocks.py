"""Predictions of withheld regions and what is said of them, against dense regressions, a real refit, and sampling."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.frame import station_frame
from calibration.diagnosis import linearisation
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.findings import withheld_blocks
from calibration.diagnosis.findings.withheld_blocks import (
    GapField,
    gap_field,
    gap_figures,
    regions,
    withheld_differences,
)
from calibration.diagnosis.linear_model import LinearModel, linearise_recording
from calibration.diagnosis.repeated_visits import scatter_over_visits
from calibration.diagnosis.result import GapFigures
from tests.calibration.diagnosis.campaigns import Arrivals, simulated


def flat(columns):
    return columns.reshape(-1, columns.shape[2])


def rows_of(linear: LinearModel, region: np.ndarray, block: int) -> np.ndarray:
    """Rows of the whitened numbers of one block."""
    of_reading = np.where(linear.visit >= 0, region[np.maximum(linear.visit, 0)], -1)
    return np.flatnonzero(np.repeat(of_reading == block, 3))


@pytest.fixture
def effect(small) -> np.ndarray:
    """Columns (n, 3, 2) of something at the drives, each times its prior standard deviation."""
    shift = MarginalLikelihood.of(small)
    contributions = [((f"travel.{d}", small.context.direction[:, a]),) for a, d in enumerate(("left", "right"))]
    return shift.columns(contributions) * 2e-5


@pytest.mark.parametrize("with_effect", [False, True])
def test_a_block_is_predicted_as_by_a_regression_on_all_others(small, likelihood, effect, with_effect):
    region = regions(small)
    a = np.concatenate([flat(small.columns), flat(effect)], axis=1) if with_effect else flat(small.columns)
    likelihood = likelihood.including(effect) if with_effect else likelihood
    y, c = small.residual.ravel(), np.eye(len(a)) + a @ a.T
    got = withheld_differences(likelihood, region).ravel()
    for block in range(withheld_blocks.REGIONS):
        here = rows_of(small, region, block)
        there = np.setdiff1d(np.arange(len(y)), here)
        expected = y[here] - c[np.ix_(here, there)] @ np.linalg.solve(c[np.ix_(there, there)], y[there])
        np.testing.assert_allclose(got[here], expected, atol=1e-6)


def test_a_block_is_predicted_as_by_a_real_refit(wandering, monkeypatch):
    """The recording without the block is fitted from the start, model and all; its unknowns predict the block."""
    start = station_frame(wandering.file.station.position_m, wandering.file.station.heading_rad)
    monkeypatch.setattr(linearisation, "initial_frame", lambda *_: start)  # unknowns of the frame count from it
    whole = linearise_recording(wandering)
    region, block = regions(whole), 2
    gone = (whole.visit >= 0) & (region[np.maximum(whole.visit, 0)] == block)
    rest = wandering.take(whole.rows[~gone])
    again = linearise_recording(rest)
    assert again.names == whole.names
    result = flat(again.columns).T @ again.apply(again.residual).ravel()
    here = rows_of(whole, region, block)
    expected = whole.residual.ravel()[here] - flat(whole.columns)[here] @ result
    got = withheld_differences(MarginalLikelihood.of(whole), region).ravel()[here]
    assert np.sqrt(np.mean(got**2)) > 0.8
    assert np.sqrt(np.mean((got - expected) ** 2)) < 0.1


def test_regions_share_the_visits_evenly_and_hang_together(small):
    region = regions(small)
    counts = np.bincount(region)
    assert len(counts) == withheld_blocks.REGIONS
    assert np.ptp(counts) <= 2
    place = small.poses.visits.target_m[:, :2]
    radius = np.linalg.norm((place - place.mean(axis=0)) / np.ptp(place, axis=0), axis=1)
    assert radius[region == 0].max() <= radius[region != 0].min()


def test_predictions_are_positions(small, likelihood):
    left = withheld_differences(likelihood, regions(small))
    predicted = small.predicted(left)
    back = np.einsum("nij,nj->ni", small.whiten, small.position_m - predicted)
    np.testing.assert_allclose(back, left, atol=1e-6)


def some_field(rng: np.random.Generator, spread: float) -> GapField:
    before, after = 2e-5 * rng.standard_normal((80, 2)), 6e-6 * rng.standard_normal((80, 2))
    return GapField(np.arange(80), before, after, spread * rng.standard_normal((80, 2, 12)), 0.0, 8e-6)


@pytest.fixture
def exact(monkeypatch):
    """Forms are taken to be exact: nothing is added for what they are not."""
    monkeypatch.setattr(withheld_blocks, "MODEL_ERROR_BEFORE", 0.0)
    monkeypatch.setattr(withheld_blocks, "MODEL_ERROR_AFTER", 0.0)


@pytest.mark.usefixtures("exact")
@pytest.mark.parametrize("spread", [3e-7, 2e-6, 6e-6])
def test_the_interval_is_that_of_many_samples(spread):
    rng = np.random.default_rng(2)
    field = some_field(rng, spread)
    factor = field.spread.reshape(-1, 12)
    drawn = rng.multivariate_normal(np.zeros(len(factor)), factor @ factor.T, 20_000, method="svd")
    before = np.sum((field.before.ravel() + drawn) ** 2, axis=1)
    after = np.sum((field.after.ravel() + drawn) ** 2, axis=1)
    shrunk = 1.0 - np.sqrt(after / before)
    got = gap_figures(field)
    low, middle, high = np.quantile(shrunk, [0.025, 0.5, 0.975])
    width = high - low
    assert got.shrink_interval[0] == pytest.approx(low, abs=0.12 * width)
    assert got.shrink_interval[1] == pytest.approx(high, abs=0.12 * width)
    assert got.shrink == pytest.approx(middle, abs=0.08 * width)
    assert got.before_m == pytest.approx(np.sqrt(before.mean() / 160), rel=0.02)
    assert got.after_m == pytest.approx(np.sqrt(after.mean() / 160), rel=0.05)


def test_figures_say_the_same_twice():
    field = some_field(np.random.default_rng(3), 2e-6)
    assert gap_figures(field) == gap_figures(field)


def test_inexact_forms_widen_the_interval(monkeypatch):
    field = some_field(np.random.default_rng(3), 2e-6)
    wide = gap_figures(field)
    monkeypatch.setattr(withheld_blocks, "MODEL_ERROR_BEFORE", 0.0)
    monkeypatch.setattr(withheld_blocks, "MODEL_ERROR_AFTER", 0.0)
    narrow = gap_figures(field)
    assert wide.shrink_interval[0] < narrow.shrink_interval[0] < narrow.shrink_interval[1] < wide.shrink_interval[1]
    assert wide.shrink == pytest.approx(narrow.shrink, abs=0.05)


def metres(linear: LinearModel, whitened: np.ndarray) -> np.ndarray:
    """Errors of the platform's reflectors in the plane, machine's frame."""
    rows = np.flatnonzero(linear.on_platform)
    station = np.linalg.solve(linear.whiten[rows], whitened[rows][:, :, None])[:, :, 0]
    return (station @ linear.frame.rotation)[:, :2]


@pytest.mark.usefixtures("exact")
def test_the_interval_holds_the_true_shrink_as_often_as_it_says(small, effect):
    """Worlds drawn from the model: unknowns, effect and noise are known, so the true errors of predictions are."""
    rng, region, inside, widths = np.random.default_rng(8), regions(small), 0, []
    worlds = 40
    for _ in range(worlds):
        true = flat(small.columns) @ rng.standard_normal(small.columns.shape[2])
        true += flat(effect) @ rng.standard_normal(2)
        noise = rng.standard_normal(len(true))
        world = replace(small, residual=(true + noise).reshape(small.residual.shape))
        plain = MarginalLikelihood.of(world)
        full = plain.including(effect)
        before, after = withheld_differences(plain, region), withheld_differences(full, region)
        gap = gap_figures(withheld_blocks.gap_field(full, before, after))
        errors = [np.sum(metres(world, x - noise.reshape(x.shape)) ** 2) for x in (before, after)]
        achieved = 1.0 - np.sqrt(errors[1] / errors[0])
        low, high = gap.shrink_interval
        widths.append(high - low)
        inside += low <= achieved <= high
    assert 0.85 * worlds <= inside  # 95 % of 40, less three standard deviations
    assert 0.01 < np.median(widths) < 0.6


def test_noise_is_that_of_the_readings(small, likelihood):
    """RMS over both coordinates of what the platform's readings stray: what the stated covariances say."""
    left = withheld_differences(likelihood, regions(small))
    rows = np.flatnonzero(small.on_platform)
    turned = np.einsum(
        "ji,njk,kl->nil", small.frame.rotation, small.recording.covariances_m2[small.rows[rows]], small.frame.rotation
    )
    stated = np.sqrt(np.mean(np.diagonal(turned, axis1=1, axis2=2)[:, :2]))
    assert withheld_blocks.gap_field(likelihood, left, left).noise_m == pytest.approx(stated, rel=0.1)


def test_the_noise_floor_is_the_scatter_at_a_target_that_is_visited_again(small):
    """Seen by the same reflector, with equal approach and payload; a target that differs by tens of nanometres is the
    same. Two visits are too few."""
    rng, rows = np.random.default_rng(4), np.flatnonzero(small.on_platform)
    visits, n = len(small.poses.visits.target_m), len(small.visit)
    place = np.arange(visits) % (visits // 5)
    target = np.zeros((visits, 6))
    target[:, :2] = 0.01 * place[:, None] + rng.uniform(-4e-8, 4e-8, (visits, 2))
    context = replace(small.context, direction=np.ones((n, 2)), payload_kg=np.zeros(n))
    own = 1e-5 * rng.standard_normal((n, 3)) + 0.1 * small.smr[:, None]
    own[rows, 0] += 0.01 * place[small.visit[rows]]
    again = replace(
        small,
        position_m=small.frame.to_station(own),
        context=context,
        poses=replace(small.poses, visits=replace(small.poses.visits, target_m=target)),
    )
    square, freedom = 0.0, 0
    for smr in np.unique(small.smr[rows]):
        for p in np.unique(place):
            seen = own[rows[(small.smr[rows] == smr) & (place[small.visit[rows]] == p)], :2]
            assert len(seen) >= 3
            square, freedom = square + np.sum((seen - seen.mean(axis=0)) ** 2), freedom + seen.size - 2
    assert again.repeatability_m() == pytest.approx(np.sqrt(square / freedom), rel=1e-6)
    conditions = replace(context, payload_kg=np.where(small.visit >= 0, small.visit // (2 * (visits // 5)), 0.0))
    assert replace(again, context=conditions).repeatability_m() is None


@pytest.mark.parametrize(("before_m", "shrink"), [(3e-6, 0.0), (0.0, np.nan)])
def test_without_an_effect_nothing_shrinks_and_the_shrink_of_no_gap_is_none(before_m, shrink):
    gap = GapFigures(before_m, 1e-6, 5e-6, 0.7, (0.6, 0.8), "regions").without_effect()
    assert gap.after_m == before_m
    assert (gap.shrink, *gap.shrink_interval) == pytest.approx((shrink,) * 3, nan_ok=True)


@pytest.mark.parametrize("readings", [1, 2, 3])
def test_the_noise_floor_counts_visits_not_readings(readings):
    """However often a reflector is read at a stop, it is the scatter of the stops' means; two stops have none."""
    rng = np.random.default_rng(5)
    stops = rng.normal(0.0, 1e-5, (400, 2))
    visit, place = np.repeat(np.arange(400), readings), np.repeat(np.arange(400) // 4, readings)
    within = rng.normal(0.0, 1e-4, (400, readings, 2))
    within -= within.mean(axis=1, keepdims=True)
    read = np.repeat(stops, readings, axis=0) + within.reshape(-1, 2)
    means = stops.reshape(100, 4, 2)
    expected = np.sqrt(np.sum((means - means.mean(axis=1, keepdims=True)) ** 2) / (100 * 3 * 2))
    twice, number = rng.normal(0.0, 1e-5, (2, 2)), np.arange(400, 402)  # a place of two stops counts nothing
    read, visit, place = np.concatenate([read, twice]), np.append(visit, number), np.append(place, [100, 100])
    order = rng.permutation(len(read))
    assert scatter_over_visits(read[order], place[order, None], visit[order]) == pytest.approx(expected)
    in_twos = visit // 2
    assert scatter_over_visits(read, in_twos[:, None], visit) is None


@pytest.mark.parametrize("scatter_m", [0.0, 4e-6, 1.2e-5])
def test_half_of_what_scatters_from_visit_to_visit_and_is_in_no_model_counts_as_left(scatter_m):
    """Drives that stop anyhow, as the same campaign without them shows; of none, less than a tenth of the noise."""
    rng = np.random.default_rng(4)

    def anyhow(arrivals: Arrivals) -> np.ndarray:
        return scatter_m * rng.standard_normal(arrivals.drives.shape)

    scattered, exact = simulated("planar4", 160, anyhow), simulated("planar4", 160)
    likelihood = MarginalLikelihood.of(linearise_recording(scattered))
    difference = withheld_differences(likelihood, regions(likelihood.linear))
    field = gap_field(likelihood, difference, difference)
    moved_m = (scattered.positions_m - exact.positions_m)[likelihood.linear.source_rows[field.rows]]
    true_m = float(np.sqrt(np.mean(np.sum(moved_m**2, axis=1)) / field.before.shape[1]))
    assert field.left_m == pytest.approx(np.sqrt(0.5) * true_m, rel=0.15, abs=0.1 * field.noise_m)


@pytest.mark.usefixtures("exact")
def test_what_is_left_is_left_before_and_after():
    field = some_field(np.random.default_rng(3), 2e-6)
    plain, more = gap_figures(field), gap_figures(replace(field, left_m=5e-6))
    assert more.before_m == pytest.approx(np.hypot(plain.before_m, 5e-6))
    assert more.after_m == pytest.approx(np.hypot(plain.after_m, 5e-6))
    assert more.shrink == pytest.approx(1.0 - more.after_m / more.before_m, abs=0.02)
