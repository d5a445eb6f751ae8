"""The evidence of an effect that departs from its form.

A basis set is an exact statement, which no real part obeys, and the stronger the signal, the more a small departure
costs. Beside the exact form there are therefore the form times a smooth function of one coordinate or of all of them: a
little of any coordinate, wholly of those with which the effect's strength may vary; and for effects that are another
one at each stop, times a number of its own for each visit (of a drive's, where it comes with the side of the approach).
A general function has no form to depart from, but may change with a coordinate: then each of its columns is multiplied
by functions of that one. Departures are a share of what is *seen* of the form: otherwise a form that the calibration
absorbs could become anything. That is just what a form may do which is anew at each visit.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import (
    BasisSetEvidence,
    evidence_of_basis_sets,
    log_sum,
)
from calibration.diagnosis.chance import are_by_chance
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.one_way import judge_courses, loss_of_one_way
from calibration.diagnosis.settings import VERDICT
from calibration.effects.api import PERIOD, Departure, Effect, EffectInputs
from calibration.effects.columns import Contributions
from calibration.effects.departures import (
    STIFFNESS,
    VISIT,
    departing,
    functions_it_varies_with,
    functions_of_change,
    functions_of_coordinates,
    through_stiffened,
)

SMOOTH_SHARES, SHARES_BY_VISIT = VERDICT.smooth_departures, VERDICT.departures_by_visit
SHARES_ANEW = (1.0, 4.0)  # of what is anew at each visit, over the form itself, whatever is seen of that
NOTHING = 1e-300
# Share of the readings at which a strength of known sign may have the opposite one, by more than a share of its RMS.
FEW, LITTLE = 0.05, 0.3
MOST_MAIN_COLUMNS = 3  # more are a general function already, which has no form to depart from a little
MOST_CHANGING, MOST_PRODUCTS = 60, 120  # columns of a general function that may change, and their products
ONE_SIDED = 0.9  # of the square of a form at each side of the approach, which has one sign there
FEWEST_BY_CHANCE = 30  # visits, of which chance can be told from a course
LEAST_U_OF_STIFFNESS = 0.01  # of a logarithm: what is known better changes no response
MOST_PRODUCTS_A_VISIT = 0.5  # of more than half as many as visits one fits nearly anything that differs by visit

_Kind = Literal["exact", "a little", "wholly", "by visit"]


@dataclass(frozen=True)
class _Way:
    """One way of departing from a form: its prior over that of the exact form, its departures, and the standard
    deviation of each, over the size."""

    kind: _Kind
    prior: float
    departures: tuple[Departure, ...] = ()
    scales: tuple[float, ...] = ()


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
    anew: bool = False,
) -> DepartingEvidence:
    """An effect's basis set, of columns `contributions`, and its departures; low: its smallest size.

    by_visit: whether an effect that is another at each stop may be so; anew: whether its form may be anything then.
    """
    main = [i for i, relative in enumerate(exact.basis_set.relative) if relative >= 1.0]
    if exact.basis_set.curve is not None:  # the others are derivatives
        main = main[:1]
    general = len(main) > MOST_MAIN_COLUMNS
    period_m = exact.basis_set.parameters.get(PERIOD, 0.0)
    a_little, wholly = _functions_to_depart_by(inputs, effect, place, 0 if anew else len(main), period_m)
    stiffened = {} if anew else _of_uncertain_stiffness(likelihood, inputs, main, contributions)
    if general and not wholly and not stiffened:
        return DepartingEvidence(0.0, 0.0, exact, tuple(contributions))
    of_coordinate = {
        coordinate: [Departure(i, coordinate, term, period_m) for i in main for term in range(functions.shape[1])]
        for coordinate, functions in (a_little | wholly).items()
    }
    comes_with_side = bool(main) and _comes_with_side(inputs, effect, place, contributions[main[0]])
    may_differ = by_visit and not general and (anew or comes_with_side)
    fluctuating = _departures_by_visit(inputs, effect, main if anew else main[:1]) if may_differ else []
    departures = [departure for group in (stiffened, *of_coordinate.values(), fluctuating) for departure in group]
    columns = (*contributions, *departing(inputs, effect, place, contributions, departures))
    information = likelihood.information_and_score(columns)
    seen = dict(zip(departures, np.diag(information.information)[len(contributions) :].tolist(), strict=True))
    seen_of_form = float(np.sum(np.diag(information.information)[main]))

    ways = _all_ways(of_coordinate, a_little, wholly, fluctuating, seen, seen_of_form, general=general, anew=anew)
    number = {departure: len(contributions) + i for i, departure in enumerate(departures)}
    own = tuple(range(len(contributions)))
    sets = [
        replace(
            exact.basis_set,
            columns=(*own, *(number[departure] for departure in (*stiffened, *way.departures))),
            relative=(*exact.basis_set.relative, *stiffened.values(), *way.scales),
        )
        for way in ways
    ]
    plain = replace(exact.basis_set, columns=own)
    without, *evidence = evidence_of_basis_sets(information, [plain, *sets], low, effect.size.high)
    priors = np.array([way.prior for way in ways])
    logs = np.array([entry.log_evidence for entry in evidence]) + np.log(priors / priors.sum())
    anywhere = anew and effect.place == "smr"  # where nothing else acts
    possible = [
        anywhere or _is_possible(entry, way, wholly, inputs, information.information, anew=anew)
        for entry, way in zip(evidence, ways, strict=True)
    ]
    logs[np.logical_not(possible)] = -np.inf
    judge_courses(evidence, logs)
    likeliest = int(np.argmax(logs))
    best, departures_of_best = evidence[likeliest], (*stiffened, *ways[likeliest].departures)
    basis_set = replace(best.basis_set, columns=exact.basis_set.columns, departures=departures_of_best)
    log_evidence = float(log_sum(logs))
    expected = [i for i, way in enumerate(ways) if way.kind in ("exact", "wholly")]
    log_expected = float(log_sum(logs[expected]) - np.log(priors[expected].sum() / priors.sum()))
    return DepartingEvidence(
        log_evidence - (without.log_evidence - loss_of_one_way(without)),
        0.0 if ways[likeliest].kind == "by visit" else max(log_evidence - log_expected, 0.0),
        replace(best, basis_set=basis_set),
        tuple(columns[c] for c in best.basis_set.columns),
    )


def _all_ways(
    of_coordinate: Mapping[str, Sequence[Departure]],
    a_little: Collection[str],
    wholly: Collection[str],
    fluctuating: Sequence[Departure],
    seen: Mapping[Departure, float],
    seen_of_form: float,
    *,
    general: bool,
    anew: bool,
) -> list[_Way]:
    """The exact form, and all ways of departing from it; seen: information of each departure, and of the form."""

    def way(kind: _Kind, prior: float, share: float, *groups: Sequence[Departure]) -> _Way:
        """Departures whose groups have a share of the form together, but no more than of what is seen of the form."""
        each, scales = share / math.sqrt(len(groups)), list[float]()
        for group in groups:
            total = sum(seen[departure] for departure in group)
            seen_share = math.sqrt(seen_of_form / max(total, NOTHING))
            free = kind == "by visit" and anew
            scales += [each if free else each * min(1.0, seen_share)] * len(group)
        return _Way(kind, prior, tuple(d for group in groups for d in group), tuple(scales))

    def all_and_each(kind: _Kind, prior: float, share: float, coordinates: Collection[str]) -> list[_Way]:
        """Half the prior for all coordinates together, but of a general function; the other half for each alone."""
        groups = [of_coordinate[coordinate] for coordinate in coordinates]
        together = [] if general or not groups else [way(kind, 0.5 * prior, share, *groups)]
        return together + [way(kind, 0.5 * prior / len(groups), share, group) for group in groups]

    ways = [_Way("exact", 1.0)]
    for share in SMOOTH_SHARES:
        ways += all_and_each("a little", 2.0 / len(SMOOTH_SHARES), share, a_little)
    for share in VERDICT.dependence_shares:
        ways += all_and_each("wholly", 1.0 / len(VERDICT.dependence_shares), share, wholly)
    shares_by_visit = SHARES_ANEW if anew else SHARES_BY_VISIT
    for share in shares_by_visit if fluctuating else ():
        ways.append(way("by visit", 1.0 / len(shares_by_visit), share, fluctuating))
    return ways


def _of_uncertain_stiffness(
    likelihood: MarginalLikelihood, inputs: EffectInputs, main: Sequence[int], contributions: Sequence[Contributions]
) -> dict[Departure, float]:
    """How a form may move the platform otherwise than at the stiffnesses that the readings were linearised at; the
    standard deviation of each, over the size: that which is left of the stiffness's logarithm.

    In a machine that is held by more parts than it needs, which way one of them moves it depends on how stiff the
    others are. Effect and stiffness enter as a product, which no sum of the two has. Of functions of so many columns
    that they could be anything none.
    """
    left_open = stiffnesses_left_open(likelihood)
    if len(main) * len(left_open) > MOST_PRODUCTS:
        return {}
    return {
        Departure(i, STIFFNESS, constraint): u
        for i in main
        for constraint, u in left_open.items()
        if through_stiffened(inputs, constraint, contributions[i])
    }


def stiffnesses_left_open(likelihood: MarginalLikelihood) -> dict[int, float]:
    """Standard uncertainties of the logarithms of stiffnesses that are known badly enough to matter."""
    return {c: u for c, u in likelihood.linear.u_of_ln_stiffness.items() if u > LEAST_U_OF_STIFFNESS}


def _functions_to_depart_by(
    inputs: EffectInputs, effect: Effect, place: int, columns: int, period_m: float
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Functions by which a form of some columns departs a little, and wholly; of none, what is anything already."""
    if not columns:
        return {}, {}
    if columns > MOST_MAIN_COLUMNS:
        return {}, _functions_of_change(inputs, effect, place, columns)
    a_little = functions_of_coordinates(inputs, effect, place)
    return a_little, functions_it_varies_with(inputs, effect, place, period_m)


