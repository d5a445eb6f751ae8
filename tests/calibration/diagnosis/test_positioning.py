"""Machines that do not repeat: drives that stand off anew at each visit, beside effects and without any."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal

from calibration.diagnosis.diagnose import diagnose, diagnose_measurements
from calibration.diagnosis.linear_folder import linearise_measurements
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.positioning import FACTOR, MEDIAN_M, PositioningPosterior
from calibration.diagnosis.result import NONE
from calibration.machine.description import load_machine, shipped_machine
from calibration.recording.measurement_folder import COLUMNS
from tests.calibration.diagnosis.campaigns import simulated
from tests.calibration.diagnosis.measured import Wanted, made


def standing_off(
    machine: str, visits: int, sd_m: float, seed: int = 1, travel_m=lambda arrivals: 0.0, noise: float = 1.0
):
    """A recording of a machine whose drives stand off anew by a standard deviation in m, beside what an effect does."""
    rng = np.random.default_rng([seed, 1])

    def anew(arrivals):
        return travel_m(arrivals) + sd_m * rng.standard_normal(arrivals.drives.shape)

    return simulated(machine, visits, anew, seed=seed, noise=noise)


def posterior_of(linear) -> PositioningPosterior:
    return PositioningPosterior(linear, linear.off_together())


def said(found) -> list[float]:
    """In m, how far the drives of a diagnosed machine stand off anew: none, or one number."""
    return [1e-6 * float(m[1]) for r in found.remarks if (m := re.search(r"repeat better than ([\d.]+) um:", r))]


@pytest.fixture(scope="module")
def few():
    """Few visits, in a linear model that is small enough for its covariance to be written down."""
    return linearise_recording(standing_off("planar4", 24, 8e-6))


@pytest.mark.parametrize("sd_m", [2e-6, 9e-6])
def test_its_evidence_is_that_of_the_covariance_of_all_readings(few, sd_m):
    response, columns = few.drive_responses(), few.columns.reshape(-1, few.columns.shape[2])
    blocks = [response[few.visit == visit].reshape(-1, response.shape[2]) for visit in np.unique(few.visit)]
    order = np.concatenate([np.flatnonzero(few.visit == visit) for visit in np.unique(few.visit)])
    rows = (3 * order[:, None] + np.arange(3)).ravel()
    of_all = np.eye(len(columns)) + columns @ columns.T
    together = np.zeros_like(of_all)
    together[np.ix_(rows, rows)] = block_diag(*(block @ block.T for block in blocks))
    density = [
        multivariate_normal.logpdf(few.residual.ravel(), cov=covariance)
        for covariance in (of_all + sd_m**2 * together, of_all)
    ]
    prior = -0.5 * (np.log1p(sd_m / MEDIAN_M) / np.log(FACTOR)) ** 2
    expected = density[0] - density[1] + prior
    assert posterior_of(few).log_evidence(sd_m) == pytest.approx(expected, abs=1e-3 * abs(expected) + 1e-2)


def test_one_by_one_the_readings_of_a_visit_say_as_much_of_its_drives_as_together(few):
    sd_m = 8e-6
    response, off = few.drive_responses(), few.standing_off(sd_m).drive_responses()
    for visit in np.unique(few.visit[few.visit >= 0]):
        rows = few.visit == visit
        together = response[rows].reshape(-1, response.shape[2])
        exact = together.T @ np.linalg.solve(np.eye(len(together)) + sd_m**2 * together @ together.T, together)
        one_by_one = np.einsum("nwd,nwe->de", off[rows], off[rows])
        assert np.trace(one_by_one) == pytest.approx(np.trace(exact), rel=1e-5)


def test_the_frame_of_floor_nests_is_known_as_well_as_before(few):
    assert np.array_equal(few.standing_off(1e-5).columns[few.on_floor], few.columns[few.on_floor])


@pytest.mark.parametrize("machine", ["delta6", "stewart6"])
@pytest.mark.parametrize("sd_m", [5e-6, 2e-5])
def test_it_is_found_as_large_as_it_is(machine, sd_m):
    """Of some hundred draws: within a third, or at the largest that the prior expects."""
    linear = linearise_recording(standing_off(machine, 60, sd_m, seed=3))
    largest_m = MEDIAN_M * (FACTOR**1.645 - 1.0)
    assert posterior_of(linear).most_likely_m() == pytest.approx(min(sd_m, largest_m), rel=0.33)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [1.0, 2.0])
def test_a_machine_that_repeats_is_not_taken_for_one_that_does_not(seed, noise):
    """Nor is scatter of the single readings, as large as it may be."""
    posterior = posterior_of(linearise_recording(standing_off("delta6", 60, 0.0, seed, noise=noise)))
    assert posterior.most_likely_m() == 0.0


@pytest.mark.parametrize(("machine", "sd_m"), [("delta6", 5e-6), ("planar4", 1e-5), ("rrr3", 4e-5)])
def test_a_machine_that_does_not_repeat_has_no_cause(machine, sd_m):
    arm_m = load_machine(shipped_machine(machine)).crank_arm_m(0) if machine == "rrr3" else 1.0
    found = diagnose(standing_off(machine, 60, sd_m, seed=2))
    assert found.verdict == NONE
    assert said(found) == [pytest.approx(sd_m * arm_m, rel=0.35)]


def lost(arrivals):
    return np.where(np.arange(arrivals.drives.shape[1]) == 1, 3e-5 * arrivals.sides, 0.0)


def wave(arrivals):
    return np.where(np.arange(arrivals.drives.shape[1]) == 1, 2e-5 * np.sin(2 * np.pi * arrivals.drives / 0.01), 0.0)


@pytest.mark.parametrize(("travel_m", "effect"), [(lost, "backlash"), (wave, "screw_periodic_error")])
def test_an_effect_is_found_beside_it(travel_m, effect):
    found = diagnose(standing_off("delta6", 80, 5e-6, seed=5, travel_m=travel_m))
    assert [(each.effect, each.place) for each in found.effects] == [(effect, "b")]
    assert said(found) == [pytest.approx(5e-6, rel=0.35)]


def anew(sd_m: float, seed: int):
    rng = np.random.default_rng([seed, 2])
    return lambda drives, sides: sd_m * rng.standard_normal(drives.shape)


@pytest.mark.parametrize(
    "wanted",
    [Wanted(pairs=240, sides=True), Wanted("stewart6", COLUMNS, visits=80, sides=True)],
    ids=["distances", "poses"],
)
def test_a_measured_machine_that_does_not_repeat_has_no_cause(wanted):
    found = diagnose_measurements(made(replace(wanted, seed=3, shift=anew(1e-5, 3))))
    assert found.verdict == NONE
    assert said(found) == [pytest.approx(1e-5, rel=0.35)]


def test_evidence_beside_a_cause_is_that_of_distances_which_have_it_at_both_ends():
    linear = linearise_measurements(made(Wanted(pairs=60, visits=40, seed=5)))
    cause = 0.3 * np.random.default_rng(6).standard_normal((*linear.residual.shape, 2))  # unlike at the two ends
    residual = linear.of_numbers(linear.residual).ravel()

    def density(columns, sd_m):
        flat = linear.of_numbers(linear.joined(columns)).reshape(len(residual), -1)
        drives = linear.off_together().response[:, 0]
        covariance = np.eye(len(residual)) + flat @ flat.T + sd_m**2 * drives @ drives.T
        return multivariate_normal.logpdf(residual, cov=covariance)

    beside = np.concatenate([linear.columns, cause], axis=2)
    prior = -0.5 * (np.log1p(4e-6 / MEDIAN_M) / np.log(FACTOR)) ** 2
    expected = density(beside, 4e-6) - density(beside, 0.0) + prior
    assert PositioningPosterior(linear, linear.off_together(), cause).log_evidence(4e-6) == pytest.approx(expected)
