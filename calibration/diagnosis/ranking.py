"""The evidence of each effect alone: at each of its places, and at several of them together.

Parts that are built alike wear alike, so an effect is as likely to be at several of its places as at a single one. By
the chain rule its evidence at two places is that at the first times that at the second, given the first.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.alike_places import AlikeAtAllPlaces, alike_at_all_places
from calibration.diagnosis.basis_set_evidence import BasisSetEvidence, log_sum
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.non_parametric import NonParametricEffect
from calibration.diagnosis.place_evidence import (
    PlaceEvidence,
    evidence_by_place,
    refine,
    smallest_size,
    total_log_evidence,
)
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import Effect, EffectInputs
from calibration.effects.columns import Contributions
from calibration.effects.departures import STIFFNESS, VISIT

ALIKE_PRIOR = math.log(8.0)  # log odds against all places alike
ALIKE_SHARE = 0.05  # of the strongest effect's log evidence: together places explain more than the sum of each alone


@dataclass(frozen=True)
class Cause:
    """An effect with its evidence over all places and basis sets, and with the best of them.

    log_evidence: over `none`. places: probability of each, given the effect; place: the most likely one. best: its best
    basis set; contributions: columns of that, in the order of its coefficients. further: the same effect at other
    places, if it is more likely to be at all of these together; each with its evidence given those before.
    alike: whether it is at all of its places alike, so that each of them is as likely as all; in_common: whether its
    coefficients are the same ones there.
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
    in_common: bool = False
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
        coordinates = dict.fromkeys(departure.coordinate for departure in self.best.basis_set.departures)
        return tuple(coordinate for coordinate in coordinates if coordinate != STIFFNESS)

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
    thorough: bool = False,
) -> list[Cause]:
    """All effects, the most likely first; those without a basis set at any place are left out.

    by_visit: whether effects may be others at each visit, where they are of that kind. explained: log evidence of the
    causes in the model, of which a further one must add a share: what is far from it is not refined. thorough: whether
    to refine, however long that takes, all that would be enough for a cause.
    """
    by_effect = [
        (effect, places)
        for effect in effects
        if (places := evidence_by_place(likelihood, inputs, effect, effect.places(inputs.machine)))
    ]
    strongest = max((total_log_evidence(places) for _, places in by_effect), default=0.0)
    strongest = max(strongest, VERDICT.min_gain_share * explained)
    threshold = max(VERDICT.detection_threshold, VERDICT.refined_share * strongest)
    leader = max(by_effect, key=lambda entry: total_log_evidence(entry[1]), default=None)
    law_leads = leader is not None and bool(leader[0].curves_at(inputs, 0))
    causes = []
    for effect, places in by_effect:
        alike = _alike(likelihood, inputs, effect, places, max(VERDICT.detection_threshold, ALIKE_SHARE * strongest))
        # Where a nonlinear law leads, the basis sets of another one say little of what its curve explains.
        rival = law_leads and bool(effect.curves_at(inputs, 0))
        least = VERDICT.detection_threshold if rival or thorough else threshold
        if _may_be_anew(effect, by_visit=by_visit) and not explained:
            least = -math.inf
        if (log_evidence := total_log_evidence(places)) <= least:
            unrefined = log_evidence > VERDICT.detection_threshold
            causes.append(_or_alike(replace(_cause(effect, places), unrefined=unrefined), alike))
            continue
        cause = _cause(effect, refine(likelihood, inputs, effect, places, by_visit=by_visit))
        causes.append(_or_alike(_at_several_places(likelihood, inputs, cause, by_visit=by_visit), alike))
    return first_likely(causes)


def first_likely(causes: Sequence[Cause]) -> list[Cause]:
    """Causes, the most likely first."""
    return sorted(causes, key=lambda cause: -cause.log_evidence)


def refit_cause(likelihood: MarginalLikelihood, inputs: EffectInputs, cause: Cause, taken: Collection[str]) -> Cause:
    """The effect of a cause at the best of its places that are not taken, all other causes being in the model."""
    effect, by_visit = cause.effect, differs_by_visit(cause)
    names = [name for name in effect.places(inputs.machine) if name not in taken]
    places = evidence_by_place(likelihood, inputs, effect, names)
    if total_log_evidence(places) > VERDICT.detection_threshold or _may_be_anew(effect, by_visit=by_visit):
        places = refine(likelihood, inputs, effect, places, by_visit=by_visit)
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
        if not (places := evidence_by_place(given, inputs, effect, left)):
            break
        # A curve may have what no column has.
        if total_log_evidence(places) > VERDICT.worth_refining or _may_be_anew(effect, by_visit=by_visit):
            places = refine(given, inputs, effect, places, by_visit=by_visit)
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
    likelihood: MarginalLikelihood, inputs: EffectInputs, effect: Effect, places: Sequence[PlaceEvidence], least: float
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
            alike=True, in_common=alike.in_common,
        )
        for part in sorted(alike.parts, key=lambda part: -abs(part.best.coefficients[0]))
    )  # fmt: skip
    return replace(main, log_evidence=log_evidence, further=tuple(further))


def _cause(effect: Effect, places: list[PlaceEvidence]) -> Cause:
    total, best = total_log_evidence(places), max(places, key=lambda place: place.log_evidence)
    probabilities = {place.place: float(np.exp(place.log_evidence - total)) for place in places}
    return Cause(
        effect, total, probabilities, best.place, best.best, best.contributions, departure_gain=best.departure_gain
    )


def include_cause(likelihood: MarginalLikelihood, cause: Cause | NonParametricEffect) -> MarginalLikelihood:
    """The marginal likelihood with a cause, in its best basis set, or a non-parametric effect added to the model."""
    if isinstance(cause, NonParametricEffect):
        return likelihood.including(cause.columns(likelihood))
    return likelihood.including(columns_of_cause(likelihood, cause))


def columns_of_cause(likelihood: MarginalLikelihood, cause: Cause) -> Array:
    """Whitened columns (n, w, k) of a cause, each times the prior standard deviation of its coefficient."""
    columns = [likelihood.columns(part.contributions) * part.prior_deviations for part in cause.parts]
    if not cause.in_common:
        return np.concatenate(columns, axis=2)
    return np.asarray(np.tensordot(shares_of_places(cause), np.stack(columns), 1))


def shares_of_places(cause: Cause) -> Array:
    """Of the first place's coefficients, what each place has (p,) of a cause that has them in common."""
    coefficients = np.stack([part.best.coefficients for part in cause.parts])
    return np.asarray(coefficients @ coefficients[0] / (coefficients[0] @ coefficients[0]))


def as_found(parts: Sequence[Cause]) -> list[Cause]:
    """Causes at one place each, of which those that have their coefficients in common are one again."""
    out: dict[object, Cause] = {}
    for part in parts:
        found = (part.effect.name, part.best.log_evidence)  # the same of all parts of one finding
        key = found if part.in_common else (*found, part.place, id(part))
        out[key] = replace(out[key], further=(*out[key].further, part)) if key in out else part
    return list(out.values())
