"""The evidence of each possible change, what together explains most, and the probabilities of structures.

As in the diagnosis (docs/explanation/diagnosis-method.md): the marginal likelihood of a way's columns with everything
that both campaigns leave open, over the size of the change; alternatives without a name; at most three changes.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.comparison.candidates import LENGTHS_M, TURN_LEVER_M, Candidate, Move, MoveColumns, Way
from calibration.comparison.two_campaigns import TwoCampaigns
from calibration.diagnosis.basis_set_evidence import (
    InformationAndScore,
    evidence_of_basis_sets,
    log_evidence_of_sizes,
    log_sum,
)
from calibration.diagnosis.settings import VERDICT
from calibration.diagnosis.verdict import verdict_probabilities
from calibration.effects.api import BasisSet
from calibration.machine.description import COORDINATES, Machine

NOTHING, UNKNOWN = "nothing", "unknown"
# Chosen on pairs of campaigns of their own (docs/explanation/comparison.md).
COMPARISON_VERDICT = replace(
    VERDICT,
    none_prior_log_odds=7.0,
    excess_share=0.03,
    strong_evidence=math.inf,
    misleading_probability=0.0,
)
# Of what differs anew, over the declared levels, which are right within a factor of two (one standard deviation).
LEVELS, LEVEL_SPREAD = (0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0), math.log(2.0)
MOST_CHANGES = VERDICT.max_causes
DEGREES = {1: 6, 2: 4, 3: 3}  # of the polynomials over the workspace, by the number of commanded coordinates
LEAST_DEGREE, SHARE_OF_DEGREE = 2, 0.5


@dataclass(frozen=True)
class Found:
    """A candidate with its evidence over `nothing`, averaged over its ways, and its best way.

    coefficients (k,) and covariance (k, k): of the moves of that way, in their units. size: the most likely one.
    """

    candidate: Candidate
    log_evidence: float
    way: Way
    size: float
    coefficients: Array
    covariance: Array

    @property
    def name(self) -> tuple[str, str]:
        """Structure and place."""
        return self.candidate.structure, self.candidate.place


@dataclass(frozen=True)
class Model:
    """The model of both campaigns with some changes in it: q (m, r) as `TwoCampaigns.q`, and those changes' columns."""

    pair: TwoCampaigns
    columns: MoveColumns
    q: Array

    @classmethod
    def of(cls, pair: TwoCampaigns, level: float = 1.0, columns: MoveColumns | None = None) -> Model:
        """Without any change; level: of what differs anew from one campaign to the next, over the declared one."""
        return cls(pair, columns or MoveColumns(pair.after), pair.q)._with(level * pair.anew)

    def of_moves(self, moves: Sequence[Move]) -> Array:
        """Columns (m, k) of both campaigns by one unit of each move: what changed acts on the readings after."""
        out = np.zeros((self.pair.residual.size, len(moves)))
        weight = self.pair.weight_after
        for k, move in enumerate(moves):
            out[self.pair.of_after, k] = self.columns(move).ravel() * weight
        return out

    def apply(self, columns: Array) -> Array:
        """Inverse covariance times columns (m, k) or (m,)."""
        return np.asarray(columns - self.q @ (self.q.T @ columns))

    def including(self, way: Way, size: float) -> Model:
        """The model with a way of a change in it, of some size."""
        return self._with(self.of_moves(way.moves) * np.array([move.relative for move in way.moves]) * size)

    def _with(self, columns: Array) -> Model:
        """The model with columns (m, k), each times its prior standard deviation."""
        projected = self.apply(columns)
        upper = np.linalg.cholesky(np.eye(columns.shape[1]) + columns.T @ projected).T
        return Model(self.pair, self.columns, np.concatenate([self.q, np.linalg.solve(upper.T, projected.T).T], axis=1))

    def information_and_score(self, columns: Array) -> InformationAndScore:
        """Information and score of columns (m, k)."""
        along = self.q.T @ columns
        score = columns.T @ self.apply(self.pair.residual)
        return InformationAndScore(columns.T @ columns - along.T @ along, score)


@dataclass(frozen=True)
class Weighed:
    """What was found: all candidates, each alone, the most likely first; changes that together explain most.

    model: without changes, at the likeliest level of what differs anew. place_probability: of each change by its name,
    given its structure and the changes before it. log_evidence: of the changes together over nothing, less the penalty
    for more than one. excess: how much more changes have that depend on the place in the workspace in no way that a
    candidate could.
    """

    model: Model
    ranking: tuple[Found, ...]
    changes: tuple[Found, ...]
    place_probability: Mapping[tuple[str, str], float]
    log_evidence: float
    excess: float

    def probabilities(self) -> dict[str, float]:
        """Probability of each structure as the main change, of NOTHING and of UNKNOWN; they add up to one."""
        by_structure: dict[str, list[float]] = {}
        for found in self.ranking:
            by_structure.setdefault(found.candidate.structure, []).append(found.log_evidence)
        logs = {name: float(log_sum(np.array(values))) - math.log(len(values)) for name, values in by_structure.items()}
        named = verdict_probabilities(logs, self.log_evidence, self.excess, COMPARISON_VERDICT)
        return {{"none": NOTHING}.get(name, name): p for name, p in named.items()}

    def places(self, structure: str) -> dict[str, float]:
        """Probability of each place of a structure as the only change, given that structure."""
        return _places(self.ranking, structure)


