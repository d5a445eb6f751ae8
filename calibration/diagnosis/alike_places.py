"""The evidence that an effect is at all of its places, in one form.

Parts of one kind that stand in one hall, carry one load and are as old as each other often err alike: all struts are
warmer than their sensor, all columns sink. At a single place such an effect may leave too little to be seen, so that a
search that takes one place after the other never begins. The coefficients at the places have the covariance
rho 11' + (1 - rho) I: none in common, a common one and a smaller one at each place, or a common one only. How all of
them together move the platform depends on stiffnesses that are uncertain, as at a single place (`departure_evidence`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import BasisSetEvidence, evidence_of_basis_sets, log_sum
from calibration.diagnosis.departure_evidence import stiffnesses_left_open
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.effects.api import BasisSet, BasisSets, Departure, Effect, EffectInputs
from calibration.effects.columns import ColumnsByChannel, Contributions
from calibration.effects.departures import STIFFNESS, through_stiffened

CORRELATIONS = (0.0, 0.9, 1.0)  # of coefficients at two places
MOST_COLUMNS = 15  # of a basis set with coefficients of each place: more are any function, which is another at each
MOST_IN_COMMON = 100  # of one with common ones only, of courses or the same functions, as of a heater
SAME_FUNCTION = 1e-6  # below which the cosine between two functions may be less than one
ALTERNATIONS = 3  # between common coefficients and shares of them
SHARES = 0.5  # standard deviation of what a place has of common coefficients, over the mean
LIKELIEST = 4  # sets, by what they explain with common coefficients and at each place alone, that get their own ones


@dataclass(frozen=True)
class PartAlike:
    """The effect at one of the places: its basis set with coefficients there, and the columns of that."""

    place: str
    best: BasisSetEvidence
    contributions: tuple[Contributions, ...]


@dataclass(frozen=True)
class AlikeAtAllPlaces:
    """Log evidence over `none` that an effect is at all of its places alike; its parts in the likeliest basis set, and
    whether they have their coefficients in common."""

    log_evidence: float
    parts: tuple[PartAlike, ...]
    in_common: bool = False


def alike_at_all_places(
    likelihood: MarginalLikelihood,
    inputs: EffectInputs,
    effect: Effect,
    low: float,
    at_each: Sequence[Array],
) -> AlikeAtAllPlaces | None:
    """None where its places have no basis sets in common; low: its smallest size; at_each: log evidence (s,) of its
    basis sets at each place alone."""
    names = effect.places(inputs.machine)
    built = [effect.basis_sets(inputs, place) for place in range(len(names))]
    _, joined = inputs.once(("alike", id(effect)), lambda: (effect, _joined(built)))
    if joined is None:
        return None
    columns = likelihood.kept_information_and_score(joined.columns)
    in_common = evidence_of_basis_sets(columns, joined.sets, low, effect.size.high)
    found = [_Spread(k, one.basis_set.weight, 1.0, one) for k, one in zip(joined.numbers, in_common, strict=True)]
    alone = np.sum(at_each, axis=0)
    by_evidence = sorted(found, key=lambda each: -each.evidence.log_evidence)
    few = [each.number for each in by_evidence if len(built[0].sets[each.number].columns) <= MOST_COLUMNS]
    if wide := [each for each in by_evidence if each.number not in few]:
        found += _by_shares(likelihood, built, wide[0], low, effect.size.high)
    for number in {*few[:LIKELIEST], *sorted(few, key=lambda k: -alone[k])[:LIKELIEST]}:
        found += _spread_over_places(likelihood, inputs, built, number, low, effect.size.high)
    # Sets that are left out here have their share of the prior at a single place too.
    every = max(1.0, sum(basis_set.weight for basis_set in built[0].sets)) * len(CORRELATIONS)
    logs = np.array([each.evidence.log_evidence + math.log(each.weight / every) for each in found])
    exact = found[int(np.argmax(logs))]
    likeliest = _with_stiffened(likelihood, inputs, built, exact, low, effect.size.high)
    parts = [
        likeliest.part_at(place, name, at_place, inputs)
        for place, (name, at_place) in enumerate(zip(names, built, strict=True))
    ]
    # The likeliest holds nearly all of the evidence, so that what it gains the effect gains.
    gain = likeliest.evidence.log_evidence - exact.evidence.log_evidence
    return AlikeAtAllPlaces(float(log_sum(logs)) + gain, tuple(parts), likeliest.correlation == 1.0)


@dataclass(frozen=True)
class _Spread:
    """The evidence of a basis set at all places: coefficients of each, if they are not all the same, then common ones,
    if they are correlated; shares (p,) of common ones that each place has, where these are not all one. stiffened:
    struts and guides, by number, of whose stiffness the last coefficients are; amounts (k,), of each place: of its
    columns, stiffened, in those."""

    number: int
    weight: float
    correlation: float
    evidence: BasisSetEvidence
    shares: Array | None = None
    stiffened: tuple[int, ...] = ()
    amounts: tuple[Array, ...] = ()

    def sums_at(self, place: int, columns: int) -> Array:
        """Matrix (k, c): the sum of a place's own coefficients of its columns and of the common ones."""
        own = len(self.evidence.coefficients) - len(self.stiffened)
        sums = np.zeros((columns, own + len(self.stiffened)))
        if self.correlation < 1.0:
            sums[:, columns * place : columns * (place + 1)] = np.eye(columns)
        if self.correlation > 0.0:
            share = 1.0 if self.shares is None else self.shares[place]
            sums[:, own - columns : own] += share * np.eye(columns)
        return sums

    def part_at(self, place: int, name: str, built: BasisSets, inputs: EffectInputs) -> PartAlike:
        """What belongs to one place, with what stiffnesses that are other than stated make of it."""
        basis_set, found = built.sets[self.number], self.evidence
        sums = self.sums_at(place, len(basis_set.columns))
        contributions = [built.contributions[c] for c in basis_set.columns]
        departures, relative, of_stiffness = list[Departure](), list[float](), np.eye(sums.shape[1])
        for k, constraint in enumerate(self.stiffened, start=-len(self.stiffened)):
            for column, amount in enumerate(self.amounts[place].tolist()):
                if stiffened := through_stiffened(inputs, constraint, contributions[column]):
                    sums = np.vstack([sums, amount * of_stiffness[k]])
                    contributions.append(stiffened)
                    departures.append(Departure(column, STIFFNESS, constraint))
                    relative.append(abs(amount) * found.basis_set.relative[k])
        with_stiffened = replace(
            basis_set, relative=(*basis_set.relative, *relative), departures=(*basis_set.departures, *departures)
        )
        covariance: Array = sums @ found.covariance @ sums.T
        best = BasisSetEvidence(with_stiffened, found.log_evidence, found.size, sums @ found.coefficients, covariance)
        return PartAlike(name, best, tuple(contributions))

    def contributions(self, built: Sequence[BasisSets]) -> list[Contributions]:
        """Its columns: those of each place, then common ones."""
        of_places = _at_places(built, self.number)
        shares = np.ones(len(built)) if self.shares is None else self.shares
        own = [column for at_place in of_places for column in at_place if self.correlation < 1.0]
        common = [_weighted_sum(alike, shares) for alike in zip(*of_places, strict=True) if self.correlation > 0.0]
        return own + common


