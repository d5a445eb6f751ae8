"""Estimators against their definitions: loss and weights, what truncation keeps, covariances, chi-square."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from calibration.identification.estimators import identify
from calibration.identification.linear_system import QrAccumulator, estimator_covariance, truncated_covariance
from calibration.identification.prediction import monte_carlo, predict_tool, tool_derivatives
from calibration.identification.problem import LeastSquaresProblem
from calibration.instruments.tool_coordinates import ToolCoordinates
from calibration.machine.description import load_machine, shipped_machine
from calibration.machine.inverse import rigid_drives
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits

SIGMA = np.array([7e-6, 7e-6, 30e-6])


@pytest.fixture(scope="module")
def model():
    return Model(ParameterSet.of(load_machine(shipped_machine("planar4")), ("strut_length", "platform_joint")))


def seen(model, seed, count=8, wrong_m=0.0):
    """Visits of a machine with errors, and what was read of them; every fourth reading may be wrong."""
    rng = np.random.default_rng(seed)
    machine = model.machine
    target = np.zeros((count, 6))
    low, high = machine.workspace[:2].T
    target[:, :2] = rng.uniform(low, high, (count, 2))
    visits = Visits.at_reference_temperature(machine, rigid_drives(machine, machine.nominal, target), target)
    truth = np.array([u.sigma for u in model.unknowns]) * rng.standard_normal(len(model))
    poses = model.predict(truth, visits)
    value = np.concatenate([poses.tool_m(), poses.equilibrium.coordinates()[:, 3:]], axis=1)
    value[:, [0, 1, 5]] += rng.standard_normal((count, 3)) * SIGMA
    value[::4, 0] += wrong_m
    return visits, ToolCoordinates.of(visits, (0, 1, 5), value, SIGMA)


def test_weights_of_huber_belong_to_its_loss(model):
    """The gradient by weighted rows is half that of the loss, by differences; wrong readings have weights below 1."""
    visits, readings = seen(model, 1, wrong_m=4e-4)
    problem = LeastSquaresProblem(model, visits, [readings], robust=True)
    z = 0.3 * np.random.default_rng(2).standard_normal(problem.layout.size)
    none = np.zeros(z.size)
    step = 1e-4 * np.eye(z.size)
    by_differences = [(problem.loss(z + h, none) - problem.loss(z - h, none)) / 2e-4 for h in step]
    gradient = problem.linearise(z).gradient()
    np.testing.assert_allclose(2.0 * gradient, by_differences, rtol=1e-4, atol=1e-4 * np.max(np.abs(gradient)))


def test_priors_are_squares_whatever_the_loss_of_readings(model):
    visits, readings = seen(model, 1)
    problem = LeastSquaresProblem(model, visits, [readings], robust=True)
    z = np.linspace(-6.0, 6.0, problem.layout.size)
    weight = np.linspace(0.5, 2.0, z.size)
    alone = problem.loss(z, np.zeros(z.size))
    assert problem.loss(z, weight) - alone == pytest.approx(np.sum((weight * z) ** 2), rel=1e-6)


def test_a_robust_fit_is_where_loss_and_priors_balance(model):
    visits, readings = seen(model, 3, wrong_m=4e-4)
    fit = identify(model, visits, [readings], robust=True)
    z = fit.unknowns / fit.layout.sigma
    problem = LeastSquaresProblem(model, visits, [readings], robust=True)
    np.testing.assert_allclose(problem.linearise(z).gradient() + z, 0.0, atol=1e-4)


def test_truncation_keeps_what_the_data_say_more_about_than_the_tolerances(model):
    """In the directions of singular values above 1 the readings alone decide; in all others nothing is moved."""
    visits, readings = seen(model, 4, count=5)
    fit = identify(model, visits, [readings], "truncated_svd")
    assert fit.converged
    _, s, vt = np.linalg.svd(fit.system.factor)
    assert np.any((s > 0.5) & (s < 1.0))  # what a wrong limit would keep
    assert np.any((s > 1.0) & (s < 2.0))  # what a wrong limit would leave out
    z = vt @ (fit.unknowns / fit.layout.sigma)
    assert np.max(np.abs(z[s < 1.0])) < 1e-3
    assert np.min(np.abs(z[s > 1.0])) > 1e-3
    assert np.max(np.abs((vt @ fit.system.gradient())[s > 1.0] / s[s > 1.0])) < 1e-3


def linear(rng, unknowns=5, rows=40):
    """A linear problem whose singular values stretch from well above 1 to well below."""
    jacobian = rng.standard_normal((rows, unknowns)) @ np.diag(np.geomspace(2.0, 0.02, unknowns))
    folding = QrAccumulator(unknowns)
    folding.add(jacobian, np.zeros(rows))
    return jacobian, folding.result()


@pytest.mark.parametrize("weight", [0.01, 0.3, 1.0, 5.0])
def test_covariance_of_an_estimator_is_the_scatter_of_its_error(weight):
    """Truths drawn from the priors, noise, the estimate by its normal equations: as JCGM 101 would have it."""
    rng = np.random.default_rng(5)
    jacobian, system = linear(rng)
    weights = np.array([weight, weight, weight, 1.0, 1.0])
    truth = rng.standard_normal((40_000, 5))
    reading = truth @ jacobian.T + rng.standard_normal((40_000, 40))
    estimate = np.linalg.solve(jacobian.T @ jacobian + np.diag(weights**2), jacobian.T @ reading.T).T
    scatter = np.cov((estimate - truth).T)
    stated = estimator_covariance(system, weights)
    white = np.linalg.inv(np.linalg.cholesky(stated))
    np.testing.assert_allclose(white @ scatter @ white.T, np.eye(5), atol=0.05)


def test_covariance_of_truncation_is_the_scatter_of_its_error():
    rng = np.random.default_rng(6)
    jacobian, system = linear(rng)
    _, s, vt = np.linalg.svd(jacobian, full_matrices=False)
    assert np.any(s < 0.7)
    kept = vt[s > 1.0]
    truth = rng.standard_normal((40_000, 5))
    reading = truth @ jacobian.T + rng.standard_normal((40_000, 40))
    by_kept = jacobian @ kept.T
    estimate = np.linalg.lstsq(by_kept, reading.T, rcond=None)[0].T @ kept
    scatter = np.cov((estimate - truth).T)
    white = np.linalg.inv(np.linalg.cholesky(truncated_covariance(system)))
    np.testing.assert_allclose(white @ scatter @ white.T, np.eye(5), atol=0.05)


@pytest.mark.parametrize("estimator", ["least_squares", "tikhonov", "l_curve", "truncated_svd", "map"])
def test_a_fit_states_the_covariance_of_its_own_estimator(model, estimator):
    """From the fit's linear system and weight by plain matrices, on readings that leave directions open."""
    visits, readings = seen(model, 7, count=6)
    fit = identify(model, visits, [readings], estimator)
    information = fit.system.factor.T @ fit.system.factor
    n = len(information)
    if estimator == "truncated_svd":
        values, vectors = np.linalg.eigh(information)
        expected = (vectors * np.where(values > 1.0, 1.0 / values, 1.0)) @ vectors.T
    else:
        squares = np.full(n, fit.weight**2)
        posterior = np.linalg.inv(information + np.diag(squares))
        expected = posterior @ (np.diag(squares**2) + information) @ posterior
    sigma = fit.layout.sigma
    np.testing.assert_allclose(fit.covariance / np.outer(sigma, sigma), expected, rtol=1e-5, atol=1e-6)
    if estimator != "map":
        assert fit.weight != 1.0 or estimator == "truncated_svd"


