"""The evidence of each effect alone: at each of its places, and at several of them together.

Parts that are built alike wear alike, so an effect is as likely to be at several of its places as at a single one. By
the chain rule its evidence at two places is that at the first times that at the second, given the first.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.alike_places import AlikeAtAllPlaces, alike_at_all_places
from calibration.diagnosis.basis_set_evidence import (
    BasisSetEvidence,
    evidence_of_basis_sets,
    log_sum,
)
from calibration.diagnosis.curve_fit import fit_curves
from calibration.diagnosis.departure_evidence import MOST_MAIN_COLUMNS, with_departures
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.non_parametric import NonParametricEffect
from calibration.diagnosis.one_way import judge_courses
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import BasisSet, BasisSets, Effect, EffectInputs
from calibration.effects.columns import Contributions
from calibration.effects.departures import VISIT

OTHER_FORMS, OTHER_FORMS_SHARE = 1, 0.3  # from how many departures are tried too; of the best one's log evidence
PERIOD_DIGITS = 2  # of a period's logarithm, to which waves are told apart
ALIKE_PRIOR = math.log(8.0)  # log odds against all places alike
ALIKE_SHARE = 0.2  # of the strongest effect's log evidence: together places explain more than the sum of each alone


@dataclass(frozen=True)
class Cause:
    """An effect with its evidence over all places and basis sets, and with the best of them.

    log_evidence: over `none`. places: probability of each, given the effect; place: the most likely one. best: its best
    basis set; contributions: columns of that, in the order of its coefficients. further: the same effect at other
    places, if it is more likely to be at all of these together; each with its evidence given those before.
    alike: whether it is at all of its places alike, so that each of them is as likely as all.
    unrefined: whether, to save time, neither its curves nor departures nor further places were tried, though its basis
    sets alone would be enough for a cause. departure_gain: of the log evidence, what smooth departures from its form
    add at `place`.
    """

    effect: Effect
    log_evidence: float
    places: dict[str, float]
    place: str
    best: BasisSetEvidence
    contributions: tuple[Contributions, ...]
    further: tuple[Cause, ...] = ()
    alike: bool = False
    unrefined: bool = False
    departure_gain: float = 0.0

    @property
    def parts(self) -> tuple[Cause, ...]:
        """One cause for each place where it acts."""
        return (replace(self, further=()), *self.further)

    @property
    def differs_with(self) -> tuple[str, ...]:
        """Coordinates with which its strength departs from the form at `place`, or its general functions change; VISIT
        from visit to visit."""
        return tuple(dict.fromkeys(departure.coordinate for departure in self.best.basis_set.departures))

    @property
    def prior_deviations(self) -> Array:
        """Prior standard deviations (k,) of the best basis set's coefficients."""
        return self.best.size * np.array(self.best.basis_set.relative)


def rank_effects(
    likelihood: MarginalLikelihood,
    inputs: EffectInputs,
    effects: Sequence[Effect],
    *,
    by_visit: bool = False,
    explained: float = 0.0,
) -> list[Cause]:
    """All effects, the most likely first; those without a basis set at any place are left out.

    by_visit: whether effects may be others at each visit, where they are of that kind. explained: log evidence of the
    causes in the model, of which a further one must add a share: what is far from it is not refined.
    """
    by_effect = [
        (effect, places)
        for effect in effects
        if (places := _evidence_by_place(likelihood, inputs, effect, effect.places(inputs.machine)))
    ]
    strongest = max((_total_log_evidence(places) for _, places in by_effect), default=0.0)
    strongest = max(strongest, VERDICT.min_gain_share * explained)
    threshold = max(VERDICT.detection_threshold, VERDICT.refined_share * strongest)
    leader = max(by_effect, key=lambda entry: _total_log_evidence(entry[1]), default=None)
    law_leads = leader is not None and bool(leader[0].curves_at(inputs, 0))
    causes = []
    for effect, places in by_effect:
        alike = _alike(likelihood, inputs, effect, places, max(VERDICT.detection_threshold, ALIKE_SHARE * strongest))
        # Where a nonlinear law leads, the basis sets of another one say little of what its curve explains.
        rival = law_leads and bool(effect.curves_at(inputs, 0))
        least = VERDICT.detection_threshold if rival else threshold
        if _may_be_anew(effect, by_visit=by_visit) and not explained:
            least = -math.inf
        if (log_evidence := _total_log_evidence(places)) <= least:
            unrefined = log_evidence > VERDICT.detection_threshold
            causes.append(_or_alike(replace(_cause(effect, places), unrefined=unrefined), alike))
            continue
        cause = _cause(effect, _refine(likelihood, inputs, effect, places, by_visit=by_visit))
        causes.append(_or_alike(_at_several_places(likelihood, inputs, cause, by_visit=by_visit), alike))
    return first_likely(causes)