@dataclass(frozen=True)
class _Joined:
    """Basis sets that all places have, by their numbers there, and their columns at all places at once, in which they
    are counted anew."""

    numbers: tuple[int, ...]
    sets: tuple[BasisSet, ...]
    columns: ColumnsByChannel


def _joined(built: Sequence[BasisSets]) -> _Joined | None:
    first, *others = built
    if any(len(other.sets) != len(first.sets) for other in others):
        return None
    numbers = [
        k
        for k, basis_set in enumerate(first.sets)
        if len(basis_set.columns) <= MOST_IN_COMMON
        and not basis_set.one_way
        and all(other.sets[k].columns == basis_set.columns for other in others)
        and (
            len(basis_set.columns) <= MOST_COLUMNS
            or basis_set.courses
            or _are_the_same_functions(built, basis_set.columns)
        )
    ]
    used = sorted({c for k in numbers for c in first.sets[k].columns})
    if not used:
        return None
    anew = {c: i for i, c in enumerate(used)}
    sets = [replace(first.sets[k], columns=tuple(anew[c] for c in first.sets[k].columns)) for k in numbers]
    columns = [tuple(part for at_place in built for part in at_place.contributions[c]) for c in used]
    return _Joined(tuple(numbers), tuple(sets), ColumnsByChannel.of(columns))


def _are_the_same_functions(built: Sequence[BasisSets], columns: Sequence[int]) -> bool:
    """Whether columns are at each place the same functions of the readings, as of time, and not of its own drive."""
    for number in columns:
        first, *others = (np.concatenate([shape for _, shape in of.contributions[number]]) for of in built)
        least = (1.0 - SAME_FUNCTION) * float(np.linalg.norm(first))
        for other in others:
            if other.shape != first.shape or abs(float(first @ other)) < least * float(np.linalg.norm(other)):
                return False
    return True


def _spread_over_places(
    likelihood: MarginalLikelihood,
    inputs: EffectInputs,
    built: Sequence[BasisSets],
    number: int,
    low: float,
    high: float,
) -> list[_Spread]:
    """A basis set with coefficients of each place, by their correlation."""
    basis_set = built[0].sets[number]
    _, columns = inputs.once(("spread", id(built[0]), number), lambda: (built[0], _columns_at_places(built, number)))
    at_places = basis_set.relative * len(built)
    sets, correlations = [], [correlation for correlation in CORRELATIONS if correlation < 1.0]
    for correlation in correlations:
        relative = [math.sqrt(1.0 - correlation) * r for r in at_places]
        relative += [math.sqrt(correlation) * r for r in basis_set.relative if correlation > 0.0]
        sets.append(replace(basis_set, columns=tuple(range(len(relative))), relative=tuple(relative), sign=0.0))
    found = evidence_of_basis_sets(likelihood.kept_information_and_score(columns), sets, low, high)
    return [_Spread(number, basis_set.weight, *each) for each in zip(correlations, found, strict=True)]


