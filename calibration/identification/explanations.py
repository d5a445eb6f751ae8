"""Other explanations of a fit's residual: kinds of error that the fit did not vary, grouped where indistinguishable.

At the solution the readings are linear in every unknown. For each kind of unknown that the fit did not vary, the part
of its effect that the fitted unknowns cannot absorb is fitted to the residual, by the smallest change in units of the
tolerances. Kinds whose explanations differ by less than SAME_WITHIN_SD standard deviations of a reading (RMS) are one
equivalence class on these readings: the data cannot distinguish them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.identification.fit import Fit
from calibration.identification.problem import LeastSquaresProblem
from calibration.instruments.readings import Readings
from calibration.model.model import Model

SAME_WITHIN_SD = 0.3  # standard deviations of a reading, RMS
ABSORBED_SHARE = 1e-9  # of the largest singular value: directions of the fit itself
NEGLIGIBLE_EFFECT = 1e-2  # of a kind's largest singular value: fainter directions are not used to explain


@dataclass(frozen=True)
class Explanation:
    """A kind of error and the changes (k,) of its unknowns that explain a residual best.

    share: of the residual's weighted squares that they explain; tolerances: RMS of the changes in standard deviations
    of the priors; absorbed: share of the kind's effect on the readings that the fitted unknowns absorb; effect
    (u + 1,): of the changes on the readings, whitened and rotated.
    """

    kind: str
    names: tuple[str, ...]
    unit: str
    value: Array
    share: float
    prior_deviations: float
    absorbed: float
    effect: Array

    @property
    def size(self) -> float:
        """RMS of the changes, in `unit`."""
        return float(np.sqrt(np.mean(self.value**2)))


def explanations(fit: Fit, wider: Model, readings: Sequence[Readings]) -> tuple[Explanation, ...]:
    """Explanations of a fit's residual by the unknowns of a wider model and of its instruments, the best first.

    readings: those of the fit; unknowns of their instruments that the fit did not have may explain too.
    """
    problem = LeastSquaresProblem(wider, fit.visits, tuple(readings))
    names = problem.layout.names
    varied = np.array([name in fit.layout.names for name in names])
    z = np.zeros(len(names))
    for i in np.flatnonzero(varied):
        z[i] = fit.value(names[i])[0] / problem.layout.sigma[i]
    system = problem.linearise(z)
    columns = np.vstack([system.factor, np.zeros(len(names))])
    residual = np.append(system.right_side, np.sqrt(max(system.residual_squares, 0.0)))
    u, s, _ = np.linalg.svd(columns[:, varied], full_matrices=False)
    absorbed = u[:, s > ABSORBED_SHARE * np.max(s, initial=0.0)]
    remaining = columns - absorbed @ (absorbed.T @ columns)
    residual = residual - absorbed @ (absorbed.T @ residual)
    out = []
    for kind in dict.fromkeys(name.partition(".")[0] for name, fitted in zip(names, varied, strict=True) if not fitted):
        rows = [i for i, name in enumerate(names) if not varied[i] and name.partition(".")[0] == kind]
        for unit in dict.fromkeys(problem.layout.unknowns[i].unit for i in rows):
            some = [i for i in rows if problem.layout.unknowns[i].unit == unit]
            if np.linalg.norm(remaining[:, some]) < ABSORBED_SHARE * np.linalg.norm(columns[:, some]):
                continue
            step = -np.linalg.pinv(remaining[:, some], rcond=NEGLIGIBLE_EFFECT) @ residual
            effect = remaining[:, some] @ step
            share = 1.0 - float(np.sum((residual + effect) ** 2) / max(np.sum(residual**2), 1e-300))
            label = kind if len(some) > 1 else names[some[0]]
            remaining_share = float(np.sum(remaining[:, some] ** 2) / np.sum(columns[:, some] ** 2))
            out.append(
                Explanation(
                    kind=label,
                    names=tuple(names[i] for i in some),
                    unit=unit,
                    value=step * problem.layout.sigma[some],
                    share=share,
                    prior_deviations=float(np.sqrt(np.mean(step**2))),
                    absorbed=1.0 - remaining_share,
                    effect=effect,
                )
            )
    return tuple(sorted(out, key=lambda e: -e.share))


def group_indistinguishable(candidates: Sequence[Explanation], readings: int) -> tuple[tuple[Explanation, ...], ...]:
    """Groups of explanations that the readings cannot distinguish, by single linkage; readings: their number."""
    groups: list[list[Explanation]] = []
    for one in candidates:
        near = [
            group
            for group in groups
            if any(np.linalg.norm(one.effect - other.effect) < SAME_WITHIN_SD * np.sqrt(readings) for other in group)
        ]
        groups = [group for group in groups if group not in near]
        groups.append([*(other for group in near for other in group), one])
    return tuple(tuple(group) for group in groups)