def first_likely(causes: Sequence[Cause]) -> list[Cause]:
    """Causes, the most likely first."""
    return sorted(causes, key=lambda cause: -cause.log_evidence)


def refit_cause(likelihood: MarginalLikelihood, inputs: EffectInputs, cause: Cause, taken: Collection[str]) -> Cause:
    """The effect of a cause at the best of its places that are not taken, all other causes being in the model."""
    effect, by_visit = cause.effect, differs_by_visit(cause)
    names = [name for name in effect.places(inputs.machine) if name not in taken]
    places = _evidence_by_place(likelihood, inputs, effect, names)
    if _total_log_evidence(places) > VERDICT.detection_threshold or _may_be_anew(effect, by_visit=by_visit):
        places = _refine(likelihood, inputs, effect, places, by_visit=by_visit)
    return _cause(effect, places)


def _may_be_anew(effect: Effect, *, by_visit: bool) -> bool:
    """Whether there may be what its basis sets by themselves say nothing of. Those of a reflector do."""
    return by_visit and bool(effect.anew_by_visit) and effect.place != "smr"


def differs_by_visit(cause: Cause) -> bool:
    """Whether the best basis set is another at each visit."""
    return VISIT in cause.differs_with


def _at_several_places(likelihood: MarginalLikelihood, inputs: EffectInputs, cause: Cause, *, by_visit: bool) -> Cause:
    """The cause, and the same effect at further places where that explains more; the strongest first."""
    effect, names = cause.effect, cause.effect.places(inputs.machine)
    if len(names) < 2 or effect.place == "smr":  # all reflectors that move together are a platform that moves
        return cause
    # The evidence of a cause contains the prior of its place; that of a set of places replaces it.
    log_evidence = cause.log_evidence + math.log(cause.places[cause.place]) + math.log(len(names))
    sets: list[tuple[float, tuple[Cause, ...]]] = [(cause.log_evidence - math.log(2.0), ())]
    further: tuple[Cause, ...] = ()
    given = include_cause(likelihood, cause)
    while left := [name for name in names if name not in {cause.place, *(part.place for part in further)}]:
        if not (places := _evidence_by_place(given, inputs, effect, left)):
            break
        # A curve may have what no column has.
        if _total_log_evidence(places) > VERDICT.worth_refining or _may_be_anew(effect, by_visit=by_visit):
            places = _refine(given, inputs, effect, places, by_visit=by_visit)
        part = _cause(effect, places)
        if part.log_evidence < max(VERDICT.detection_threshold, VERDICT.min_gain_share_same_part * log_evidence):
            break
        log_evidence += part.log_evidence + math.log(part.places[part.place]) + math.log(len(left))
        further = (*further, part)
        given = include_cause(given, part)
        alike = 2.0 * (len(names) - 1) * math.comb(len(names), len(further) + 1)  # sets that share the prior
        sets.append((log_evidence - math.log(alike), further))
    _, likeliest = max(sets, key=lambda entry: entry[0])
    return replace(cause, log_evidence=float(log_sum(np.array([log for log, _ in sets]))), further=likeliest)


def _alike(
    likelihood: MarginalLikelihood, inputs: EffectInputs, effect: Effect, places: Sequence[_PlaceEvidence], least: float
) -> AlikeAtAllPlaces | None:
    """The effect at all of its places alike, if what these explain each is together worth it."""
    names = effect.places(inputs.machine)
    if len(names) < 2 or effect.place == "smr":  # all reflectors that move together are a platform that moves
        return None
    alone = [place.log_evidence + math.log(len(names)) for place in places]
    if len(alone) < len(names) or sum(max(log, 0.0) for log in alone) <= least:
        return None
    low = smallest_size(likelihood, effect)
    return alike_at_all_places(likelihood, inputs, effect, low, [place.of_sets for place in places])


def _or_alike(cause: Cause, alike: AlikeAtAllPlaces | None) -> Cause:
    """The cause, or the same effect at all places if that is likelier by what any further place must add, since a
    little more may be the model error of one; its evidence is that of both."""
    if alike is None:
        return cause
    together = alike.log_evidence - ALIKE_PRIOR
    if together <= cause.log_evidence + VERDICT.min_gain_share_same_part * max(cause.log_evidence, 0.0):
        no_more = min(together, cause.log_evidence)
        return replace(cause, log_evidence=float(np.logaddexp(cause.log_evidence, no_more)))
    log_evidence = float(np.logaddexp(cause.log_evidence, together))
    main, *further = (
        Cause(
            cause.effect, together / len(alike.parts), {part.place: 1.0}, part.place, part.best, part.contributions,
            alike=True,
        )
        for part in sorted(alike.parts, key=lambda part: -abs(part.best.coefficients[0]))
    )  # fmt: skip
    return replace(main, log_evidence=log_evidence, further=tuple(further))


