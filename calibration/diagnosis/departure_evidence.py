"""The evidence of an effect that departs from its form.

A basis set is an exact statement, which no real part obeys, and the stronger the signal, the more a small departure
costs. Beside the exact form there are therefore the form times a smooth function of one coordinate or, a little, of all
of them; and for effects that are another one at each stop, times a number of its own for each visit. Departures are a
share of what is *seen* of the form: otherwise a form that the calibration absorbs could become anything.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.diagnosis.basis_set_evidence import (
    BasisSetEvidence,
    evidence_of_basis_sets,
    log_sum,
)
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import Departure, Effect, EffectInputs
from calibration.effects.columns import Contributions
from calibration.effects.departures import VISIT, departing, functions_it_varies_with, functions_of_coordinates

SMOOTH_SHARES, SHARES_BY_VISIT = VERDICT.smooth_departures, VERDICT.departures_by_visit
NOTHING = 1e-300
DEPENDENCE_WEIGHT = 0.5  # prior of an effect whose strength depends on something, over that of its exact form
MOST_MAIN_COLUMNS = 3  # more are an arbitrary function already, which has no form to depart from


@dataclass(frozen=True)
class DepartingEvidence:
    """Log evidence of a basis set with all its departures, the best of them with its columns.

    gain: of log evidence over the exact form; a little below zero where that explains all. unexpected: of that, what
    smooth departures add with coordinates on which its strength is not expected to depend.
    """

    gain: float
    unexpected: float
    best: BasisSetEvidence
    contributions: tuple[Contributions, ...]


def with_departures(
    likelihood: MarginalLikelihood,
    inputs: EffectInputs,
    effect: Effect,
    place: int,
    exact: BasisSetEvidence,
    contributions: Sequence[Contributions],
    low: float,
    *,
    by_visit: bool,
) -> DepartingEvidence:
    """An effect's basis set, of columns `contributions`, and its departures; low: its smallest size.

    by_visit: whether an effect that is another at each stop may be so.
    """
    main = [i for i, relative in enumerate(exact.basis_set.relative) if relative >= 1.0]
    if exact.basis_set.curve is not None:  # the others are derivatives
        main = main[:1]
    if len(main) > MOST_MAIN_COLUMNS:
        return DepartingEvidence(0.0, 0.0, exact, tuple(contributions))
    of_coordinates = {
        coordinate: [Departure(i, coordinate, term) for i in main for term in range(functions.shape[1])]
        for every in (functions_of_coordinates, functions_it_varies_with)
        for coordinate, functions in every(inputs, effect, place).items()
    }
    smooth = [of_coordinates[coordinate] for coordinate in functions_of_coordinates(inputs, effect, place)]
    expected = [of_coordinates[coordinate] for coordinate in functions_it_varies_with(inputs, effect, place)]
    visits = np.unique(inputs.context.arrival) if by_visit and effect.differs_by_visit else ()
    fluctuating = [Departure(main[0], VISIT, int(arrival)) for arrival in visits]
    departures = [departure for group in (*of_coordinates.values(), fluctuating) for departure in group]
    columns = (*contributions, *departing(inputs, effect, place, contributions, departures))
    information = likelihood.information_and_score(columns)
    seen = dict(zip(departures, np.diag(information.information)[len(contributions) :].tolist(), strict=True))
    seen_of_form = float(np.sum(np.diag(information.information)[main]))

    def scales(group: Sequence[Departure], share: float) -> list[float]:
        """Standard deviations relative to the size: a share of the form, and of what is seen of the form."""
        total = sum(seen[departure] for departure in group)
        return [share * min(1.0, math.sqrt(seen_of_form / max(total, NOTHING)))] * len(group)

    # Each way has one share of the prior, and within it each coordinate and each size of a departure the same.
    ways: list[tuple[float, list[Departure], list[float]]] = [(1.0, [], [])]
    for share in SMOOTH_SHARES if smooth else ():
        each = share / math.sqrt(len(smooth))
        together = [scale for group in smooth for scale in scales(group, each)]
        ways.append((1.0 / len(SMOOTH_SHARES), [d for group in smooth for d in group], together))
        prior = 1.0 / len(SMOOTH_SHARES) / len(smooth)
        ways += [(prior, group, scales(group, share)) for group in smooth]
    first_expected = len(ways)
    for share in VERDICT.dependence_shares if expected else ():
        weight = DEPENDENCE_WEIGHT / len(VERDICT.dependence_shares)
        each = share / math.sqrt(len(expected))
        together = [scale for group in expected for scale in scales(group, each)]
        ways.append((weight, [d for group in expected for d in group], together))
        ways += [(weight / len(expected), group, scales(group, share)) for group in expected]
    first_fluctuating = len(ways)
    for share in SHARES_BY_VISIT if fluctuating else ():
        ways.append((1.0 / len(SHARES_BY_VISIT), fluctuating, scales(fluctuating, share)))
    number = {departure: len(contributions) + i for i, departure in enumerate(departures)}
    own = tuple(range(len(contributions)))
    sets = [
        replace(
            exact.basis_set,
            columns=(*own, *(number[departure] for departure in group)),
            relative=(*exact.basis_set.relative, *relative),
        )
        for _, group, relative in ways
    ]
    evidence = evidence_of_basis_sets(information, sets, low, effect.size.high)
    priors = np.array([prior for prior, _, _ in ways])
    logs = np.array([entry.log_evidence for entry in evidence]) + np.log(priors / priors.sum())
    logs[[not _is_share_of_form(entry, group) for entry, (_, group, _) in zip(evidence, ways, strict=True)]] = -np.inf
    likeliest = int(np.argmax(logs))
    best, group = evidence[likeliest], tuple(ways[likeliest][1])
    basis_set = replace(best.basis_set, columns=exact.basis_set.columns, departures=group)
    log_evidence = float(log_sum(logs))
    as_expected = [0, *range(first_expected, first_fluctuating)]
    log_expected = float(log_sum(logs[as_expected]) - np.log(priors[as_expected].sum() / priors.sum()))
    return DepartingEvidence(
        log_evidence - evidence[0].log_evidence,
        0.0 if likeliest >= first_fluctuating else max(log_evidence - log_expected, 0.0),
        replace(best, basis_set=basis_set),
        tuple(columns[c] for c in best.basis_set.columns),
    )


def _is_share_of_form(entry: BasisSetEvidence, departures: Sequence[Departure]) -> bool:
    """Whether what differs by visit may be shares, zero to all, of what acts: then it scatters less than its mean."""
    if not departures or departures[0].coordinate != VISIT:
        return True
    scatter = np.sqrt(np.mean(entry.coefficients[-len(departures) :] ** 2))
    return bool(scatter < abs(entry.coefficients[departures[0].column]))
