"""The formulae of ISO 230-2 and ISO 9283, held against figures that follow from the noise alone."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.reduction.standard_figures import axis_figures, pose_figures


def test_pure_noise_gives_the_known_means_and_spreads():
    rng = np.random.default_rng([230, 2])
    drawn = [axis_figures(*rng.normal(size=(2, 11, 5))) for _ in range(4000)]
    repeatability = np.array([f.repeatability_m for f in drawn])
    accuracy = np.array([f.accuracy_m for f in drawn])
    assert repeatability.mean() == pytest.approx(6.66, abs=0.06)
    assert np.quantile(repeatability, (0.025, 0.975)) == pytest.approx((5.27, 8.55), abs=0.15)
    assert accuracy.mean() == pytest.approx(7.05, abs=0.06)
    assert np.quantile(accuracy, (0.025, 0.975)) == pytest.approx((5.76, 8.68), abs=0.15)


def test_a_constant_reversal_is_reversal_and_repeatability():
    up, down = np.full((11, 5), 3.0), np.full((11, 5), 1.0)
    found = axis_figures(up, down)
    assert found.reversal_m == found.repeatability_m == found.accuracy_m == found.systematic_m == 2.0
    assert found.mean_error_m == 0.0
    assert (found.targets, found.runs) == (11, 5)


def test_by_hand():
    # Two targets, two runs. s = |difference| / sqrt(2). Target 1: up 0, 2 (mean 1, s 1.4142), down 3, 3 (mean 3, s 0);
    # target 2: up -1, -1, down 0, 4 (mean 2, s 2.8284).
    found = axis_figures(np.array([[0.0, 2.0], [-1.0, -1.0]]), np.array([[3.0, 3.0], [0.0, 4.0]]))
    root = np.sqrt(2.0)
    assert found.reversal_m == pytest.approx(3.0)
    assert found.repeatability_m == pytest.approx(max(2 * root + 2.0, 4 * root, 4 * root + 3.0, 8 * root))
    assert found.accuracy_m == pytest.approx((2.0 + 4 * root) - min(1.0 - 2 * root, -1.0, 2.0 - 4 * root))
    assert found.systematic_m == pytest.approx(4.0)
    assert found.mean_error_m == pytest.approx(2.0 - 0.5)


def test_isotropic_noise_gives_the_known_pose_repeatability():
    rng = np.random.default_rng(9283)
    drawn = np.array([pose_figures(rng.normal(size=(30, 3))).repeatability_m for _ in range(4000)])
    assert drawn.mean() == pytest.approx(3.54, abs=0.03)
    assert np.quantile(drawn, (0.025, 0.975)) == pytest.approx((2.93, 4.19), abs=0.06)


def test_pose_accuracy_is_the_distance_of_the_barycentre():
    found = pose_figures(np.array([[3.0, 4.0], [5.0, 4.0], [1.0, 4.0], [3.0, 4.0]]))
    assert found.accuracy_m == pytest.approx(5.0)
    assert found.repeatability_m == pytest.approx(1.0 + 3.0 * np.std([0, 2, 2, 0], ddof=1))
    assert found.cycles == 4


@pytest.mark.parametrize("shapes", [((1, 5), (1, 5)), ((11, 1), (11, 1)), ((11, 5), (11, 4)), ((11,), (11,))])
def test_too_little_is_refused(shapes):
    with pytest.raises(ValueError, match="deviations of shape"):
        axis_figures(*(np.zeros(shape) for shape in shapes))
    with pytest.raises(ValueError, match="deviations of shape"):
        pose_figures(np.zeros(shapes[0])[:1])
