"""The search for causes: evidence of every effect at every place, and of non-parametric alternatives."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from calibration.diagnosis.anew_at_visits import acting_elsewhere, without_anew
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.non_parametric import NonParametricEffect, rank_non_parametric
from calibration.diagnosis.ranking import (
    Cause,
    as_found,
    differs_by_visit,
    first_likely,
    include_cause,
    rank_effects,
    refit_cause,
)
from calibration.diagnosis.search_budget import BY_VISIT, SearchBudget
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import Effect, EffectInputs

STEPS_BY_VISIT = 2  # of a search with numbers for the visits, that are expected
SHARE_OF_UNKNOWN = 0.5  # of the excess at which an effect is unknown, from which on something is left


@dataclass(frozen=True)
class SearchResult:
    """The result of a search for causes.

    ranking: all effects, each alone, the most likely first. causes: effects of the catalogue that together explain
    most; likelihoods: without any of them and after each. log_evidence: of the causes together over `none`, less the
    penalty for more than one; excess_log_evidence: how much more the best non-parametric alternative has, alone or in
    addition to them. non_parametric: alternatives in addition to the causes; non_parametric_alone: alternatives without
    any cause (empty if not needed). not_begun_with: names of effects with which the search did not begin, to save time,
    though they explain enough alone.
    """

    ranking: tuple[Cause, ...]
    causes: tuple[Cause, ...]
    likelihoods: tuple[MarginalLikelihood, ...]
    log_evidence: float
    excess_log_evidence: float
    non_parametric: tuple[NonParametricEffect, ...]
    non_parametric_alone: tuple[NonParametricEffect, ...]
    not_begun_with: tuple[str, ...] = ()

    @property
    def has_several_effects(self) -> bool:
        """Whether the causes are more than one effect, at however many places."""
        return len({cause.effect.name for cause in self.causes}) > 1

    def with_ranked(self, causes: Sequence[Cause]) -> SearchResult:
        """The same with further effects in the ranking."""
        return replace(self, ranking=tuple(first_likely([*self.ranking, *causes])))

    @property
    def departure_gain(self) -> float:
        """Of the causes' log evidence, what smooth departures from their forms add with coordinates on which their
        strength is not expected to depend."""
        return departure_gain(self.causes)


def search_causes(
    likelihood: MarginalLikelihood,
    inputs: EffectInputs,
    effects: Sequence[Effect],
    budget: SearchBudget | None = None,
    ranking: Sequence[Cause] | None = None,
) -> SearchResult:
    """Include effects as long as each adds enough evidence; then compare with non-parametric alternatives.

    What is another at each visit explains much that is not its own: it is looked for only where something is left or
    several explain it only together. budget: of all searches in the same readings; ranking: of effects alone, if known.
    """
    budget = budget or SearchBudget()
    alone = ranking or rank_effects(likelihood, inputs, effects, thorough=budget.thorough)
    found = _search(likelihood, inputs, effects, alone, budget, by_visit=False)
    if not (something_is_left(found) or found.has_several_effects) or budget.is_in_vain(BY_VISIT):
        return found
    by_visit = _search_by_visit(likelihood, inputs, effects, alone, found, budget)
    if elsewhere := acting_elsewhere(likelihood, inputs, by_visit.causes, by_visit.ranking):
        kept = [without_anew(effect) if effect.name in elsewhere else effect for effect in effects]
        by_visit = _search_by_visit(likelihood, inputs, kept, alone, found, budget)
        if acting_elsewhere(likelihood, inputs, by_visit.causes, by_visit.ranking):
            by_visit = found
    if by_visit is found:
        budget.was_in_vain(BY_VISIT)
    return by_visit


def _search_by_visit(
    likelihood: MarginalLikelihood,
    inputs: EffectInputs,
    effects: Sequence[Effect],
    alone: Sequence[Cause],
    found: SearchResult,
    budget: SearchBudget,
) -> SearchResult:
    """What was found, or what explains more with effects that are another at each visit. That is looked for in any case
    where one of these alone explains more than what was found together with any function beside it."""
    differing = [effect for effect in effects if effect.differs_by_visit]
    ranked = rank_effects(likelihood, inputs, differing, by_visit=True, thorough=budget.thorough)
    if not ranked or not differs_by_visit(ranked[0]) or ranked[0].log_evidence < alone[0].log_evidence:
        return found
    explains_most = ranked[0].log_evidence > found.log_evidence + found.excess_log_evidence
    expected = STEPS_BY_VISIT * budget.work(len(inputs.context), _columns(ranked[0]))
    if not (explains_most or budget.allows(BY_VISIT, expected)):
        return found
    names = {effect.name for effect in differing}
    others = [cause for cause in alone if cause.effect.name not in names]
    # Of what is the same at each visit it begins with the main cause only: with the others the search has begun.
    leaders = {cause.effect.name for cause in (*ranked, *found.causes[:1])}
    ranking = first_likely([*ranked, *others])
    by_visit = _search(likelihood, inputs, effects, ranking, budget, by_visit=True, leaders=leaders)
    if by_visit.log_evidence <= found.log_evidence:
        return found
    return replace(by_visit, not_begun_with=tuple(dict.fromkeys((*found.not_begun_with, *by_visit.not_begun_with))))


def include_effects(
    likelihood: MarginalLikelihood, inputs: EffectInputs, effects: Sequence[Effect]
) -> MarginalLikelihood:
    """The marginal likelihood with some effects, whatever their evidence: each where it is likeliest, then the next."""
    left = [without_anew(effect) for effect in effects]  # which says nothing of other visits
    while left and (ranked := rank_effects(likelihood, inputs, left, by_visit=True)):
        likelihood = include_cause(likelihood, ranked[0])
        left = [effect for effect in left if effect is not ranked[0].effect]
    return likelihood


def departure_gain(causes: Sequence[Cause]) -> float:
    """Of the log evidence of causes at one place each, what smooth departures from their forms add."""
    return sum(cause.departure_gain for cause in causes)


def something_is_left(result: SearchResult) -> bool:
    """Whether alternatives explain so much more that other effects or levels of disturbances are worth a search."""
    return _is_much(result.excess_log_evidence, result.log_evidence)


def _is_much(excess: float, explained: float) -> bool:
    return excess > SHARE_OF_UNKNOWN * float(VERDICT.threshold_of_excess(explained))


@dataclass(frozen=True)
class _Explanation:
    """Causes that were included one after the other: likelihoods without any and after each, their log evidence less
    the penalty for more than one, and alternatives to what remains (empty without causes). of_fewer: the best log
    evidence of fewer causes with an alternative in place of the next, which is penalised as that is."""

    causes: tuple[Cause, ...]
    likelihoods: tuple[MarginalLikelihood, ...]
    log_evidence: float = 0.0
    non_parametric: tuple[NonParametricEffect, ...] = ()
    of_fewer: float = 0.0

    @property
    def best_log_evidence(self) -> float:
        """Of causes and the strongest alternative together."""
        return max(self.of_fewer, self.log_evidence + max((a.log_evidence for a in self.non_parametric), default=0.0))

    @property
    def left_over(self) -> float:
        """What an alternative explains more, and the share of what departures add that counts as that."""
        more = self.best_log_evidence - self.log_evidence
        return more + VERDICT.departure_share * departure_gain([part for cause in self.causes for part in cause.parts])


def _search(
    likelihood: MarginalLikelihood,
    inputs: EffectInputs,
    effects: Sequence[Effect],
    ranking: Sequence[Cause],
    budget: SearchBudget,
    *,
    by_visit: bool,
    leaders: Collection[str] | None = None,
) -> SearchResult:
    """The same from the ranking of all effects, each alone; leaders: those with which it may begin, None for any.

    Two effects may together look most like a third, so that the strongest alone need not be one of those that explain
    most together. Where one cause is not enough, or leaves so much that `unknown` comes into question, the search also
    begins with the next in the ranking and with each cause that was found later.
    """
    before = budget.spent
    found = best = _include_from(likelihood, inputs, effects, ranking, budget, by_visit=by_visit)
    work = budget.spent - before
    not_begun_with: list[str] = []
    much_is_left = _is_much(found.left_over, found.log_evidence)
    if len(found.causes) > 1 or (found.causes and much_is_left):
        later = {cause.effect.name for cause in found.causes[1:]}
        for place, leader in enumerate(ranking[1:], 2):
            share = leader.log_evidence / found.log_evidence
            weak = share <= VERDICT.leaders_share
            worth = much_is_left and share > VERDICT.leaders_share_if_much_is_left and budget.has_room_for_weak(work)
            if (weak and not worth) or (leaders is not None and leader.effect.name not in leaders):
                continue
            if place > VERDICT.leaders and leader.effect.name not in later and not budget.thorough:
                not_begun_with.append(leader.effect.name)
                continue
            if not budget.allows(leader.effect.name, work):
                continue
            other = _include_from(likelihood, inputs, effects, [leader], budget, by_visit=by_visit)
            if other.log_evidence > best.log_evidence:
                best = other
        ranking = _with_main_cause_first(ranking, best, best.log_evidence - found.log_evidence)
    parts, likelihoods = [part for cause in best.causes for part in cause.parts], list(best.likelihoods)
    if len(parts) > 1:
        parts, likelihoods = _refit_causes(likelihood, inputs, parts)
    non_parametric, best_log_evidence = best.non_parametric, best.best_log_evidence
    non_parametric_alone: tuple[NonParametricEffect, ...] = ()
    left_over = best_log_evidence - best.log_evidence + VERDICT.departure_share * departure_gain(parts)
    # What is another at each visit, or several causes, may leave nothing where one function explains it with far less.
    by_itself = len(parts) != 1 or differs_by_visit(parts[0])
    if left_over > VERDICT.residual_search_threshold or by_itself:
        non_parametric_alone = tuple(rank_non_parametric(likelihood, inputs))
        best_log_evidence = max(best_log_evidence, non_parametric_alone[0].log_evidence)
        non_parametric = non_parametric or non_parametric_alone
    return SearchResult(
        ranking=tuple(ranking),
        causes=tuple(parts),
        likelihoods=tuple(likelihoods),
        log_evidence=best.log_evidence,
        excess_log_evidence=max(best_log_evidence - best.log_evidence, 0.0),
        non_parametric=non_parametric,
        non_parametric_alone=non_parametric_alone,
        not_begun_with=tuple(not_begun_with),
    )


def _with_main_cause_first(ranking: Sequence[Cause], best: _Explanation, gain: float) -> Sequence[Cause]:
    """The ranking, in which the strongest cause of the best explanation is as much likelier than the first of all as
    that explanation is than the one which begins there."""
    names = {cause.effect.name for cause in best.causes}
    if ranking[0].effect.name in names:
        return ranking
    main = next(cause for cause in ranking if cause.effect.name in names)
    raised = replace(main, log_evidence=ranking[0].log_evidence + gain)
    return first_likely([raised, *(cause for cause in ranking if cause is not main)])


def _include_from(
    likelihood: MarginalLikelihood,
    inputs: EffectInputs,
    effects: Sequence[Effect],
    ranked: Sequence[Cause],
    budget: SearchBudget,
    *,
    by_visit: bool,
) -> _Explanation:
    """The first of a ranking, then always the strongest given those before, as long as each adds enough."""
    found = _Explanation((), (likelihood,))
    while ranked:
        gain, log_evidence = ranked[0].log_evidence, found.log_evidence
        same_part = any(_same_part_of_machine(inputs, ranked[0], cause) for cause in found.causes)
        share = VERDICT.min_gain_share_same_part if same_part else VERDICT.min_gain_share
        if gain < max(VERDICT.detection_threshold, share * log_evidence):
            break
        of_fewer = found.of_fewer
        if found.causes:
            log_evidence = _with_one_more(found.log_evidence, gain, same_part=same_part)
            instead = found.non_parametric[0]
            kinds = {_kind(channel) for channel, _ in instead.channels}
            same_part = any(_channel_kinds(cause) & kinds for cause in found.causes)
            of_fewer = max(of_fewer, _with_one_more(found.log_evidence, instead.log_evidence, same_part=same_part))
        else:
            log_evidence = gain
        budget.spent += budget.work(len(inputs.context), _columns(ranked[0]))
        given = include_cause(found.likelihoods[-1], ranked[0])
        non_parametric = rank_non_parametric(given, inputs)
        causes, likelihoods = (*found.causes, ranked[0]), (*found.likelihoods, given)
        found = _Explanation(causes, likelihoods, log_evidence, tuple(non_parametric), of_fewer)
        nothing_left = non_parametric[0].log_evidence < VERDICT.residual_search_threshold
        if nothing_left or len(found.causes) == VERDICT.max_causes:
            break
        by_visit = by_visit and _has_room_for_visits(inputs, found.causes)
        ranked = rank_effects(
            given, inputs, effects, by_visit=by_visit, explained=log_evidence, thorough=budget.thorough
        )
    return found


def _has_room_for_visits(inputs: EffectInputs, causes: Sequence[Cause]) -> bool:
    """Whether numbers for the visits of one cause more leave most of what was read to be explained: of campaigns that
    read one reflector at each visit, three such causes would have a number for every coordinate."""
    numbers = sum(len(part.contributions) for cause in causes for part in cause.parts if differs_by_visit(part))
    visits = int(inputs.context.arrival.max()) + 1
    return not numbers or numbers + visits <= len(inputs.context)


def _columns(cause: Cause) -> int:
    return sum(len(part.contributions) for part in cause.parts)


def _with_one_more(log_evidence: float, gain: float, *, same_part: bool) -> float:
    """Log evidence of causes and of one more that adds so much, less what that one costs."""
    explained = log_evidence + gain
    share = VERDICT.further_cause_penalty_share_same_part if same_part else VERDICT.further_cause_penalty_share
    return explained - VERDICT.further_cause_penalty - share * explained


def _same_part_of_machine(inputs: EffectInputs, one: Cause, other: Cause) -> bool:
    """Whether two causes are the same effect, or act at the same drive or its struts through the same kind of channel:
    what is left over there may be one's model error, elsewhere hardly."""
    machine = inputs.machine

    def drives(cause: Cause) -> set[int]:
        if cause.effect.place == "drive":
            return {machine.drive_names.index(cause.place)}
        if cause.effect.place == "strut":
            return {int(machine.strut_drive[machine.strut_names.index(cause.place)])}
        return set()

    if one.effect.name == other.effect.name:
        return True
    return bool(drives(one) & drives(other)) and bool(_channel_kinds(one) & _channel_kinds(other))


