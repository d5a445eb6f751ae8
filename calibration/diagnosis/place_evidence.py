"""The evidence of an effect at each of its places: of its basis sets, and of what departs from them.

At the likeliest places the likeliest forms are refined: nonlinear laws are fitted, and what departs from the form is
tried.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import BasisSetEvidence, evidence_of_basis_sets, log_sum
from calibration.diagnosis.curve_fit import fit_curves
from calibration.diagnosis.departure_evidence import MOST_MAIN_COLUMNS, with_departures
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.non_parametric import evidence_of_shifts_by_visit
from calibration.diagnosis.one_way import judge_courses
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import BasisSet, BasisSets, Effect, EffectInputs
from calibration.effects.columns import Contributions

OTHER_FORMS, OTHER_FORMS_SHARE = 1, 0.3  # from how many departures are tried too; of the best one's log evidence
PLACES_ANEW = 2  # at which numbers for the visits are tried: those whose channels explain most by them
PERIOD_DIGITS = 2  # of a period's logarithm, to which waves are told apart


@dataclass(frozen=True)
class PlaceEvidence:
    """An effect at one of its places: log evidence with the place's prior, the best basis set, its columns, and what of
    the log evidence smooth departures from the form add.

    form: that all of its main columns are, if they are one. others: the same for the likeliest basis sets of other
    forms or periods, which may be likelier once they depart. of_sets (s,): log evidence of each basis set.
    """

    place: str
    log_evidence: float
    best: BasisSetEvidence
    contributions: tuple[Contributions, ...]
    departure_gain: float = 0.0
    form: str = ""
    others: tuple[PlaceEvidence, ...] = ()
    of_sets: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of_set(cls, place: str, built: BasisSets, log_evidence: float, entry: BasisSetEvidence) -> PlaceEvidence:
        """Of one of the basis sets that were built there."""
        contributions = tuple(built.contributions[c] for c in entry.basis_set.columns)
        return cls(place, log_evidence, entry, contributions, form=_form(built, entry.basis_set))


def evidence_by_place(
    likelihood: MarginalLikelihood, inputs: EffectInputs, effect: Effect, names: Sequence[str]
) -> list[PlaceEvidence]:
    """Evidence at each of some places of which one is the effect's."""
    low, every = smallest_size(likelihood, effect), effect.places(inputs.machine)
    out = []
    for name in names:
        built = effect.basis_sets(inputs, every.index(name))
        if not built.sets:
            continue
        columns = likelihood.kept_information_and_score(built.by_channel)
        evidence = evidence_of_basis_sets(columns, built.sets, low, effect.size.high)
        weights = np.array([entry.basis_set.weight for entry in evidence])
        # Weights that add up to less than one leave the remainder to basis sets that were not listed.
        weights /= max(1.0, float(weights.sum()))
        of_sets = np.array([entry.log_evidence for entry in evidence])
        logs = of_sets + np.log(weights)
        judge_courses(evidence, logs)
        logs -= np.log(len(names))
        others = tuple(
            PlaceEvidence.of_set(name, built, float(logs[k]), evidence[k]) for k in _other_forms(effect, built, logs)
        )
        best = PlaceEvidence.of_set(name, built, float(log_sum(logs)), evidence[int(np.argmax(logs))])
        out.append(replace(best, others=others, of_sets=of_sets))
    return out


def _form(built: BasisSets, basis_set: BasisSet) -> str:
    """The form that all main columns of a basis set are; empty if they are several, or general functions."""
    named = {built.named[c] for c in basis_set.main}
    return named.pop() if len(named) == 1 else ""