@dataclass(frozen=True)
class _PlaceEvidence:
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
    others: tuple[_PlaceEvidence, ...] = ()
    of_sets: Array = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of_set(cls, place: str, built: BasisSets, log_evidence: float, entry: BasisSetEvidence) -> _PlaceEvidence:
        """Of one of the basis sets that were built there."""
        contributions = tuple(built.contributions[c] for c in entry.basis_set.columns)
        return cls(place, log_evidence, entry, contributions, form=_form(built, entry.basis_set))


def _evidence_by_place(
    likelihood: MarginalLikelihood, inputs: EffectInputs, effect: Effect, names: Sequence[str]
) -> list[_PlaceEvidence]:
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
            _PlaceEvidence.of_set(name, built, float(logs[k]), evidence[k]) for k in _other_forms(effect, built, logs)
        )
        best = _PlaceEvidence.of_set(name, built, float(log_sum(logs)), evidence[int(np.argmax(logs))])
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


def _refine(
    likelihood: MarginalLikelihood,
    inputs: EffectInputs,
    effect: Effect,
    places: list[_PlaceEvidence],
    *,
    by_visit: bool,
) -> list[_PlaceEvidence]:
    """The same with departures and curves, where the basis sets have evidence; elsewhere with what is anew."""
    every, low = effect.places(inputs.machine), smallest_size(likelihood, effect)
    strongest = max(place.log_evidence for place in places)

    def with_curves(place: _PlaceEvidence) -> _PlaceEvidence:
        of_place = effect.curves_at(inputs, every.index(place.place))
        fit = fit_curves(likelihood, of_place, low, effect.size.high)
        if fit is None:
            return place
        log_evidence = fit.log_evidence - float(np.log(len(places) * len(of_place)))
        both = float(np.logaddexp(log_evidence, place.log_evidence)) - float(np.log(2.0))
        if log_evidence > place.log_evidence:
            return _PlaceEvidence(place.place, both, fit.best, fit.contributions)
        return replace(place, log_evidence=both)

    def is_anew(near: _PlaceEvidence) -> bool:
        return by_visit and bool(near.form) and near.form == effect.anew_by_visit

    def departing(near: _PlaceEvidence) -> _PlaceEvidence:
        found = with_departures(
            likelihood, inputs, effect, every.index(near.place), near.best, near.contributions, low,
            by_visit=by_visit, anew=is_anew(near),
        )  # fmt: skip
        # The best basis set holds nearly all of the evidence, so that what it gains the effect gains.
        log_evidence = near.log_evidence + found.gain
        return _PlaceEvidence(near.place, log_evidence, found.best, found.contributions, found.unexpected)

    def refine(place: _PlaceEvidence) -> _PlaceEvidence:
        if place.log_evidence > threshold:  # a form that is anew at each visit is nothing where it is the same
            others = [near for near in place.others if is_anew(near) or near.form != (effect.anew_by_visit or None)]
            ways = [departing(near) for near in (with_curves(place), *others)]
        else:
            ways = [place, *(departing(near) for near in (place, *place.others) if is_anew(near))]
        return max(ways, key=lambda way: way.log_evidence)

    threshold = min(VERDICT.curve_fit_share_at_place * strongest, strongest - VERDICT.curve_fit_margin_at_place)
    return [refine(place) for place in places]


def _cause(effect: Effect, places: list[_PlaceEvidence]) -> Cause:
    total, best = _total_log_evidence(places), max(places, key=lambda place: place.log_evidence)
    probabilities = {place.place: float(np.exp(place.log_evidence - total)) for place in places}
    return Cause(
        effect, total, probabilities, best.place, best.best, best.contributions, departure_gain=best.departure_gain
    )


def _total_log_evidence(places: list[_PlaceEvidence]) -> float:
    return float(log_sum(np.array([place.log_evidence for place in places])))


def smallest_size(likelihood: MarginalLikelihood, effect: Effect) -> float:
    """The smallest size that counts as an effect on a recording."""
    linear = likelihood.linear
    return effect.smallest_size(linear.levels, effect.stated_u(linear.machine, linear.payloads))


def include_cause(likelihood: MarginalLikelihood, cause: Cause | NonParametricEffect) -> MarginalLikelihood:
    """The marginal likelihood with a cause, in its best basis set, or a non-parametric effect added to the model."""
    if isinstance(cause, NonParametricEffect):
        return likelihood.including(cause.columns(likelihood))
    columns = [likelihood.columns(part.contributions) * part.prior_deviations for part in cause.parts]
    return likelihood.including(np.concatenate(columns, axis=2))
