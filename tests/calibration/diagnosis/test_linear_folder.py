"""The linear model of a measurement folder against dense algebra of the readings, and finite differences of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.diagnosis.detectable_effects import detectable_effects
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.findings.withheld_blocks import gap_field, region_of_readings, regions, withheld_differences
from calibration.diagnosis.linear_folder import LinearFolder, linearise_measurements
from calibration.effects.catalogue import load_catalogue
from calibration.recording.measurement_folder import MeasuredMachine
from tests.calibration.diagnosis.measured import SD, Wanted, made

POSE = ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad")
STEP = 1e-6


@pytest.fixture(scope="module")
def mixed() -> tuple[MeasuredMachine, LinearFolder]:
    """Heights of some delta, and distances between its visits."""
    measured = made(Wanted(columns=("z_m",), pairs=40, visits=60))
    return measured, linearise_measurements(measured)


def numbers_of(linear: LinearFolder, whitened: np.ndarray) -> np.ndarray:
    """Figures of the numbers read, from those of the rows: both ends of a distance over the root of two."""
    first = np.flatnonzero(linear.rows.is_first)
    ends = linear.rows.has_two_ends[first]
    other = np.where(ends, linear.rows.partner[first], first)
    both = np.where(ends, 1.0 / np.sqrt(2.0), 0.5).reshape(-1, *[1] * (whitened.ndim - 2))
    return (whitened[first, 0] + whitened[other, 0]) * both


def read(linear: LinearFolder, drives: np.ndarray, values: np.ndarray | None = None) -> np.ndarray:
    """Readings of the fitted machine, its drives or unknowns being elsewhere, in sigma, as `numbers_of` orders them."""
    poses, rows = linear.poses, linear.rows
    values = poses.values if values is None else values
    moved = poses.model.predict(values, replace(poses.visits, drives=drives), poses.equilibrium.coordinates())
    tool = moved.tool_m() @ linear.frame.rotation.T + linear.frame.translation_m
    out = []
    for row in np.flatnonzero(rows.is_first):
        if rows.has_two_ends[row]:
            apart = tool[linear.visit[row]] - tool[linear.visit[rows.partner[row]]]
            out.append(np.linalg.norm(apart) / rows.sigma[row])
        else:
            out.append(tool[linear.visit[row], rows.axis[row]] / rows.sigma[row])
    return np.array(out)


def test_columns_and_residual_are_those_of_the_readings(mixed):
    """By finite differences of the readings with an unknown, and what was measured less what the fit says."""
    measured, linear = mixed
    values, drives = linear.poses.values, linear.poses.visits.drives
    z = values / linear.sigma
    for number in (0, linear.names.index("drive_scale.b")):
        step = np.zeros(len(values))
        step[number] = 1e-3 * linear.sigma[number]
        by_difference = (read(linear, drives, values + step) - read(linear, drives, values - step)) / 2e-3
        column = numbers_of(linear, linear.columns[:, :, number : number + 1])[:, 0]
        np.testing.assert_allclose(column, by_difference, atol=1e-3 * np.abs(by_difference).max())
    readings = np.array([*measured.coordinates[:, 2], *measured.distance_m]) / SD
    left = linear.residual - linear.columns[:, :, : len(z)] @ z
    np.testing.assert_allclose(numbers_of(linear, left), readings - read(linear, drives), atol=1e-3)


def test_a_folder_that_scatters_more_has_larger_deviations_and_the_same_readings(mixed):
    """What was read and predicted stays, in m; in sigma it is less, as is all that answers to it."""
    _, linear = mixed
    linear = replace(linear, left_alone={"bar": linear.columns[:, :, 0]})
    more = linear.scattering(1.5)
    assert more.numbers_read == 60 + 40  # a distance is one
    differences = np.random.default_rng(6).standard_normal((len(linear.rows), 1))
    np.testing.assert_allclose(more.predicted(differences / 1.5), linear.predicted(differences), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(more.lengths_m(differences / 1.5), linear.lengths_m(differences))
    assert more.sigma_of_length_m == pytest.approx(1.5 * linear.sigma_of_length_m)
    for name in ("residual", "columns", "whiten"):
        np.testing.assert_allclose(getattr(more, name), getattr(linear, name) / 1.5)
    np.testing.assert_allclose(more.rows.whiten, more.whiten)
    np.testing.assert_allclose(more.left_alone["bar"], linear.left_alone["bar"] / 1.5)
    flat = more.columns.reshape(len(more.rows), -1)
    covariance = np.eye(len(flat)) + flat @ flat.T
    y = more.residual.ravel()
    assert y @ more.apply(more.residual).ravel() == pytest.approx(y @ np.linalg.solve(covariance, y), rel=1e-3)


def test_rows_respond_as_the_readings_do(mixed):
    """A drive moved at each visit by its own amount, against finite differences of heights and distances."""
    _, linear = mixed
    amounts = np.random.default_rng(2).normal(0.0, 1.0, len(linear.poses.visits))
    likelihood = MarginalLikelihood.of(linear)
    column = likelihood.columns([(("travel.b", amounts[linear.visit]),)])
    drives = linear.poses.visits.drives
    moved = np.zeros_like(drives)
    moved[:, 1] = STEP * amounts
    by_difference = (read(linear, drives + moved) - read(linear, drives - moved)) / (2.0 * STEP)
    np.testing.assert_allclose(numbers_of(linear, column)[:, 0], by_difference, rtol=1e-4, atol=1e-4 / SD * 1e-2)


def test_information_and_score_are_those_of_the_readings(mixed):
    """C = 1 + A A' of the numbers read, without any notion of ends."""
    _, linear = mixed
    rng = np.random.default_rng(3)
    by_visit = rng.normal(0.0, 1e-5, (len(linear.poses.visits), 3))
    contributions = [(("travel.a", shape[linear.visit]), ("pose.z", 0.3 * shape[linear.visit])) for shape in by_visit.T]
    likelihood = MarginalLikelihood.of(linear)
    found = likelihood.information_and_score(contributions)
    h, a = numbers_of(linear, likelihood.columns(contributions)), numbers_of(linear, linear.columns)
    y = numbers_of(linear, linear.residual)
    inverse = np.linalg.inv(np.eye(len(y)) + a @ a.T)
    scale = np.abs(np.diag(h.T @ inverse @ h)).max()
    np.testing.assert_allclose(found.information, h.T @ inverse @ h, atol=1e-2 * scale)
    np.testing.assert_allclose(found.score, h.T @ inverse @ y, atol=1e-2 * np.sqrt(scale))
    further = likelihood.including(likelihood.columns(contributions))
    inverse = np.linalg.inv(np.eye(len(y)) + a @ a.T + h @ h.T)
    np.testing.assert_allclose(numbers_of(linear, further.weighted_residual), inverse @ y, atol=0.02)


