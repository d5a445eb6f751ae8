"""What may be activated alone, and what a verification of new tables says."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.intervals.envelope import Envelope, VerificationPlan, judge, verify, verify_further, without_harm
from calibration.intervals.facts import ErrorFigure
from tests.calibration.intervals.facts_for_tests import DAY_S, START_S, calibration

FOUND = ErrorFigure(12e-6, 1e-6)
NO_DRIFT = np.zeros(2)


def new(**changes):
    return calibration("c2", START_S + 30 * DAY_S, **changes)


def test_small_changes_need_no_approval():
    result = judge(Envelope(), calibration(), new(parameters=(1.3e-5, 2.5e-5)), NO_DRIFT, 20e-6, FOUND)
    assert result.allowed
    assert result.reasons == ()


@pytest.mark.parametrize(
    ("changes", "table_m", "found_um", "words"),
    [
        ({"parameters": (3e-5, 2e-5)}, 1e-6, 5.0, "drive_scale.left has changed by 2e-05, 14.1"),
        ({}, -60e-6, 5.0, "a drive's correction would change by -60.0 um"),
        ({}, 1e-6, 80.0, "the error was 80.0 um"),
        ({"parameter_names": ("a", "b")}, 1e-6, 5.0, "history begins anew"),
    ],
)
def test_each_limit_has_its_reason(changes, table_m, found_um, words):
    result = judge(Envelope(), calibration(), new(**changes), NO_DRIFT, table_m, ErrorFigure(found_um * 1e-6, 1e-6))
    assert not result.allowed
    assert len(result.reasons) == 1
    assert words in result.reasons[0]


def test_allowed_drift_widens_the_limit_of_a_parameter():
    moved = new(parameters=(3e-5, 2e-5))
    assert judge(Envelope(), calibration(), moved, np.array([4e-6, 0.0]), 0.0, FOUND).allowed


def test_an_improvement_is_verified_and_a_worsening_refused():
    rng = np.random.default_rng(1)
    true = rng.standard_normal((12, 2)) * 10e-6
    good = verify(true + 5e-6 * rng.standard_normal((12, 2)), 5e-6 * rng.standard_normal((12, 2)), 5e-6)
    assert good.accepted
    assert good.fall_m == pytest.approx(np.sqrt(np.mean(np.sum(true**2, axis=1))), abs=3.0 * good.u_m)
    assert not verify(5e-6 * rng.standard_normal((12, 2)), true + 5e-6 * rng.standard_normal((12, 2)), 5e-6).accepted


def test_equal_tables_are_rarely_taken_for_an_improvement():
    rng = np.random.default_rng(2)
    taken = [
        verify(5e-6 * rng.standard_normal((12, 2)), 5e-6 * rng.standard_normal((12, 2)), 5e-6).accepted
        for _ in range(2000)
    ]
    assert np.mean(taken) < 0.05


def test_what_cannot_be_is_refused():
    with pytest.raises(InputError, match="above zero"):
        Envelope(table_m=0.0)
    with pytest.raises(InputError, match="same poses"):
        verify(np.zeros((3, 2)), np.zeros((2, 2)), 1e-6)
    with pytest.raises(InputError, match="finite"):
        judge(Envelope(), calibration(), new(), NO_DRIFT, np.nan, FOUND)


def run_of_looks(rng, before_rms_m, after_rms_m):
    """Answer and poses of one verification with errors of some size, 5 um of noise."""
    plan = VerificationPlan()
    true = rng.standard_normal((2, plan.looks[-1], 2)) * np.array([before_rms_m, after_rms_m])[:, None, None]
    seen = true + 5e-6 * rng.standard_normal(true.shape)
    for look in plan.looks:
        answer, result = verify_further(seen[0, :look], seen[1, :look], 5e-6, plan)
        assert result.accepted is (answer == "accepted")
        assert f"at {look} poses: " in result.reason
        assert ("the tables stay" in result.reason) is (answer == "accepted")
        if answer != "go on":
            return answer, look
    raise AssertionError


def test_a_verification_ends_when_it_can_decide():
    rng = np.random.default_rng(3)
    better = [run_of_looks(rng, 15e-6, 2e-6) for _ in range(200)]
    worse = [run_of_looks(rng, 2e-6, 15e-6) for _ in range(200)]
    equal = [run_of_looks(rng, 2e-6, 2e-6) for _ in range(1000)]
    assert {answer for answer, _ in better} == {"accepted"}
    assert {answer for answer, _ in worse} == {"refused"}
    assert np.median([look for _, look in better]) == 12
    assert np.mean([answer == "accepted" for answer, _ in equal]) < 0.03


def test_a_verification_needs_a_dozen_poses():
    with pytest.raises(InputError, match="at least 12"):
        VerificationPlan(looks=(6, 12))
    with pytest.raises(InputError, match="no look"):
        verify_further(np.zeros((13, 2)), np.zeros((13, 2)), 1e-6, VerificationPlan())
    with pytest.raises(InputError, match="not in"):
        VerificationPlan(error=0.5)


def test_rotations_that_have_become_worse_refuse_what_the_positions_accept():
    rng, u_rad, plan = np.random.default_rng(5), 4e-6, VerificationPlan()
    noise = [u_rad * rng.standard_normal((12, 2)) for _ in range(3)]
    moves = 30e-6 * rng.standard_normal((12, 2))
    answer, result = verify_further(moves, moves * 0.1, 2e-6, plan)
    assert without_harm(answer, result, noise[0], noise[1], u_rad, plan) == (answer, result) == ("accepted", result)
    answer, worse = without_harm(answer, result, noise[0], noise[2] + 25e-6, u_rad, plan)
    assert (answer, worse.accepted, worse.fall_m) == ("refused", False, result.fall_m)
    assert "rotation errors rise by" in worse.reason
    assert worse.reason.endswith("former tables back")
