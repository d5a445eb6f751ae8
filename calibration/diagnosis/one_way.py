"""What it costs in log evidence that a course goes one way only, as of what sinks or wears.

The posterior of a course's coefficients is normal, with mean m and covariance K K'. Of all courses that never turn, the
nearest to m lies off by x = K^-1 (b - m) of least length: a least-distance problem with linear constraints, solved by
non-negative least squares (Lawson, Hanson, Solving Least Squares Problems, SIAM 1995, ch. 23). Its density is less by
x'x / 2, which is taken for what all of them have less: that a prior which allows turning gives most of its weight to
courses that do turn is not counted for the effect.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import nnls

from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import BasisSetEvidence
from calibration.diagnosis.settings import VERDICT

FAR_BELOW = 30.0  # log evidence of a basis set below the best one that decides nothing
NOTHING = 1e-12  # of a residual: the constraints contradict one another, which these never do


def judge_courses(evidence: Sequence[BasisSetEvidence], logs: Array) -> None:
    """Take from log evidence (m,) what courses lose that must not turn, the strongest first, as far as it decides."""
    left = [number for number, entry in enumerate(evidence) if entry.basis_set.one_way]
    while left:
        strongest = max(left, key=lambda number: float(logs[number]))
        if logs[strongest] <= max(VERDICT.detection_threshold, float(logs.max()) - FAR_BELOW):
            return
        logs[strongest] -= loss_of_one_way(evidence[strongest])
        left.remove(strongest)


def loss_of_one_way(entry: BasisSetEvidence) -> float:
    """By how much the log evidence of a basis set falls if its courses must not turn; 0 for one without courses.

    Each course goes the way that its mean goes from its begin to its end.
    """
    constraints, first = [], 0
    for steps in entry.basis_set.one_way:
        own = slice(first, first + steps.shape[1])
        constraint = np.zeros((len(steps), len(entry.coefficients)))
        constraint[:, own] = steps
        way = float(np.sum(steps @ entry.coefficients[own]))
        constraints.append(constraint if way >= 0.0 else -constraint)
        first += steps.shape[1]
    if not constraints:
        return 0.0
    rows = np.concatenate(constraints)
    lacking = -rows @ entry.coefficients
    if np.all(lacking <= 0.0):
        return 0.0
    values, vectors = np.linalg.eigh(entry.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return 0.5 * least_square(rows @ root, lacking)


def least_square(g: Array, h: Array) -> float:
    """The least x'x of all x (k,) with g x >= h, g (m, k), h (m,); infinite if there is none."""
    scale = np.maximum(np.linalg.norm(g, axis=1), 1e-300)  # each constraint in units of its own deviation
    system = np.vstack([(g / scale[:, None]).T, h / scale])
    wanted = np.zeros(len(system))
    wanted[-1] = 1.0
    solution, rest = nnls(system, wanted)
    if rest <= NOTHING:
        return float("inf")
    residual = system @ solution - wanted
    return float(np.sum((residual[:-1] / residual[-1]) ** 2))
