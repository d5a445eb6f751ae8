"""Drives that stand off anew at each visit: found in the residuals, and in the uncertainty of what is identified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from benchmarks.joint_covariance import error_in_directions
from calibration.identification.calibration import identified_summary, identify_recording
from calibration.identification.estimators import identify
from calibration.identification.fit import Positioning
from calibration.identification.leave_one_out import leave_one_out
from calibration.identification.positioning import drive_responses, with_positioning
from calibration.identification.prediction import monte_carlo, predict_tool
from calibration.identification.problem import LeastSquaresProblem
from calibration.identification.remarks import remarks
from calibration.machine.description import load_machine, shipped_machine
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from pkm_rig.jobs.measured_machine import identify_measurements
from tests.calibration.diagnosis import campaigns
from tests.calibration.diagnosis.campaigns import simulated
from tests.calibration.diagnosis.measured import Wanted, made

SD_M = 1e-5
DECIDED = 0.3  # posterior over prior variance of directions that the readings decide
VISITS, SEEDS = 50, 8


def anew(sd_m, seed):
    rng = np.random.default_rng([seed, 1])
    return lambda drives: sd_m * rng.standard_normal(drives.shape)


def identified(name, sd_m, seed):
    off = anew(sd_m, seed)
    return identify_recording(simulated(name, VISITS, lambda at: off(at.drives), seed=seed), baselines=False)


def fit_of(wanted):
    measured = made(wanted)
    return identify(Model(ParameterSet.of(measured.machine)), measured.visits, measured.readings())


@pytest.fixture(scope="module")
def of_stewart():
    """Fits of machines whose drives stand off anew, and their true parameters."""
    parameters = ParameterSet.of(load_machine(shipped_machine("stewart6")))
    fits = []
    with pytest.MonkeyPatch.context() as patch:
        for seed in range(SEEDS):
            truth = parameters.sigma * np.random.default_rng([seed, 2]).standard_normal(len(parameters))
            patch.setattr(campaigns, "drawn_geometry", lambda *_, truth=truth: parameters.geometry(truth))
            fits.append((identified("stewart6", SD_M, seed).fit, truth))
    return fits


def test_the_truth_lies_within_it(of_stewart):
    known = np.concatenate([error_in_directions(fit, truth, fit.covariance, DECIDED) for fit, truth in of_stewart])
    stated = np.concatenate([
        error_in_directions(fit, truth, fit.covariance_as_stated, DECIDED) for fit, truth in of_stewart
    ])  # fmt: skip
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], len(known)) / len(known)
    assert low < np.mean(known**2) < high
    assert np.mean(stated**2) > 2.0


def test_it_is_found_as_large_as_it_is(of_stewart):
    sd_m = np.array([fit.positioning_sd_m for fit, _ in of_stewart])
    assert np.all(np.abs(sd_m / SD_M - 1.0) < 0.25)
    assert abs(sd_m.mean() / SD_M - 1.0) < 0.1
    assert abs(np.mean([fit.positioning.scatter for fit, _ in of_stewart]) - 1.0) < 0.15
    assert all(fit.chi2_per_dof > 1.5 for fit, _ in of_stewart)


@pytest.mark.parametrize("name", ["stewart6", "rrr4"])
def test_a_machine_that_repeats_has_none(name):
    assert [identified(name, 0.0, seed).fit.positioning for seed in range(5)] == [None] * 5


@pytest.mark.parametrize(
    "wanted",
    [
        Wanted("planar4", ("x_m", "y_m", "rz_rad"), visits=20),
        Wanted("delta6", ("z_m",), pairs=30, visits=20),
        Wanted("rrr3", ball_m=(0.1, 0.2, 0.0), visits=20),
    ],
)
def test_responses_are_what_readings_do_where_drives_move(wanted):
    fit = fit_of(wanted)
    off_m = 1e-7 * np.random.default_rng(1).standard_normal(fit.visits.drives.shape)
    arm_m = [fit.machine.crank_arm_m(a) if fit.machine.rotary_drives else 1.0 for a in range(len(off_m.T))]
    z = fit.unknowns / fit.layout.sigma
    moved = replace(fit.visits, drives=fit.visits.drives + off_m / arm_m)
    for shift, after, before in zip(
        [responses.shift(off_m) for responses in drive_responses(fit)],
        LeastSquaresProblem(fit.model, moved, fit.instruments).residuals(z),
        LeastSquaresProblem(fit.model, fit.visits, fit.instruments).residuals(z),
        strict=True,
    ):
        np.testing.assert_allclose(after - before, shift, atol=1e-3 * np.abs(shift).max())


def test_residuals_and_their_freedom_stay_those_of_the_readings(of_stewart):
    fit = of_stewart[0][0]
    bare = replace(fit, positioning=None)
    assert fit.degrees_of_freedom == bare.degrees_of_freedom
    np.testing.assert_array_equal(leave_one_out(fit)[0].error, leave_one_out(bare)[0].error)


def test_drawn_errors_have_it_too():
    """Standard deviations of 40 draws, over those of the linear covariance, which has 1.5 times what is stated."""
    wide = with_positioning(fit_of(Wanted("planar4", ("x_m", "y_m", "rz_rad"), visits=60, shift=_off(3e-5))))
    linear, drawn = predict_tool(wide, wide.visits), monte_carlo(wide, wide.visits, 1, 40)
    ratio = np.sqrt(np.mean(drawn.u[:, :2] ** 2) / np.mean(linear.u[:, :2] ** 2))
    assert abs(ratio - 1.0) < 0.3
    stated = predict_tool(replace(wide, positioning=None), wide.visits)
    assert np.mean(linear.u[:, :2] ** 2) > 1.5**2 * np.mean(stated.u[:, :2] ** 2)


def _off(sd_m, seed=1):
    off = anew(sd_m, seed)
    return lambda drives, _sides: off(drives)


@pytest.mark.parametrize("estimator", ["least_squares", "tikhonov", "truncated_svd"])
def test_other_estimators_keep_their_covariance(estimator):
    measured = made(Wanted("planar4", ("x_m", "y_m", "rz_rad"), visits=30, shift=_off(3e-5)))
    fit = identify(Model(ParameterSet.of(measured.machine)), measured.visits, measured.readings(), estimator)
    assert with_positioning(fit) is fit


def test_where_each_visit_has_one_number_it_is_scatter():
    fit = fit_of(Wanted("delta6", ("z_m",), visits=80, shift=_off(3e-5)))
    assert with_positioning(fit).positioning is None


def test_a_remark_and_the_json_say_how_far(of_stewart):
    identification = identified("stewart6", SD_M, 0)
    summary = identified_summary(identification)
    assert summary["positioning_sd_m"] == identification.fit.positioning_sd_m > 0.0
    (sentence,) = [r for r in summary["remarks"] if "off anew at each visit" in r]
    assert sentence.endswith("the standard uncertainties include it")
    assert not any("the readings scatter" in r for r in summary["remarks"])
    bare = replace(identification.fit, positioning=None)
    assert any("the readings scatter 1." in r for r in remarks(bare))
    loud = replace(identification.fit, positioning=Positioning(SD_M, np.zeros_like(bare.covariance), 2.0))
    assert any("the readings scatter 2 times" in r for r in remarks(loud))


def test_a_measurement_folder_has_it():
    measured = made(Wanted("gough8", ("x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad"), visits=60, shift=_off(3e-5)))
    result = identify_measurements(measured, "map")
    assert abs(result["positioning_sd_m"] / 3e-5 - 1.0) < 0.3