def _other_forms(effect: Effect, built: BasisSets, logs: Array) -> list[int]:
    """Numbers of the likeliest basis sets of other forms or periods than the best one's: of a form that is dominated by
    what departs from it, the exact one explains less than some general function, or than a wave of another period. Of
    an effect that is anew at each visit, the form that may be so, which by itself explains next to nothing."""

    def kind(number: int) -> tuple[str, float, int]:
        basis_set = built.sets[number]
        period = round(math.log(basis_set.parameters.get("period_m", 1.0)), PERIOD_DIGITS)
        return _form(built, basis_set), period, len(basis_set.main)

    best, anew = int(np.argmax(logs)), effect.anew_by_visit
    of_anew = [k for k in range(len(logs)) if k != best and kind(k)[0] == anew] if anew else []
    seen, out = {kind(best), *map(kind, of_anew)}, list[int]()
    if anew and not (effect.varies_with or effect.functions_vary_with):  # has no departures but these
        return of_anew
    for number in np.argsort(-logs).tolist():
        if len(out) == OTHER_FORMS or logs[number] < OTHER_FORMS_SHARE * logs[best]:
            break
        few = len(built.sets[number].main) <= MOST_MAIN_COLUMNS
        if few and kind(number)[0] and kind(number) not in seen:
            seen.add(kind(number))
            out.append(number)
    return of_anew + out


def refine(
    likelihood: MarginalLikelihood,
    inputs: EffectInputs,
    effect: Effect,
    places: list[PlaceEvidence],
    *,
    by_visit: bool,
) -> list[PlaceEvidence]:
    """The same with departures and curves, where the basis sets have evidence; elsewhere with what is anew."""
    every, low = effect.places(inputs.machine), smallest_size(likelihood, effect)
    strongest = max(place.log_evidence for place in places)

    def with_curves(place: PlaceEvidence) -> PlaceEvidence:
        of_place = effect.curves_at(inputs, every.index(place.place))
        fit = fit_curves(likelihood, of_place, low, effect.size.high)
        if fit is None:
            return place
        log_evidence = fit.log_evidence - float(np.log(len(places) * len(of_place)))
        both = float(np.logaddexp(log_evidence, place.log_evidence)) - float(np.log(2.0))
        if log_evidence > place.log_evidence:
            return PlaceEvidence(place.place, both, fit.best, fit.contributions)
        return replace(place, log_evidence=both)

    def has_form_anew(near: PlaceEvidence) -> bool:
        return by_visit and bool(near.form) and near.form == effect.anew_by_visit

    def is_anew(near: PlaceEvidence) -> bool:
        return has_form_anew(near) and near.place in most_shifted

    def departing(near: PlaceEvidence) -> PlaceEvidence:
        found = with_departures(
            likelihood, inputs, effect, every.index(near.place), near.best, near.contributions, low,
            by_visit=by_visit, anew=is_anew(near),
        )  # fmt: skip
        # The best basis set holds nearly all of the evidence, so that what it gains the effect gains.
        log_evidence = near.log_evidence + found.gain
        return PlaceEvidence(near.place, log_evidence, found.best, found.contributions, found.unexpected)

    def refined(place: PlaceEvidence) -> PlaceEvidence:
        if place.log_evidence > threshold:  # a form that is anew at each visit is nothing where it is the same
            others = [near for near in place.others if is_anew(near) or near.form != (effect.anew_by_visit or None)]
            ways = [departing(near) for near in (with_curves(place), *others)]
        else:
            ways = [place, *(departing(near) for near in (place, *place.others) if is_anew(near))]
        return max(ways, key=lambda way: way.log_evidence)

    shifts = {
        place.place: evidence_of_shifts_by_visit(likelihood, {c for column in near.contributions for c, _ in column})
        for place in places
        for near in (place, *place.others)
        if has_form_anew(near)
    }
    most_shifted = sorted(shifts, key=lambda name: -shifts[name])[:PLACES_ANEW]
    threshold = min(VERDICT.curve_fit_share_at_place * strongest, strongest - VERDICT.curve_fit_margin_at_place)
    return [refined(place) for place in places]


def total_log_evidence(places: list[PlaceEvidence]) -> float:
    """Of an effect that is at one of some places."""
    return float(log_sum(np.array([place.log_evidence for place in places])))


def smallest_size(likelihood: MarginalLikelihood, effect: Effect) -> float:
    """The smallest size that counts as an effect on a recording."""
    linear = likelihood.linear
    return effect.smallest_size(linear.levels, effect.stated_u(linear.machine, linear.payloads))