def _channel_kinds(cause: Cause) -> set[str]:
    """How a cause acts: along a drive, on the length of a strut ..."""
    return {_kind(channel) for part in cause.parts for column in part.contributions for channel, _ in column}


def _kind(channel: str) -> str:
    return channel.partition(".")[0]


def _refit_causes(
    likelihood: MarginalLikelihood, inputs: EffectInputs, causes: list[Cause]
) -> tuple[list[Cause], list[MarginalLikelihood]]:
    """Each cause in its best basis set, given the others in the model; the strongest first."""
    refitted: list[Cause] = []
    for number in range(len(causes)):
        if causes[number].alike:  # each of its places has little evidence given the others
            refitted.append(causes[number])
            continue
        likelihood_of_others, others = likelihood, [*refitted, *causes[number + 1 :]]
        for other in as_found(others):
            likelihood_of_others = include_cause(likelihood_of_others, other)
        taken = {other.place for other in others if other.effect.name == causes[number].effect.name}
        cause = refit_cause(likelihood_of_others, inputs, causes[number], taken - {causes[number].place})
        if not taken or cause.log_evidence > VERDICT.detection_threshold:  # one of several places may be there no more
            refitted.append(cause)
    refitted.sort(key=lambda cause: -cause.log_evidence)
    found, likelihoods = as_found(refitted), [likelihood]
    for cause in found:
        likelihoods += [include_cause(likelihoods[-1], cause)] * len(cause.parts)
    return [part for cause in found for part in cause.parts], likelihoods
