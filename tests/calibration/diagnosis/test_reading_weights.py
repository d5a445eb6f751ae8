"""Weights of readings that are far off, and which are wrong once the causes are in the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from benchmarks.withheld.gross_readings import with_gross_readings
from calibration.diagnosis.diagnose import _diagnose_with_models, diagnose
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import linearise_again, linearise_recording
from calibration.diagnosis.outlying_readings import JudgedReadings
from calibration.diagnosis.reading_weights import (
    SecondJudgement,
    judge_beside_causes,
    student_weights,
    weights_by_model,
)
from calibration.reduction.left_out import BESIDE_CAUSES
from tests.calibration.diagnosis.campaigns import moved, simulated

PLAY_M = 4.0e-5


def test_beyond_three_standard_deviations_a_reading_pulls_as_by_students_distribution():
    """Its square weight is proportional to that of iteratively reweighted least squares: -(d ln p / dx) / x."""
    sigmas = np.array([0.0, 2.9, 3.0, 6.0, 15.0, 70.0])
    weights = student_weights(sigmas)
    assert weights[:3].tolist() == [1.0, 1.0, 1.0]
    step = 1e-5
    slope = [(stats.t.logpdf(x - step, 4.0) - stats.t.logpdf(x + step, 4.0)) / (2.0 * step) for x in sigmas[2:]]
    of_student = np.array(slope) / sigmas[2:]
    np.testing.assert_allclose(weights[2:] ** 2, of_student / of_student[0], rtol=1e-6)
    assert np.all(np.diff(weights[2:] ** 2 * sigmas[2:]) < 0.0)


@pytest.mark.parametrize(("sigmas", "weighted"), [((3.9,), False), ((4.1,), True), ((5.0,) * 3, False)])
def test_few_readings_beyond_four_standard_deviations_have_less_weight(sigmas, weighted):
    """Three of a hundred are many."""
    residual = np.full((100, 3), 0.5)
    residual[: len(sigmas), 1] = sigmas
    residual[50, 2] = -3.5
    weights = weights_by_model(residual, np.zeros((100, 3, 1)))
    assert (weights is not None) is weighted
    if weights is not None:
        np.testing.assert_array_equal(weights[[0, 50]], student_weights(np.array([4.1, 3.5])))
        assert np.all(weights[1:50] == 1.0)


def with_play(visits=80, **options):
    """A campaign whose left drive has play."""

    def travel_m(arrivals):
        off = np.zeros_like(arrivals.sides)
        off[:, 0] = -0.5 * PLAY_M * arrivals.sides[:, 0]
        return off

    return simulated("planar4", visits, travel_m, **options)


def rows_of_visit(linear, visit):
    """Rows of the recording at one visit."""
    return linear.rows[linear.visit == visit]


def test_a_wrong_reading_is_found_beside_the_cause_and_a_visit_that_is_off_is_not():
    """Both by some twenty standard deviations; without judging, as if nothing had been noticed before."""
    recording = with_play()
    linear = linearise_recording(recording, judge=False)
    one, of_a_visit = rows_of_visit(linear, 30)[:1], rows_of_visit(linear, 50)
    by_m = 25.0 * linear.sigma_of_length_m
    wrong = linearise_recording(moved(moved(recording, one, by_m), of_a_visit, by_m), judge=False)
    likelihood = MarginalLikelihood.of(wrong)
    play = wrong.context.direction[:, 0] * PLAY_M
    with_cause = likelihood.including((likelihood.response("travel.left") * play[:, None])[:, :, None])
    judged = judge_beside_causes(with_cause, wrong.weight)
    assert wrong.rows[~judged.readings.keep].tolist() == one.tolist()
    again = linearise_again(wrong, judged)
    (left_out,) = again.left_out
    assert (left_out.name, left_out.reason) == (recording["uid"][one[0]], BESIDE_CAUSES)
    assert left_out.size == pytest.approx(by_m, rel=0.3)
    assert set(wrong.rows.tolist()) - set(again.rows.tolist()) == set(one.tolist())
    np.testing.assert_array_equal(again.weight, judged.weight[judged.readings.keep])
    plain = linearise_recording(recording, judge=False).reweighted(np.ones(len(linear.rows)))
    kept = np.isin(plain.rows, again.rows)
    size = np.linalg.norm(again.whiten, axis=(1, 2)) / np.linalg.norm(plain.whiten[kept], axis=(1, 2))
    np.testing.assert_allclose(size, again.weight, rtol=0.01)
    assert np.min(again.weight) < 0.99
    weight = again.weight[np.isin(again.rows, of_a_visit)]
    assert np.all(weight == 1.0), "what moves all readings of a stand is no wrong reading"


def test_readings_may_be_weighed_anew_without_a_wrong_one():
    """As where many are far off by chance, and none of them far enough to be wrong."""
    linear = linearise_recording(with_play(), judge=False)
    readings, rows = len(linear.rows), np.zeros(0)
    none_wrong = JudgedReadings(np.ones(readings, dtype=bool), np.zeros(readings), rows, BESIDE_CAUSES, rows)
    weight = np.linspace(0.5, 1.0, readings)
    again = linearise_again(linear, SecondJudgement(none_wrong, weight))
    assert again.left_out == ()
    assert again.rows.tolist() == linear.rows.tolist()
    np.testing.assert_array_equal(again.weight, weight)


@pytest.mark.parametrize(("count", "is_judged"), [(2, True), (8, False)])
def test_many_readings_of_one_reflector_are_something_that_happened_to_it(count, is_judged):
    """Eight of its eighty are a tenth of these and less than 2.5 % of all."""
    recording = with_play()
    linear = linearise_recording(recording, judge=False)
    rows = linear.rows[(linear.smr == linear.smr[0]) & (linear.visit % 10 == 3)][:count]
    assert len(rows) == count < 0.025 * len(linear.rows)
    off = linearise_recording(moved(recording, rows, 60.0 * linear.sigma_of_length_m), judge=False)
    likelihood = MarginalLikelihood.of(off)
    play = (likelihood.response("travel.left") * (off.context.direction[:, 0] * PLAY_M)[:, None])[:, :, None]
    judged = judge_beside_causes(likelihood.including(play), off.weight)
    assert (judged is not None) is is_judged
    if judged is not None:
        assert set(off.rows[~judged.readings.keep].tolist()) == set(rows.tolist())


def test_nothing_is_judged_again_where_nothing_is_far_off():
    linear = linearise_recording(with_play(noise=0.1))
    assert judge_beside_causes(MarginalLikelihood.of(linear), linear.weight) is None


@pytest.mark.parametrize("share", [0.04, 0.08])
def test_gross_readings_of_many_visits_do_not_change_the_verdict(share):
    """0.1 to 10 mm off in any direction, of any reflector; more than 2.5 % were too many once."""
    recording = with_play()
    count = round(share * len(recording))
    columns = with_gross_readings(recording.columns, count, np.random.default_rng(5))
    gross = np.flatnonzero(columns["x_m"] != recording.columns["x_m"])
    diagnosis = diagnose(replace(recording, columns=columns))
    assert diagnosis.verdict == "backlash"
    found = {reading.name for reading in diagnosis.left_out}
    assert len(found & set(recording["uid"][gross].tolist())) >= 0.9 * count
    assert len(found) <= 1.1 * count


def test_what_is_found_wrong_beside_the_cause_is_left_out_of_the_diagnosis():
    recording = with_play()
    wrong = np.array([40, 171, 302])
    made = moved(recording, wrong, 4.0e-4)
    diagnosis = _diagnose_with_models(linearise_recording(made, judge=False), None).diagnosis
    assert diagnosis.verdict == "backlash"
    of_wrong = {(str(uid), BESIDE_CAUSES) for uid in recording["uid"][wrong]}
    assert of_wrong <= {(reading.name, reading.reason) for reading in diagnosis.left_out}
    assert len(diagnosis.left_out) < 6
