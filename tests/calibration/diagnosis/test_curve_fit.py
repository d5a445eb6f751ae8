"""A curve whose parameter is not linear: found from afar, with the evidence of a scan of the parameter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.diagnosis.basis_set_evidence import evidence_of_basis_sets
from calibration.diagnosis.curve_fit import fit_curves
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.effects.api import BasisSet, Curve, Tangent
from calibration.effects.columns import Contributions

LOW_M, HIGH_M = 1e-6, 1e-3
RATES = (-2.0, 12.0)  # 1/m
SIZE_M, RATE = 8e-5, 4.3
CHANNEL = "travel.left"


def decaying(likelihood: MarginalLikelihood, rate: float) -> np.ndarray:
    """A step at reversal that decays exponentially along the travel."""
    context = likelihood.linear.context
    return context.direction[:, 0] * np.exp(-rate * (context.drives[:, 0] - context.drives[:, 0].min()))


def curve_from(likelihood: MarginalLikelihood, start: float, spread: float = np.inf) -> Curve:
    """Of the logarithm of the size in m and the rate."""
    travel = likelihood.linear.context.drives[:, 0]

    def tangent(point: np.ndarray) -> Tangent:
        size_m, shape = float(np.exp(point[0])), decaying(likelihood, point[1])
        by_rate = -(travel - travel.min()) * shape
        contributions: tuple[Contributions, ...] = tuple(((CHANNEL, one),) for one in (shape, shape, by_rate))

        def step(coefficients: np.ndarray) -> np.ndarray:
            main = max(float(coefficients[0]), 0.2 * size_m)
            return coefficients[1:] / main + np.array([np.log(main / size_m), 0.0])

        return Tangent(contributions, (1.0, 0.5, 0.5), (1.0, 1.0), (1.0, 1.0), step)

    low, high = np.array([np.log(LOW_M), RATES[0]]), np.array([np.log(HIGH_M), RATES[1]])
    return Curve(np.array([[np.log(1e-5), start]]), low, high, np.array([np.inf, spread]), tangent)


@pytest.fixture
def decays(small, likelihood) -> MarginalLikelihood:
    """The readings' noise and a step of 80 um that decays with 4.3 1/m."""
    noise = np.random.default_rng(6).standard_normal(small.residual.shape)
    signal = SIZE_M * likelihood.response(CHANNEL) * decaying(likelihood, RATE)[:, None]
    return MarginalLikelihood.of(replace(small, residual=noise + signal))


def scanned(likelihood: MarginalLikelihood) -> tuple[float, float]:
    """Log evidence averaged over all rates, and the most likely rate."""
    rates = np.linspace(*RATES, 281)
    shapes = [((CHANNEL, decaying(likelihood, rate)),) for rate in rates]
    sets = [BasisSet((k,), (1.0,)) for k in range(len(rates))]
    evidence = evidence_of_basis_sets(likelihood.information_and_score(shapes), sets, LOW_M, HIGH_M)
    logs = np.array([one.log_evidence for one in evidence])
    return float(np.logaddexp.reduce(logs) - np.log(len(logs))), float(rates[np.argmax(logs)])


@pytest.mark.parametrize("start", [-1.0, 4.0, 9.0])
def test_the_parameter_is_found_from_wherever_it_is_looked_for(decays, start):
    found = fit_curves(decays, [curve_from(decays, start)], LOW_M, HIGH_M)
    log_evidence, rate = scanned(decays)
    assert found.best.basis_set.curve[1][1] == pytest.approx(rate, abs=0.15)
    assert found.log_evidence == pytest.approx(log_evidence, abs=1.5)
    weights = np.array([1.0, 1.0, 0.0])
    u_m = np.sqrt(weights @ found.best.covariance @ weights)
    assert weights @ found.best.coefficients == pytest.approx(SIZE_M, abs=3.0 * u_m)
    assert u_m < 0.2 * SIZE_M


def test_a_step_that_goes_too_far_is_shortened(decays):
    """Where the rate may change by any amount at once, its first steps overshoot the range in which it is linear."""
    found = fit_curves(decays, [curve_from(decays, 11.0, spread=20.0)], LOW_M, HIGH_M)
    assert found.best.basis_set.curve[1][1] == pytest.approx(scanned(decays)[1], abs=0.15)