def _with_stiffened(
    likelihood: MarginalLikelihood,
    inputs: EffectInputs,
    built: Sequence[BasisSets],
    exact: _Spread,
    low: float,
    high: float,
) -> _Spread:
    """The same with one column for each stiffness that is left open, of what that makes of all places together, by the
    coefficients found: a product of effect and stiffness, about the likeliest effect. Not of any course."""
    every, basis_set = stiffnesses_left_open(likelihood), exact.evidence.basis_set
    if len(built[0].sets[exact.number].columns) > MOST_COLUMNS:
        return exact
    at_places = _at_places(built, exact.number)
    amounts = [
        exact.sums_at(place, len(columns)) @ exact.evidence.coefficients / exact.evidence.size
        for place, columns in enumerate(at_places)
    ]
    flat, amount = [column for columns in at_places for column in columns], np.concatenate(amounts)
    stiffened = {c: _weighted_sum([through_stiffened(inputs, c, column) for column in flat], amount) for c in every}
    stiffened = {c: column for c, column in stiffened.items() if column}
    if not stiffened:
        return exact
    columns = [*exact.contributions(built), *stiffened.values()]
    plain = replace(basis_set, columns=tuple(range(len(basis_set.relative))))
    with_all = replace(
        plain,
        columns=tuple(range(len(columns))),
        relative=(*plain.relative, *(every[c] for c in stiffened)),
    )
    without, found = evidence_of_basis_sets(likelihood.information_and_score(columns), [plain, with_all], low, high)
    gained = replace(found, log_evidence=exact.evidence.log_evidence + found.log_evidence - without.log_evidence)
    return replace(exact, evidence=gained, stiffened=tuple(stiffened), amounts=tuple(amounts))


def _by_shares(
    likelihood: MarginalLikelihood, built: Sequence[BasisSets], common: _Spread, low: float, high: float
) -> list[_Spread]:
    """A basis set with common coefficients of which each place has a share of its own, as of a heater's warmth by how
    near it stands: the shares that are likeliest with those coefficients, which are then fitted anew.

    Of sets that are too wide for coefficients of each place. Laplace's approximation for the shares, whose prior has
    the mean one and the standard deviation SHARES.
    """
    basis_set, places = built[0].sets[common.number], len(built)
    at_places = _at_places(built, common.number)
    anew = replace(basis_set, columns=tuple(range(len(basis_set.columns))), sign=0.0)
    found = common.evidence
    for _ in range(ALTERNATIONS):
        of_shares = likelihood.information_and_score([_weighted_sum(one, found.coefficients) for one in at_places])
        precision = of_shares.information + np.eye(places) / SHARES**2
        shares = np.asarray(np.linalg.solve(precision, of_shares.score + 1.0 / SHARES**2), dtype=np.float64)
        joined = [_weighted_sum(alike, shares) for alike in zip(*at_places, strict=True)]
        (found,) = evidence_of_basis_sets(likelihood.information_and_score(joined), [anew], low, high)
    _, log_determinant = np.linalg.slogdet(SHARES**2 * precision)
    cost = 0.5 * float(log_determinant) + 0.5 * float(np.sum((shares - 1.0) ** 2)) / SHARES**2
    with_cost = replace(found, log_evidence=found.log_evidence - cost)
    return [_Spread(common.number, basis_set.weight, 1.0, with_cost, shares)]


def _weighted_sum(columns: Sequence[Contributions], coefficients: Array) -> Contributions:
    """Columns added up, each with a coefficient."""
    by_channel: dict[str, Array] = {}
    for column, coefficient in zip(columns, coefficients, strict=True):
        for channel, shape in column:
            by_channel[channel] = by_channel.get(channel, 0.0) + coefficient * shape
    return tuple(by_channel.items())


def _at_places(built: Sequence[BasisSets], number: int) -> list[list[Contributions]]:
    """Columns of a basis set at each place."""
    return [[at_place.contributions[c] for c in at_place.sets[number].columns] for at_place in built]


def _columns_at_places(built: Sequence[BasisSets], number: int) -> ColumnsByChannel:
    """Columns of a basis set at each place, then each at all of them at once."""
    own = _at_places(built, number)
    common = [tuple(part for column in alike for part in column) for alike in zip(*own, strict=True)]
    return ColumnsByChannel.of([*(column for at_place in own for column in at_place), *common])
