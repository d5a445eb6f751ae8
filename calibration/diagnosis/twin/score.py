"""Agreement of the campaign, simulated on its twin, with readings that were withheld from the twin.

For each region of the workspace a twin is fitted to the readings of all others (causes and their basis sets are those
of the whole diagnosis), simulated at the withheld readings and compared with what was recorded there. The errors are
those of the nonlinear model; noise is removed as in `withheld_blocks`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.findings.withheld_blocks import gap_field, gap_figures, region_of_readings, regions
from calibration.diagnosis.linear_model import require_recording
from calibration.diagnosis.result import GapFigures
from calibration.diagnosis.twin.joint_fit import JointFit, as_station_reports_m
from calibration.diagnosis.twin.twin import Twin


@dataclass(frozen=True)
class TwinScore:
    """Figures of the simulated campaign; before_sigma, after_sigma: RMS with noise over the stated one of a reading."""

    figures: GapFigures
    readings: int
    before_sigma: float
    after_sigma: float


def score_twin(
    likelihood: MarginalLikelihood, truth_likelihood: MarginalLikelihood, joint_fit: JointFit, twin: Twin
) -> TwinScore:
    """The score of a twin with its joint fit.

    truth_likelihood: the model by which the noise-free readings are estimated.
    """
    rows = np.flatnonzero(likelihood.linear.on_platform)
    before = withheld_differences_of_twin(likelihood, JointFit(likelihood, ()), replace(twin, added=()))
    after = withheld_differences_of_twin(likelihood, joint_fit, twin) if twin.added else before
    figures = gap_figures(gap_field(truth_likelihood, before, after))
    return TwinScore(
        figures if twin.added else figures.without_effect(), len(rows), _rms(before[rows]), _rms(after[rows])
    )


def withheld_differences_of_twin(likelihood: MarginalLikelihood, joint_fit: JointFit, twin: Twin) -> Array:
    """Whitened differences (n, 3) of the platform's readings from twins that were fitted without their region."""
    linear = require_recording(likelihood.linear)
    of_reading = region_of_readings(linear, regions(linear))
    out = np.zeros_like(likelihood.weighted_residual)
    for block in range(int(of_reading.max()) + 1):
        solution = joint_fit.without(np.flatnonzero(of_reading == block))
        rows = np.flatnonzero((of_reading == block) & linear.on_platform)
        positions_m = twin.with_solution(solution).readings_m(linear.context, rows, linear.smr[rows])
        error_m = linear.position_m[rows] - as_station_reports_m(linear, solution, positions_m)
        out[rows] = np.einsum("nij,nj->ni", linear.whiten[rows], error_m) - solution.disturbance_shift[rows]
    return out


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))
