"""How a campaign that is simulated again on its twin agrees with readings that were withheld from the twin.

For each region of the workspace the twin is made of the readings of all others (causes and their forms are those of
the whole diagnosis), simulated at the withheld readings and held against what was recorded there. The errors are those
of the nonlinear model; noise is taken off as in `shrink`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.evidence import Readout
from calibration.diagnosis.findings import withheld_blocks as shrink
from calibration.diagnosis.result import GapFigures
from calibration.diagnosis.twin.joint_fit import Joint, stated_m
from calibration.diagnosis.twin.twin import Twin


@dataclass(frozen=True)
class TwinScore:
    """Figures of the simulated campaign; before_sigma, after_sigma: RMS with noise over a reading's stated one."""

    figures: GapFigures
    readings: int
    before_sigma: float
    after_sigma: float


def scored(readout: Readout, truth: Readout, joint: Joint, twin: Twin) -> TwinScore:
    """The score of a twin that was made by a joint fit. truth: as `shrink.field` wants it."""
    rows = np.flatnonzero(readout.baseline.on_platform)
    before = simulated(readout, Joint(readout, ()), replace(twin, added=()))
    after = simulated(readout, joint, twin) if twin.added else before
    figures = shrink.figures(shrink.field(truth, before, after))
    if not twin.added:
        figures = GapFigures(
            figures.before_m, figures.before_m, figures.noise_floor_m, 0.0, (0.0, 0.0), figures.withheld
        )
    return TwinScore(figures, len(rows), _rms(before[rows]), _rms(after[rows]))


def simulated(readout: Readout, joint: Joint, twin: Twin) -> Array:
    """Whitened differences (n, 3) of the platform's readings from twins that were made without their region."""
    known = readout.baseline
    region = shrink.regions(known)
    of_reading = np.where(known.visit >= 0, region[np.maximum(known.visit, 0)], -1)
    out = np.zeros_like(readout.left)
    for block in range(int(region.max()) + 1):
        solution = joint.without(np.flatnonzero(of_reading == block))
        rows = np.flatnonzero((of_reading == block) & known.on_platform)
        places = twin.fitted(solution).readings_m(known.moments, rows, known.smr[rows])
        missed = known.position_m[rows] - stated_m(known, solution, places)
        out[rows] = np.einsum("nij,nj->ni", known.whiten[rows], missed) - solution.wander[rows]
    return out


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))
