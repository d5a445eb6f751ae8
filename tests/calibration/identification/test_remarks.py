"""What is said beside a fit: scatter, parameters no tolerance explains, one load only."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.identification.remarks import _scatter, remarks
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.reduction.data_checks import require_spread_poses


@pytest.fixture(scope="module")
def seen(synthetic):
    rig = synthetic(60)
    xy = rig.workspace(25)
    return rig, rig.see(rig.visits(np.concatenate([xy, xy]), np.repeat([0.0, 400.0], 25)))


def test_nothing_is_said_of_a_good_fit(seen):
    rig, good = seen
    assert remarks(rig.fit(good, rig.rough)) == ()


def test_outliers_and_wrong_covariances_are_said(seen):
    rig, good = seen
    wild = good.position_m.copy()
    wild[::30] += 1e-3
    sentences = remarks(rig.fit(replace(good, position_m=wild), rig.rough))
    assert any("outliers" in r for r in sentences)
    sentences = remarks(rig.fit(replace(good, covariance_m2=good.covariance_m2 * 1e6), rig.rough))
    assert any(r.startswith("the readings scatter 0.01") for r in sentences)


def test_an_offset_of_a_drive_shows_in_parameters_far_outside_their_tolerances(seen):
    rig, good = seen
    drives = good.visits.drives + np.array([5e-3, 0.0])
    moved = ReflectorObservations(
        replace(good.visits, drives=drives), good.visit, good.smr, good.position_m, good.covariance_m2
    )
    assert any(r.startswith("far outside their tolerances") for r in remarks(rig.fit(moved, rig.rough)))


def test_one_load_leaves_the_size_of_stiffness_open(seen):
    rig, good = seen
    fit = rig.fit(good.of_visits(good.visits.payload_kg == 0.0), rig.rough)
    assert any("second, known payload" in r for r in remarks(fit))


def test_too_few_poses_and_poses_in_one_corner_are_refused(machine):
    rng = np.random.default_rng(0)
    low, high = machine.commanded_limits.T
    target = np.zeros((6, 6))
    target[:, :2] = rng.uniform(low, high, (6, 2))
    require_spread_poses(machine, target)
    with pytest.raises(InputError, match=r"5 different poses are too few .* measure 6 or more"):
        require_spread_poses(machine, np.vstack([target[:5], target[:5]]))
    target[:, 0] *= 0.1
    with pytest.raises(InputError, match="all poses lie in one corner: x"):
        require_spread_poses(machine, target)


@pytest.mark.parametrize(
    ("chi2_per_dof", "begins"),
    [(0.09, "the readings scatter 0.3 times"), (0.11, None), (1.89, None), (1.91, "the readings scatter 1.4 times")],
)
def test_scatter_is_said_beyond_half_and_one_and_a_half_by_four_standard_deviations(chi2_per_dof, begins):
    """Of chi-squared over 200 degrees of freedom: 4 (2 / 200)^(1/2) = 0.4."""
    sentences = _scatter(SimpleNamespace(degrees_of_freedom=200.0, chi2_per_dof=chi2_per_dof, positioning=None))
    assert len(sentences) == (begins is not None)
    assert all(sentence.startswith(begins) for sentence in sentences)
