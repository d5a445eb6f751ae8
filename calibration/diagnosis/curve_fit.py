"""Fit of columns that are not linear in their parameters, from several starts.

The columns of a curve's tangent, the calibration projected out, give gradient and Hessian of the log posterior of its
parameters: Levenberg's and Marquardt's damped Gauss-Newton steps (Nocedal, Wright, Numerical Optimization, Springer
2006, ch. 10), of which only those are taken that raise it. The evidence is Laplace's approximation at the best point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import (
    BasisSetEvidence,
    InformationAndScore,
    evidence_of_families,
)
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.effects.api import BasisSet, Curve, Tangent, Tangents
from calibration.effects.columns import Contributions

STAGES = ((3, 16), (12, 8), (60, 4))  # steps from each point that is left, and how many are left then, the best ones
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
class _Points:
    """Points (m) of a curve: their parameters (m, p), units of these (m, p), the size there (m,), information
    (m, 1 + p, 1 + p) and score (m, 1 + p) of the columns, and the log posterior (m,) of the readings and the
    parameters, over that of no effect and but for a constant; minus infinity where columns are not finite."""

    parameters: Array
    units: Array
    value: Array
    information: Array
    score: Array
    log_posterior: Array

    def take(self, rows: NDArray[np.intp]) -> _Points:
        """Some of them."""
        return _Points(*(getattr(self, field.name)[rows] for field in fields(self)))

    def put(self, rows: NDArray[np.intp], others: _Points) -> None:
        """Other points in place of some."""
        for field in fields(self):
            getattr(self, field.name)[rows] = getattr(others, field.name)

    def derivatives(self) -> tuple[Array, Array]:
        """Gradient (m, p) and minus the Hessian (m, p, p) of the log likelihood (Gauss-Newton)."""
        per_unit = self.value[:, None] / self.units
        gradient = per_unit * (self.score[:, 1:] - self.value[:, None] * self.information[:, 0, 1:])
        return gradient, per_unit[:, :, None] * self.information[:, 1:, 1:] * per_unit[:, None]


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
        optima = self._points(np.asarray(self.curve.starts))
        optima = optima.take(np.flatnonzero(np.isfinite(optima.log_posterior)))
        for steps, followed in STAGES:
            self._follow(optima, steps)
            optima = optima.take(np.argsort(-optima.log_posterior, kind="stable")[:followed])
        if not len(optima.value) or optima.score[0, 0] <= 0.0:
            return None
        tangent = replace(self.curve.tangent(optima.parameters[0]), value=float(optima.value[0]))
        evidence, penalty = self._at(optima, tangent)
        return CurveFit(float(optima.log_posterior[0]) - penalty, evidence, self.curve.at_readings(tangent))

    def _points(self, parameters: Array) -> _Points:
        """Points (m) of the curve by their parameters (m, p)."""
        of_curve = self.curve.tangents
        units, value, columns = self._of_each(parameters) if of_curve is None else self._of_all(of_curve(parameters))
        information, score = columns.information, columns.score
        # Where a tangent does not say its size at the point it is the most likely one.
        likeliest = np.maximum(score[:, 0] / np.maximum(information[:, 0, 0], 1e-300), 1e-300)
        value = np.where(value == 0.0, likeliest, value)
        log_likelihood = value * (score[:, 0] - 0.5 * value * information[:, 0, 0])
        log_prior = -0.5 * np.sum((parameters / self.curve.spread) ** 2, axis=1)
        log_posterior = np.where(np.isnan(value), -np.inf, log_likelihood + log_prior)
        return _Points(parameters, units, value, information, score, log_posterior)

    def _of_all(self, tangents: Tangents) -> tuple[Array, Array, InformationAndScore]:
        """Units (m, p), sizes (m,), not numbers where columns are not finite, and information and score of each."""
        group = self.curve.group
        if group is None:
            raise ValueError("a curve whose tangents are asked for at once has groups")
        of_groups = self.likelihood.grouped(tangents.channel, group)
        finite = np.isfinite(np.sum(tangents.columns, axis=(1, 2)))
        columns = tangents.columns if np.all(finite) else np.where(finite[:, None, None], tangents.columns, 0.0)
        count, stands = columns.shape[1:]
        along = (columns.reshape(-1, stands) @ of_groups.information).reshape(-1, count, stands)
        found = InformationAndScore(along @ columns.transpose(0, 2, 1), columns @ of_groups.score)
        return tangents.units, np.where(finite, tangents.value, np.nan), found

    def _of_each(self, parameters: Array) -> tuple[Array, Array, InformationAndScore]:
        """The same, each tangent by itself."""
        tangents = [self.curve.tangent(at) for at in parameters]
        finite = np.array([_is_finite(tangent) for tangent in tangents])
        families = self.likelihood.of_families([self.curve.at_readings(t) for t in tangents if _is_finite(t)])
        count = 1 + parameters.shape[1]
        information, score = np.zeros((len(tangents), count, count)), np.zeros((len(tangents), count))
        for row, family in zip(np.flatnonzero(finite), families, strict=True):
            information[row], score[row] = family.information, family.score
        value = np.where(finite, [tangent.value for tangent in tangents], np.nan)
        return np.array([tangent.units for tangent in tangents]), value, InformationAndScore(information, score)

    def _follow(self, points: _Points, steps: int) -> None:
        """Leads each to the log posterior's maximum near it, or as near to it as some steps lead."""
        damping, active = np.full(len(points.value), FIRST_DAMPING), np.arange(len(points.value))
        for _ in range(steps):
            if not active.size:
                break
            current = points.take(active)
            trial = self._points(self._after_step(current, damping[active]))
            gain = trial.log_posterior - current.log_posterior
            raised = gain > 0.0
            points.put(active[raised], trial.take(np.flatnonzero(raised)))
            damping[active] *= np.where(raised, LESS_DAMPING, MORE_DAMPING)
            active = active[~(raised & (gain < MIN_GAIN)) & (damping[active] <= MOST_DAMPING)]

    def _after_step(self, points: _Points, damping: Array) -> Array:
        """Parameters (m, p) after a damped step from each; damping (m,)."""
        curve = self.curve
        largest = np.where(np.isfinite(curve.spread), curve.spread, LARGEST_STEP)
        gradient, information = points.derivatives()
        hessian = information + np.diag(curve.spread**-2.0)
        ascent = gradient - points.parameters * curve.spread**-2.0
        diagonal = np.diagonal(hessian, axis1=1, axis2=2)
        diagonal = np.maximum(diagonal, 1e-12 * np.sum(diagonal, axis=1, keepdims=True) + 1e-300)
        damped = hessian + (damping[:, None] * diagonal)[:, :, None] * np.eye(diagonal.shape[1])
        step = np.linalg.solve(damped, ascent[:, :, None])[:, :, 0]
        return np.clip(points.parameters + np.clip(step, -largest, largest), curve.low, curve.high)

    def _at(self, best: _Points, tangent: Tangent) -> tuple[BasisSetEvidence, float]:
        """The tangent's evidence at the best point, the first, and what the whole range of the parameters costs in log
        evidence.

        Laplace's approximation; a flat prior counts as a normal one of the same density at its middle.
        """
        curve = self.curve
        spread = np.where(np.isfinite(curve.spread), curve.spread, (curve.high - curve.low) / np.sqrt(2.0 * np.pi))
        information = best.derivatives()[1][0]
        precision = np.eye(len(spread)) + spread[:, None] * information * spread
        penalty = 0.5 * float(np.linalg.slogdet(precision)[1])
        covariance = spread[:, None] * np.linalg.inv(precision) * spread
        # Coefficients of the tangent, of which only the first is not zero here, go with the parameters.
        by_parameter = np.diag(tangent.value / np.array(tangent.units))
        uncertain = np.zeros((len(spread) + 1, len(spread) + 1))
        uncertain[1:, 1:] = by_parameter @ covariance @ by_parameter
        count = len(tangent.contributions)
        basis_set = BasisSet(
            tuple(range(count)), tangent.relative, curve=(self.number, tuple(best.parameters[0].tolist())),
            size=tangent.size, sign=1.0,
        )  # fmt: skip
        columns = InformationAndScore(best.information[0], best.score[0])
        exact = evidence_of_families([columns], [basis_set], self.low, self.high)[0]
        coefficients = tangent.value * np.eye(count)[0]
        return replace(exact, size=tangent.value, coefficients=coefficients, covariance=uncertain), penalty


def _is_finite(tangent: Tangent) -> bool:
    """Whether all columns are finite."""
    return bool(np.isfinite(sum(float(np.sum(shape)) for column in tangent.contributions for _, shape in column)))