def _places(ranking: Sequence[Found], structure: str) -> dict[str, float]:
    here = [found for found in ranking if found.candidate.structure == structure]
    logs = np.array([found.log_evidence for found in here])
    logs = logs / (1.0 + VERDICT.temperature_share * max(float(logs.max()), 0.0))
    return {found.candidate.place: float(p) for found, p in zip(here, np.exp(logs - log_sum(logs)), strict=True)}


def weigh(pair: TwoCampaigns, every: Sequence[Candidate]) -> Weighed:
    """Rank all candidates; include changes as long as each adds enough; compare with what has no name.

    All at the level of what differs anew that is most likely with the best candidate; `nothing` at all levels together.
    """
    model, ranking, shift = _at_likeliest_level(pair, every)
    changes: list[Found] = []
    sure: dict[tuple[str, str], float] = {}
    log_evidence, excess_over = 0.0, shift + _log_evidence_of_any(model)
    ranked, now = ranking, model
    while ranked and len(changes) < MOST_CHANGES:
        gain = ranked[0].log_evidence - math.log(len(every))
        if gain < _least_gain(ranked[0], changes, log_evidence):
            break
        if changes:
            gain -= VERDICT.further_cause_penalty + VERDICT.further_cause_penalty_share * (log_evidence + gain)
        changes.append(ranked[0])
        sure[ranked[0].name] = _places(ranked, ranked[0].candidate.structure)[ranked[0].candidate.place]
        log_evidence += gain
        now = now.including(ranked[0].way, ranked[0].size)
        excess_over = max(excess_over, log_evidence + _log_evidence_of_any(now))
        ranked = rank(now, [c for c in every if c not in {change.candidate for change in changes}])
    return Weighed(
        model, tuple(ranking), _refitted(model, changes), sure, log_evidence, max(excess_over - log_evidence, 0.0)
    )


def _at_likeliest_level(pair: TwoCampaigns, every: Sequence[Candidate]) -> tuple[Model, list[Found], float]:
    """The model at that level; all candidates, their evidence over that of nothing at all levels; nothing's at this."""
    columns = MoveColumns(pair.after)
    bare = Model(pair, columns, pair.q).information_and_score(pair.anew)
    priors = np.exp(-0.5 * (np.log(LEVELS) / LEVEL_SPREAD) ** 2)
    of_nothing = np.log(priors / priors.sum()) + log_evidence_of_sizes(bare, np.array(LEVELS))
    models = [Model.of(pair, level, columns) for level in LEVELS]
    rankings = [rank(model, every) for model in models]
    best = int(np.argmax([log + ranking[0].log_evidence for log, ranking in zip(of_nothing, rankings, strict=True)]))
    shift = float(of_nothing[best] - log_sum(of_nothing))
    return models[best], [replace(found, log_evidence=found.log_evidence + shift) for found in rankings[best]], shift


def _least_gain(found: Found, changes: Sequence[Found], explained: float) -> float:
    same = any(found.candidate.place == change.candidate.place for change in changes)
    share = VERDICT.min_gain_share_same_part if same else VERDICT.min_gain_share
    if not changes:
        return VERDICT.detection_threshold
    penalty = VERDICT.further_cause_penalty + VERDICT.further_cause_penalty_share * explained
    return max(VERDICT.detection_threshold, share * explained) + penalty


def rank(model: Model, every: Sequence[Candidate]) -> list[Found]:
    """Evidence of all candidates, the most likely first."""
    moves = list(dict.fromkeys(move for candidate in every for way in candidate.ways for move in way.moves))
    number = {move: k for k, move in enumerate(moves)}
    weighed = model.information_and_score(model.of_moves(moves))
    return sorted((_found(candidate, number, weighed) for candidate in every), key=lambda found: -found.log_evidence)


def _found(candidate: Candidate, number: dict[Move, int], weighed: InformationAndScore) -> Found:
    by_way = []
    for way in candidate.ways:
        basis = BasisSet(tuple(number[move] for move in way.moves), tuple(move.relative for move in way.moves))
        by_way.append(evidence_of_basis_sets(weighed, [basis], *way.limits)[0])
    logs = np.array([evidence.log_evidence for evidence in by_way])
    best = int(np.argmax(logs))
    evidence = by_way[best]
    return Found(
        candidate,
        float(log_sum(logs)) - math.log(len(logs)),
        candidate.ways[best],
        evidence.size,
        evidence.coefficients,
        evidence.covariance,
    )


