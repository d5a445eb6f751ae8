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

from calibration.base.arrays import Array
from calibration.diagnosis.detectable_effects import detectable_effects
from calibration.diagnosis.effect_inputs import inputs_of_recording, periodograms
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.level_posterior import FEW_READINGS
from calibration.diagnosis.levels_and_causes import LevelsAndCauses, SearchOfLevelsAndCauses
from calibration.diagnosis.linearised_readings import LinearisedReadings, OffTogether
from calibration.diagnosis.non_parametric import rank_non_parametric
from calibration.diagnosis.periodogram import Periodogram
from calibration.diagnosis.positioning import PositioningPosterior
from calibration.diagnosis.ranking import Cause, as_found, columns_of_cause, rank_effects
from calibration.diagnosis.search import something_is_left
from calibration.diagnosis.search_budget import SearchBudget
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import Effect, EffectInputs
from calibration.effects.catalogue import Catalogue

MUCH_EXPLAINED = 1000.0  # log evidence of one effect, beyond which others or its form leave more than drives do
MOST_SEARCHES = 3  # beside causes that were found
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
    if linear.degrees_of_freedom < FEW_READINGS or (off := linear.off_together()) is None:
        return _ReadingsToSearch(linear, catalogue).search(budget)
    return _SearchOfPositioning(linear, off, catalogue, budget).most_likely()


class _SearchOfPositioning:
    """Searches in the same readings, by the standard deviation with which drives stand off anew; 0: not at all."""

    def __init__(
        self, linear: LinearisedReadings, off: OffTogether, catalogue: Catalogue, budget: SearchBudget
    ) -> None:
        self._linear, self._off, self._catalogue, self._budget = linear, off, catalogue, budget
        self._stated = _ReadingsToSearch(linear, catalogue)
        self._posterior = PositioningPosterior(linear, off)
        self._tried: dict[float, Searched] = {}

    def most_likely(self) -> Searched:
        """The most likely of all, from what is most likely without a cause to what is beside those found."""
        sd_m = self._posterior.most_likely_m()
        if sd_m == 0.0:
            return self._stated.search(self._budget)
        self._try_all(sd_m)
        if self._one_drive_explains_more(self._best):  # not the machine, or an effect that is another at each visit
            self._tried = {0.0: self._tried.get(0.0) or self._stated.search(self._budget.anew())}
        best, every = self._best, [searched.found for searched in self._tried.values()]
        most_of_none = max(found.log_evidence + found.none_elsewhere for found in every)
        return replace(best, found=replace(best.found, none_elsewhere=most_of_none - best.found.log_evidence))

    def _try_all(self, sd_m: float) -> None:
        alone = self._standing_off(sd_m)
        if not alone.any_function_explains_something:  # what drives do at random is all there is, or most of it
            self._tried[sd_m] = alone.search(self._budget.anew())
            if self._tried[sd_m].finds_nothing:
                return
        else:
            begins_m, first = 0.0, self._stated.first_cause(self._budget)
            if first is not None and first.log_evidence < MUCH_EXPLAINED:
                begins_m = self._beside_m([first], first.log_evidence)
            self._tried[begins_m] = self._standing_off(begins_m).search(self._budget.anew())
            if self._one_drive_explains_more(self._tried[begins_m]):  # which counts for any other standard deviation
                return
            if self._best.found.log_posterior < alone.log_evidence:
                self._tried[sd_m] = alone.search(self._budget.anew())
        for _ in range(MOST_SEARCHES):
            result = self._best.found.result
            beside_m = self._beside_m(result.causes, result.log_evidence)
            if any(_alike(beside_m, other_m) for other_m in self._tried):
                break
            self._tried[beside_m] = self._standing_off(beside_m).search(self._budget.anew())

    @property
    def _best(self) -> Searched:
        return max(self._tried.values(), key=lambda searched: searched.found.log_posterior)

    def _one_drive_explains_more(self, searched: Searched) -> bool:
        """Whether beside the causes one drive that stands off by more explains more than all do by what was found."""
        sd_m, drives = searched.found.positioning_sd_m, len(self._linear.machine.drive_names)
        if sd_m == 0.0:
            return False
        columns, one_m = self._columns(searched.found.result.causes), sd_m * math.sqrt(drives)
        by_one = [
            PositioningPosterior(self._linear, self._off.by_one(drive, drives), columns) for drive in range(drives)
        ]
        most = max(posterior.log_evidence(each_m) for posterior in by_one for each_m in (one_m, one_m / 1.5))
        return most > PositioningPosterior(self._linear, self._off, columns).log_evidence(sd_m)

    def _columns(self, causes: Sequence[Cause]) -> Array | None:
        columns = [columns_of_cause(self._stated.likelihood, cause) for cause in as_found(causes)]
        return np.concatenate(columns, axis=2) if columns else None

    def _standing_off(self, sd_m: float) -> _ReadingsToSearch:
        if sd_m == 0.0:
            return self._stated
        evidence = self._posterior.log_evidence(sd_m)
        return _ReadingsToSearch(self._linear.standing_off(sd_m), self._catalogue, sd_m, evidence)

    def _beside_m(self, causes: Sequence[Cause], explained: float) -> float:
        """Most likely beside causes that explain so much log evidence; 0 where what drives do explains no more than
        what the causes' forms may leave."""
        if not causes:
            return 0.0
        posterior = PositioningPosterior(self._linear, self._off, self._columns(causes))
        return posterior.most_likely_m(float(VERDICT.threshold_of_excess(explained)))


class _ReadingsToSearch:
    """Readings of a machine whose drives stand off anew with a standard deviation, which has a log evidence over one
    that repeats itself."""

    def __init__(
        self, linear: LinearisedReadings, catalogue: Catalogue, sd_m: float = 0.0, log_evidence: float = 0.0
    ) -> None:
        self.likelihood, self.log_evidence = MarginalLikelihood.of(linear), log_evidence
        self._catalogue, self._sd_m = catalogue, sd_m
        self._ranking: list[Cause] | None = None

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

    @cached_property
    def _detectable(self) -> tuple[list[Effect], dict[str, str]]:
        return detectable_effects(self._inputs, self._catalogue)

    def first_cause(self, budget: SearchBudget) -> Cause | None:
        """The effect that alone is the most likely, if any could be."""
        self._ranking = rank_effects(self.likelihood, self._inputs, self._detectable[0], thorough=budget.thorough)
        return self._ranking[0] if self._ranking else None

    def search(self, budget: SearchBudget) -> Searched:
        """The most likely explanation."""
        effects, not_tested = self._detectable
        found = SearchOfLevelsAndCauses(self.likelihood, self._inputs, effects, budget, self._ranking).most_likely()
        found = replace(
            found,
            log_posterior=found.log_posterior + self.log_evidence,
            log_evidence=found.log_evidence + self.log_evidence,
            positioning_sd_m=self._sd_m,
        )
        return Searched(self._inputs, self._by_drive, not_tested, found)


def _alike(one_m: float, other_m: float) -> bool:
    """Whether two standard deviations say the same."""
    return one_m == other_m or (min(one_m, other_m) > 0.0 and abs(math.log(one_m / other_m)) < ALIKE)
