"""Every reading judged by the model that is fitted to the others: what is left out, named, and what is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.outliers import CASES, run_case, shifted
from calibration.identification.calibration import identified_summary, identify_recording
from calibration.identification.gate import LinearReadings, gate_readings
from calibration.identification.leave_one_out import leave_one_out
from calibration.identification.problem import LeastSquaresProblem
from calibration.reduction.reduction import reduce


def problem_of(identified):
    fit = identified.fit
    return LeastSquaresProblem(fit.model, fit.visits, fit.instruments)


def test_deviations_are_those_of_refits_without_the_reading(identified):
    """At the nominal machine's linearisation, against the leave-one-out errors at the fit."""
    assert not problem_of(identified).converged  # nothing was minimised
    fit = identified.fit
    (gated,) = gate_readings(problem_of(identified), [np.zeros(len(fit.instruments[0]), dtype=np.intp)])
    (left,) = leave_one_out(fit)
    np.testing.assert_allclose(gated.deviation, left.error, atol=0.04)
    distance = np.sqrt(np.sum(left.error * left.residual, axis=1))
    assert np.quantile(distance, 0.9) < 2.5  # noise as it is stated: own standard deviations are the stated ones
    np.testing.assert_allclose(gated.sigmas, distance, atol=0.04)
    assert gated.keep.all()


def test_a_reading_that_the_fit_was_not_given_is_judged_by_the_same_measure(identified):
    """Taken out and judged from outside, or in and judged by leave-one-out: the same number."""
    kinds = [np.zeros(len(identified.fit.instruments[0]), dtype=np.intp)]
    problem = problem_of(identified)
    seen = identified.fit.instruments[0].observations
    off = seen.position_m.copy()
    off[17] += [0.0, 0.0, 5e-3]
    spoiled = replace(problem.readings[0], observations=replace(seen, position_m=off))
    (gated,) = gate_readings(LeastSquaresProblem(problem.model, problem.visits, [spoiled]), kinds)
    assert np.flatnonzero(~gated.keep).tolist() == [17]
    z = np.zeros(problem.layout.size)
    good, bad = (
        LinearReadings.of(LeastSquaresProblem(problem.model, problem.visits, [readings]), z, kinds).farthest()
        for readings in (problem.readings[0], spoiled)
    )
    assert good < 6.0
    assert bad == pytest.approx(gated.sigmas[17], rel=0.05)
    size = np.linalg.norm(np.linalg.solve(spoiled.whiten[17], gated.deviation[17]))
    assert size == pytest.approx(5e-3, rel=0.05)
    assert gated.sigmas[17] > 100.0


@pytest.mark.parametrize("name", list(CASES))
def test_planted_readings_do_not_move_the_prediction(recording, name):
    """The claim of `make outliers` on one small campaign of the plant behind the mock rig."""
    case = run_case(recording, CASES[name], np.random.default_rng(list(CASES).index(name)))
    assert case["moved_um"] <= 0.15
    assert case["missed"] == 0
    assert case["lost"] == 0


def test_wrong_readings_are_named_with_size_and_reason(recording):
    names = {smr: np.flatnonzero(np.asarray(recording["smr"]) == smr)[3] for smr in ("P2", "SR", "N1")}
    rows = np.array(list(names.values()))
    spoiled = shifted(recording, rows, np.tile([0.0, 0.0, 2e-3], (3, 1)))
    summary = identified_summary(identify_recording(spoiled, baselines=False))
    named = {entry["of"]: entry for entry in summary["left_out"]}
    assert {smr: named[smr]["name"] for smr in names} == {s: str(recording["uid"][r]) for s, r in names.items()}
    for smr, reason in (("P2", "model gate"), ("SR", "model gate"), ("N1", "nest outlier")):
        assert named[smr]["size"] == pytest.approx(2e-3, rel=0.2)
        assert named[smr]["unit"] == "m"
        assert named[smr]["sigmas"] > 6.0
        assert named[smr]["reason"] == reason
        assert named[smr]["visit"] == recording["visit"][names[smr]]
        assert named[smr]["t_rig_s"] == recording["t_rig_s"][names[smr]]
    assert summary["dropped"]["model gate"] == 2
    assert summary["dropped"]["nest outlier"] == 1
    assert summary["dropped"]["failed nest check"] == 0


def test_what_was_left_out_stays_out_of_the_verification(recording):
    """The reduction that compares before and after begins with what the identification left out."""
    row = np.flatnonzero(np.asarray(recording["smr"]) == "P1")[7]
    spoiled = shifted(recording, np.array([row]), np.array([[2e-4, 0.0, 0.0]]))
    identification = identify_recording(spoiled, baselines=False)
    later = reduce(spoiled, identification.reduction)
    assert str(recording["uid"][row]) in {reading.name for reading in later.left_out}
    assert str(recording["uid"][row]) not in later.uid
    assert later.dropped == identification.reduction.dropped


def test_what_the_model_lacks_is_not_taken_for_wrong_readings(recording):
    """Reflectors on sliders that swing by 60 um from visit to visit: eight standard deviations, and every visit has it.

    By the stated deviations alone two thirds of these readings would be wrong.
    """
    rows = np.flatnonzero(np.isin(np.asarray(recording["smr"]), ("SL", "SR")))
    swing = 6e-5 * np.sin(2.4 * recording["visit"][rows])
    shift = np.stack([swing, np.zeros(rows.size), np.zeros(rows.size)], axis=1)
    kept = identify_recording(shifted(recording, rows, shift), baselines=False)
    assert kept.reduction.left_out == ()
    assert kept.fit.chi2_per_dof > 3.0
