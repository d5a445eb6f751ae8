"""What comes by chance, against numbers in random order, and readings that do."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.independent.planted_readings import with_far
from calibration.diagnosis.chance import are_by_chance
from calibration.diagnosis.diagnose import _diagnose_with_models, diagnose
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.outlying_readings import come_by_chance
from calibration.recording.recording import Recording
from calibration.reduction.left_out import BESIDE_CAUSES
from tests.calibration.diagnosis.campaigns import Arrivals, simulated

PLAY_M = 4.0e-5


def test_numbers_in_random_order_are_by_chance_and_a_course_is_not():
    rng = np.random.default_rng(2)
    along = rng.standard_normal((200, 2))
    drawn = [are_by_chance(rng.standard_normal(200), along) for _ in range(400)]
    assert np.mean(drawn) > 0.99  # two times 3e-5 not
    course = rng.standard_normal(200) + 1.2 * np.sin(2.0 * along[:, 1])
    assert not are_by_chance(course, along)
    assert are_by_chance(course, along[:, :1])


def test_what_neighbours_have_in_the_opposite_sense_is_by_chance_too():
    """Only likeness counts: of a few that are far off none stand side by side."""
    rare = np.zeros(100)
    rare[::10] = 1.0
    assert are_by_chance(rare, np.arange(100.0)[:, None])


def play(arrivals: Arrivals) -> np.ndarray:
    off = np.zeros_like(arrivals.sides)
    off[:, 0] = -0.5 * PLAY_M * arrivals.sides[:, 0]
    return off


def with_far_readings(recording: Recording) -> Recording:
    """One reading in twenty is off by 7 to 13 standard deviations: more than noise, less than gross."""
    return with_far(recording, np.random.default_rng(7), (7.0, 13.0))


@pytest.mark.parametrize(("off", "verdict"), [(None, "none"), (play, "backlash")])
def test_many_readings_that_are_far_off_by_chance_do_not_change_the_verdict(off, verdict):
    """Where 2.5 % that are beyond six were too many to be wrong."""
    made = simulated("planar4", 120, off)
    found = diagnose(with_far_readings(made))
    assert found.verdict == verdict
    assert len(found.left_out) > 0.025 * len(made)


def test_such_readings_are_found_before_the_search_and_beside_the_causes():
    """Where they were not judged before, the search finds what is wrong in them, and is made again."""
    made = with_far_readings(simulated("planar4", 120, play))
    count = len(linearise_recording(made).wrong)
    assert count > 0.025 * len(made)
    found = _diagnose_with_models(linearise_recording(made, judge=False), None).diagnosis
    assert found.verdict == "backlash"
    assert len(found.left_out) >= count
    assert {reading.reason for reading in found.left_out} == {BESIDE_CAUSES}


@pytest.fixture(scope="module")
def linear():
    return linearise_recording(simulated("planar4", 160), judge=False)


def rows_of(linear, count: int, *, of: slice | np.ndarray = slice(None), seed: int = 3) -> np.ndarray:
    """Some rows of the platform's reflectors, of some of their readings in the order of time."""
    rows = np.flatnonzero(linear.on_platform)
    rows = rows[np.argsort(linear.context.t_s[rows], kind="stable")][of]
    far = np.zeros(len(linear.smr), dtype=bool)
    far[np.random.default_rng(seed).choice(rows, count, replace=False)] = True
    return far


def test_readings_anywhere_and_of_all_reflectors_come_by_chance(linear):
    drawn = [come_by_chance(linear, rows_of(linear, 30, seed=seed)) for seed in range(100)]
    assert np.mean(drawn) > 0.9


def test_what_comes_at_one_time_or_place_or_to_one_reflector_does_not_come_by_chance(linear):
    assert not come_by_chance(linear, rows_of(linear, 30, of=slice(100, 160)))
    rows = np.flatnonzero(linear.on_platform)
    order = rows[np.argsort(linear.context.drives[rows, 0], kind="stable")][:60]
    at_one_place = np.zeros(len(linear.smr), dtype=bool)
    at_one_place[np.random.default_rng(3).choice(order, 30, replace=False)] = True
    assert not come_by_chance(linear, at_one_place)
    of_one = np.zeros(len(linear.smr), dtype=bool)
    of_one[np.random.default_rng(3).choice(rows[linear.smr[rows] == linear.smr[rows[0]]], 12, replace=False)] = True
    assert not come_by_chance(linear, of_one)


def test_what_leaves_one_reflector_out_does_not_come_by_chance(linear):
    """The others have hardly more than all three would."""
    rows = np.flatnonzero(linear.on_platform)
    far = np.zeros(len(linear.smr), dtype=bool)
    of_others = rows[linear.smr[rows] != linear.smr[rows[0]]]
    far[np.random.default_rng(3).choice(of_others, 40, replace=False)] = True
    assert not come_by_chance(linear, far)
    assert come_by_chance(linear, rows_of(linear, 40))


def test_more_than_fifteen_per_cent_are_too_many(linear):
    count = int(0.14 * len(linear.smr))
    assert come_by_chance(linear, rows_of(linear, count))
    assert not come_by_chance(linear, rows_of(linear, count + int(0.02 * len(linear.smr))))


def test_what_is_off_beside_the_platform_only_is_something_that_happened_there(linear):
    """Much more often than the platform's readings."""
    far = rows_of(linear, 20)
    assert come_by_chance(linear, far)
    others = np.flatnonzero(~linear.on_platform & (linear.smr == linear.smr[~linear.on_platform][0]))
    far[others[::3][:20]] = True
    assert not come_by_chance(linear, far)
