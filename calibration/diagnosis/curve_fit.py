"""Iterative fit of columns that are not linear in their parameters, from several starts.

At each point of a curve the evidence of its tangent is computed as for any basis set, the calibration projected out,
and the coefficients give the next point: Gauss-Newton on the evidence, with a step that is shortened if it does not
help.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.evidence import BasisSetEvidence, MarginalLikelihood, evidence_of_families
from calibration.effects.api import BasisSet, Curve, Tangent
from calibration.effects.columns import Contributions

MAX_STARTS = 4  # the best ones, that are followed
MAX_STEPS = 8
MIN_STEP_LENGTH = 0.05
LARGEST_STEP = 0.7  # of parameters without a spread of their own
MIN_GAIN = 0.1  # of log evidence: a step that gains less is the last


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
class _EvaluatedPoint:
    """A point of a curve: its parameters (p,), tangent, evidence, and log evidence with the prior of the parameters."""

    parameters: Array
    tangent: Tangent
    evidence: BasisSetEvidence
    log_posterior: float

    @property
    def size(self) -> float:
        """The most likely size."""
        return float(np.dot(self.tangent.size, self.evidence.coefficients[: len(self.tangent.size)]))


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
        points = self._evaluate([*self.curve.starts])
        points.sort(key=lambda point: -point.log_posterior)
        optima = [self._optimise_from(point) for point in points[:MAX_STARTS]]
        optima = [point for point in optima if point.size > 0.0]
        if not optima:
            return None
        best = max(optima, key=lambda point: point.log_posterior)
        penalty, covariance = self._occam_penalty(best)
        evidence = replace(best.evidence, covariance=covariance)
        return CurveFit(best.log_posterior - penalty, evidence, best.tangent.contributions)

    def _evaluate(self, points: Sequence[Array]) -> list[_EvaluatedPoint]:
        """Points of the curve; without those where the tangent has columns that are not finite."""
        tangents = [(parameters, self.curve.tangent(parameters)) for parameters in points]
        finite = [
            (parameters, tangent)
            for parameters, tangent in tangents
            if all(np.all(np.isfinite(shape)) for column in tangent.contributions for _, shape in column)
        ]
        if not finite:
            return []
        basis_sets = [
            BasisSet(
                tuple(range(len(tangent.contributions))),
                tangent.relative,
                curve=(self.number, tuple(parameters.tolist())),
                size=tangent.size,
            )
            for parameters, tangent in finite
        ]
        families = self.likelihood.of_families([tangent.contributions for _, tangent in finite])
        evidence = evidence_of_families(families, basis_sets, self.low, self.high)
        log_priors = [-0.5 * float(np.sum((parameters / self.curve.spread) ** 2)) for parameters, _ in finite]
        return [
            _EvaluatedPoint(parameters, tangent, entry, entry.log_evidence + log_prior)
            for (parameters, tangent), entry, log_prior in zip(finite, evidence, log_priors, strict=True)
        ]

    def _optimise_from(self, start: _EvaluatedPoint) -> _EvaluatedPoint:
        curve = self.curve
        largest = np.where(np.isfinite(curve.spread), curve.spread, LARGEST_STEP)
        current, step_length = start, 1.0
        for _ in range(MAX_STEPS):
            step = np.clip(step_length * current.tangent.step(current.evidence.coefficients), -largest, largest)
            trial = self._evaluate([np.clip(current.parameters + step, curve.low, curve.high)])
            if trial and trial[0].log_posterior > current.log_posterior + MIN_GAIN:
                current, step_length = trial[0], min(1.0, 2.0 * step_length)
            else:
                step_length /= 3.0
                if step_length < MIN_STEP_LENGTH:
                    break
        return current

    def _occam_penalty(self, point: _EvaluatedPoint) -> tuple[float, Array]:
        """What the whole range of the parameters costs in log evidence, and the covariance (k, k) of the coefficients.

        Laplace's approximation: the tangent's information with the priors of the parameters instead of `relative`.
        """
        curve = self.curve
        information = self.likelihood.information_and_score(point.tangent.contributions).information
        spread = np.where(np.isfinite(curve.spread), curve.spread, (curve.high - curve.low) / np.sqrt(12.0))
        local = np.array(point.tangent.relative)
        prior = np.array([1.0, *np.maximum(spread / point.tangent.units, local[1:])])
        prior[1] = local[1]  # the first parameter goes with the size, which has its own prior

        def posterior(relative: Array) -> tuple[Array, Array]:
            d = point.evidence.size * relative
            return d, np.eye(len(d)) + d[:, None] * information * d

        (_, local_matrix), (d, prior_matrix) = posterior(local), posterior(prior)
        penalty = 0.5 * float(np.linalg.slogdet(prior_matrix)[1] - np.linalg.slogdet(local_matrix)[1])
        return penalty, d[:, None] * np.linalg.inv(prior_matrix) * d
