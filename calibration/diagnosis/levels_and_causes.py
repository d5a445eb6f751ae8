"""The search for causes where the levels of the ordinary disturbances are not known either.

What a rig declares of its disturbances is a prior, and so are the tolerances of its geometry. A drift three times as
strong as declared looks like an effect, so do joints that lie three times as far off as the machine file says, and an
effect looks like strong disturbances; so causes are searched for at the declared levels, at those that are most likely
without any cause and at those that are most likely with the causes found, and the explanation is taken that is most
likely with its levels. What acts like a disturbance and is not larger than one may well be is not named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.few_visits import or_at_few_visits
from calibration.diagnosis.level_posterior import COLUMNS, QUANTILE, TOLERANCES, LevelPosterior, scaled_levels
from calibration.diagnosis.non_parametric import largest_evidence_by_visit
from calibration.diagnosis.ranking import Cause, as_found, columns_of_cause
from calibration.diagnosis.search import SearchResult, search_causes, something_is_left
from calibration.diagnosis.search_budget import SearchBudget
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import MIN_RATIO_TO_DECLARED, Effect, EffectInputs
from calibration.recording.header import DisturbanceLevels

WORTH_SEARCHING = 2.0  # log posterior that other levels have over those that were tried
SHARE_OF_CAUSES, SHORT_OF_CAUSES = 0.8, 10.0  # of the log posterior of causes: less for levels alone is too little
SHARE_OF_EXCESS = 0.5  # of what non-parametric alternatives have more, that levels must have with the causes
NO_LEVELS = DisturbanceLevels()
ANY_LEVEL = DisturbanceLevels(drift_m=1.0, reseat_m=1.0, reversal_m=1.0, temperature_k=1.0)
TOLD_BY_FORM = 20.0  # log posterior over what levels explain, at which an effect is told from them whatever its size
ALIKE = 0.2  # of logarithms of levels: nearer ones say the same


@dataclass(frozen=True)
class SearchAtLevels:
    """The causes found at some levels of the disturbances.

    levels (k + 1,): their logarithms over the declared ones, as LevelPosterior has them. log_evidence: of `none` at
    these levels over that at the declared ones, both with the prior of the levels.
    """

    likelihood: MarginalLikelihood
    result: SearchResult
    levels: Array
    log_evidence: float

    @property
    def log_posterior(self) -> float:
        """Of its explanation, over `none` at the declared levels, less the prior odds of a cause and of `unknown`."""
        result = self.result
        named = result.log_evidence
        left_over = result.excess_log_evidence - float(VERDICT.threshold_of_excess(result.log_evidence))
        unknown = result.log_evidence + left_over
        return self.log_evidence + max(0.0, max(named, unknown) - VERDICT.none_prior_log_odds)


@dataclass(frozen=True)
class ToldByForm:
    """Effects that are no larger than a disturbance may be and were kept, as their form tells them from it.

    log_posterior: what the explanation with them has over the one without.
    """

    names: tuple[str, ...]
    log_posterior: float


@dataclass(frozen=True)
class LevelsAndCauses:
    """The most likely explanation, and the log evidence that `none` has at other levels over that at these.

    log_posterior, log_evidence: of the explanation and of `none`, as those of the search at its levels.
    told_by_form: None where no effect was kept for its form alone. left_out: what no search began with, to save time.
    times_tolerances, times_scatter: how far off the geometry is most likely, over what the machine file states, and how
    much the readings scatter, over what is stated of them. positioning_sd_m: how far drives stand off anew at each
    visit.
    """

    likelihood: MarginalLikelihood
    result: SearchResult
    none_elsewhere: float
    told_by_form: ToldByForm | None = None
    left_out: tuple[str, ...] = ()
    times_tolerances: float = 1.0
    times_scatter: float = 1.0
    positioning_sd_m: float = 0.0
    log_posterior: float = 0.0
    log_evidence: float = 0.0


class SearchOfLevelsAndCauses:
    """The search on one recording; inputs, ranking (if known): of the effects, at the declared levels."""

    def __init__(
        self,
        likelihood: MarginalLikelihood,
        inputs: EffectInputs,
        effects: Sequence[Effect],
        budget: SearchBudget | None = None,
        ranking: Sequence[Cause] | None = None,
    ) -> None:
        self._likelihood, self._inputs, self._effects = likelihood, inputs, tuple(effects)
        self._budget, self._ranking = budget or SearchBudget(), ranking
        self._without_causes = LevelPosterior(likelihood.linear)

    def most_likely(self) -> LevelsAndCauses:
        """The explanation that is most likely with its levels."""
        scattering = self._without_causes.most_likely_scatter()
        scattered = self._search_in_noise(scattering)
        if scattered is not None and not (scattered.result.causes or something_is_left(scattered.result)):
            return self._found(scattered, [scattered], None)
        declared = self._search(np.zeros(len(self._without_causes.prior)), self._effects)
        tried = [declared]
        alone = self._without_causes.most_likely_as_stated()
        if scattering[-1] > 0.0 and self._without_causes.gain(scattering) > declared.log_posterior:
            tried.append(scattered or self._search(scattering, self._effects))
        least = SHARE_OF_CAUSES * declared.log_posterior - SHORT_OF_CAUSES
        beyond = self._beyond_disturbances(declared.result.causes)
        if not beyond and self._without_causes.gain(alone) > max(WORTH_SEARCHING, least):
            tried.append(self._search(alone, self._effects))
        may_change = _may_change(declared.result)
        if may_change or (declared.result.causes and scattering[-1] > 0.0):
            posterior = self._posterior_with(declared.result.causes)
            x = posterior.most_likely_ordinary() if may_change else posterior.most_likely_scatter()
            least = max(WORTH_SEARCHING, SHARE_OF_EXCESS * declared.result.excess_log_evidence)
            if posterior.gain(x) > least and all(np.max(np.abs(x - search.levels)) > ALIKE for search in tried):
                tried.append(self._search(x, self._effects))
        told_by_form = None
        best, effects = max(tried, key=lambda search: search.log_posterior), self._effects
        remaining_alone: list[Cause] = []
        while ordinary := self._no_more_than_disturbances(best.result.causes):
            effects = tuple(effect for effect in effects if effect not in ordinary)
            remaining = [cause for cause in best.result.causes if cause.effect not in ordinary]
            other = self._search(self._posterior_with(remaining).most_likely_ordinary(), effects)
            if (gain := best.log_posterior - other.log_posterior) > TOLD_BY_FORM:
                told_by_form = ToldByForm(tuple(effect.name for effect in ordinary), gain)
                break
            tried.append(other)
            # Over `none` at the levels of the search that is left; likelier than what this has found it is not.
            remaining_alone += self._beyond_alone(best.result.ranking, ordinary)
            most = max((cause.log_evidence for cause in other.result.ranking), default=0.0)
            shift = best.log_evidence - other.log_evidence
            remaining_alone = [replace(c, log_evidence=min(c.log_evidence + shift, most)) for c in remaining_alone]
            best = other
        best = replace(best, result=best.result.with_ranked(remaining_alone))
        return self._found(best, tried, told_by_form)

    def _found(
        self, best: SearchAtLevels, tried: Sequence[SearchAtLevels], told_by_form: ToldByForm | None
    ) -> LevelsAndCauses:
        most_of_none = max(search.log_evidence for search in tried)
        none_elsewhere, left_out = most_of_none - best.log_evidence, tuple(self._budget.left_out)
        times = self._without_causes.levels(best.levels)[TOLERANCES], float(np.exp(best.levels[-1]))
        found = LevelsAndCauses(best.likelihood, best.result, none_elsewhere, told_by_form, left_out, *times)
        return replace(found, log_posterior=best.log_posterior, log_evidence=best.log_evidence)

    def _search_in_noise(self, scattering: Array) -> SearchAtLevels | None:
        """The search with readings that scatter more than stated, where no visit is off; else None.

        Where it finds nothing there is nothing but noise: what an effect moves would be seen in noise of any size that
        can stand for it.
        """
        if scattering[-1] == 0.0:
            return None
        likelihood = self._likelihood_at(scattering)
        if largest_evidence_by_visit(likelihood, self._inputs) > WORTH_SEARCHING:
            return None
        return self._search(scattering, self._effects, likelihood)

    def _search(
        self, levels: Array, effects: Sequence[Effect], likelihood: MarginalLikelihood | None = None
    ) -> SearchAtLevels:
        likelihood = likelihood or self._likelihood_at(levels)
        known = likelihood is self._likelihood and tuple(effects) == self._effects
        result = search_causes(likelihood, self._inputs, effects, self._budget, self._ranking if known else None)
        result = or_at_few_visits(result, likelihood)
        return SearchAtLevels(likelihood, result, levels, self._without_causes.gain(levels))

    def _likelihood_at(self, levels: Array) -> MarginalLikelihood:
        likelihood = self._likelihood
        if np.any(levels):
            posterior = self._without_causes
            rig = scaled_levels(likelihood.linear.levels, posterior.levels(levels))
            linear = likelihood.linear.with_levels(rig, posterior.scales(levels))
            times = float(np.exp(levels[-1]))
            likelihood = likelihood.on(linear) if times == 1.0 else MarginalLikelihood.of(linear.scattering(times))
        return likelihood

    def _posterior_with(self, causes: Sequence[Cause]) -> LevelPosterior:
        """The posterior of the levels with causes in the model."""
        if not causes:
            return self._without_causes
        columns = [columns_of_cause(self._likelihood, cause) for cause in as_found(causes)]
        return LevelPosterior(self._likelihood.linear, included=np.concatenate(columns, axis=2))

    def _beyond_disturbances(self, causes: Sequence[Cause]) -> bool:
        """Whether an effect that acts like a disturbance is larger than twice what this may well be a priori."""
        likely = QUANTILE * self._without_causes.prior
        return any(self._ratio(effect, causes, likely) > MIN_RATIO_TO_DECLARED for effect in _like_disturbances(causes))

    def _no_more_than_disturbances(self, causes: Sequence[Cause]) -> list[Effect]:
        """Effects that act like a disturbance and are no larger than twice what this may well be beside them."""
        if not (alike := _like_disturbances(causes)):
            return []
        posterior = self._posterior_with(causes)
        x = posterior.most_likely_ordinary()
        likely = np.minimum(x + QUANTILE * posterior.standard_deviations(x), QUANTILE * posterior.prior)
        return [effect for effect in alike if self._ratio(effect, causes, likely) < MIN_RATIO_TO_DECLARED]

    def _beyond_alone(self, ranking: Sequence[Cause], effects: Sequence[Effect]) -> list[Cause]:
        """Those of some effects that alone would do more than disturbances, though beside others they need not: they
        remain in the ranking."""
        alone = [cause for cause in ranking if cause.effect in effects]
        return [cause for cause in alone if not self._no_more_than_disturbances(cause.parts)]

    def _ratio(self, effect: Effect, causes: Sequence[Cause], levels: Array) -> float:
        """RMS over the readings of what an effect does at all its places, over that of its disturbances at levels.

        Both as the calibration leaves them: of what it absorbs the readings say nothing.
        """
        likelihood = self._likelihood
        parts = [cause for cause in causes if cause.effect is effect]
        does = np.sum([likelihood.columns(part.contributions) @ part.best.coefficients for part in parts], axis=0)
        linear, scales = likelihood.linear, self._without_causes.scales(levels)
        like = [prefix for key, prefix in COLUMNS.items() if effect.declared(NO_LEVELS.model_copy(update={key: 1.0}))]
        of_disturbance = [i for i, name in enumerate(linear.names) if name.startswith(tuple(like))]
        disturbance = linear.after_calibration(linear.columns[:, :, of_disturbance] * scales[of_disturbance])
        expected = float(np.sum(disturbance**2))
        return float(np.sqrt(np.sum(linear.after_calibration(does) ** 2) / expected)) if expected > 0.0 else np.inf


def _like_disturbances(causes: Sequence[Cause]) -> list[Effect]:
    """Effects that act like a disturbance."""
    return list({cause.effect.name: cause.effect for cause in causes if cause.effect.declared(ANY_LEVEL)}.values())


def _may_change(result: SearchResult) -> bool:
    """Whether other levels could leave out a cause or explain what is left: not where one cause explains all."""
    return bool(result.causes) and (result.has_several_effects or something_is_left(result))
