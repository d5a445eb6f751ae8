"""Set-ups of the station on recordings of the mock plant, which knows where the station truly stood."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.setups import campaigns, motions_chi2, recording_of
from calibration.base.errors import InputError
from calibration.base.rotation import rotation_matrix
from calibration.identification.calibration import identify_recording
from calibration.instruments.setups import range_shifts
from calibration.instruments.station_geometry import point_covariances, points_to_polar, polar_to_points
from calibration.recording.recording import make_recording
from calibration.reduction.common_points import NestEstimate, common_nests
from calibration.reduction.figures import setup_part
from calibration.reduction.nest_checks import drop_unclosed_readings, drop_unused_setups, nest_shift, usable_readings
from calibration.reduction.nest_distances import require_equal_nest_distances
from calibration.reduction.recording_setups import require_common_points, setups_of, tied_by_nests
from calibration.reduction.reduction import reduce
from calibration.reduction.setups import known_from_nests, tie_setups
from calibration.reduction.setups import require_common_points as require_points
from tests.calibration.conftest import STATED

NESTS_M = np.array([[-0.8, 3.1, -1.1], [0.9, 3.3, -1.0], [0.1, 2.2, -1.2], [-0.6, 4.4, 0.3]])
NAMES = ("N1", "N2", "N3", "N4")


@pytest.fixture(scope="module")
def moved():
    return recording_of(campaigns(3)[1], "moved")


def seen(places_m, number, rng, noise=1.0, constant_m=0.0):
    """Nests as set-up 1, or a later one half a metre aside, sees them; and the true motion to the first."""
    turn = rotation_matrix(np.array([2e-5, -1e-5, 0.3 if number > 1 else 0.0]) * (number > 1))
    shift = np.array([0.3, -0.2, 0.1 * number]) * (number > 1)
    own = (places_m - shift) @ turn
    hz, v, d = points_to_polar(own)
    covariance = point_covariances(hz, v, d, STATED) / 25.0
    sd = noise * np.array([STATED.angle_sd_rad, STATED.angle_sd_rad, STATED.range_sd_m]) / 5.0
    hz, v, d = hz + sd[0] * rng.standard_normal(len(d)), v + sd[1] * rng.standard_normal(len(d)), d + constant_m
    position = polar_to_points(hz, v, d + sd[2] * rng.standard_normal(len(d)))
    full = np.zeros((3 * len(d), 3 * len(d)))
    for i in range(len(d)):
        full[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = covariance[i]
    return NestEstimate((*NAMES, "", "")[: len(d)], position, full), turn, shift


def error_of(setups, k, turn, shift):
    """Rotation vector and shift of a motion from the true one, to first order."""
    off = setups.rotation[k] @ turn.T
    vector = 0.5 * np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]])
    return np.concatenate([vector, setups.translation_m[k] - off @ shift])


def test_motions_lie_within_their_covariance():
    rng, squares = np.random.default_rng(1), []
    for _ in range(60):
        first, _, _ = seen(NESTS_M, 1, rng)
        second, turn, shift = seen(NESTS_M, 2, rng)
        setups = tie_setups([1.0, 2.0], common_nests({1.0: first, 2.0: second}), np.eye(3))
        error = error_of(setups, 1, turn, shift)
        squares.append(error @ np.linalg.solve(setups.error_covariance, error))
    # Mean of 60 values of chi2 with 6 degrees of freedom: 6 with a standard deviation of 0.45.
    assert 4.6 < np.mean(squares) < 7.6


def test_a_constant_of_the_ranges_turns_and_shifts_a_set_up_as_stated():
    rng = np.random.default_rng(2)
    first, _, _ = seen(NESTS_M, 1, rng, noise=0.0, constant_m=1e-4)
    second, turn, shift = seen(NESTS_M, 2, rng, noise=0.0, constant_m=1e-4)
    setups = tie_setups([1.0, 2.0], common_nests({1.0: first, 2.0: second}), np.eye(3))
    error = error_of(setups, 1, turn, shift)
    assert np.linalg.norm(error[3:]) > 1e-6
    assert error == pytest.approx(setups.error_by_range[:, 0] * 1e-4, abs=3e-8)


def test_two_nests_leave_one_rotation_open():
    rng = np.random.default_rng(3)
    groups = common_nests({n: seen(NESTS_M, n, rng)[0] for n in (1.0, 2.0)})
    setups = tie_setups([1.0, 2.0], groups, np.eye(3))
    two = common_nests({n: seen(NESTS_M[:2], n, rng)[0] for n in (1.0, 2.0)})
    spread = np.sqrt(np.linalg.eigvalsh(known_from_nests(setups, two).error_covariance))
    assert spread[-1] > 5e-3
    assert spread[-2] < 2e-4


def test_less_than_three_points_or_three_in_a_line_say_what_to_measure():
    rng = np.random.default_rng(4)
    both = {1.0: seen(NESTS_M, 1, rng)[0], 2.0: seen(NESTS_M[:2], 2, rng)[0]}
    with pytest.raises(
        InputError, match=r"set-up 2: only N1, N2 measured before.*; measure nest N3 and N4, or all refl"
    ):
        require_points([1.0, 2.0], common_nests(both))
    line = NESTS_M[0] + np.outer([0.0, 0.5, 1.0], [1.0, 0.2, 0.0])
    both = {n: seen(line, n, rng)[0] for n in (1.0, 2.0)}
    with pytest.raises(InputError, match="not in a line"):
        require_points([1.0, 2.0], common_nests(both))
    both = {n: seen(NESTS_M[:3], n, rng)[0] for n in (1.0, 2.0)}
    require_points([1.0, 2.0], common_nests(both))


def test_a_set_up_may_be_tied_through_another():
    rng = np.random.default_rng(5)
    places = np.vstack([NESTS_M, [[0.5, 3.9, -0.2], [-0.3, 2.6, 0.4]]])
    first, third = (seen(places[some], n, rng)[0] for n, some in ((1, [0, 1, 2, 3]), (3, [2, 3, 4, 5])))
    second = replace(seen(places, 2, rng)[0], names=(*NAMES, "N5", "N6"))
    third = replace(third, names=("N3", "N4", "N5", "N6"))
    with pytest.raises(InputError, match="set-up 3: only N3, N4 measured before"):
        require_points([1.0, 3.0], common_nests({1.0: first, 3.0: third}))
    setups = tie_setups([1.0, 2.0, 3.0], common_nests({1.0: first, 2.0: second, 3.0: third}), np.eye(3))
    assert setups.translation_m[2] == pytest.approx([0.3, -0.2, 0.3], abs=3e-4)


@pytest.mark.parametrize("nest", range(4))
def test_a_nest_that_moved_in_between_is_named(nest):
    for seed in range(5):
        rng = np.random.default_rng([6, seed])
        places = NESTS_M.copy()
        places[nest] += np.array([2e-4, 0.0, 0.0])
        nests = {1.0: seen(NESTS_M, 1, rng)[0], 2.0: seen(places, 2, rng)[0]}
        with pytest.raises(InputError, match=f"set-up 2: nest {NAMES[nest]} has moved since set-up 1"):
            require_equal_nest_distances(nests, 2e-5)


def test_swapped_nests_are_named():
    rng = np.random.default_rng(7)
    nests = {1.0: seen(NESTS_M, 1, rng)[0], 2.0: seen(NESTS_M[[0, 2, 1, 3]], 2, rng)[0]}
    with pytest.raises(InputError, match="nests N2 and N3 were mixed up"):
        require_equal_nest_distances(nests, 2e-5)


def test_distances_of_good_nests_are_hardly_ever_refused():
    refused = 0
    for seed in range(100):
        rng = np.random.default_rng([8, seed])
        constant = 2e-5 * rng.standard_normal()
        nests = {n: seen(NESTS_M, n, rng, constant_m=constant)[0] for n in (1.0, 2.0)}
        try:
            require_equal_nest_distances(nests, 2e-5)
        except InputError:
            refused += 1
    assert refused <= 6  # six distances beyond three u each: 1.6 in 100


def test_a_distance_counts_by_its_own_uncertainty():
    rng = np.random.default_rng(9)
    first, second = (seen(NESTS_M, n, rng, noise=0.0)[0] for n in (1, 2))
    at_limit = second.position_m.copy()
    between = at_limit[1] - at_limit[0]
    at_limit[1] += between / np.linalg.norm(between) * 1e-4
    changed = replace(second, position_m=at_limit)
    loose = replace(changed, covariance_m2=second.covariance_m2 * 400.0)
    with pytest.raises(InputError, match="has moved"):
        require_equal_nest_distances({1.0: first, 2.0: changed}, 1e-7)
    require_equal_nest_distances({1.0: first, 2.0: loose}, 1e-7)


def test_a_recording_of_three_set_ups_is_tied_by_nests_and_poses(moved):
    assert set(moved["station"]) == {1.0, 2.0, 3.0}
    assert not tied_by_nests(moved)
    require_common_points(moved)
    setups = setups_of(moved)
    assert 0.05 < np.linalg.norm(setups.translation_m[1]) < 0.7
    nests = np.asarray(moved["phase"]) == "nests"
    without_poses = moved.take((moved["station"] == 1.0) | (nests & (moved["station"] == 2.0)))
    with pytest.raises(InputError, match=r"set-up 2: only N1, N2 measured before.*; measure all reflectors at a pose"):
        require_common_points(without_poses)


def test_figures_stand_in_the_frame_of_the_first(moved):
    one, three = (reduce(recording_of(campaign, "x")) for campaign in campaigns(3))
    error_one, error_three = (r.errors(r.rows("calibration"))[0][:, :2] for r in (one, three))
    assert three.dropped["innovation gate"] == 0
    assert error_three == pytest.approx(error_one, abs=6e-5)
    assert np.sqrt(np.mean((error_three - error_one) ** 2)) < 1.2e-5


def test_a_fit_of_three_set_ups_knows_them_better_than_the_common_points(moved):
    campaign = campaigns(3)[1]
    before = setups_of(moved)
    fitted = identify_recording(moved, baselines=False)
    u_before, u_after = (np.sqrt(np.diag(s.error_covariance)) for s in (before, fitted.reduction.setups))
    assert np.all(u_after < 0.7 * u_before)
    assert motions_chi2(campaign, fitted)[0] < 40.0  # 12 degrees of freedom; 77 without the drift in common


def test_a_station_that_moved_within_a_set_up_is_found(moved):
    last = moved["nest_check"].max()
    bumped = (moved["station"] == 3.0) & (moved["nest_check"] >= last)
    x = moved["x_m"] + 3e-4 * bumped
    shifted = replace(moved, columns={**moved.columns, "x_m": x})
    checks, shifts = nest_shift(shifted)
    assert shifts[checks == last] > 2e-4
    assert np.all(shifts[checks < last] < moved.file.nest_limit_m)
    nests = np.asarray(moved["phase"]) == "nests"
    usable = usable_readings(shifted)
    assert not usable[(moved["nest_check"] == last - 1) & ~nests].any()
    assert usable[moved["nest_check"] < last - 1].all()


def test_a_check_of_a_later_set_up_does_not_close_readings_of_an_earlier_one(moved):
    nests = np.asarray(moved["phase"]) == "nests"
    closing = moved["nest_check"][moved["station"] == 1.0].max()
    broken = moved.take(~(nests & (moved["nest_check"] == closing)))
    columns = dict(broken.columns)
    columns["nest_check"] = np.where(broken["nest_check"] > closing, broken["nest_check"] - 1.0, broken["nest_check"])
    broken = replace(broken, columns=columns)
    open_ = (broken["nest_check"] == closing - 1.0) & (np.asarray(broken["phase"]) != "nests")
    assert open_.any()
    assert set(broken["station"][broken["nest_check"] == closing]) == {2.0}
    assert not usable_readings(broken)[open_].any()
    assert len(broken) - len(drop_unclosed_readings(broken)) == np.count_nonzero(open_)


def test_a_set_up_that_was_given_up_is_in_no_result(moved):
    """Only nests were measured in the third, and one of them stood elsewhere."""
    third = moved["station"] == 3.0
    given_up = moved.take(~third | (np.asarray(moved["phase"]) == "nests"))
    spoilt = (given_up["station"] == 3.0) & (np.asarray(given_up["smr"]) == "N1")
    given_up = replace(given_up, columns={**given_up.columns, "z_m": given_up["z_m"] + 1e-3 * spoilt})
    without = moved.take(~third)
    found, expected = (reduce(recording) for recording in (given_up, without))
    assert found.setups.numbers.tolist() == [1, 2]
    assert found.poses.coordinates == pytest.approx(expected.poses.coordinates, abs=0.0)
    assert set(drop_unclosed_readings(given_up)["station"]) == {1.0, 2.0}
    assert set(drop_unused_setups(given_up, keep=3.0)["station"]) == {1.0, 2.0, 3.0}
    assert len(drop_unused_setups(moved)) == len(moved)


def test_range_errors_act_along_the_sight():
    sight = np.array([[0.0, 3.0, 4.0]])
    shifts = range_shifts(sight)
    assert shifts["range.constant"] == pytest.approx(sight / 5.0)
    assert shifts["refraction.curvature"] @ sight[0] == pytest.approx(0.0, abs=1e-12)


def test_verification_from_another_set_up_stands_in_the_frame_of_the_first(moved):
    """The calibration has set-ups 1 and 2; what is measured from the third is tied to them, which stay as they are."""
    basis = reduce(moved.take(moved["station"] <= 2.0))
    full = reduce(moved, basis)
    assert np.array_equal(full.setups.rotation[:2], basis.setups.rotation)
    assert np.array_equal(full.setups.error_covariance[:6, :6], basis.setups.error_covariance)
    assert full.report is basis.report
    still = reduce(recording_of(campaigns(3)[0], "still"))
    late = full.info.setup == 2
    difference = (full.errors(late)[0] - still.errors(late)[0])[:, :2]
    assert late.any()
    assert np.sqrt(np.mean(difference**2)) < 1.5e-5
    assert setup_part(full, late) > 0.0
    assert setup_part(still, late) == 0.0


def test_u_of_a_figure_contains_the_motions(moved):
    """Against the change of the figure when a set-up's readings are moved by draws of the motions' covariance."""
    reduction = reduce(moved)
    late = reduction.info.setup == 1
    error = reduction.errors(late)[0][:, :2]
    tool = reduction.poses.coordinates[late][:, :3]
    rng, rms = np.random.default_rng(10), []
    for draw in rng.multivariate_normal(np.zeros(12), reduction.setups.error_covariance, 400):
        lever = reduction.report.frame.to_station(tool)
        moved_m = (np.cross(draw[:3], lever) + draw[3:6]) @ reduction.report.frame.rotation
        rms.append(np.sqrt(np.mean(np.sum((error + moved_m[:, :2]) ** 2, axis=1))))
    assert setup_part(reduction, late) == pytest.approx(np.std(rms), rel=0.25)


def test_a_visit_has_one_set_up(moved):
    station = moved["station"].copy()
    station[np.flatnonzero(moved["visit"] == 3.0)[0]] = 2.0
    columns = {**moved.columns, "station": station}
    rows = [{name: column[i].item() for name, column in columns.items()} for i in range(len(moved))]
    with pytest.raises(InputError, match="visit 3 has readings of two set-ups"):
        make_recording(moved.file, moved.machine, rows)
