"""Courses that must not turn, against isotonic regression and a general optimiser, and at a foundation that settles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import isotonic_regression, minimize

from calibration.diagnosis import one_way
from calibration.diagnosis.basis_set_evidence import BasisSetEvidence
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.one_way import judge_courses, least_square, loss_of_one_way
from calibration.diagnosis.place_evidence import evidence_by_place
from calibration.effects.api import BasisSets
from calibration.effects.basis_functions import random_walk_basis, steps_over
from calibration.effects.catalogue import load_catalogue
from mock_devices.effects import EffectChoice
from tests.calibration.diagnosis.campaigns import plant, recorded

COUNT = 12


def evidence_of(values: np.ndarray, sd: float, *, steps: np.ndarray) -> BasisSetEvidence:
    """Of a course whose coefficients (k,) are known to a standard deviation."""
    sets = BasisSets()
    sets.add_set(sets.add(("travel.left", np.eye(len(values)))))
    sets.keep_one_way(steps, since=0)
    return BasisSetEvidence(sets.sets[0], 100.0, 1.0, values, sd**2 * np.eye(len(values)))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_loss_is_that_of_isotonic_regression(seed, way):
    """Values at times, each known by itself: the nearest course that goes one way is what that computes."""
    rng, sd = np.random.default_rng(seed), 0.3
    values = way * np.linspace(0.0, 4.0, COUNT) + rng.standard_normal(COUNT)
    nearest = isotonic_regression(values, increasing=way > 0.0).x
    loss = loss_of_one_way(evidence_of(values, sd, steps=np.diff(np.eye(COUNT), axis=0)))
    assert loss == pytest.approx(0.5 * np.sum((nearest - values) ** 2) / sd**2, rel=1e-6)
    assert loss > 1.0


@pytest.mark.parametrize("seed", range(5))
def test_least_square_is_that_of_a_general_optimiser(seed):
    rng = np.random.default_rng(seed)
    g, h = rng.standard_normal((8, 5)), rng.standard_normal(8) - 0.5
    constraint = {"type": "ineq", "fun": lambda x: g @ x - h, "jac": lambda _: g}
    inside = 100.0 * np.linalg.lstsq(g, np.abs(h) + 1.0)[0]
    found = minimize(lambda x: x @ x, inside, jac=lambda x: 2.0 * x, constraints=constraint, method="SLSQP")
    assert least_square(g, h) == pytest.approx(found.fun if found.success else np.inf, rel=1e-5, abs=1e-6)


def test_constraints_that_contradict_one_another_cannot_be_met():
    assert least_square(np.array([[1.0], [-1.0]]), np.array([1.0, 1.0])) == float("inf")


def test_a_course_that_goes_one_way_loses_nothing():
    steps = np.diff(np.eye(COUNT), axis=0)
    assert loss_of_one_way(evidence_of(np.linspace(3.0, -1.0, COUNT), 0.1, steps=steps)) == 0.0


def test_basis_sets_without_such_courses_lose_nothing():
    sets = BasisSets()
    sets.add_set(sets.add(("travel.left", np.eye(3))))
    entry = BasisSetEvidence(sets.sets[0], 100.0, 1.0, np.array([1.0, -1.0, 1.0]), 1e-6 * np.eye(3))
    assert loss_of_one_way(entry) == 0.0


def test_each_course_of_a_set_goes_its_own_way():
    """Sunk and leant: one goes up while the other goes down, and either may cost."""
    sets, line = BasisSets(), np.linspace(0.0, 1.0, COUNT)
    main, flexible = (sets.add(("travel.left", np.eye(COUNT))) for _ in range(2))
    sets.add_set(main, flexible)
    steps = np.diff(np.eye(COUNT), axis=0)
    sets.keep_one_way(steps, since=0)
    assert [len(basis_set.one_way) for basis_set in sets.sets] == [1, 2]

    def loss(second: np.ndarray) -> float:
        values = np.concatenate([line, second])
        return loss_of_one_way(BasisSetEvidence(sets.sets[1], 100.0, 1.0, values, 1e-4 * np.eye(2 * COUNT)))

    assert loss(-line) == 0.0
    returns = np.minimum(line, 1.0 - line)
    nearest = isotonic_regression(returns, increasing=bool(returns[-1] - returns[0] >= 0.0)).x
    assert loss(returns) == pytest.approx(0.5e4 * np.sum((nearest - returns) ** 2), rel=1e-6)


def test_steps_are_those_of_a_course_in_the_order_of_time():
    rng = np.random.default_rng(3)
    t_s = rng.permutation(np.linspace(0.0, 4000.0, 301))
    steps = steps_over(t_s, np.column_stack([t_s, random_walk_basis(t_s, 3)[:, 0]]))
    assert np.all(steps[:, 0] > 0.0)
    first, last = np.argmin(t_s), np.argmax(t_s)
    walk = random_walk_basis(t_s, 3)[:, 0]
    assert np.sum(steps, axis=0) == pytest.approx([4000.0, walk[last] - walk[first]])


def test_all_courses_that_decide_are_judged_however_far_the_strongest_falls():
    """Two that turn, far apart, and one that never does: none that turns may stay the best unjudged."""
    steps, turns = np.diff(np.eye(COUNT), axis=0), np.sin(np.linspace(0.0, 6.0, COUNT))
    entries = [evidence_of(turns, 0.01, steps=steps) for _ in range(2)]
    still = BasisSets()
    still.add_set(still.add(("travel.left", np.eye(COUNT))))
    entries.append(BasisSetEvidence(still.sets[0], 100.0, 1.0, turns, 1e-4 * np.eye(COUNT)))
    logs, loss = np.array([6_000.0, 5_000.0, 500.0]), loss_of_one_way(entries[0])
    judge_courses(entries, logs)
    assert loss > 4_000.0
    assert logs == pytest.approx([6_000.0 - loss, 5_000.0 - loss, 500.0])


def test_courses_far_below_the_best_are_not_judged():
    entries = [evidence_of(np.sin(np.linspace(0.0, 6.0, COUNT)), 0.01, steps=np.diff(np.eye(COUNT), axis=0))] * 2
    logs = np.array([100.0, 5.0])
    still = BasisSets()
    still.add_set(still.add(("travel.left", np.eye(COUNT))))
    entries[0] = BasisSetEvidence(still.sets[0], 100.0, 1.0, np.ones(COUNT), np.eye(COUNT))
    judge_courses(entries, logs)
    assert logs.tolist() == [100.0, 5.0]


SINKS = EffectChoice("foundation_settling", 1e-4, "left", "stick_slip", (("onset_s", 300.0), ("tau_s", 400.0)))
STANDS_HERE_AND_THERE = EffectChoice("crane_tilt", 6e-5, variant="plain")


@pytest.mark.parametrize(("effect", "least", "most"), [(SINKS, 0.0, 0.01), (STANDS_HERE_AND_THERE, 0.3, 1.0)])
def test_a_crane_that_comes_and_goes_is_no_settling(monkeypatch, effect, least, most):
    """Share of the evidence of settling that goes with the condition that a foundation never rises again."""
    likelihood = MarginalLikelihood.of(linearise_recording(recorded(plant(80, effect, seed=2)), judge=False))
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    settling = load_catalogue().effect("foundation_settling")

    def evidence() -> float:
        (place,) = evidence_by_place(likelihood, inputs, settling, ["left"])
        return place.log_evidence

    held = evidence()
    monkeypatch.setattr(one_way, "loss_of_one_way", lambda _: 0.0)
    free = evidence()
    assert free > 200.0
    assert least <= (free - held) / free <= most
