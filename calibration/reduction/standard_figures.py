"""Figures evaluated with the formulae of ISO 230-2 and ISO 9283, from visits that were made for them.

Neither standard applies to a parallel machine as it stands: along a virtual axis several drives move together. The
formulae are used, the standards' tests are not claimed.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from calibration.base.arrays import Array

COVERAGE = 2.0  # of the standard deviation in ISO 230-2


@dataclass(frozen=True)
class AxisFigures:
    """ISO 230-2, bidirectional, in m: accuracy A, repeatability R, reversal B, systematic error E, mean error M.

    targets m and runs n in each direction.
    """

    accuracy_m: float
    repeatability_m: float
    reversal_m: float
    systematic_m: float
    mean_error_m: float
    targets: int
    runs: int

    def as_dict(self) -> dict[str, float]:
        """For JSON."""
        return asdict(self)


def axis_figures(up_m: Array, down_m: Array) -> AxisFigures:
    """Figures of deviations (m, n), measured minus target, approached from below (up) and from above (down).

    ISO 230-2:2014, 3.12 to 3.23: s with n - 1; R_i = max(2 s_up + 2 s_dn + |B_i|, 4 s_up, 4 s_dn), A the range of
    mean +- 2 s over both directions. Raises ValueError for fewer than two targets or runs, or unequal shapes.
    """
    if up_m.shape != down_m.shape or up_m.ndim != 2 or min(up_m.shape) < 2:
        raise ValueError(f"deviations of shapes {up_m.shape} and {down_m.shape}; both are (targets, runs), 2 or more")
    mean = np.stack([up_m.mean(axis=1), down_m.mean(axis=1)])
    s = np.stack([up_m.std(axis=1, ddof=1), down_m.std(axis=1, ddof=1)])
    reversal = np.abs(mean[0] - mean[1])
    both = COVERAGE * (s[0] + s[1]) + reversal
    repeatability = np.maximum(both, 2.0 * COVERAGE * s.max(axis=0))
    of_both = mean.mean(axis=0)
    return AxisFigures(
        accuracy_m=float(np.max(mean + COVERAGE * s) - np.min(mean - COVERAGE * s)),
        repeatability_m=float(repeatability.max()),
        reversal_m=float(reversal.max()),
        systematic_m=float(mean.max() - mean.min()),
        mean_error_m=float(of_both.max() - of_both.min()),
        targets=up_m.shape[0],
        runs=up_m.shape[1],
    )


@dataclass(frozen=True)
class PoseFigures:
    """ISO 9283 at one pose, in m: accuracy AP and repeatability RP over n cycles."""

    accuracy_m: float
    repeatability_m: float
    cycles: int

    def as_dict(self) -> dict[str, float]:
        """For JSON."""
        return asdict(self)


def pose_figures(deviation_m: Array) -> PoseFigures:
    """Figures of deviations (n, d), attained minus commanded position.

    ISO 9283:1998, 7.2: AP is the distance of the barycentre from the command, RP = mean(l) + 3 s(l) with l the
    distances from the barycentre, s with n - 1. Raises ValueError for fewer than two cycles.
    """
    if deviation_m.ndim != 2 or len(deviation_m) < 2:
        raise ValueError(f"deviations of shape {deviation_m.shape}; they are (cycles, coordinates), 2 cycles or more")
    barycentre = deviation_m.mean(axis=0)
    distance = np.linalg.norm(deviation_m - barycentre, axis=1)
    return PoseFigures(
        accuracy_m=float(np.linalg.norm(barycentre)),
        repeatability_m=float(distance.mean() + 3.0 * distance.std(ddof=1)),
        cycles=len(deviation_m),
    )
