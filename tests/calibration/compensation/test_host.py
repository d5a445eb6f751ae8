"""Corrections of whole paths: exact in every row, held near what was measured, refused beyond it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from calibration.base.errors import InputError
from calibration.compensation.correction import correct_drives, model_error
from calibration.compensation.host import HostCorrection, host_correction
from calibration.compensation.limits import MOST_CHANGE, require_change, require_size_and_slope
from calibration.compensation.measured_range import MeasuredRange
from calibration.compensation.samples import CorrectionSamples, slopes_of
from calibration.identification.calibration import identify_recording
from calibration.machine.description import load_machine, shipped_machine
from calibration.machine.inverse import nominal_closure, nominal_drives, nominal_poses
from calibration.machine.led_path import tool_coordinates
from calibration.model.operating_conditions import OperatingConditions
from calibration.model.visits import Visits
from tests.pkm_rig.spatial_recording import TEMPERATURES_C, record


@pytest.fixture(scope="module")
def identified():
    return identify_recording(record("stewart6", 5, poses=12), baselines=False)


@pytest.fixture(scope="module")
def correction(identified) -> HostCorrection:
    return host_correction(identified, 1, TEMPERATURES_C)


def samples_of(correction):
    return CorrectionSamples.of(correction.report.machine, correction.measured.box, correction.corrections)


def way(correction, rows):
    box = correction.measured.box
    shares = np.linspace(0.25, 0.75, rows)[:, None]
    return nominal_poses(correction.report.machine, box[:, 0] + shares * (box[:, 1] - box[:, 0]))


def test_every_row_of_a_path_is_where_the_identified_model_has_its_target(correction):
    target = way(correction, 40)
    drives = correction.drives(target)
    error = model_error(correction.fit, correction.report, correction.conditions)
    assert np.abs(error(drives, target)).max() < 1e-9
    assert np.abs(error(nominal_drives(correction.report.machine, target), target)).max() > 1e-6
    single = correction.drives(target[17:18])[0]
    assert single == pytest.approx(drives[17], abs=1e-11)
    steps = np.diff(correction.corrections(target), 2, axis=0)
    assert np.abs(steps).max() < 1e-7  # it has no steps where the target has none


def test_with_more_drives_than_coordinates_the_smallest_correction_is_taken():
    """Against the minimum-norm solution of the linearised problem, by differences of the error."""
    machine = load_machine(shipped_machine("gough8"))
    target = np.zeros((1, 6))
    target[0, 2] = 1.0
    nominal = nominal_drives(machine, target)
    rng = np.random.default_rng(4)
    jac, offset = rng.normal(size=(6, 8)) * 0.001, np.full(6, 2e-5)
    jac = nominal_closure(machine, target)[1][0] + jac

    def error(drives, targets):
        return (drives - nominal) @ jac.T + offset

    found = correct_drives(machine, error, target) - nominal
    assert error(found + nominal, target) == pytest.approx(np.zeros((1, 6)), abs=1e-12)
    smallest = -np.linalg.pinv(jac) @ offset
    assert np.linalg.norm(found[0]) <= np.linalg.norm(smallest) * (1.0 + 1e-4)


def test_beyond_the_measured_poses_the_nearest_ones_correction_is_held_then_there_is_none(correction):
    measured, machine = correction.measured, correction.report.machine
    edge = measured.box.mean(axis=1)
    edge[0] = measured.box[0, 1]
    side = np.ptp(machine.commanded_limits[0])
    near, far = edge.copy(), edge.copy()
    near[0] += 0.04 * side
    far[0] += 0.06 * side
    at_edge, held = correction.corrections(nominal_poses(machine, np.array([edge, near])))
    assert held == pytest.approx(at_edge, abs=1e-12)
    assert tool_coordinates(machine, measured.held(nominal_poses(machine, near[None])))[0] == pytest.approx(
        edge, abs=1e-9
    )
    with pytest.raises(InputError, match=r"correction: x = .* were measured, beyond them there is none"):
        correction.corrections(nominal_poses(machine, far[None]))


def range_of(machine="stewart6"):
    described = load_machine(shipped_machine(machine))
    return MeasuredRange(described, described.commanded_limits, (0.0, 400.0), {"struts": (20.0, 22.0)})


def conditions(kg, struts_c):
    return OperatingConditions(kg, (0.0, 0.0, 0.0), {"struts": struts_c})


def test_a_later_measurement_widens_loads_and_temperatures_but_not_the_poses():
    measured = range_of()
    target = nominal_poses(measured.machine, measured.machine.commanded_limits.mean(axis=1)[None])
    drives = nominal_drives(measured.machine, target)
    later = Visits(drives, target, np.array([450.0]), np.zeros((1, 3)), {"struts": np.array([28.0])})
    wider = measured.widened(later)
    assert (wider.payload_kg, wider.temperatures_c["struts"]) == ((0.0, 450.0), (20.0, 28.0))
    np.testing.assert_array_equal(wider.box, measured.box)
    again = MeasuredRange.of_json(measured.machine, json.loads(json.dumps(wider.as_json())))
    np.testing.assert_array_equal(again.box, wider.box)
    assert (again.payload_kg, again.temperatures_c) == (wider.payload_kg, wider.temperatures_c)


def test_there_is_no_correction_beyond_the_measured_loads():
    range_of().require(conditions(200.0, 21.0))
    with pytest.raises(InputError, match="0 to 400 kg were measured"):
        range_of().require(conditions(401.0, 21.0))


@pytest.mark.parametrize("struts_c", [15.9, 26.1, float("nan")])
def test_there_is_no_correction_beyond_the_measured_temperatures(struts_c):
    range_of().require(conditions(0.0, 16.1))
    range_of().require(conditions(0.0, 25.9))
    with pytest.raises(InputError, match=r"temperature of struts: .* 20\.0 to 22\.0 degC were measured"):
        range_of().require(conditions(0.0, struts_c))


def test_a_correction_that_is_too_large_or_too_steep_is_refused(correction, identified):
    samples = samples_of(correction)
    assert np.abs(samples.correction).max() > 1e-6
    wrong = identified.fit.unknowns.copy()
    wrong[0] += 5e-3  # the length of a leg
    with pytest.raises(InputError, match="are permitted; check identification"):
        samples_of(replace(correction, fit=replace(identified.fit, unknowns=wrong)))
    machine = correction.report.machine
    with pytest.raises(InputError, match=r"leg2: the correction changes by 0\.0300 a unit"):
        require_size_and_slope(machine, np.zeros((1, 6)), 0.03 * np.eye(6)[1:2])


def test_slopes_are_a_unit_of_travel(correction):
    """Of a correction that is a share of each drive's own way: no more than that, and all of it for the fastest."""
    machine, box = correction.report.machine, correction.measured.box
    found = slopes_of(machine, box, lambda pose: 0.01 * nominal_drives(machine, pose))
    assert np.abs(found).max() == pytest.approx(0.01, rel=1e-6)


