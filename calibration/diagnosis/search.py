"""The search for causes: evidence of every effect at every place, and of non-parametric alternatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.curve_fit import fit_curves
from calibration.diagnosis.evidence import BasisSetEvidence, MarginalLikelihood, evidence_of_basis_sets, log_sum
from calibration.diagnosis.non_parametric import NonParametricEffect, rank_non_parametric
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import Contributions, Effect, EffectInputs
from calibration.effects.catalogue import Catalogue
from calibration.effects.context import TimelessContext, TimeUnknown

TIME_UNKNOWN = "an unknown time passed between two sessions of the recording"


@dataclass(frozen=True)
class Cause:
    """An effect with its evidence over all places and basis sets, and with the best of them.

    log_evidence: over `none`. places: probability of each, given the effect; place: the most likely one. best: its best
    basis set; contributions: columns of that, in the order of its coefficients.
    """

    effect: Effect
    log_evidence: float
    places: dict[str, float]
    place: str
    best: BasisSetEvidence
    contributions: tuple[Contributions, ...]

    @property
    def prior_deviations(self) -> Array:
        """Prior standard deviations (k,) of the best basis set's coefficients."""
        return self.best.size * np.array(self.best.basis_set.relative)


def rank_effects(likelihood: MarginalLikelihood, inputs: EffectInputs, effects: Sequence[Effect]) -> list[Cause]:
    """All effects, the most likely first; those without a basis set at any place are left out."""
    by_effect = [(effect, places) for effect in effects if (places := _evidence_by_place(likelihood, inputs, effect))]
    strongest = max((_total_log_evidence(places) for _, places in by_effect), default=0.0)
    threshold = max(VERDICT.detection_threshold, VERDICT.curve_fit_share * strongest)
    causes = []
    for effect, places in by_effect:
        refine = _total_log_evidence(places) > threshold
        causes.append(_cause(effect, _refine_with_curves(likelihood, inputs, effect, places) if refine else places))
    return sorted(causes, key=lambda cause: -cause.log_evidence)


@dataclass(frozen=True)
class _PlaceEvidence:
    """An effect at one of its places: log evidence with the place's prior, the best basis set, its columns."""

    place: str
    log_evidence: float
    best: BasisSetEvidence
    contributions: tuple[Contributions, ...]


def _evidence_by_place(likelihood: MarginalLikelihood, inputs: EffectInputs, effect: Effect) -> list[_PlaceEvidence]:
    names = effect.places(inputs.machine)
    low = _smallest_size(likelihood, effect)
    out = []
    for index, name in enumerate(names):
        built = effect.forms(inputs, index)
        if not built.sets:
            continue
        columns = likelihood.information_and_score(built.contributions)
        evidence = evidence_of_basis_sets(columns, built.sets, low, effect.size.high)
        weights = np.array([entry.basis_set.weight for entry in evidence])
        # Weights that add up to less than one leave the remainder to basis sets that were not listed.
        weights /= max(1.0, float(weights.sum()))
        logs = np.array([entry.log_evidence for entry in evidence]) + np.log(weights)
        best = evidence[int(np.argmax(logs))]
        contributions = tuple(built.contributions[c] for c in best.basis_set.columns)
        out.append(_PlaceEvidence(name, float(log_sum(logs)) - float(np.log(len(names))), best, contributions))
    return out


def _refine_with_curves(
    likelihood: MarginalLikelihood, inputs: EffectInputs, effect: Effect, places: list[_PlaceEvidence]
) -> list[_PlaceEvidence]:
    """The same with the effect's curves, at the places where its basis sets have evidence."""
    names, low = effect.places(inputs.machine), _smallest_size(likelihood, effect)
    strongest = max(place.log_evidence for place in places)

    def refine(place: _PlaceEvidence) -> _PlaceEvidence:
        curves = effect.curves(inputs, names.index(place.place))
        fit = fit_curves(likelihood, curves, low, effect.size.high)
        if fit is None:
            return place
        log_evidence = fit.log_evidence - float(np.log(len(names) * len(curves)))
        both = float(np.logaddexp(log_evidence, place.log_evidence)) - float(np.log(2.0))
        if log_evidence > place.log_evidence:
            return _PlaceEvidence(place.place, both, fit.best, fit.contributions)
        return replace(place, log_evidence=both)

    threshold = VERDICT.curve_fit_share_at_place * strongest
    return [refine(place) if place.log_evidence > threshold else place for place in places]


def _cause(effect: Effect, places: list[_PlaceEvidence]) -> Cause:
    total, best = _total_log_evidence(places), max(places, key=lambda place: place.log_evidence)
    probabilities = {place.place: float(np.exp(place.log_evidence - total)) for place in places}
    return Cause(effect, total, probabilities, best.place, best.best, best.contributions)


def _total_log_evidence(places: list[_PlaceEvidence]) -> float:
    return float(log_sum(np.array([place.log_evidence for place in places])))


def _smallest_size(likelihood: MarginalLikelihood, effect: Effect) -> float:
    return effect.smallest_size(likelihood.linear.recording.file.nuisance)


def include_cause(likelihood: MarginalLikelihood, cause: Cause | NonParametricEffect) -> MarginalLikelihood:
    """The marginal likelihood with a cause, in its best basis set, or a non-parametric effect added to the model."""
    if isinstance(cause, NonParametricEffect):
        return likelihood.including(cause.columns(likelihood))
    return likelihood.including(likelihood.columns(cause.contributions) * cause.prior_deviations)


