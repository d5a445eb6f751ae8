"""The step to which positions are rounded, by their values alone."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import savgol_filter

from calibration.base.rounded_values import rounding_deviation, rounding_step

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


@pytest.mark.parametrize("noise", [0.0, 1e-4])
@pytest.mark.parametrize(
    "place", [np.arange(900.0), np.abs(np.arange(900.0) - 450.0), np.minimum(np.arange(900.0), 600.0)]
)
def test_a_steady_motion_is_not_rounded(place, noise):
    x = 0.25 * place + noise * np.random.default_rng(2).standard_normal(900)
    assert rounding_deviation(x, savgol_filter(x, 7, 3)) < max(1.3 * noise, 2e-3)


def test_deviation_of_rounded_values():
    x = np.round(SMOOTH, 3)
    assert rounding_deviation(x, savgol_filter(x, 7, 3)) == pytest.approx(float(np.std(x - SMOOTH)), rel=0.1)
