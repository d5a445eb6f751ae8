"""When a fit has settled although its steps did not end by themselves."""

from __future__ import annotations

import math

import pytest

from benchmarks.joint_covariance import fitted
from calibration.identification.gauss_newton import left_to_go


def test_what_is_left_is_the_sum_of_the_steps_to_come():
    assert left_to_go([math.inf, 8e-6, 4e-6]) == pytest.approx(sum(4e-6 / 2**k for k in range(1, 60)))
    assert left_to_go([math.inf, 1e-9, 2e-9]) == math.inf
    assert left_to_go([math.inf]) == math.inf
    assert left_to_go([math.inf, 1.0]) == math.inf  # one step says nothing of the next


def test_a_fit_that_creeps_towards_its_minimum_has_settled():
    """Linear convergence by a fifth a step: after sixty of them 1e-5 standard errors are left."""
    fit, _ = fitted("delta8", 3)
    assert fit.converged
