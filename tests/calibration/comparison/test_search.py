"""Evidence of changes, against dense normal distributions of all readings of both campaigns."""

from __future__ import annotations

import math
from functools import lru_cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from benchmarks.comparison.change import Change
from calibration.comparison.candidates import Candidate, Move, Way, candidates
from calibration.comparison.same_machine import shared_reflectors
from calibration.comparison.search import LEVEL_SPREAD, LEVELS, NOTHING, UNKNOWN, Model, Weighed, rank, weigh
from calibration.comparison.two_campaigns import TwoCampaigns, linearise_pair
from tests.calibration.comparison.pairs import first, recorded

SIZES = 9  # of a prior that is uniform in the logarithm


@lru_cache(maxsize=1)
def pair() -> TwoCampaigns:
    before, after = (r.take(np.asarray(r["visit"]) < 30) for r in (first(), recorded(Change(length_m={0: 3e-5}))))
    return linearise_pair(before, after, shared_reflectors(before.machine, after.machine))


def log_density(model: Model, level: float, more: np.ndarray) -> float:
    """Of the readings, their covariance formed in full: noise, unknowns, what differs anew, and columns (m, k)."""
    both = model.pair
    covariance = np.eye(both.residual.size)
    for columns in (both.columns, level * both.anew, more):
        covariance += columns @ columns.T
    return float(multivariate_normal.logpdf(both.residual, np.zeros(both.residual.size), covariance))


def test_evidence_is_that_of_dense_normal_distributions():
    model = Model.of(pair(), 1.4)
    move = Move("length", "m", 1.0, unknown="strut_length.left_upper")
    (found,) = rank(model, [Candidate("strut", "left_upper", (Way((move,)),))])
    column = model.of_moves([move])
    nothing = log_density(model, 1.4, np.zeros((len(column), 0)))
    logs = [log_density(model, 1.4, column * size) - nothing for size in np.geomspace(0.5e-6, 3.0e-3, SIZES)]
    # Directions of which the readings say next to nothing are left out of the model.
    assert found.log_evidence == pytest.approx(logsumexp(logs) - math.log(SIZES), abs=0.3)
    assert found.log_evidence > 10.0
    assert found.coefficients[0] == pytest.approx(3e-5, abs=4.0 * math.sqrt(found.covariance[0, 0]))


def test_what_is_in_the_model_is_not_found_again():
    model = Model.of(pair())
    move = Move("length", "m", 1.0, unknown="strut_length.left_upper")
    strut = Candidate("strut", "left_upper", (Way((move,)),))
    assert rank(model.including(strut.ways[0], 5e-5), [strut])[0].log_evidence < 1.0


def test_nothing_is_weighed_at_every_level_of_what_differs_anew():
    weighed = weigh(pair(), candidates(pair().after.machine, (0, 1), pair().shared))
    best = weighed.ranking[0]
    none = np.zeros((pair().residual.size, 0))
    priors = np.exp(-0.5 * (np.log(LEVELS) / LEVEL_SPREAD) ** 2)
    logs = np.array([log_density(weighed.model, level, none) for level in LEVELS]) + np.log(priors / priors.sum())
    shifts = [
        logs[k] - logsumexp(logs) + found.log_evidence
        for k, level in enumerate(LEVELS)
        for found in rank(Model.of(pair(), level), [best.candidate])
    ]
    assert best.log_evidence == pytest.approx(max(shifts), abs=0.3)


def test_probabilities_add_up_to_one():
    weighed = weigh(pair(), candidates(pair().after.machine, (0, 1), pair().shared))
    assert sum(weighed.probabilities().values()) == pytest.approx(1.0)
    for structure in ("strut", "nest", "column"):
        assert sum(weighed.places(structure).values()) == pytest.approx(1.0)
    assert weighed.changes[0].name == ("strut", "left_upper")


def test_candidates_of_a_machine_name_its_parts_once():
    machine = pair().after.machine
    names = [(c.structure, c.place) for c in candidates(machine, range(7), pair().shared)]
    assert len(names) == len(set(names))
    assert {place for structure, place in names if structure == "strut"} == set(machine.strut_names)
    assert {place for structure, place in names if structure == "column"} == {"left", "right"}
    assert {place for structure, place in names if structure == "nest"} == {
        "P1", "P2", "P3", "SL", "SR", "N1", "N2", "platform reflectors", "floor nests",
    }  # fmt: skip
    assert "P1" not in {c.place for c in candidates(machine, range(7), pair().shared - {"P1"})}


@pytest.mark.parametrize(("explained", "threshold"), [(1000.0, 42.0), (9000.0, 282.0)])
@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_an_unknown_change_has_even_odds_at_twelve_and_three_per_cent_of_what_is_explained(explained, threshold, side):
    """This constant is of comparisons; that of a diagnosis is another."""
    found = SimpleNamespace(candidate=SimpleNamespace(structure="a strut's length"), log_evidence=explained)
    weighed = Weighed(None, (found,), (), {}, log_evidence=explained, excess=threshold + side)
    p = weighed.probabilities()
    assert (p[UNKNOWN] > p["a strut's length"]) is (side > 0.0)


@pytest.mark.parametrize("side", [-0.1, 0.1])
def test_a_change_is_as_likely_as_nothing_at_seven(side):
    """This constant is of comparisons; that of a diagnosis is another."""
    found = SimpleNamespace(candidate=SimpleNamespace(structure="a strut's length"), log_evidence=7.0 + side)
    p = Weighed(None, (found,), (), {}, log_evidence=7.0 + side, excess=0.0).probabilities()
    assert (p[NOTHING] < 0.5) is (side > 0.0)
