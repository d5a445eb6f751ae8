"""Marginal likelihood of the gap of one axis: coefficients and noise together.

For given noise it is that of `calibration.diagnosis.evidence`, with a covariance that is diagonal in the cosines. The
noise is fitted anew for every hypothesis (expectation maximisation over the coefficients): with the noise of no effect
an effect would be noise, with that of another one everything would be an effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.axis.effects import Law, LawSets
from calibration.axis.noise import NoiseShape, cosines, from_cosines
from calibration.axis.signals import Signals
from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import (
    BasisSetEvidence,
    InformationAndScore,
    evidence_of_basis_sets,
    log_sum,
)
from calibration.effects.api import BasisSet

ROUNDS = 12
SETTLED = 0.02  # change of log evidence
MOST_FITTED = 3  # basis sets whose noise is fitted: those with the most evidence, and those closest to the gap
RIDGE = 1e-9
EXACT = 1e-10  # of the travel, and at most in rad or m: noise below that no encoder has
ROUNDED = 1.25  # times its expected RMS, up to which a gap is rounding: that of a mere offset, rounded, is 1.22


@dataclass(frozen=True)
class Explanation:
    """A hypothesis: log evidence over the model that it was added to, best basis set, its laws and columns (n, k)."""

    log_evidence: float
    best: BasisSetEvidence
    laws: tuple[tuple[Law, int], ...]
    columns: Array

    @property
    def prior_deviations(self) -> Array:
        """Prior standard deviations (k,) of its coefficients."""
        return self.best.size * np.array(self.best.basis_set.relative)

    @property
    def scaled(self) -> Array:
        """Columns (n, k) times their prior standard deviations."""
        return self.columns * self.prior_deviations


@dataclass(frozen=True)
class AxisLikelihood:
    """The gap's cosines (c,), columns (c, j) of the model times their prior deviations, and the noise (knots)."""

    gap: Array
    model: Array
    shape: NoiseShape
    knots: Array

    @classmethod
    def of(cls, signals: Signals) -> AxisLikelihood:
        """Without any effect: offset and scale of the second position, and noise."""
        gap = cosines(signals.gap)
        scale = cosines((signals.position - signals.position.mean())[:, None]) * signals.scale_u
        shape = NoiseShape.of(len(gap), least_noise(signals) ** 2)
        start = cls(gap, scale, shape, shape.fit(gap**2))
        return start.settled()

    def is_rounding(self, signals: Signals) -> bool:
        """Whether all that the model leaves may be rounding of the positions, and what smoothing does to a scale."""
        slope = signals.slope + float(self.coefficients[0]) * signals.scale_u
        level = max(least_noise(signals), abs(slope) * signals.smoothed_off)
        return float(np.sqrt(np.mean(self.remaining**2))) <= ROUNDED * level

    def settled(self) -> AxisLikelihood:
        """The same with the noise that fits it best."""
        current = self
        for _ in range(ROUNDS):
            renewed = replace(current, knots=self.shape.fit(current.expected_squares(), current.knots))
            gain = renewed.log_marginal - current.log_marginal
            current = renewed
            if abs(gain) < SETTLED:
                break
        return current

    def including(self, *columns: Array) -> AxisLikelihood:
        """With further columns (n, k), each times its prior standard deviation, and the noise fitted to it."""
        if not columns:
            return self
        return replace(self, model=np.concatenate([self.model, *map(cosines, columns)], axis=1)).settled()

    @cached_property
    def power(self) -> Array:
        """Power (c,) of the noise."""
        return self.shape.power(self.knots)

    @cached_property
    def root(self) -> Array:
        """Root (j, j) of the covariance of the model's coefficients over their prior deviations: root @ root.T is it.

        Of a gap without noise the information may be too large for its prior, a one, to count beside it.
        """
        information = np.eye(self.model.shape[1]) + self.model.T @ (self.model / self.power[:, None])
        scale = 1.0 / np.sqrt(np.diag(information))
        scaled = information * np.outer(scale, scale)
        try:
            factor = np.linalg.cholesky(scaled)
        except np.linalg.LinAlgError:
            factor = np.linalg.cholesky(scaled + RIDGE * np.eye(len(scaled)))
        return np.asarray(scale[:, None] * np.linalg.inv(factor).T)

    @cached_property
    def covariance(self) -> Array:
        """Covariance (j, j) of the model's coefficients over their prior deviations."""
        return np.asarray(self.root @ self.root.T)

    @cached_property
    def coefficients(self) -> Array:
        """The model's coefficients (j,) over their prior deviations."""
        return np.asarray(self.covariance @ (self.model.T @ (self.gap / self.power)))

    @cached_property
    def residual(self) -> Array:
        """Cosines (c,) of what the model leaves."""
        return self.gap - self.model @ self.coefficients

    @cached_property
    def remaining(self) -> Array:
        """What the model leaves of the gap (n,), less its mean."""
        return from_cosines(self.residual)

    @cached_property
    def log_marginal(self) -> float:
        """Logarithm of the marginal likelihood, with the prior of the noise."""
        weighted = self.residual / self.power
        log_determinant = -float(np.linalg.slogdet(self.covariance)[1])
        squares = float(self.gap @ weighted)
        noise = float(np.sum(self.shape.weights @ self.knots))
        return -0.5 * (squares + log_determinant + noise) + self.shape.log_prior(self.knots)

    def expected_squares(self) -> Array:
        """Expected squares (c,) of the noise, coefficients being as uncertain as they are."""
        return np.asarray(self.residual**2 + np.sum((self.model @ self.root) ** 2, axis=1))

    def information_and_score(self, columns: Array) -> InformationAndScore:
        """Information and score of cosines of columns (c, k), the model's own coefficients projected out."""
        weighted = columns / self.power[:, None]
        along = self.model.T @ weighted
        information = columns.T @ weighted - along.T @ self.covariance @ along
        return InformationAndScore(information, weighted.T @ self.residual)

    def weighted_residual(self) -> Array:
        """Inverse covariance times the gap (n,)."""
        return from_cosines(self.residual / self.power)

    def explain(self, built: LawSets, low: float, high: float) -> Explanation:
        """The evidence of an effect, each of its likeliest basis sets with noise of its own.

        The noise is sought from two sides, as either may end in a lesser maximum: from that of the model, in which an
        effect may be noise, and from what least squares leave, in which no noise is an effect.
        """
        columns = np.column_stack([contribution[0][1] for contribution in built.contributions])
        of_columns = cosines(columns)
        at_start = self._evidence(of_columns, built.sets, low, high)
        left = self._least_squares(of_columns, built)
        likeliest = np.argsort([-entry.log_evidence for entry in at_start])[:MOST_FITTED].tolist()
        closest = np.argsort([float(np.sum(residual**2)) for residual in left])[:MOST_FITTED].tolist()
        starts = [(number, self.knots) for number in likeliest]
        starts += [(number, self.shape.fit(left[number] ** 2)) for number in closest]
        fitted: dict[int, tuple[float, BasisSetEvidence]] = {}
        for number, knots in starts:
            found = self._with_own_noise(of_columns, built, number, low, high, knots)
            if number not in fitted or found[0] > fitted[number][0]:
                fitted[number] = found
        logs = {number: found[0] + float(np.log(_weights(built)[number])) for number, found in fitted.items()}
        best = fitted[max(logs, key=lambda number: logs[number])][1]
        chosen = list(best.basis_set.columns)
        total = float(log_sum(np.array(list(logs.values()))))
        return Explanation(total, best, tuple(built.laws[c] for c in chosen), columns[:, chosen])

    def _with_own_noise(
        self, columns: Array, built: LawSets, number: int, low: float, high: float, knots: Array
    ) -> tuple[float, BasisSetEvidence]:
        """Log evidence of one basis set with its most likely noise over the model with its own, and the set."""
        current, reached, best = replace(self, knots=knots), -np.inf, None
        for _ in range(ROUNDS):
            (at,) = current._evidence(columns, [built.sets[number]], low, high)
            log_evidence = current.log_marginal + at.log_evidence - self.log_marginal
            if log_evidence < reached + SETTLED:
                break
            reached, best = log_evidence, at
            chosen = columns[:, list(at.basis_set.columns)]
            prior = at.size * np.array(at.basis_set.relative)
            wide = replace(current, model=np.concatenate([self.model, chosen * prior], axis=1))
            current = replace(self, knots=self.shape.fit(wide.expected_squares(), current.knots))
        if best is None:
            raise AssertionError("at least one round")
        return reached, best

    def _least_squares(self, columns: Array, built: LawSets) -> list[Array]:
        """What least squares of the model and each basis set leave of the gap (c,)."""
        basis = np.concatenate([self.model, columns], axis=1)
        basis = basis / np.maximum(np.sqrt(np.sum(basis**2, axis=0)), 1e-300)
        gram, along = basis.T @ basis, basis.T @ self.gap
        own, out = list(range(self.model.shape[1])), []
        for basis_set in built.sets:
            chosen = own + [self.model.shape[1] + c for c in basis_set.columns]
            regular = gram[np.ix_(chosen, chosen)] + RIDGE * np.eye(len(chosen))
            out.append(self.gap - basis[:, chosen] @ np.linalg.solve(regular, along[chosen]))
        return out

    def _evidence(
        self, columns: Array, sets: Sequence[BasisSet], low: float, high: float
    ) -> Sequence[BasisSetEvidence]:
        return evidence_of_basis_sets(self.information_and_score(columns), sets, low, high)


def least_noise(signals: Signals) -> float:
    """Standard deviation of noise that every gap has: a gap of zero would have none."""
    return max(EXACT * min(signals.travel, 1.0), signals.rounding)


def _weights(built: LawSets) -> Array:
    """Prior weights of basis sets; those that add up to less than one leave the remainder to sets not listed."""
    weights = np.array([basis_set.weight for basis_set in built.sets])
    return np.asarray(weights / max(1.0, float(weights.sum())))
