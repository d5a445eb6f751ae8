"""The search for the causes of one axis' gap, and which of them is the main one.

Evidence says how surely an effect is there, not how much of the gap it is: under coloured noise a small fast wave is
far surer than a slow wind-up of a thousand times its size. So effects are added by their evidence, as long as each is
there beside the others; the main one is that without which the gap would be largest.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import log_ndtr

from calibration.axis.effects import AxisEffect, LawSets, axis_effects
from calibration.axis.likelihood import EXACT, AxisLikelihood, Explanation
from calibration.axis.non_parametric import non_parametric
from calibration.axis.ripple import strongest_periods
from calibration.axis.signals import Signals
from calibration.base.arrays import Array
from calibration.diagnosis.settings import VERDICT

MOST_CAUSES = 6
MOST_OF_ONE = 3  # periods of a ripple
REFINEMENTS = 2
SURE = 3.0  # standard uncertainties
LEAST_TRANSMITTED = 0.25  # a motor has at most three times its load's inertia and friction, both on the load's side
AVERAGED_FOR_LIMIT_S = 0.1  # of a torque, as the fast part of a motor's accelerates the motor
WIDE = 30.0  # prior standard deviation of what a column may do to the gap, over the gap, where nothing is known


@dataclass(frozen=True)
class AxisCause:
    """An effect with its evidence over the model that it was added to; excluded: the torque does not allow it."""

    effect: AxisEffect
    explanation: Explanation
    excluded: bool = False

    @property
    def log_evidence(self) -> float:
        """Logarithm of its evidence."""
        return self.explanation.log_evidence


@dataclass(frozen=True)
class AxisSearch:
    """The result of a search.

    causes: the main one first. before, after: the likelihood without and with them. slot: the likelihood with all but
    the main cause; ranking: all effects in its place, the most likely first. without: RMS of what remains without each
    cause. excluded: kinds of friction that the recorded torque does not allow in the main cause's place.
    log_evidence: of all causes together; excess_log_evidence: how much more an arbitrary function has, in addition to
    them or in the main cause's place; alternatives: log evidence of each such function in addition; in_place: the same
    in the main cause's place.
    """

    causes: tuple[AxisCause, ...]
    before: AxisLikelihood
    after: AxisLikelihood
    slot: AxisLikelihood
    ranking: tuple[AxisCause, ...]
    without: tuple[float, ...]
    log_evidence: float
    excess_log_evidence: float
    alternatives: Mapping[str, float]
    excluded: tuple[str, ...]
    in_place: Mapping[str, float]


def search_axis(signals: Signals) -> AxisSearch:
    """Include effects as long as each adds enough evidence; then find the main one and compare with alternatives."""
    before = AxisLikelihood.of(signals)
    if before.is_rounding(signals):
        return _nothing(before, (), {})
    causes: list[AxisCause] = []
    current, explained = before, 0.0
    ranked = _ranked(before, signals)
    while ranked and len(causes) < MOST_CAUSES and ranked[0].log_evidence > _least(ranked[0], causes):
        causes.append(ranked[0])
        explained += ranked[0].log_evidence
        current = before.including(*(c.explanation.scaled for c in causes))
        ranked = _ranked(current, signals, causes)
    causes = _beside_one_another(before, signals, causes)
    if not causes:
        ranking = tuple(_ranked(before, signals))
        alternatives = _alternatives(before, signals)
        return _nothing(before, ranking, alternatives)
    without = _without_each(before, causes)
    first = int(np.argmax(without))
    others = [cause for i, cause in enumerate(causes) if i != first]
    slot = before.including(*(c.explanation.scaled for c in others))
    ranking = tuple(_ranked(slot, signals, others))
    if ranking and ranking[0].log_evidence > VERDICT.detection_threshold:
        causes = [ranking[0], *others]
    after = before.including(*(c.explanation.scaled for c in causes))
    alternatives = _alternatives(after, signals)
    in_place = _alternatives(slot, signals)
    more_in_place = max(in_place.values()) - ranking[0].log_evidence
    return AxisSearch(
        causes=tuple(causes),
        before=before,
        after=after,
        slot=slot,
        ranking=ranking,
        without=tuple(_without_each(before, causes)),
        log_evidence=explained,
        excess_log_evidence=max(0.0, more_in_place, *alternatives.values()),
        alternatives=alternatives,
        excluded=_excluded(ranking),
        in_place=in_place,
    )


def _nothing(before: AxisLikelihood, ranking: tuple[AxisCause, ...], alternatives: Mapping[str, float]) -> AxisSearch:
    """Without any cause."""
    most = max((cause.log_evidence for cause in ranking), default=0.0)
    return AxisSearch(
        causes=(),
        before=before,
        after=before,
        slot=before,
        ranking=ranking,
        without=(),
        log_evidence=0.0,
        excess_log_evidence=max(0.0, max(alternatives.values(), default=0.0) - most),
        alternatives=alternatives,
        excluded=_excluded(ranking),
        in_place=alternatives,
    )


def _least(cause: AxisCause, causes: Sequence[AxisCause]) -> float:
    """Log evidence that a further cause must add: it is not to be a former one's model error.

    Waves are fast and wind-up is slow, so each is held against its own kind only.
    """
    alike = sum(c.log_evidence for c in causes if c.effect.several == cause.effect.several)
    return max(VERDICT.detection_threshold, VERDICT.min_gain_share_same_part * alike)


def _excluded(ranking: Sequence[AxisCause]) -> tuple[str, ...]:
    return tuple(cause.effect.name for cause in ranking if cause.excluded)


def _ranked(likelihood: AxisLikelihood, signals: Signals, causes: Sequence[AxisCause] = ()) -> list[AxisCause]:
    """Each effect in addition to the causes, the most likely first; those that are there already are left out."""
    names = [cause.effect.name for cause in causes]

    def periods(shortest: float, longest: float) -> Sequence[tuple[float, float]]:
        return strongest_periods(likelihood, signals, shortest, longest)

    out = []
    for effect in axis_effects(signals, periods):
        often = MOST_OF_ONE if effect.several else 1
        if effect.untested is None and names.count(effect.name) < often:
            built = effect.built()
            if built.sets:  # without any peak there is no period to try
                out.append(explain_effect(likelihood, signals, effect, built))
    return sorted(out, key=lambda cause: -cause.log_evidence)


def explain_effect(
    likelihood: AxisLikelihood, signals: Signals, effect: AxisEffect, built: LawSets | None = None
) -> AxisCause:
    """An effect with its evidence over a model; its basis sets, if they are built already."""
    low, high = effect.size.low, effect.size.high
    best = _with_sign(effect, likelihood.explain(effect.built() if built is None else built, low, high))
    for _ in range(REFINEMENTS):
        if effect.refined is None or (best.log_evidence < VERDICT.residual_search_threshold and not effect.consistent):
            break
        refined = effect.refined(float(best.best.coefficients[0]))
        if not refined.sets:
            break
        other = _with_sign(effect, likelihood.explain(refined, low, high))
        both = float(np.logaddexp(best.log_evidence, other.log_evidence)) - math.log(2.0)
        likelier = max(best, other, key=lambda e: e.log_evidence)
        best = other if effect.consistent else replace(likelier, log_evidence=both)
    if not effect.friction or signals.torque is None or best.log_evidence < VERDICT.residual_search_threshold:
        return AxisCause(effect, best)
    beyond = float(best.best.coefficients[0]) - _torque_allows(likelihood, signals, best)
    sure = beyond / max(float(np.sqrt(best.best.covariance[0, 0])), 1e-300)
    log_evidence = best.log_evidence + min(0.0, math.log(2.0) + float(log_ndtr(-sure)))
    return AxisCause(effect, replace(best, log_evidence=log_evidence), excluded=sure > SURE)


def _with_sign(effect: AxisEffect, explanation: Explanation) -> Explanation:
    """With the probability that the size has the sign that physics allows, against half of it before."""
    if not effect.one_sign:
        return explanation
    best = explanation.best
    deviations = float(best.coefficients[0]) / max(float(np.sqrt(best.covariance[0, 0])), 1e-300)
    return replace(explanation, log_evidence=explanation.log_evidence + math.log(2.0) + float(log_ndtr(deviations)))


def _beside_one_another(before: AxisLikelihood, signals: Signals, causes: Sequence[AxisCause]) -> list[AxisCause]:
    """Each cause anew with the others in the model; the weakest goes, as long as one is no longer there beside them."""
    kept = list(causes)
    while len(kept) > 1:
        again = []
        for cause in kept:
            others = before.including(*(c.explanation.scaled for c in kept if c is not cause))
            again.append(explain_effect(others, signals, _same(cause, signals)))
        weakest = min(again, key=lambda cause: cause.log_evidence)
        if weakest.log_evidence >= VERDICT.detection_threshold:
            return again
        kept.pop(next(i for i, cause in enumerate(again) if cause is weakest))
    return kept


def _same(cause: AxisCause, signals: Signals) -> AxisEffect:
    """The effect of a cause; a ripple with the period that was found."""
    parameters = cause.explanation.best.basis_set.parameters
    known = [(parameters["period"], cause.explanation.best.basis_set.weight)] if "period" in parameters else []
    effects = axis_effects(signals, lambda _shortest, _longest: known)
    return next(effect for effect in effects if effect.name == cause.effect.name)


def _without_each(before: AxisLikelihood, causes: Sequence[AxisCause]) -> list[float]:
    """RMS of what remains of the gap without each of the causes, the others fitted again."""
    out = []
    for cause in causes:
        likelihood = before.including(*(c.explanation.scaled for c in causes if c is not cause))
        out.append(float(np.std(likelihood.remaining)))
    return out


def _alternatives(likelihood: AxisLikelihood, signals: Signals) -> dict[str, float]:
    """Log evidence of arbitrary functions in addition to a model."""
    rms = max(float(np.std(signals.gap)), EXACT * signals.travel)
    return {
        name: likelihood.explain(built, 1e-4 * rms, 2.0 * rms).log_evidence
        for name, built in non_parametric(signals).items()
    }


def _torque_allows(likelihood: AxisLikelihood, signals: Signals, explanation: Explanation) -> float:
    """The largest wind-up by friction, as a size, that the recorded torque allows.

    What winds up the drive is transmitted, so it is in the torque, and one compliance holds for all of the torque. So
    friction winds up at most its part of the torque times the largest compliance that the rest of the torque allows.
    A motor's torque also moves the motor: of each part at least LEAST_TRANSMITTED reaches the load.
    """
    rest = [signals.acceleration, signals.position, np.ones(len(signals))]
    if signals.rotary:
        rest += [np.sin(signals.position), np.cos(signals.position)]
    torque = np.asarray(signals.torque)
    slope, slope_u = _slope(explanation.columns[:, 0], np.column_stack(rest), torque)
    averaged = signals.averaged(torque, AVERAGED_FOR_LIMIT_S)
    columns = np.column_stack([averaged, explanation.columns])
    prior = WIDE * max(float(np.std(signals.gap)), 1e-300) / np.maximum(columns.std(axis=0), 1e-300)
    wide = likelihood.including(columns * prior)
    first = likelihood.model.shape[1]
    compliance = float(wide.coefficients[first] * prior[0])
    u = float(np.sqrt(wide.covariance[first, first]) * prior[0])
    reaches = LEAST_TRANSMITTED if signals.torque_of_motor else 1.0
    return (abs(compliance) + SURE * u) / reaches * (abs(slope) + SURE * slope_u)


def _slope(column: Array, rest: Array, torque: Array) -> tuple[float, float]:
    """Least squares of a torque (n,) on a column (n,) beside others (n, k): coefficient and its standard uncertainty.

    What is left is coloured: as many of its values count as it changes sign.
    """
    columns = np.column_stack([column, rest])
    scale = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    inverse = np.linalg.pinv((columns / scale).T @ (columns / scale))
    coefficients = inverse @ ((columns / scale).T @ torque)
    left = torque - (columns / scale) @ coefficients
    changes = max(int(np.sum(np.diff(np.sign(left)) != 0.0)), 1)
    variance = float(np.mean(left**2)) * len(torque) / changes
    return float(coefficients[0] / scale[0]), float(np.sqrt(variance * inverse[0, 0]) / scale[0])
