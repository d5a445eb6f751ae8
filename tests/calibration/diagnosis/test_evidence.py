"""Evidence and what belongs to it, against dense normal distributions without any of the engine's shortcuts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from calibration.diagnosis.evidence import SIZES, Readout, log_evidence_of_sizes, weigh
from calibration.diagnosis.linear_model import baseline_of
from calibration.effects.api import Form


def flat(columns):
    return columns.reshape(-1, columns.shape[2])


def dense(baseline, *more):
    """Covariance of all whitened readings."""
    a = np.concatenate([flat(baseline.columns), *more], axis=1)
    return np.eye(len(a)) + a @ a.T


def log_density(y, covariance):
    _, log_determinant = np.linalg.slogdet(covariance)
    return -0.5 * (y @ np.linalg.solve(covariance, y) + log_determinant + len(y) * np.log(2.0 * np.pi))


def explicit(baseline, readout, acts):
    """Columns (3 n, k) without `Readout.columns`."""
    out = np.zeros((3 * len(baseline.rows), len(acts)))
    for k, act in enumerate(acts):
        for channel, shape in act:
            moved = readout.channels.shift_m(channel) @ baseline.frame.rotation.T
            out[:, k] += (baseline.whiten @ moved[:, :, None])[:, :, 0].ravel() * np.repeat(shape, 3)
    return out


@pytest.fixture
def acts(small):
    rng = np.random.default_rng(5)
    m = small.moments
    return [
        (("travel.left", -0.5 * m.direction[:, 0]),),
        (("length.left_upper", rng.standard_normal(len(m))), ("pose.rz", rng.standard_normal(len(m)))),
        (("travel.left", m.drives[:, 0]), ("travel.right", m.dwell_s), ("travel.left", m.dwell_s)),
        (("light.v", np.ones(len(m))),),
        (("turn.right.z", m.elapsed_s / 3600.0), ("sideways.right.x", m.direction[:, 1])),
    ]


FORMS = (Form((0,), (1.0,)), Form((0, 1, 4), (1.0, 0.3, 0.1)), Form((2, 3, 4), (1.0, 1.0, 0.5)))
LOW, HIGH = 1e-6, 3e-4


@pytest.mark.parametrize("number", range(len(FORMS)))
def test_evidence_is_the_ratio_of_dense_densities(small, readout, acts, number):
    form = FORMS[number]
    y, c = small.residual.ravel(), dense(small)
    h = explicit(small, readout, acts)[:, form.columns] * form.relative
    logs = [log_density(y, c + a * a * h @ h.T) for a in np.geomspace(LOW, HIGH, SIZES)]
    expected = np.logaddexp.reduce(logs) - np.log(SIZES) - log_density(y, c)
    got = weigh(readout.judge(acts), FORMS, LOW, HIGH)[number]
    assert got.form is form
    assert got.log_evidence == pytest.approx(expected, abs=1e-5, rel=1e-7)
    a = np.geomspace(LOW, HIGH, SIZES)[int(np.argmax(logs))]
    assert got.size == pytest.approx(a)
    # Coefficients and covariance are those of a joint regression with the prior of the best size.
    prior = np.diag((a * np.array(form.relative)) ** 2)
    h = explicit(small, readout, acts)[:, form.columns]
    gain = prior @ h.T @ np.linalg.inv(c + h @ prior @ h.T)
    scale = np.sqrt(np.diag(prior))
    assert got.coefficients / scale == pytest.approx(gain @ y / scale, abs=1e-6)
    assert got.covariance / np.outer(scale, scale) == pytest.approx(
        (prior - gain @ h @ prior) / np.outer(scale, scale), abs=1e-6
    )


def test_the_density_is_that_of_another_library(small, readout):
    some = slice(0, 120)
    y, c = small.residual.ravel()[some], dense(small)[some, some]
    assert log_density(y, c) == pytest.approx(multivariate_normal(np.zeros(120), c).logpdf(y), rel=1e-9)


def test_nine_sizes_stand_for_the_whole_prior(readout, acts):
    judged = readout.judge(acts[:1])
    logs = log_evidence_of_sizes(judged, np.geomspace(LOW, HIGH, 2001))
    coarse = weigh(judged, FORMS[:1], LOW, HIGH)[0].log_evidence
    assert coarse == pytest.approx(np.logaddexp.reduce(logs) - np.log(2001.0), abs=0.5)


def test_directions_that_are_left_out_hardly_count(wandering, small, readout, acts):
    quick = Readout(baseline_of(wandering))
    assert quick.q.shape[2] < readout.q.shape[2]
    here, there = (weigh(r.judge(acts), FORMS, LOW, HIGH) for r in (quick, readout))
    for a, b in zip(here, there, strict=True):
        assert a.log_evidence == pytest.approx(b.log_evidence, abs=0.3, rel=2e-3)
        assert a.coefficients == pytest.approx(b.coefficients, abs=0.1 * np.sqrt(np.diag(b.covariance)).max())


def test_readings_of_a_sound_rig_are_explained_down_to_their_noise(small, readout):
    """Under the model the quadratic form is chi-squared with as many degrees of freedom as numbers."""
    count = small.residual.size
    assert small.residual.ravel() @ readout.left.ravel() == pytest.approx(count, abs=5.0 * np.sqrt(2.0 * count))


def test_given_is_a_fresh_dense_computation(small, readout, acts):
    h = explicit(small, readout, acts) * np.array([2e-5, 1e-5, 3e-6, 1e-6, 1e-5])
    y = small.residual.ravel()
    inverse = np.linalg.inv(dense(small, h))
    shaped = h.reshape(*small.residual.shape, -1)
    at_once, in_turn = readout.given(shaped), readout.given(shaped[:, :, :2]).given(shaped[:, :, 2:])
    some = np.random.default_rng(1).standard_normal((*small.residual.shape, 3))
    for other in (at_once, in_turn):
        np.testing.assert_allclose(other.left.ravel(), inverse @ y, atol=1e-7)
        np.testing.assert_allclose(flat(other.apply(some)), inverse @ flat(some), atol=1e-7)
        q = flat(other.q)
        np.testing.assert_allclose(np.eye(len(q)) - q @ q.T, inverse, atol=1e-7)
        judged = other.judge(acts)
        h1 = explicit(small, readout, acts)
        assert judged.information == pytest.approx(h1.T @ inverse @ h1, rel=1e-5, abs=1e-6 * judged.information.max())
        assert judged.score == pytest.approx(h1.T @ inverse @ y, rel=1e-5, abs=1e-6 * np.abs(judged.score).max())


def test_giving_does_not_change_the_former_readout(readout, small, acts):
    before = readout.judge(acts)
    readout.given(np.ones((*small.residual.shape, 1))).judge(acts)
    after = readout.judge(acts)
    assert np.array_equal(before.information, after.information)
    assert np.array_equal(before.score, after.score)


def test_judge_is_what_explicit_columns_give(small, readout, acts):
    h = explicit(small, readout, acts)
    inverse = np.linalg.inv(dense(small))
    judged = readout.judge(acts)
    np.testing.assert_allclose(flat(readout.columns(acts)), h, rtol=1e-9, atol=1e-9 * np.abs(h).max())
    scale = np.sqrt(np.diag(h.T @ inverse @ h))
    assert judged.information / np.outer(scale, scale) == pytest.approx(
        h.T @ inverse @ h / np.outer(scale, scale), abs=1e-7
    )
    assert judged.score / scale == pytest.approx(h.T @ inverse @ small.residual.ravel() / scale, abs=1e-6)


def test_judge_through_is_judge(small, readout):
    shapes = np.random.default_rng(2).standard_normal((len(small.rows), 3))
    channels = [("travel.left", 2.0), ("smr.P1.x", 0.5), ("station.rz", 3.0)]
    acts = [((name, unit * shapes[:, k]),) for name, unit in channels for k in range(3)]
    through, plain = readout.judge_through(channels, shapes), readout.judge(acts)
    top = plain.information.max()
    assert through.information == pytest.approx(plain.information, abs=1e-9 * top)
    assert through.score == pytest.approx(plain.score, abs=1e-9 * np.abs(plain.score).max())


def test_by_visit_is_judge_of_single_visits(small, readout):
    arrival = small.moments.arrival
    acts = [(("travel.right", (arrival == v).astype(float)),) for v in range(int(arrival.max()) + 1)]
    information, score = readout.by_visit("travel.right", arrival)
    judged = readout.judge(acts)
    assert information == pytest.approx(np.diag(judged.information), rel=1e-9, abs=1e-9 * information.max())
    assert score == pytest.approx(judged.score, rel=1e-9, abs=1e-9 * np.abs(score).max())
