"""Readings of floor nests judged by all others: drifting stations, wrong readings, stations and nests that moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from calibration.reduction.nest_gate import NestReadings, _covariance, _judge, _without, wrong_nest_readings
from tests.calibration.reduction.test_pose_filter import STATED, walk

CHECKS = 20


def readings(seed):
    """Nest readings of a station that drifts as is stated of it."""
    _, times, nest, position, covariance, _ = walk(seed, CHECKS)
    return NestReadings(times, nest, np.repeat(np.arange(float(CHECKS)), 2), position, covariance)


def spoilt(one, rows, shift_m):
    position = one.position_m.copy()
    position[rows] += shift_m
    return replace(one, position_m=position)


def wrong_rows(one):
    return sorted(wrong_nest_readings(one, STATED).rows.tolist())


def test_distances_are_those_of_chi_square():
    """The walk is simulated step by step; the gate has its covariance in closed form."""
    squares = 0.0
    for seed in range(20):
        one = readings(seed)
        off = one.position_m - np.stack([one.position_m[one.nest == i].mean(axis=0) for i in one.nest])
        squares += np.sum(_judge(np.linalg.inv(_covariance(one, STATED)), off)[0] ** 2)
    count = 20 * 2 * CHECKS * 3
    # Neighbours share the drift between them, so fewer numbers are independent: half of them at least.
    low, high = chi2.ppf([1e-4, 1 - 1e-4], count / 2) / (count / 2)
    assert low < squares / count < high


def test_a_deviation_is_that_from_what_the_others_say():
    """Closed form against conditioning a Gaussian vector on all others, with one reading already left out."""
    one = readings(3)
    covariance = _covariance(one, STATED)
    off = one.position_m - one.position_m[:2][one.nest]
    _, deviation = _judge(_without(np.linalg.inv(covariance), 4), np.delete(off, 4, axis=0))
    own, others = np.arange(21, 24), np.delete(np.arange(len(covariance)), [12, 13, 14, 21, 22, 23])
    said = covariance[np.ix_(own, others)] @ np.linalg.solve(covariance[np.ix_(others, others)], off.ravel()[others])
    np.testing.assert_allclose(deviation[6], off[7] - said, atol=1e-9)


def test_nothing_is_wrong_in_good_readings():
    assert [wrong_rows(readings(seed)) for seed in range(20)] == [[]] * 20


@pytest.mark.parametrize("size_m", [1e-4, 1e-2])
def test_one_wrong_reading_is_found_wherever_it_stands(size_m):
    """The first and the last of a nest too: there is nothing before the one, nothing after the other."""
    rng = np.random.default_rng(0)
    one = readings(4)
    for row in range(len(one)):
        shift = rng.standard_normal(3)
        spoiled = spoilt(one, [row], size_m * shift / np.linalg.norm(shift))
        found = wrong_nest_readings(spoiled, STATED)
        assert found.rows.tolist() == [row]
        assert found.size_m[0] == pytest.approx(size_m, rel=0.4)
        assert found.sigmas[0] > 6.0


def test_several_wrong_readings_are_found_beside_one_another():
    rows = [0, 9, 11, 24]
    shifts = np.array([[1e-2, 0, 0], [3e-3, 1e-3, 0], [0, -4e-3, 1e-3], [1e-3, 0, 0]])
    assert wrong_rows(spoilt(readings(5), rows, shifts)) == rows


def test_a_station_that_moved_is_no_matter_of_wrong_readings():
    """From a check on both nests are off, or one nest is: its readings stay for the nest check to fail."""
    one = readings(6)
    later = np.flatnonzero(one.check >= 12.0)
    assert wrong_rows(spoilt(one, later, [3e-4, 0.0, 0.0])) == []
    assert wrong_rows(spoilt(one, later[one.nest[later] == 1], [0.0, 0.0, 3e-4])) == []
    assert wrong_rows(spoilt(one, later[-2:], [3e-4, 0.0, 0.0])) == []


def test_a_nest_that_was_knocked_and_put_back_is_no_matter_of_wrong_readings():
    """Off alike at two checks in a row: its checks fail. Off at both, but not alike: two wrong readings."""
    one = readings(8)
    rows = np.flatnonzero((one.nest == 1) & np.isin(one.check, (7.0, 8.0)))
    assert wrong_rows(spoilt(one, rows, [0.0, 0.0, 3e-4])) == []
    assert wrong_rows(spoilt(one, rows, [[0.0, 0.0, 3e-4], [2e-3, 0.0, 0.0]])) == rows.tolist()


def test_two_wrong_readings_of_a_check_leave_nobody_to_speak_for_the_station():
    assert wrong_rows(spoilt(readings(7), [10, 11], [[1e-3, 0, 0], [0, 1e-3, 0]])) == []


def test_a_station_that_drifts_more_than_is_stated_loses_no_reading():
    """Five times as much: what each reading shows widens what is taken for wrong."""
    for seed in range(5):
        one = readings(seed)
        steps = np.random.default_rng(seed).normal(0.0, 1.0, (CHECKS, 3)) * 2e-5
        assert wrong_rows(spoilt(one, np.arange(2 * CHECKS), np.repeat(np.cumsum(steps, axis=0), 2, axis=0))) == []
