"""The search for causes where the levels of the ordinary disturbances are not known either.

What a rig declares of its disturbances is a prior. A drift three times as strong as declared looks like an effect, and
an effect looks like strong disturbances; so causes are searched for at the declared levels, at those that are most
likely without any cause and at those that are most likely with the causes found, and the explanation is taken that is
most likely with its levels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.level_posterior import LevelPosterior
from calibration.diagnosis.linear_model import LinearModel
from calibration.diagnosis.periodogram import Periodogram
from calibration.diagnosis.search import SearchResult, detectable_effects, excess_threshold, search_causes
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import EffectInputs
from calibration.effects.catalogue import Catalogue

WORTH_SEARCHING = 2.0  # log posterior that other levels have over those that were tried
ALIKE = 0.2  # of logarithms of levels: nearer ones say the same


@dataclass(frozen=True)
class SearchAtLevels:
    """The causes found at some levels of the disturbances.

    log_evidence: of `none` at these levels over that at the declared ones, both with the prior of the levels.
    """

    likelihood: MarginalLikelihood
    inputs: EffectInputs
    by_drive: tuple[Periodogram, ...]
    not_tested: dict[str, str]
    result: SearchResult
    log_evidence: float

    @property
    def log_posterior(self) -> float:
        """Of its explanation, over `none` at the declared levels, less the prior odds of a cause and of `unknown`."""
        result = self.result
        named = result.log_evidence
        unknown = result.log_evidence + result.excess_log_evidence - excess_threshold(result.log_evidence)
        return self.log_evidence + max(0.0, max(named, unknown) - VERDICT.none_prior_log_odds)


def search_levels_and_causes(linear: LinearModel, catalogue: Catalogue) -> tuple[SearchAtLevels, float]:
    """The most likely explanation, and how much more likely `none` is at other levels than at those of it."""
    declared = _search_at(linear, catalogue, 0.0)
    tried = [(np.zeros(0), declared)]
    without_causes = LevelPosterior(linear)
    for posterior in (without_causes, _with_causes(declared)):
        if posterior is None:
            continue
        x = posterior.most_likely(scatter=False)
        gain = posterior.log_density(x) - posterior.log_density(np.zeros_like(x))
        if gain < WORTH_SEARCHING or any(known.size and np.max(np.abs(known - x)) < ALIKE for known, _ in tried):
            continue
        of_none = without_causes.log_density(x) - without_causes.log_density(np.zeros_like(x))
        scales = without_causes.scales(x)
        tried.append((x, _search_at(linear.with_levels(posterior.levels(x), scales), catalogue, of_none)))
    best = max((search for _, search in tried), key=lambda search: search.log_posterior)
    return best, max(search.log_evidence for _, search in tried) - best.log_evidence


def _search_at(linear: LinearModel, catalogue: Catalogue, log_evidence: float) -> SearchAtLevels:
    likelihood = MarginalLikelihood.of(linear)
    by_drive = periodograms(likelihood)
    inputs = inputs_of_recording(likelihood, by_drive)
    effects, not_tested = detectable_effects(inputs, catalogue)
    result = search_causes(likelihood, inputs, effects)
    return SearchAtLevels(likelihood, inputs, by_drive, not_tested, result, log_evidence)


def _with_causes(search: SearchAtLevels) -> LevelPosterior | None:
    """The posterior of the levels with the causes in the model; None if there are none."""
    causes = search.result.causes
    if not causes:
        return None
    columns = [search.likelihood.columns(cause.contributions) * cause.prior_deviations for cause in causes]
    return LevelPosterior(search.likelihood.linear, included=np.concatenate(columns, axis=2))