def _functions_of_change(inputs: EffectInputs, effect: Effect, place: int, columns: int) -> dict[str, Array]:
    """Functions of each coordinate with which a general function of some columns may change, if not too many."""
    if columns > MOST_CHANGING:
        return {}
    most = min(MOST_PRODUCTS, MOST_PRODUCTS_A_VISIT * len(np.unique(inputs.context.arrival)))
    every = functions_of_change(inputs, effect, place)
    return {name: functions for name, functions in every.items() if columns * functions.shape[1] <= most}


def _comes_with_side(inputs: EffectInputs, effect: Effect, place: int, form: Contributions) -> bool:
    """Whether a form of a drive goes with the side of the approach, as what a stop leaves of friction or play does.

    What the weight winds up is the same after each stop: numbers for the visits would make it anything.
    """
    if effect.place != "drive":
        return True
    side = inputs.context.direction[:, place]

    def is_mostly(sign: float, of_side: float) -> bool:
        there = [shape[of_side * side > 0.0] for _, shape in form]
        return sum(float(np.sum(x[sign * x > 0.0] ** 2)) for x in there) > ONE_SIDED * sum(float(x @ x) for x in there)

    return any(is_mostly(sign, 1.0) and is_mostly(-sign, -1.0) for sign in (1.0, -1.0))