def test_chi_square_is_per_degree_of_freedom_not_per_row(model):
    """Of 24 numbers the fit follows a quarter: over rows it would seem that noise is smaller than stated."""
    values = []
    for seed in range(30):
        visits, readings = seen(model, seed)
        fit = identify(model, visits, [readings])
        hat = np.linalg.inv(fit.system.information() + np.eye(fit.layout.size)) @ fit.system.information()
        freedom = 24.0 - np.trace(hat)
        assert freedom < 20.0
        assert fit.chi2_per_dof == pytest.approx(np.sum(fit.residuals[0] ** 2) / freedom, rel=1e-6)
        values.append(fit.chi2_per_dof)
    assert np.mean(values) == pytest.approx(1.0, abs=0.25)


def test_the_squared_weight_of_a_reading_is_the_slope_of_its_loss():
    """Of Huber's loss, for readings of three numbers from far below to far above its limit."""
    robust, step = SimpleNamespace(robust=True), 1e-6
    residual = np.geomspace(1e-3, 1e3, 40)[:, None] * np.array([0.6, -0.8, 0.1])
    square = np.sum(residual**2, axis=1)
    above, below = (LeastSquaresProblem._rho(robust, square * (1.0 + s), 3) for s in (step, -step))
    slope = (above - below) / (2.0 * step * square)
    assert LeastSquaresProblem._weights(robust, residual) ** 2 == pytest.approx(slope, rel=1e-4)
    assert slope[0] == pytest.approx(1.0)
    assert slope[-1] < 0.01