def _refitted(model: Model, changes: Sequence[Found]) -> tuple[Found, ...]:
    """The changes, each fitted again with the others in the model."""
    if len(changes) < 2:
        return tuple(changes)
    out = []
    for number, change in enumerate(changes):
        others = model
        for other in (*changes[:number], *changes[number + 1 :]):
            others = others.including(other.way, other.size)
        out.append(rank(others, [Candidate(*change.name, (change.way,))])[0])
    return tuple(sorted(out, key=lambda change: -change.log_evidence))


def _log_evidence_of_any(model: Model) -> float:
    """Evidence of a change of the platform's pose that is a smooth function of the place in the workspace, no more."""
    columns, relative = _polynomials(model)
    weighed = model.information_and_score(columns)
    basis = BasisSet(tuple(range(columns.shape[1])), tuple(relative))
    return evidence_of_basis_sets(weighed, [basis], *LENGTHS_M)[0].log_evidence


def _polynomials(model: Model) -> tuple[Array, list[float]]:
    """Columns (m, k) of the pose's coordinates times polynomials of the commanded ones; their relative sizes (k,)."""
    linear = model.pair.after
    machine = linear.machine
    shapes = _shapes(machine, linear.places())
    out, relative = [], []
    for coordinate in machine.dof:
        response = model.columns(Move("pose", "", 1.0, channel=f"pose.{COORDINATES[coordinate]}"))
        for degree, shape in shapes:
            column = np.zeros(model.pair.residual.size)
            at = np.where(linear.visit >= 0, shape[np.maximum(linear.visit, 0)], 0.0)
            column[model.pair.of_after] = (response * at[:, None]).ravel() * model.pair.weight_after
            out.append(column)
            relative.append(SHARE_OF_DEGREE**degree / (TURN_LEVER_M if coordinate > 2 else 1.0))
    return np.stack(out, axis=1), relative


def _shapes(machine: Machine, places: Array) -> list[tuple[int, Array]]:
    """Polynomials (v,) of the commanded coordinates (v, c) of visits, each with its degree."""
    low, high = machine.commanded_limits.T
    place = (places - 0.5 * (low + high)) / np.maximum(0.5 * (high - low), 1e-9)
    return [(int(sum(powers)), np.prod(place**powers, axis=1)) for powers in _powers(place.shape[1])]


def _powers(count: int) -> Iterator[Array]:
    degree = DEGREES.get(count, LEAST_DEGREE)
    for powers in itertools.product(range(degree + 1), repeat=count):
        if sum(powers) <= degree:
            yield np.array(powers)


def largest_hidden_change_m(weighed: Weighed) -> float:
    """RMS of a smooth change of the tool's place that the readings still allow (95 %), what was found in the model."""
    model = weighed.model
    for change in weighed.changes:
        model = model.including(change.way, change.size)
    columns, relative = _polynomials(model)
    weighed_columns = model.information_and_score(columns * np.array(relative))
    sizes = np.geomspace(1.0e-8, 1.0e-3, 60)
    logs = log_evidence_of_sizes(weighed_columns, sizes)
    share = np.cumsum(np.exp(logs - logs.max()))
    machine, places = model.pair.after.machine, model.pair.after.places()
    shapes = np.stack([SHARE_OF_DEGREE**degree * shape for degree, shape in _shapes(machine, places)], axis=1)
    moving = int(np.sum(machine.dof < 3))
    spread = float(np.sqrt(moving * np.mean(np.sum(shapes**2, axis=1))))
    return float(sizes[int(np.searchsorted(share / share[-1], 0.95))]) * spread


def equivalents(weighed: Weighed, first: Found) -> tuple[tuple[Found, ...], float]:
    """Candidates that the readings tell no more from the first change than its own columns; the largest difference.

    As the diagnosis has it: not excluded by their evidence, and with their columns in the model less than 0.3 sigma RMS
    of what the first change does to the platform's readings is left.
    """
    model = weighed.model
    for other in weighed.changes:
        if other is not first:
            model = model.including(other.way, other.size)
    alone = next(found for found in weighed.ranking if found.name == first.name)
    signal = model.of_moves(first.way.moves) @ first.coefficients
    threshold = VERDICT.distinguishable + VERDICT.distinguishable_share * alone.log_evidence
    names, largest = [], 0.0
    for rival in weighed.ranking:
        if rival.name == first.name or rival.log_evidence < alone.log_evidence - threshold:
            continue
        if set(first.way.moves) <= set(rival.way.moves):  # it may do the same and more: the evidence has decided
            continue
        left = model.pair.largest_rms(model.including(rival.way, rival.size).apply(signal))
        if left < VERDICT.equivalent_sigma:
            names.append(rival)
            largest = max(largest, left)
    return tuple(names), largest