def test_samples_find_a_correction_again_and_tell_a_change(correction):
    samples = samples_of(correction)
    again = CorrectionSamples.of_json(samples.as_json())
    assert again.crc == samples.crc
    assert again.largest_difference(correction.corrections) < 1e-10
    moved = replace(samples, correction=samples.correction + np.eye(6)[2] * 2.5e-4)
    assert moved.crc != samples.crc
    assert moved.largest_difference(correction.corrections) == pytest.approx(2.5e-4, abs=1e-9)
    machine = correction.report.machine
    change = correction.corrections(moved.target_m) - moved.correction
    with pytest.raises(InputError, match=r"drive leg3: the correction differs by 250 um from that of rig-1"):
        require_change(machine, change, "rig-1", accept=False)
    assert require_change(machine, change, "rig-1", accept=True) > MOST_CHANGE


@pytest.mark.parametrize(
    "data", [{}, {"target_m": [[0.0] * 6]}, {"target_m": [[0.0] * 5], "correction": [[0.0]]},
             {"target_m": [[0.0] * 6], "correction": [[float("nan")]]}, {"target_m": [], "correction": []}]
)  # fmt: skip
def test_damaged_samples_are_refused(data):
    with pytest.raises(InputError, match="damaged"):
        CorrectionSamples.of_json(data)


def test_tables_need_the_whole_workspace_measured():
    """A campaign of half of the workspace has no table for the other half."""
    machine = load_machine(shipped_machine("planar4"))
    half = machine.commanded_limits.copy()
    half[0, 1] = half[0].mean()
    measured = MeasuredRange(machine, half, (0.0, 400.0), {})
    with pytest.raises(InputError, match=r"x = .* were measured, beyond them there is none"):
        measured.require_workspace()
    replace(measured, box=machine.commanded_limits).require_workspace()
