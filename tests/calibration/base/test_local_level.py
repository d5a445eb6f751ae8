"""The course of a slow quantity by readings that scatter, against dense matrices and by many drawn courses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from calibration.base.local_level import local_level

WALK, NOISE = 0.02, 0.1  # of one second, of one reading


def drawn(seed: int, count: int, noise: float = NOISE) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, levels and readings."""
    rng = np.random.default_rng(seed)
    wait = rng.uniform(1.0, 30.0, count)
    level = 21.0 + np.cumsum(WALK * np.sqrt(wait) * rng.standard_normal(count))
    return np.cumsum(wait), level, level + noise * rng.standard_normal(count)


def walk_covariance(t_s: np.ndarray, walk: float) -> np.ndarray:
    return walk**2 * (np.minimum(t_s[:, None], t_s) - t_s[0])


def test_it_is_the_most_likely_course_by_dense_matrices():
    t_s, _, x = drawn(3, 40)
    differ = np.diff(np.eye(len(x)), axis=0)  # contrasts, which know nothing of the first level

    def cost(log_sizes: np.ndarray) -> float:
        walk, noise = np.exp(log_sizes)
        covariance = differ @ (walk_covariance(t_s, walk) + noise**2 * np.eye(len(x))) @ differ.T
        return -float(multivariate_normal(np.zeros(len(x) - 1), covariance).logpdf(differ @ x))

    walk, noise = np.exp(minimize(cost, np.log([WALK, NOISE]), method="Nelder-Mead", options={"xatol": 1e-5}).x)
    prior = walk_covariance(t_s, walk) + 1e3  # the first level is free
    gain = prior @ np.linalg.inv(prior + noise**2 * np.eye(len(x)))
    expected = 21.0 + gain @ (x - 21.0)
    deviation = np.sqrt(np.diag(prior - gain @ prior))
    found = local_level(t_s, x)
    assert found.noise == pytest.approx(noise, rel=0.01)
    np.testing.assert_allclose(found.level, expected, atol=0.01 * noise)
    np.testing.assert_allclose(found.deviation, deviation, rtol=0.02)


def test_deviations_and_noise_are_right_over_many_courses():
    found, square = [], []
    for seed in range(40):
        t_s, level, x = drawn(seed, 150)
        course = local_level(t_s, x)
        found.append(course.noise)
        square.append(np.mean(((course.level - level) / course.deviation) ** 2))
    assert np.mean(found) == pytest.approx(NOISE, rel=0.05)
    assert 0.85 < np.mean(square) < 1.3  # 40 courses of some ten independent stretches each


@pytest.mark.parametrize("noise", [0.1, 0.3, 1.0])
def test_it_is_nearer_to_the_truth_than_the_readings(noise):
    t_s, level, x = drawn(11, 200, noise)
    assert np.std(local_level(t_s, x).level - level) < 0.75 * noise


def test_readings_without_noise_stay_what_they_are():
    t_s = np.arange(0.0, 3000.0, 10.0)
    level = 21.0 + np.sin(t_s / 700.0) + 1e-4 * t_s
    found = local_level(t_s, level)
    np.testing.assert_allclose(found.level, level, atol=2e-3)
    assert found.noise < 2e-3


def test_a_level_that_stays_is_their_mean():
    rng = np.random.default_rng(5)
    x = 21.0 + NOISE * rng.standard_normal(100)
    found = local_level(np.arange(100.0), x)
    np.testing.assert_allclose(found.level, x.mean(), atol=0.03)
    assert found.noise == pytest.approx(NOISE, rel=0.2)


def test_noise_that_must_be_there_is():
    t_s = np.arange(0.0, 4000.0, 10.0)
    level = 21.0 + 1.3 * np.sin(t_s / 1300.0)
    rounded = 0.1 * np.round(level / 0.1)
    plain, smoothed = local_level(t_s, rounded), local_level(t_s, rounded, 0.1 / np.sqrt(12.0))
    assert smoothed.noise >= 0.1 / np.sqrt(12.0) > plain.noise
    assert np.std(smoothed.level - level) < 0.85 * np.std(plain.level - level)


def test_an_hour_without_readings_is_one_step():
    t_s, _, x = drawn(2, 60)
    late = t_s + 3600.0 * (np.arange(60) >= 30)
    x[30:] += 2.0  # in an hour a part may well become so much warmer
    found = local_level(late, x)
    assert found.level[30:].mean() - found.level[:30].mean() == pytest.approx(x[30:].mean() - x[:30].mean(), abs=0.05)


@given(
    st.lists(st.tuples(st.floats(0.0, 1e5), st.floats(-200.0, 200.0)), min_size=2, max_size=40),
    st.floats(0.0, 1.0),
)
def test_any_readings_give_finite_courses_among_them(rows, least_noise):
    t_s, x = np.array(sorted(rows)).T
    found = local_level(t_s, x, least_noise)
    assert np.all(np.isfinite(found.level) & np.isfinite(found.deviation))
    assert found.noise >= least_noise
    assert np.all((found.level >= x.min() - 1e-6) & (found.level <= x.max() + 1e-6))
