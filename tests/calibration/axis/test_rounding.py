"""The step to which positions are rounded, by their values alone."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.axis.rounding import rounding_deviation, rounding_step

SMOOTH = 0.8 * np.sin(0.01 * np.arange(900.0)) + 0.1 * np.sin(0.037 * np.arange(900.0))


@pytest.mark.parametrize("step", [1e-3, np.radians(1e-2), 2.0 * np.pi / 2**16])
def test_a_grid_is_found(step):
    assert rounding_step(step * np.round(SMOOTH / step) + 3.0) == pytest.approx(step, rel=1e-4)


def test_counts_in_a_file_of_decimals_are_the_counts():
    step = 2.0 * np.pi / 2**14
    assert rounding_step(np.round(step * np.round(SMOOTH / step), 7)) == pytest.approx(step, rel=1e-3)


def test_without_a_grid_it_is_that_of_the_numbers():
    assert rounding_step(1000.0 + SMOOTH) == np.spacing(1000.9)
    assert rounding_step(np.full(300, 2.0)) == np.spacing(2.0)
    assert rounding_step(np.repeat([0.0, 1.0], 200)) == np.spacing(1.0)  # two values are no grid


def test_deviation_of_a_difference():
    rng = np.random.default_rng(1)
    first, second = SMOOTH + 1e-3 * rng.random(900), SMOOTH
    left = (np.round(first, 3) - first) - (np.round(second, 3) - second)
    assert rounding_deviation(np.round(first, 3), np.round(second, 3)) == pytest.approx(float(np.std(left)), rel=0.1)