def test_withheld_readings_are_predicted_from_all_others(mixed):
    """A distance is withheld with its first visit, as a whole."""
    _, linear = mixed
    region = regions(linear)
    likelihood = MarginalLikelihood.of(linear)
    differences = numbers_of(linear, withheld_differences(likelihood, region))
    block = region_of_readings(linear, region)[linear.rows.is_first]
    a, y = numbers_of(linear, linear.columns), numbers_of(linear, linear.residual)
    covariance = np.eye(len(y)) + a @ a.T
    for number in range(5):
        out = np.flatnonzero(block == number)
        rest = np.flatnonzero(block != number)
        predicted = covariance[np.ix_(out, rest)] @ np.linalg.solve(covariance[np.ix_(rest, rest)], y[rest])
        np.testing.assert_allclose(differences[out], y[out] - predicted, atol=0.05)
    field = gap_field(likelihood, *[withheld_differences(likelihood, region)] * 2)
    assert field.before.shape == (len(y), 1)
    assert field.noise_m == pytest.approx(SD, rel=0.25)


def test_predictions_are_in_the_units_of_the_readings(mixed):
    measured, linear = mixed
    predicted = linear.predicted(np.zeros((len(linear.rows), 1)))[linear.rows.is_first, 0]
    np.testing.assert_allclose(predicted, [*measured.coordinates[:, 2], *measured.distance_m], atol=1e-12)
    off = linear.predicted(numbers_rows(linear, 2.0))[linear.rows.is_first, 0]
    np.testing.assert_allclose(predicted - off, 2.0 * SD, rtol=1e-9)


def numbers_rows(linear: LinearFolder, whitened: float) -> np.ndarray:
    """Rows that say that each number is off by so much."""
    return np.where(linear.rows.has_two_ends, whitened / np.sqrt(2.0), whitened)[:, None]


def test_poses_in_an_own_frame_respond_to_turns_and_shifts():
    """The platform's turn about y moves rotations by one, and places by the lever of the tool."""
    linear = linearise_measurements(made(Wanted("stewart6", POSE, visits=20, turned=(0.0, 0.0, 0.5))))
    np.testing.assert_allclose(linear.frame.rotation[:2, :2], [[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]],
                               atol=2e-3)  # fmt: skip
    likelihood = MarginalLikelihood.of(linear)
    response = likelihood.response("pose.ry")[:, 0] * SD
    turns = response[linear.rows.turns].reshape(-1, 3)
    np.testing.assert_allclose(turns, np.tile(linear.frame.rotation[:, 1], (20, 1)), atol=1e-9)
    lever = linear.poses.equilibrium.rotation @ linear.machine.tool_point_m
    places = np.cross([0.0, 1.0, 0.0], lever) @ linear.frame.rotation.T
    np.testing.assert_allclose(response[~linear.rows.turns].reshape(-1, 3), places, atol=1e-9)
    shift = likelihood.response("pose.x")[:, 0] * SD
    np.testing.assert_allclose(shift[linear.rows.turns], 0.0)


def test_what_the_columns_do_not_say_is_not_tested():
    linear = linearise_measurements(made(Wanted(columns=("z_m",), visits=40)))
    likelihood = MarginalLikelihood.of(linear)
    inputs = inputs_of_recording(likelihood, periodograms(likelihood))
    tested, reasons = detectable_effects(inputs, load_catalogue())
    assert reasons["backlash"] == "coordinates.csv has no column a_direction"
    assert reasons["link_thermal_growth"] == "coordinates.csv has no column t_rig_s"
    assert reasons["payload"] == "coordinates.csv has no column payload_mass_kg"
    assert reasons["servo_settling"] == "coordinates.csv has no column dwell_s"
    for name in ("tracker_drift", "refraction", "smr_reseat"):
        assert reasons[name].startswith("no station measured reflectors")
    assert {"screw_cumulative_error", "joint_clearance", "guide_straightness", "axis_coupling"} <= {
        effect.name for effect in tested
    }


def test_rotations_alone_are_refused():
    with pytest.raises(InputError, match="only rotations were read"):
        linearise_measurements(made(Wanted("stewart6", POSE[3:], visits=30)))
