"""How a campaign that is simulated again on its twin agrees with readings that were withheld from the twin.

For each region of the workspace the twin is made of the readings of all others (causes and their forms are those of the
whole diagnosis), simulated at the withheld readings and held against what was recorded there. The errors are those of the
nonlinear model; noise is taken off as in `shrink`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.gap import shrink
from calibration.gap.evidence import Readout
from calibration.gap.result import GapFigures
from calibration.gap.search import Cause
from calibration.gap.solution import solved, stated_m
from calibration.gap.twin import Twin
from calibration.machine import Array


@dataclass(frozen=True)
class TwinScore:
    """Figures of the simulated campaign; before_sigma, after_sigma: RMS with the noise, over what is stated of a reading."""

    figures: GapFigures
    readings: int
    before_sigma: float
    after_sigma: float


def scored(readout: Readout, after: Readout, causes: Sequence[Cause], truth: Readout, twin: Twin) -> TwinScore:
    """The score of a twin. readout, after: without and with the causes; truth: as `shrink.field` wants it."""
    rows = np.flatnonzero(readout.baseline.on_platform)
    before = simulated(readout, (), twin)
    after_differences = simulated(after, causes, twin) if causes else before
    figures = shrink.figures(shrink.field(truth, before, after_differences))
    if not causes:
        figures = GapFigures(
            figures.before_m, figures.before_m, figures.noise_floor_m, 0.0, (0.0, 0.0), figures.withheld
        )
    return TwinScore(figures, len(rows), _rms(before[rows]), _rms(after_differences[rows]))


def simulated(readout: Readout, causes: Sequence[Cause], twin: Twin) -> Array:
    """Whitened differences (n, 3) of the platform's readings from those of twins that were made without their region."""
    known = readout.baseline
    region = shrink.regions(known)
    of_reading = np.where(known.visit >= 0, region[np.maximum(known.visit, 0)], -1)
    bare = twin if causes else Twin(twin.campaign, twin.fit, (), twin.catalogue)
    out = np.zeros_like(readout.left)
    for block in range(int(region.max()) + 1):
        solution = solved(readout, causes, np.flatnonzero(of_reading == block))
        rows = np.flatnonzero((of_reading == block) & known.on_platform)
        places = bare.fitted(solution).readings_m(known.moments, rows, known.smr[rows])
        missed = known.position_m[rows] - stated_m(known, solution, places)
        out[rows] = np.einsum("nij,nj->ni", known.whiten[rows], missed) - solution.wander[rows]
    return out


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))
