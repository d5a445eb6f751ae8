"""What is off at few visits only: told with its visits and its drive, and no law of the catalogue."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.few_visits import FEW_VISITS, SHARE, SIZES_SIGMA, at_few_visits, or_at_few_visits
from calibration.diagnosis.linear_folder import linearise_measurements
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.result import UNKNOWN
from calibration.diagnosis.search import SearchResult
from calibration.diagnosis.settings import VERDICT
from tests.calibration.diagnosis.campaigns import Arrivals, simulated
from tests.calibration.diagnosis.measured import Wanted, made

PLAY_M = 1.0e-4


def elsewhere(visits, by, play_m=0.0):
    """The first drive stands off by so much (m, rad) at some visits, and all have a play."""

    def travel_m(arrivals: Arrivals) -> np.ndarray:
        off = -0.5 * play_m * arrivals.sides
        off[visits, 0] += by
        return off

    return travel_m


def likelihood_of(recording) -> MarginalLikelihood:
    return MarginalLikelihood.of(linearise_recording(recording, judge=False))


@pytest.mark.parametrize(
    ("machine", "by", "unit"),
    [("planar4", 5e-5, "um"), ("planar4", 2e-4, "um"), ("delta6", 1e-4, "um"), ("rrr3", 3e-4, "urad")],
)
def test_a_drive_that_is_elsewhere_at_two_visits_is_told(machine, by, unit):
    diagnosis = diagnose(simulated(machine, 80, elsewhere([20, 51], by), seed=4))
    assert diagnosis.verdict == UNKNOWN
    (said,) = [remark for remark in diagnosis.remarks if "alone something is elsewhere" in remark]
    assert said.startswith("at visits 20, 51 alone something is elsewhere, most likely travel.")
    assert diagnosis.clues[0].coordinate == FEW_VISITS
    found = float(said.split("up to ")[1].split(f" {unit}")[0])
    assert found == pytest.approx(1e6 * by, rel=0.25)
    assert diagnosis.clues[0].channel == f"travel.{simulated(machine, 8).machine.drive_names[0]}"


def test_one_that_is_so_at_one_visit_too():
    diagnosis = diagnose(simulated("planar4", 60, elsewhere([33], 2e-4)))
    assert diagnosis.verdict == UNKNOWN
    assert any("at visit 33 alone" in remark for remark in diagnosis.remarks)


def test_a_play_beside_them_keeps_its_name():
    diagnosis = diagnose(simulated("planar4", 80, elsewhere([20, 51], 3e-5, play_m=PLAY_M)))
    assert diagnosis.verdict == "backlash"
    assert not any("alone something is elsewhere" in remark for remark in diagnosis.remarks)


def test_in_a_folder_its_own_numbers_are_said():
    def shift(drives, sides):
        off = np.zeros_like(drives)
        off[[9, 44, 61], 1] = 2.0e-5  # beyond six standard deviations a row of a folder is a wrong one
        return off

    measured = made(Wanted("delta6", ("x_m", "y_m", "z_m"), visits=80, shift=shift))
    likelihood = MarginalLikelihood.of(linearise_measurements(replace(measured, number=measured.number + 100.0)))
    found = at_few_visits(likelihood)
    assert found.visits == (109, 144, 161)
    assert found.channel == f"travel.{measured.machine.drive_names[1]}"
    assert found.off == pytest.approx([2.0e-5] * 3, rel=0.4)


@pytest.mark.parametrize("machine", ["planar4", "stewart6", "rrr3"])
def test_where_nothing_is_off_there_is_no_evidence(machine):
    for seed in range(3):
        assert at_few_visits(likelihood_of(simulated(machine, 40, seed=seed))).log_evidence < 0.0


def test_many_are_not_few():
    off = np.arange(3, 80, 5)
    found = at_few_visits(likelihood_of(simulated("planar4", 80, elsewhere(off, 1e-4))))
    assert len(found.visits) == 4


def test_what_explains_as_much_but_for_a_model_s_error_has_even_odds():
    likelihood = likelihood_of(simulated("planar4", 80, elsewhere([20, 51], 5e-4), seed=5))
    few = at_few_visits(likelihood).log_evidence

    def beside(explained: float) -> SearchResult:
        result = SearchResult((), (), (likelihood,), explained, 0.0, (), ())
        return or_at_few_visits(result, likelihood)

    alike = beside(few)
    assert few > 1000.0
    assert alike.excess_log_evidence == pytest.approx(VERDICT.threshold_of_excess(few) - VERDICT.excess_threshold)
    assert alike.non_parametric_alone[0].coordinate == FEW_VISITS
    assert beside(1.2 * few).non_parametric_alone == ()  # a law that explains clearly more
    assert beside(0.5 * few).excess_log_evidence > 0.5 * few


def test_evidence_is_that_of_a_dense_covariance():
    """Of the visits that were chosen: over all sizes, less what it costs that any could be those."""
    likelihood = likelihood_of(simulated("planar4", 24, elsewhere([7], 4e-5), seed=2))
    found = at_few_visits(likelihood)
    assert found.visits == (7,)
    linear = likelihood.linear
    y, a = linear.residual.ravel(), linear.columns.reshape(-1, linear.columns.shape[2])
    ((channel, unit),) = found.channels
    z = (unit * likelihood.response(channel)[:, :, None] * found.shapes[:, None, :]).reshape(len(y), -1)
    none = np.eye(len(y)) + a @ a.T
    mean = np.zeros(len(y))
    logs = [multivariate_normal(mean, none + size**2 * z @ z.T).logpdf(y) for size in SIZES_SIGMA]
    expected = np.logaddexp.reduce(logs) - np.log(len(logs)) - multivariate_normal(mean, none).logpdf(y)
    expected += np.log(SHARE) + 23 * np.log1p(-SHARE)
    assert found.log_evidence == pytest.approx(expected, abs=0.05)
    (off_m,) = found.off
    assert off_m == pytest.approx(4e-5, abs=1.5e-5)
