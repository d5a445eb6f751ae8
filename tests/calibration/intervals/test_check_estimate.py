"""What a check says of a planar machine, against simulated readings and direct least squares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from calibration.base.errors import InputError
from calibration.identification.pose_selection import workspace_poses
from calibration.intervals.check_design import CheckReadings, check_design, choose_poses
from calibration.intervals.check_estimate import estimate_check, expected_error_u_m, joint_change
from calibration.intervals.drift import DriftSettings
from calibration.intervals.extent import what_to_measure
from calibration.intervals.facts import EventFact
from calibration.intervals.partial import grown_covariance, released_covariance
from calibration.intervals.watched import (
    drive_offset,
    smr_response,
    station_nuisance,
    tool_response,
    watched_changes,
)
from calibration.machine.description import load_machine, shipped_machine
from calibration.machine.inverse import nominal_drives, nominal_poses
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits

STATION_M = np.array([0.0, 0.3, 3.2])
SD_M = 8e-6


@pytest.fixture(scope="module")
def model():
    machine = load_machine(shipped_machine("planar4"))
    return Model(ParameterSet.of(machine))


def at_rest(model, xy, theta=None):
    target = np.zeros((len(xy), 6))
    target[:, :2] = xy
    visits = Visits.at_reference_temperature(model.machine, nominal_drives(model.machine, target), target)
    return model.predict(np.zeros(len(model)) if theta is None else theta, visits)


def grid(n, width, height):
    return np.array([(width * x, height * y) for x in np.linspace(-1, 1, n) for y in np.linspace(-1, 1, n)])


@pytest.fixture(scope="module")
def readings(model):
    poses = at_rest(model, grid(4, 0.33, 0.28))
    visit, smr, place = [], [], []
    for s, reflector in enumerate(model.machine.smrs):
        where = poses.reflector_m(s, np.array(reflector.position_m))
        for v in [-1] if reflector.on == "floor" else range(len(where)):
            visit.append(v)
            smr.append(s)
            place.append(where[max(v, 0)])
    whiten = np.tile(np.eye(3) / SD_M, (len(visit), 1, 1))
    return CheckReadings(np.array(visit), np.array(smr), np.array(place), whiten)


@pytest.fixture(scope="module")
def design(model, readings):
    count, size = len(model.parameters), len(model.parameters) + 15
    prior, reference = np.zeros((size, size)), np.zeros((size, size))
    prior[:count, :count] = np.diag(np.full(count, 1e-5) ** 2)
    reference[:count, :count] = np.diag(np.full(count, 1e-6) ** 2)
    mounting = np.array([s.position_m for s in model.machine.smrs])
    return check_design(
        readings,
        at_rest(model, grid(4, 0.33, 0.28)),
        at_rest(model, grid(5, 0.35, 0.30)),
        mounting,
        watched_changes(model.parameters),
        station_m=STATION_M,
        range_u=(1e-4, 1e-6),
        prior=prior,
        reference=reference,
    )


def test_responses_are_the_model_s_own_differences(model):
    xy, step = grid(2, 0.3, 0.2), 1e-6
    mounting = np.array([s.position_m for s in model.machine.smrs])
    before = at_rest(model, xy)
    response, tool = smr_response(before, (0, 3, 5), mounting[[0, 3, 5]]), tool_response(before)
    for column in (0, 5, 13, 20, 22):
        theta = np.zeros(len(model))
        theta[column] = step
        after = at_rest(model, xy, theta)
        for k, smr in enumerate((0, 3)):
            moved = after.reflector_m(smr, mounting[smr]) - before.reflector_m(smr, mounting[smr])
            assert response[:, k, :, column] == pytest.approx(moved / step, abs=2e-5)
        assert tool[:, :, column] == pytest.approx((after.tool_m() - before.tool_m()) / step, abs=2e-5)
    assert not response[:, 2].any()  # a nest stays where it is


def test_a_drive_s_offset_is_that_of_its_base_joints(model):
    watched = watched_changes(model.parameters)
    column = watched.combination[:, watched.names.index("drive_offset.left")]
    moved = [name for name, c in zip(model.parameters.names, column, strict=True) if c]
    assert moved == ["base_joint.left_upper.y", "base_joint.left_lower.y"]
    assert column[column != 0.0] == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize("name", ["planar4", "stewart6", "rrr4", "delta6"])
def test_a_drive_that_stands_elsewhere_is_what_its_offset_says(name):
    """The pose with a drive a little farther is that of the parameters of its offset, by the model itself."""
    machine, step = load_machine(shipped_machine(name)), 2e-6
    model = Model(ParameterSet.of(machine))
    target = nominal_poses(machine, workspace_poses(machine, 5, 3)[:, machine.commanded])
    visits = Visits.at_reference_temperature(machine, nominal_drives(machine, target), target)
    for drive in range(len(machine.drive_names)):
        farther = visits.drives.copy()
        farther[:, drive] += step
        moved = model.predict(np.zeros(len(model)), replace(visits, drives=farther)).equilibrium.coordinates()
        offset = step * drive_offset(model.parameters, drive)
        meant = model.predict(offset, visits).equilibrium.coordinates()
        before = model.predict(np.zeros(len(model)), visits).equilibrium.coordinates()
        assert np.abs(moved - before).max() > 0.1 * step
        assert meant == pytest.approx(moved, abs=2e-4 * step)


def test_a_slider_s_reflector_goes_with_its_drive_s_offset(design, readings, model):
    """A drive that has lost its reference carries its reflector as far as it stands off; no other is touched alone."""
    column = design.watched.combination[len(model.parameters) :, design.watched.names.index("drive_offset.left")]
    smrs = [s for s in model.machine.smrs if s.on != "floor"]
    expected = [model.machine.nominal.axis[0] if s.on == "slider" and s.drive == 0 else np.zeros(3) for s in smrs]
    np.testing.assert_array_equal(column.reshape(-1, 3), expected)


def test_the_station_s_place_does_not_count(design, readings):
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(len(design.by_parameter))
    moved = readings.whitened(station_nuisance(readings.place_m, STATION_M)) @ np.array(
        [2e-4, -1e-4, 3e-4, 1e-3, -2e-3, 1e-3, 0.0, 0.0]
    )
    still, shifted = estimate_check(design, noise), estimate_check(design, noise + moved)
    assert shifted.standardised == pytest.approx(still.standardised, abs=1e-5)


def test_a_change_is_found_unbiased_within_its_uncertainty(design):
    rng = np.random.default_rng(2)
    watched = design.watched.names.index("drive_scale.right")
    size = 7.0 * design.change_u[watched]
    shift = design.by_parameter @ design.watched.combination[:, watched] * size
    found = [estimate_check(design, shift + rng.standard_normal(len(shift))) for _ in range(600)]
    error = np.array([(f.change[watched] - size) / f.change_u[watched] for f in found])
    assert np.mean(error) == pytest.approx(0.0, abs=4.0 / np.sqrt(600))
    assert np.std(error) == pytest.approx(1.0, abs=4.0 / np.sqrt(1200))
    alike = (watched, design.watched.names.index("drive_offset.right"))  # the slider's reflector moves with both
    assert all(int(np.argmax(np.abs(f.standardised))) in alike for f in found[:50])


def test_one_change_alone_is_fitted_by_least_squares(design):
    rng = np.random.default_rng(3)
    residual = rng.standard_normal(len(design.by_parameter))
    column = design.by_parameter @ design.watched.combination[:, 4]
    known = 1.0 / design.nuisance_u
    left = np.concatenate([np.column_stack([column, design.nuisance]), np.column_stack([np.zeros(8), np.diag(known)])])
    left, right = left * np.array([1e-6, *[1e-3] * 8]), np.concatenate([residual, np.zeros(8)])
    solved = np.linalg.lstsq(left, right, rcond=None)[0]
    u = np.sqrt(np.linalg.inv(left.T @ left)[0, 0])
    found = estimate_check(design, residual)
    assert found.change[4] == pytest.approx(solved[0] * 1e-6, rel=1e-6)
    assert found.change_u[4] == pytest.approx(u * 1e-6, rel=1e-6)


def test_a_calibration_s_uncertainty_is_common_to_its_checks(design):
    rng = np.random.default_rng(4)
    offsets = rng.standard_normal((2000, len(design.reference))) * np.sqrt(np.diag(design.reference))
    change = np.array([estimate_check(design, design.by_parameter @ o).change for o in offsets])
    assert np.std(change, axis=0) == pytest.approx(design.reference_u, rel=4.0 / np.sqrt(4000))


def test_the_error_is_that_of_the_tool_over_the_workspace(design):
    rng = np.random.default_rng(5)
    count = len(design.prior)
    off = []
    for _ in range(300):
        change = rng.standard_normal(count) * np.sqrt(np.diag(design.prior))
        true = np.sqrt(np.sum((design.workspace @ change) ** 2) / design.points)
        noise = rng.standard_normal(len(design.by_parameter))
        found = estimate_check(design, design.by_parameter @ change + noise).error
        off.append((found.position_m - true) / found.u_m)
    assert abs(np.mean(off)) < 0.35
    assert 0.8 < np.std(off) < 1.2


def test_noise_alone_is_no_error(design):
    rng = np.random.default_rng(6)
    errors = [estimate_check(design, rng.standard_normal(len(design.by_parameter))).error for _ in range(200)]
    assert np.median([e.position_m for e in errors]) < errors[0].u_m
    assert min(e.position_m for e in errors) == 0.0


def test_the_uncertainty_of_a_check_is_known_before_it(design):
    """The median over checks of an unchanged machine, from other noise."""
    rng = np.random.default_rng(21)
    u = [estimate_check(design, rng.standard_normal(len(design.by_parameter))).error.u_m for _ in range(400)]
    assert expected_error_u_m(design) == pytest.approx(np.median(u), rel=0.1)


def test_independent_changes_are_fewer_than_the_watched_ones(design):
    rng = np.random.default_rng(7)
    unit = design.columns * design.change_u
    largest = np.array([np.abs(unit.T @ rng.standard_normal(len(unit))).max() for _ in range(20000)])
    expected = 1.0 - (1.0 - 2.0 * ndtr(-3.0)) ** design.independent
    assert np.mean(largest > 3.0) == pytest.approx(expected, rel=0.25)
    assert 2.0 < design.independent < len(design.watched.names)


def test_poses_are_chosen_one_after_the_other(design, readings):
    visit = np.repeat(readings.visit, 3)
    chosen = choose_poses(design, visit, 6)
    assert len(set(chosen)) == 6
    assert choose_poses(design, visit, 4) == chosen[:4]

    def worst(poses):
        some = design.rows(np.isin(visit, [-1, *poses]))
        return np.max(some.change_u * some.error_per_change)

    rng = np.random.default_rng(8)
    others = [worst(rng.choice(16, 6, replace=False)) for _ in range(60)]
    assert worst(chosen) < np.quantile(others, 0.1)
    with pytest.raises(InputError, match="17 poses of 16"):
        choose_poses(design, visit, 17)


def test_what_a_check_cannot_tell_is_said(design):
    with pytest.raises(InputError, match="finite residuals"):
        estimate_check(design, np.full(len(design.by_parameter), np.nan))
    blind = replace(design, by_parameter=design.by_parameter * 0.0)
    with pytest.raises(InputError, match="do not show"):
        estimate_check(blind, np.zeros(len(design.by_parameter)))


def test_what_is_known_of_the_temperature_is_part_of_the_error(design):
    known = np.full(len(design.workspace), 10e-6)
    errors = [
        estimate_check(design, np.random.default_rng(seed).standard_normal(len(design.by_parameter)), known).error
        for seed in range(40)
    ]
    assert np.mean([e.position_m for e in errors]) == pytest.approx(10e-6 * np.sqrt(3.0), abs=1.5e-6)


def test_a_joint_change_is_the_normal_posterior(design):
    rng = np.random.default_rng(9)
    used = np.flatnonzero(np.diag(design.prior))
    residual = rng.standard_normal(len(design.by_parameter))
    found, covariance = joint_change(design, residual)
    free, prior = design.free[:, used], design.prior[np.ix_(used, used)]
    information = free.T @ free + np.linalg.inv(prior)
    direct = np.linalg.solve(information, free.T @ design.free_of_station(residual))
    assert found[used] == pytest.approx(direct, rel=1e-6, abs=1e-12)
    assert covariance[np.ix_(used, used)] == pytest.approx(np.linalg.inv(information), rel=1e-5, abs=1e-16)


def test_a_drive_s_offset_is_found_from_ten_visits(design, readings):
    """A reference that was lost by 0.3 mm: the former calibration's uncertainty, walked for a quarter, is the prior."""
    rng = np.random.default_rng(10)
    watched = design.watched
    offset = watched.names.index("drive_offset.right")
    measurement = what_to_measure(("event",), (EventFact(1.7e9, "reference lost", "right"),))
    assert measurement.visits == 10
    visit = np.repeat(readings.visit, 3)
    some = design.rows(np.isin(visit, [-1, *choose_poses(design, visit, measurement.visits)]))
    known = grown_covariance(design.reference, watched, design.change_u, 90 * 86400.0, DriftSettings())
    prior = released_covariance(known, watched, design.error_per_change, measurement, 1e-3)
    off = []
    for _ in range(60):
        change = rng.multivariate_normal(np.zeros(len(known)), known) + 3e-4 * watched.combination[:, offset]
        residual = some.by_parameter @ change + rng.standard_normal(len(some.by_parameter))
        found, covariance = joint_change(replace(some, prior=prior), residual)
        left = some.workspace @ (change - found)
        off.append(np.sqrt(left @ left / some.points))
    assert np.sqrt(np.mean(np.square(off))) < 8e-6
    expected = np.sqrt(np.trace(some.workspace @ covariance @ some.workspace.T) / some.points)
    assert np.sqrt(np.mean(np.square(off))) == pytest.approx(expected, rel=0.2)


def test_only_what_is_measured_is_left_free(design):
    watched, known = design.watched, design.reference
    full, expansion = (what_to_measure((rule,), ()) for rule in ("check", "temperature"))
    assert released_covariance(known, watched, design.error_per_change, expansion, 1e-5) is known
    grown = np.diag(released_covariance(known, watched, design.error_per_change, full, 1e-5) - known)
    singles = np.count_nonzero(watched.combination, axis=0) == 1
    assert np.all(grown[np.any(watched.combination[:, singles] != 0.0, axis=1)] > 0.0)
    assert not grown[-15:-6].any()  # reflectors stay where they are mounted on the platform
    lost = what_to_measure(("event",), (EventFact(1.7e9, "reference lost", "middle"),))
    with pytest.raises(InputError, match="no offset of middle"):
        released_covariance(known, watched, design.error_per_change, lost, 1e-5)
    with pytest.raises(InputError, match="set back"):
        grown_covariance(known, watched, design.change_u, -1.0, DriftSettings())
