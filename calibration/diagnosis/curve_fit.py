"""Fit of columns that are not linear in their parameters, from several starts.

The columns of a curve's tangent, the calibration projected out, give gradient and Hessian of the log posterior of its
parameters: Levenberg's and Marquardt's damped Gauss-Newton steps (Nocedal, Wright, Numerical Optimization, Springer
2006, ch. 10), of which only those are taken that raise it. The evidence is Laplace's approximation at the best point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import (
    BasisSetEvidence,
    InformationAndScore,
    evidence_of_families,
)
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.effects.api import BasisSet, Curve, Tangent
from calibration.effects.columns import Contributions

STAGES = ((1, 8), (5, 2), (25, 1))  # steps from each point that is left, and how many are left then, the best ones
FIRST_DAMPING, LESS_DAMPING, MORE_DAMPING, MOST_DAMPING = 1e-2, 0.2, 5.0, 1e4
LARGEST_STEP = 0.7  # of parameters without a spread of their own
MIN_GAIN = 0.02  # of log evidence: a step that gains less is the last


@dataclass(frozen=True)
class CurveFit:
    """The best point of a curve: log evidence, evidence of the tangent there, its columns."""

    log_evidence: float
    best: BasisSetEvidence
    contributions: tuple[Contributions, ...]


def fit_curves(likelihood: MarginalLikelihood, curves: Sequence[Curve], low: float, high: float) -> CurveFit | None:
    """The best of all curves, equally likely a priori, for sizes between two limits; None without a positive size."""
    fits = [_CurveOnReadings(likelihood, number, curve, low, high).fit() for number, curve in enumerate(curves)]
    return max((fit for fit in fits if fit is not None), key=lambda fit: fit.log_evidence, default=None)


@dataclass(frozen=True)
class _Point:
    """A point of a curve: its parameters (p,), tangent, the information and score of its columns (1 + p), and the
    logarithm of the prior of the parameters, but for a constant."""

    parameters: Array
    tangent: Tangent
    columns: InformationAndScore
    log_prior: float

    @property
    def log_posterior(self) -> float:
        """Of the readings and the parameters, over that of no effect."""
        value = self.tangent.value
        return value * float(self.columns.score[0] - 0.5 * value * self.columns.information[0, 0]) + self.log_prior

    def derivatives(self) -> tuple[Array, Array]:
        """Gradient (p,) and minus the Hessian (p, p) of the log likelihood (Gauss-Newton)."""
        per_unit = self.tangent.value / np.array(self.tangent.units)
        gradient = per_unit * (self.columns.score[1:] - self.tangent.value * self.columns.information[0, 1:])
        return gradient, per_unit[:, None] * self.columns.information[1:, 1:] * per_unit


@dataclass(frozen=True)
class _CurveOnReadings:
    """A curve, its number among the effect's, and the readings that it is fitted to; low, high: limits of the size."""

    likelihood: MarginalLikelihood
    number: int
    curve: Curve
    low: float
    high: float

    def fit(self) -> CurveFit | None:
        """The best point of the curve; None if the readings ask for a negative size."""
        optima = self._points([*self.curve.starts])
        for steps, followed in STAGES:
            optima = [self._follow(point, steps) for point in optima]
            optima.sort(key=lambda point: -point.log_posterior)
            optima = optima[:followed]
        if not optima or (best := optima[0]).columns.score[0] <= 0.0:
            return None
        evidence, penalty = self._at(best)
        return CurveFit(best.log_posterior - penalty, evidence, self.curve.at_readings(best.tangent))

    def _points(self, parameters: Sequence[Array]) -> list[_Point]:
        """Points of the curve; without those where the tangent has columns that are not finite."""
        tangents = [(at, self.curve.tangent(at)) for at in parameters]
        finite = [(at, tangent) for at, tangent in tangents if _is_finite(tangent)]
        families = self._columns([tangent for _, tangent in finite]) if finite else []
        return [
            _Point(at, _with_value(tangent, columns), columns, -0.5 * float(np.sum((at / self.curve.spread) ** 2)))
            for (at, tangent), columns in zip(finite, families, strict=True)
        ]

    def _columns(self, tangents: Sequence[Tangent]) -> list[InformationAndScore]:
        """Information and score of the columns of each."""
        group = self.curve.group
        if group is None:
            return self.likelihood.of_families([tangent.contributions for tangent in tangents])
        out = []
        for tangent in tangents:
            of_groups = self.likelihood.grouped(tangent.contributions[0][0][0], group)
            shapes = np.stack([column[0][1] for column in tangent.contributions], axis=1)
            out.append(InformationAndScore(shapes.T @ of_groups.information @ shapes, of_groups.score @ shapes))
        return out

    def _follow(self, start: _Point, steps: int) -> _Point:
        """The log posterior's maximum near a point, or as near to it as some steps lead."""
        curve, current, damping = self.curve, start, FIRST_DAMPING
        largest = np.where(np.isfinite(curve.spread), curve.spread, LARGEST_STEP)
        for _ in range(steps):
            gradient, information = current.derivatives()
            hessian = information + np.diag(curve.spread**-2.0)
            ascent = gradient - current.parameters * curve.spread**-2.0
            diagonal = np.maximum(np.diag(hessian), 1e-12 * float(np.trace(hessian)) + 1e-300)
            step = np.linalg.solve(hessian + np.diag(damping * diagonal), ascent)
            at = np.clip(current.parameters + np.clip(step, -largest, largest), curve.low, curve.high)
            trial = self._points([np.asarray(at)])
            gain = trial[0].log_posterior - current.log_posterior if trial else -np.inf
            if gain > 0.0:
                current, damping = trial[0], damping * LESS_DAMPING
            else:
                damping *= MORE_DAMPING
            if 0.0 < gain < MIN_GAIN or damping > MOST_DAMPING:
                break
        return current

    def _at(self, point: _Point) -> tuple[BasisSetEvidence, float]:
        """The tangent's evidence at the best point, and what the whole range of the parameters costs in log evidence.

        Laplace's approximation; a flat prior counts as a normal one of the same density at its middle.
        """
        curve, tangent = self.curve, point.tangent
        spread = np.where(np.isfinite(curve.spread), curve.spread, (curve.high - curve.low) / np.sqrt(2.0 * np.pi))
        information = point.derivatives()[1]
        precision = np.eye(len(spread)) + spread[:, None] * information * spread
        penalty = 0.5 * float(np.linalg.slogdet(precision)[1])
        covariance = spread[:, None] * np.linalg.inv(precision) * spread
        # Coefficients of the tangent, of which only the first is not zero here, go with the parameters.
        by_parameter = np.diag(tangent.value / np.array(tangent.units))
        uncertain = np.zeros((len(spread) + 1, len(spread) + 1))
        uncertain[1:, 1:] = by_parameter @ covariance @ by_parameter
        count = len(tangent.contributions)
        basis_set = BasisSet(
            tuple(range(count)), tangent.relative, curve=(self.number, tuple(point.parameters.tolist())),
            size=tangent.size,
        )  # fmt: skip
        exact = evidence_of_families([point.columns], [basis_set], self.low, self.high)[0]
        coefficients = tangent.value * np.eye(count)[0]
        return replace(exact, size=tangent.value, coefficients=coefficients, covariance=uncertain), penalty


def _is_finite(tangent: Tangent) -> bool:
    """Whether all columns are finite."""
    return bool(np.isfinite(sum(float(np.sum(shape)) for column in tangent.contributions for _, shape in column)))


def _with_value(tangent: Tangent, columns: InformationAndScore) -> Tangent:
    """The tangent; where it does not say its size at the point, with the most likely one."""
    if tangent.value:
        return tangent
    return replace(tangent, value=max(float(columns.score[0] / max(columns.information[0, 0], 1e-300)), 1e-300))