def detectable_effects(inputs: EffectInputs, catalogue: Catalogue) -> tuple[list[Effect], dict[str, str]]:
    """The effects that the campaign can show; for the others, by name, the reason why not."""
    timeless = _without_time(inputs) if inputs.context.breaks_s else None
    reasons = {
        effect.name: TIME_UNKNOWN if timeless and _asks_for_time(effect, timeless) else effect.untested(inputs)
        for effect in catalogue.effects
    }
    detectable = [effect for effect in catalogue.effects if reasons[effect.name] is None]
    return detectable, {name: reason for name, reason in reasons.items() if reason is not None}


@dataclass(frozen=True)
class SearchResult:
    """The result of a search for causes.

    ranking: all effects, each alone, the most likely first. causes: effects of the catalogue that together explain
    most; likelihoods: without any of them and after each. log_evidence: of the causes together over `none`, less the
    penalty for more than one; excess_log_evidence: how much more the best non-parametric alternative has, alone or in
    addition to them. non_parametric: alternatives in addition to the causes; non_parametric_alone: alternatives without
    any cause (empty if not needed).
    """

    ranking: tuple[Cause, ...]
    causes: tuple[Cause, ...]
    likelihoods: tuple[MarginalLikelihood, ...]
    log_evidence: float
    excess_log_evidence: float
    non_parametric: tuple[NonParametricEffect, ...]
    non_parametric_alone: tuple[NonParametricEffect, ...]


def search_causes(likelihood: MarginalLikelihood, inputs: EffectInputs, effects: Sequence[Effect]) -> SearchResult:
    """Include effects as long as each adds enough evidence; then compare with non-parametric alternatives."""
    ranking = rank_effects(likelihood, inputs, effects)
    likelihoods, log_evidence, best_log_evidence = [likelihood], 0.0, 0.0
    causes: list[Cause] = []
    non_parametric: list[NonParametricEffect] = []
    ranked = ranking
    while ranked and len(causes) < VERDICT.max_causes:
        gain = ranked[0].log_evidence
        same_part = any(_same_part_of_machine(inputs, ranked[0], cause) for cause in causes)
        share = VERDICT.min_gain_share_same_part if same_part else VERDICT.min_gain_share
        if gain < max(VERDICT.detection_threshold, share * log_evidence):
            break
        if causes:
            share_of_explained = VERDICT.further_cause_penalty_share * (log_evidence + gain)
            log_evidence -= VERDICT.further_cause_penalty + share_of_explained
        causes.append(ranked[0])
        log_evidence += gain
        likelihoods.append(include_cause(likelihoods[-1], ranked[0]))
        non_parametric = rank_non_parametric(likelihoods[-1], inputs)
        best_log_evidence = max(best_log_evidence, log_evidence + non_parametric[0].log_evidence)
        if non_parametric[0].log_evidence < VERDICT.residual_search_threshold:
            break
        ranked = rank_effects(likelihoods[-1], inputs, effects)
    non_parametric_alone: list[NonParametricEffect] = []
    if best_log_evidence - log_evidence > VERDICT.residual_search_threshold or not causes:
        non_parametric_alone = rank_non_parametric(likelihood, inputs)
        best_log_evidence = max(best_log_evidence, non_parametric_alone[0].log_evidence)
        non_parametric = non_parametric or non_parametric_alone
    if len(causes) > 1:
        causes, likelihoods = _refit_causes(likelihood, inputs, causes)
    return SearchResult(
        ranking=tuple(ranking),
        causes=tuple(causes),
        likelihoods=tuple(likelihoods),
        log_evidence=log_evidence,
        excess_log_evidence=max(best_log_evidence - log_evidence, 0.0),
        non_parametric=tuple(non_parametric),
        non_parametric_alone=tuple(non_parametric_alone),
    )


def _same_part_of_machine(inputs: EffectInputs, one: Cause, other: Cause) -> bool:
    """Whether two causes act at the same drive or its struts, or are the same effect."""
    machine = inputs.machine

    def drives(cause: Cause) -> set[int]:
        if cause.effect.place == "drive":
            return {machine.drive_names.index(cause.place)}
        if cause.effect.place == "strut":
            return {int(machine.strut_drive[machine.strut_names.index(cause.place)])}
        return set()

    return one.effect.name == other.effect.name or bool(drives(one) & drives(other))


def _refit_causes(
    likelihood: MarginalLikelihood, inputs: EffectInputs, causes: list[Cause]
) -> tuple[list[Cause], list[MarginalLikelihood]]:
    """Each cause in its best basis set, given the others in the model; the strongest first."""
    refitted: list[Cause] = []
    for number in range(len(causes)):
        likelihood_of_others = likelihood
        for other in (*refitted, *causes[number + 1 :]):
            likelihood_of_others = include_cause(likelihood_of_others, other)
        refitted.append(rank_effects(likelihood_of_others, inputs, [causes[number].effect])[0])
    refitted.sort(key=lambda cause: -cause.log_evidence)
    likelihoods = [likelihood]
    for cause in refitted:
        likelihoods.append(include_cause(likelihoods[-1], cause))
    return refitted, likelihoods


def _without_time(inputs: EffectInputs) -> EffectInputs:
    def onsets(_channels: Sequence[str]) -> Sequence[tuple[float, float]]:
        raise TimeUnknown

    return replace(inputs, context=TimelessContext.of(inputs.context), onsets=onsets)


def _asks_for_time(effect: Effect, timeless: EffectInputs) -> bool:
    """Whether an effect is a function of the time that passes between readings, its curves included."""
    try:
        for place in range(len(effect.places(timeless.machine))):
            effect.forms(timeless, place)
            for curve in effect.curves(timeless, place):
                curve.tangent(curve.starts[0])
    except TimeUnknown:
        return True
    return False