def _departures_by_visit(inputs: EffectInputs, effect: Effect, columns: Sequence[int]) -> list[Departure]:
    """Those of an effect that is another one at each visit, by some of its columns."""
    visits = np.unique(inputs.context.arrival).tolist() if effect.differs_by_visit else []
    return [Departure(i, VISIT, visit) for i in columns for visit in visits]


def _is_possible(
    entry: BasisSetEvidence,
    way: _Way,
    functions: Mapping[str, Array],
    inputs: EffectInputs,
    information: Array,
    *,
    anew: bool,
) -> bool:
    """Whether what was found of a way of departing is something that the effect may do."""
    if way.kind == "a little":
        return not _outweighs_its_form(entry, len(way.departures), information)
    if way.kind == "by visit":
        return (_is_by_chance if anew else _is_share_of_form)(entry, way.departures, inputs)
    return way.kind != "wholly" or not _turns(entry, way.departures, functions)


def _outweighs_its_form(entry: BasisSetEvidence, count: int, information: Array) -> bool:
    """Whether more is seen of its last columns, which depart from a form, than of the basis set without them: a little
    of next to nothing is nothing, and a size that the other columns do not bear out would make it anything."""
    columns, coefficients = np.array(entry.basis_set.columns), entry.coefficients

    def seen(part: slice) -> float:
        number, of_part = columns[part], coefficients[part]
        return float(of_part @ information[np.ix_(number, number)] @ of_part)

    return seen(slice(-count, None)) > seen(slice(0, -count))


def _turns(entry: BasisSetEvidence, departures: Sequence[Departure], functions: Mapping[str, Array]) -> bool:
    """Whether an effect whose sign mechanics knows has the opposite one at more than a few readings by more than a
    little."""
    if not entry.basis_set.sign:
        return False
    strength = entry.coefficients[0] + sum(
        coefficient * functions[departure.coordinate][:, departure.term]
        for coefficient, departure in zip(entry.coefficients[-len(departures) :], departures, strict=True)
        if departure.column == 0
    )
    least = -LITTLE * float(np.sqrt(np.mean(strength**2)))
    return bool(np.mean(strength * entry.basis_set.sign < least) > FEW)


def _is_share_of_form(entry: BasisSetEvidence, departures: Sequence[Departure], _: EffectInputs) -> bool:
    """Whether what differs by visit may be shares, zero to all, of what acts: then it scatters less than its mean."""
    scatter = np.sqrt(np.mean(entry.coefficients[-len(departures) :] ** 2))
    return bool(scatter < abs(entry.coefficients[departures[0].column]))


def _is_by_chance(entry: BasisSetEvidence, departures: Sequence[Departure], inputs: EffectInputs) -> bool:
    """Whether what is anew at each visit does not follow from when and where that was: neighbours in time, or along
    the travel of a drive, are no more alike than chance has it."""
    coefficients = np.asarray(entry.coefficients[-len(departures) :])
    if len({departure.term for departure in departures}) < FEWEST_BY_CHANCE:
        return False
    column, visit = np.array([(d.column, d.term) for d in departures]).T
    visits, at = np.unique(inputs.context.arrival, return_index=True)
    along = np.column_stack([inputs.context.t_s[at], inputs.context.drives[at]])[np.searchsorted(visits, visit)]
    return all(are_by_chance(coefficients[column == number], along[column == number]) for number in np.unique(column))