def test_a_start_is_searched_with_an_even_share_of_the_readings(model):
    """The same ones each time, in their order; a problem that is not much larger is its own start."""
    visits, readings = seen(model, 1, count=50)
    problem = LeastSquaresProblem(model, visits, [readings])
    some, again = problem.subsample(10), problem.subsample(10)
    rows, again_rows = (part.readings[0].value for part in (some, again))
    assert len(rows) == np.ceil(0.2 * len(readings))
    assert np.array_equal(rows, again_rows)
    place = [int(np.flatnonzero(np.all(readings.value == row, axis=1))[0]) for row in rows]
    assert place == sorted(set(place))
    assert problem.subsample(26) is problem


def test_a_search_that_starts_where_one_ended_makes_no_step(model):
    """It has converged at once, and had not before it began."""
    visits, readings = seen(model, 1)
    problem = LeastSquaresProblem(model, visits, [readings])
    assert not problem.converged
    every = np.arange(problem.layout.size)
    z = problem.minimise(np.zeros(every.size), every, 1.0)
    again = LeastSquaresProblem(model, visits, [readings])
    assert np.array_equal(again.minimise(z, every, 1.0), z)
    assert again.converged


def test_the_mean_of_monte_carlo_is_that_of_its_draws(model):
    """Of two draws, by the linear answer to their errors: of the readings first, then of the priors."""
    visits, readings = seen(model, 2)
    fit = identify(model, visits, [readings])
    rng = np.random.default_rng(5)
    (block,) = LeastSquaresProblem(model, visits, [readings]).derivatives(fit.unknowns / fit.layout.sigma)
    jacobian = block.jacobian.reshape(-1, fit.layout.size) * fit.layout.sigma
    means = []
    for _ in range(2):
        pull = jacobian.T @ rng.standard_normal((len(readings), readings.width)).ravel()
        pull += rng.standard_normal(fit.layout.size)
        means.append(np.linalg.solve(jacobian.T @ jacobian + np.eye(len(pull)), pull) * fit.layout.sigma)
    derivatives = tool_derivatives(model, fit.layout, fit.instruments, fit.unknowns, visits).both
    drawn = monte_carlo(fit, visits, seed=5, draws=2)
    shift = drawn.coordinates - predict_tool(fit, visits).coordinates
    assert np.max(np.abs(shift[:, :2])) > 1e-6
    assert shift == pytest.approx(derivatives @ np.mean(means, axis=0), abs=2e-8)
