"""Run lengths of charts against published tables, a Markov chain and simulated runs."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from calibration.base.errors import InputError
from calibration.intervals.charts import Cusum, Ewma, Shewhart, limit_for

SHIFTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0)
# Lucas and Saccucci 1990, as in Montgomery, Introduction to Statistical Quality Control, chapter on EWMA and CUSUM.
EWMA_PUBLISHED = {
    (0.40, 3.054): (500, 224, 71.2, 28.4, 14.3, 5.9, 3.5, 2.5, 2.0, 1.4),
    (0.25, 2.998): (500, 170, 48.2, 20.1, 11.1, 5.5, 3.6, 2.7, 2.3, 1.7),
    (0.20, 2.962): (500, 150, 41.8, 18.2, 10.5, 5.5, 3.7, 2.9, 2.4, 1.9),
    (0.10, 2.814): (500, 106, 31.3, 15.9, 10.3, 6.1, 4.4, 3.4, 2.9, 2.2),
    (0.05, 2.615): (500, 84.1, 28.8, 16.4, 11.4, 7.1, 5.2, 4.2, 3.5, 2.7),
}
CUSUM_PUBLISHED = {
    4.0: (168, 74.2, 26.6, 13.3, 8.38, 4.75, 3.34, 2.62, 2.19, 1.71),
    5.0: (465, 139, 38.0, 17.0, 10.4, 5.75, 4.01, 3.11, 2.57, 2.01),
}


@pytest.mark.parametrize(("chart", "published"), EWMA_PUBLISHED.items())
def test_ewma_has_the_published_run_lengths(chart, published):
    lengths = [Ewma(*chart, steady=True).average_run_length(shift) for shift in SHIFTS]
    assert lengths == pytest.approx(published, rel=0.012, abs=0.06)


@pytest.mark.parametrize(("limit", "published"), CUSUM_PUBLISHED.items())
def test_cusum_has_the_published_run_lengths(limit, published):
    lengths = [Cusum(0.5, limit).average_run_length(shift) for shift in SHIFTS]
    assert lengths == pytest.approx(published, rel=0.006, abs=0.006)


def test_shewhart_has_the_published_run_lengths():
    lengths = [Shewhart(3.0).average_run_length(shift) for shift in (0.0, 1.0, 2.0, 3.0)]
    assert lengths == pytest.approx((370.4, 43.89, 6.30, 2.00), rel=1e-3)


def markov_ewma(weight, limit, shift, states=601):
    """Lucas and Saccucci's chain: the in-control band cut into cells, from each cell's middle into the others."""
    edge = limit * np.sqrt(weight / (2.0 - weight))
    width = 2.0 * edge / states
    middle = -edge + width * (np.arange(states) + 0.5)
    step = (middle[None, :] - (1.0 - weight) * middle[:, None]) / weight
    half = 0.5 * width / weight
    moves = norm.cdf(step + half, shift) - norm.cdf(step - half, shift)
    return np.linalg.solve(np.eye(states) - moves, np.ones(states))[states // 2]


def markov_cusum(reference, limit, shift, states=601):
    """Brook and Evans' chain of one sum: zero, then cells of equal width."""
    width = 2.0 * limit / (2.0 * states - 1.0)
    at = width * np.arange(states)
    step = at[None, :] - at[:, None] + reference
    moves = norm.cdf(step + 0.5 * width, shift) - norm.cdf(step - 0.5 * width, shift)
    moves[:, 0] = norm.cdf(step[:, 0] + 0.5 * width, shift)
    return np.linalg.solve(np.eye(states) - moves, np.ones(states))[0]


@pytest.mark.parametrize("shift", [0.0, 0.4, 1.0, 3.0])
def test_run_lengths_agree_with_markov_chains(shift):
    for weight, limit in ((0.1, 2.7), (0.3, 3.0)):
        assert Ewma(weight, limit, steady=True).average_run_length(shift) == pytest.approx(
            markov_ewma(weight, limit, shift), rel=2e-3
        )
    both = 1.0 / (1.0 / markov_cusum(0.5, 4.5, shift) + 1.0 / markov_cusum(0.5, 4.5, -shift))
    assert Cusum(0.5, 4.5).average_run_length(shift) == pytest.approx(both, rel=2e-3)


@pytest.mark.parametrize("chart", [Shewhart(2.2), Ewma(0.2, 2.0, steady=True), Cusum(0.5, 2.5)])
def test_charts_run_as_long_as_computed(chart):
    rng = np.random.default_rng(5)
    expected = chart.average_run_length(0.5)
    lengths = []
    for _ in range(400):
        first = chart.run(rng.standard_normal(int(12 * expected)) + 0.5).first_alarm
        assert first is not None
        lengths.append(first + 1)
    # the standard deviation of a run's length is about its mean
    assert np.mean(lengths) == pytest.approx(expected, abs=4.0 * expected / np.sqrt(400))


def test_exact_limits_of_ewma_begin_narrow_and_become_the_steady_ones():
    exact, steady = Ewma(0.2, 3.0).run(np.zeros(60)), Ewma(0.2, 3.0, steady=True).run(np.zeros(60))
    assert exact.limit[0] == pytest.approx(3.0 * 0.2)
    assert exact.limit[-1] == pytest.approx(steady.limit[0], rel=1e-9)


def test_a_limit_is_found_for_a_run_length():
    assert limit_for(Shewhart, 370.398) == pytest.approx(3.0, abs=1e-5)
    assert limit_for(lambda h: Cusum(0.5, h), 465.0) == pytest.approx(5.0, abs=5e-3)
    assert limit_for(lambda h: Ewma(0.25, h), 500.0) == pytest.approx(2.998, abs=3e-3)
    with pytest.raises(InputError, match="no limit"):
        limit_for(Shewhart, 1e60)


def test_a_cusum_has_the_sign_of_its_larger_sum():
    assert Cusum(0.5, 4.0).run(np.array([-2.0, -2.0])).statistic == pytest.approx([-1.5, -3.0])
    assert Cusum(0.5, 4.0).run(np.array([2.0, 0.0, -3.0])).statistic == pytest.approx([1.5, 1.0, -2.5])


@pytest.mark.parametrize(
    "make",
    [lambda: Shewhart(0.0), lambda: Ewma(1.2, 3.0), lambda: Cusum(-1.0, 4.0), lambda: Shewhart(3.0).run([np.nan])],
)
def test_charts_that_cannot_be_are_refused(make):
    with pytest.raises(InputError):
        make()
