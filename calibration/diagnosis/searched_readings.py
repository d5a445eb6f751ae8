"""The search for causes in linearised readings, of a machine that repeats itself or of one that does not.

Drives that stand off anew at each visit look like an effect that nothing tells from one visit to the next, such as one
of a fine period; and such an effect looks like drives that do. So causes are searched for as if the machine repeated
itself and as if it did not, and the explanation is taken that is most likely.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calibration.diagnosis.detectable_effects import detectable_effects
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.levels_and_causes import LevelsAndCauses, SearchOfLevelsAndCauses
from calibration.diagnosis.linear_model import LinearModel
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.diagnosis.non_parametric import rank_non_parametric
from calibration.diagnosis.periodogram import Periodogram
from calibration.diagnosis.positioning import PositioningPosterior
from calibration.diagnosis.ranking import Cause, as_found, columns_of_cause
from calibration.diagnosis.search import something_is_left
from calibration.diagnosis.search_budget import SearchBudget
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import EffectInputs
from calibration.effects.catalogue import Catalogue

WORTH_SEARCHING = 2.0  # log posterior that drives which stand off anew have over such that do not
MOST_SEARCHES = 2  # beside causes that were found
ALIKE = 0.2  # of the logarithm of a standard deviation: nearer ones say the same


@dataclass(frozen=True)
class Searched:
    """What was found in readings, and with what. not_tested: effects that could not be, and why."""

    inputs: EffectInputs
    by_drive: tuple[Periodogram, ...]
    not_tested: dict[str, str]
    found: LevelsAndCauses

    @property
    def finds_nothing(self) -> bool:
        """Whether there is no cause, nor any function that explains what an unknown one would."""
        return not (self.found.result.causes or something_is_left(self.found.result))


def search_readings(linear: LinearisedReadings, catalogue: Catalogue, budget: SearchBudget) -> Searched:
    """The most likely explanation of the readings."""
    stated = _ReadingsToSearch(linear, catalogue)
    if not isinstance(linear, LinearModel):
        return stated.search(budget)
    posterior = PositioningPosterior(linear)
    sd_m = posterior.most_likely_m()
    if sd_m == 0.0 or posterior.gain(sd_m) < WORTH_SEARCHING:
        return stated.search(budget)

    def standing_off(sd_m: float) -> _ReadingsToSearch:
        return _ReadingsToSearch(linear.standing_off(sd_m), catalogue, sd_m, posterior.log_evidence(sd_m))

    alone = standing_off(sd_m)
    # Where no function explains anything, what drives do at random is all there is, or most of it.
    first, at_m = (stated, 0.0) if alone.any_function_explains_something else (alone, sd_m)
    tried = {at_m: first.search(budget)}
    if at_m > 0.0 and tried[at_m].finds_nothing:
        return tried[at_m]
    if at_m == 0.0 and tried[at_m].found.log_posterior < alone.log_evidence:
        at_m = sd_m
        tried[at_m] = alone.search(budget)
    for _ in range(MOST_SEARCHES):
        if not (causes := tried[at_m].found.result.causes):
            break
        at_m = _most_likely_beside(stated.likelihood, causes)
        if any(_alike(at_m, other_m) for other_m in tried):
            break
        tried[at_m] = (standing_off(at_m) if at_m > 0.0 else stated).search(budget)
    best = max(tried.values(), key=lambda searched: searched.found.log_posterior)
    most_of_none = max(searched.found.log_evidence + searched.found.none_elsewhere for searched in tried.values())
    return replace(best, found=replace(best.found, none_elsewhere=most_of_none - best.found.log_evidence))


class _ReadingsToSearch:
    """Readings of a machine whose drives stand off anew with a standard deviation, which has a log evidence over one
    that repeats itself."""

    def __init__(
        self, linear: LinearisedReadings, catalogue: Catalogue, sd_m: float = 0.0, log_evidence: float = 0.0
    ) -> None:
        self.likelihood, self.log_evidence = MarginalLikelihood.of(linear), log_evidence
        self._catalogue, self._sd_m = catalogue, sd_m

    @cached_property
    def _by_drive(self) -> tuple[Periodogram, ...]:
        return periodograms(self.likelihood)

    @cached_property
    def _inputs(self) -> EffectInputs:
        return inputs_of_recording(self.likelihood, self._by_drive)

    @property
    def any_function_explains_something(self) -> bool:
        """Whether an arbitrary function of some coordinate does, so that causes will."""
        return rank_non_parametric(self.likelihood, self._inputs)[0].log_evidence > VERDICT.residual_search_threshold

    def search(self, budget: SearchBudget) -> Searched:
        """The most likely explanation."""
        effects, not_tested = detectable_effects(self._inputs, self._catalogue)
        found = SearchOfLevelsAndCauses(self.likelihood, self._inputs, effects, budget).most_likely()
        found = replace(
            found,
            log_posterior=found.log_posterior + self.log_evidence,
            log_evidence=found.log_evidence + self.log_evidence,
            positioning_sd_m=self._sd_m,
        )
        return Searched(self._inputs, self._by_drive, not_tested, found)


def _most_likely_beside(likelihood: MarginalLikelihood, causes: Sequence[Cause]) -> float:
    """Standard deviation in m with which drives stand off beside causes, 0 if it is not worth a search."""
    columns = [columns_of_cause(likelihood, cause) for cause in as_found(causes)]
    posterior = PositioningPosterior(likelihood.linear, np.concatenate(columns, axis=2))
    sd_m = posterior.most_likely_m()
    return sd_m if posterior.gain(sd_m) > WORTH_SEARCHING else 0.0


def _alike(one_m: float, other_m: float) -> bool:
    """Whether two standard deviations say the same."""
    return one_m == other_m or (min(one_m, other_m) > 0.0 and abs(math.log(one_m / other_m)) < ALIKE)
