"""The evidence that an effect is at all of its places, and at all of them alike.

Parts of one kind that stand in one hall, carry one load and are as old as each other often err alike: all struts are
warmer than their sensor, all columns sink. At a single place such an effect may leave too little to be seen, so that a
search that takes one place after the other never begins. The coefficients at the places have the covariance
rho 11' + (1 - rho) I: a common one and a smaller one at each place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import BasisSetEvidence, evidence_of_basis_sets, log_sum
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.effects.api import BasisSet, BasisSets, Effect, EffectInputs
from calibration.effects.columns import ColumnsByChannel, Contributions

CORRELATION = 0.9  # of coefficients at two places
MOST_COLUMNS = 8  # of a basis set: more are any function, which is another at each place


@dataclass(frozen=True)
class PartAlike:
    """The effect at one of the places: its basis set with coefficients there, and the columns of that."""

    place: str
    best: BasisSetEvidence
    contributions: tuple[Contributions, ...]


@dataclass(frozen=True)
class AlikeAtAllPlaces:
    """Log evidence over `none` that an effect is at all of its places alike; its parts in the likeliest basis set."""

    log_evidence: float
    parts: tuple[PartAlike, ...]


@dataclass(frozen=True)
class _Joined:
    """Basis sets of few columns that all places have, by their numbers there, and their columns at all places at
    once, in which they are counted anew."""

    numbers: tuple[int, ...]
    sets: tuple[BasisSet, ...]
    columns: ColumnsByChannel


def alike_at_all_places(
    likelihood: MarginalLikelihood, inputs: EffectInputs, effect: Effect, low: float
) -> AlikeAtAllPlaces | None:
    """None where its places have no basis sets in common; low: its smallest size."""
    names = effect.places(inputs.machine)
    built = [effect.basis_sets(inputs, place) for place in range(len(names))]
    _, joined = inputs.once(("alike", id(effect)), lambda: (effect, _joined(built)))
    if joined is None:
        return None
    columns = likelihood.kept_information_and_score(joined.columns)
    evidence = evidence_of_basis_sets(columns, joined.sets, low, effect.size.high)
    weights = np.array([basis_set.weight for basis_set in joined.sets])
    # Sets of many columns, which are left out here, have their share of the prior at a single place too.
    weights /= max(1.0, sum(basis_set.weight for basis_set in built[0].sets))
    logs = np.array([entry.log_evidence for entry in evidence]) + np.log(weights)
    likeliest = int(np.argmax(logs))
    number = joined.numbers[likeliest]
    own = [
        tuple(at_place.contributions[c] for c in at_place.sets[number].columns) for at_place in built
    ]  # (places, columns)
    spread = _spread_over_places(likelihood, joined.sets[likeliest], own, low, effect.size.high)
    gain = max(spread.log_evidence - evidence[likeliest].log_evidence, 0.0)
    parts = [
        PartAlike(name, _at_place(spread, at_place.sets[number], place), own[place])
        for place, (name, at_place) in enumerate(zip(names, built, strict=True))
    ]
    return AlikeAtAllPlaces(float(log_sum(logs)) + gain - math.log(2.0), tuple(parts))


def _joined(built: Sequence[BasisSets]) -> _Joined | None:
    first, *others = built
    if any(len(other.sets) != len(first.sets) for other in others):
        return None
    numbers = [
        k
        for k, basis_set in enumerate(first.sets)
        if len(basis_set.columns) <= MOST_COLUMNS
        and not basis_set.one_way
        and all(other.sets[k].columns == basis_set.columns for other in others)
    ]
    used = sorted({c for k in numbers for c in first.sets[k].columns})
    if not used:
        return None
    anew = {c: i for i, c in enumerate(used)}
    sets = [replace(first.sets[k], columns=tuple(anew[c] for c in first.sets[k].columns)) for k in numbers]
    columns = [tuple(part for at_place in built for part in at_place.contributions[c]) for c in used]
    return _Joined(tuple(numbers), tuple(sets), ColumnsByChannel.of(columns))


def _spread_over_places(
    likelihood: MarginalLikelihood,
    basis_set: BasisSet,
    own: Sequence[tuple[Contributions, ...]],
    low: float,
    high: float,
) -> BasisSetEvidence:
    """The basis set with common coefficients, then with those of each place; own: the columns at each."""
    common = [tuple(part for column in alike for part in column) for alike in zip(*own, strict=True)]
    columns = [*common, *(column for at_place in own for column in at_place)]
    shared, apart = math.sqrt(CORRELATION), math.sqrt(1.0 - CORRELATION)
    relative = (*(shared * r for r in basis_set.relative), *(apart * r for r in basis_set.relative * len(own)))
    spread = replace(basis_set, columns=tuple(range(len(columns))), relative=relative, sign=0.0)
    (evidence,) = evidence_of_basis_sets(likelihood.information_and_score(columns), [spread], low, high)
    return evidence


def _at_place(spread: BasisSetEvidence, basis_set: BasisSet, place: int) -> BasisSetEvidence:
    """What belongs to one place: the sum of the common coefficients and of its own."""
    k = len(basis_set.columns)
    sums = np.zeros((k, len(spread.coefficients)))
    sums[:, :k] = np.eye(k)
    sums[:, k * (place + 1) : k * (place + 2)] = np.eye(k)
    covariance: Array = sums @ spread.covariance @ sums.T
    return BasisSetEvidence(basis_set, spread.log_evidence, spread.size, sums @ spread.coefficients, covariance)
