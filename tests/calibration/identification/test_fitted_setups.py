"""What a fit says of where the station stood: set-ups of one machine whose motions the test draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.rotation import rotation_matrix, rotation_vector
from calibration.identification.calibration import _fitted_setups
from calibration.identification.estimators import identify
from calibration.instruments.setups import Setups
from calibration.instruments.smr_positions import SmrPositions, StationModel
from calibration.reduction.common_points import NestEstimate
from tests.calibration.conftest import SMRS


def test_the_fit_finds_the_motion_of_a_set_up_and_adds_the_drift_of_its_nests(synthetic):
    """Half of the visits were seen from a second place, whose motion was known to a tenth of a millimetre."""
    rig = synthetic(6)
    seen = rig.see(rig.visits(rig.workspace(30), np.zeros(30)))
    setup = (seen.visit % 2).astype(np.intp)
    turn, shift = rotation_matrix(np.array([3e-5, -5e-5, 6e-5])), np.array([8e-5, -6e-5, 9e-5])
    position = np.where(setup[:, None] == 1, seen.position_m @ turn.T + shift, seen.position_m)
    stated = Setups(
        np.array([1, 2]), np.stack([np.eye(3), turn]), np.stack([np.zeros(3), shift]), *[np.empty(0)] * 3
    ).with_error(1e-4)
    station = StationModel(rig.rough, SMRS, 1e-5, 1e-6, 5e-7, setups=stated)
    fit = identify(rig.model, seen.visits, [SmrPositions(replace(seen, position_m=position, setup=setup), station)])
    found = _fitted_setups(fit, {})
    white = np.linalg.cholesky(np.linalg.inv(found.error_covariance)).T
    before, after = (np.concatenate([rotation_vector(s.rotation[1:])[0], s.translation_m[1]]) for s in (stated, found))
    assert np.sum((white @ before) ** 2) > 200.0
    assert np.sum((white @ after) ** 2) < 20.0  # of six degrees of freedom
    drift = np.diag([1e-6, 2e-6, 3e-6, 4e-6, 5e-6, 6e-6]) ** 2
    nests = {1.0: NestEstimate((), np.zeros((0, 3)), np.zeros((0, 0)), drift)}
    assert _fitted_setups(fit, nests).error_covariance - found.error_covariance == pytest.approx(drift, abs=1e-18)
