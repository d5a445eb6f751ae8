"""Observability: the remaining share of each tolerance, and in words the combinations that the data do not determine.

Everything is scaled by noise and tolerance: readings are whitened, parameters divided by their prior standard
deviation, instruments and systematic unknowns eliminated with their own priors. A singular value s of the rest
narrows its direction to 1 / sqrt(1 + s^2) of the tolerance: below 1 the tolerance knows more than the data. The same
works for a planned campaign: only derivatives are used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.identification.combinations import known_combinations, list_terms, merge_sentences
from calibration.identification.fit import Fit
from calibration.identification.linear_system import TriangularSystem, posterior_covariance
from calibration.identification.problem import LeastSquaresProblem
from calibration.instruments.readings import Readings
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits

OPEN = 0.1  # singular value below which a direction is open: the data take less than 0.5 % off its tolerance
INSIDE = 1e-2  # rad: a known combination counts as open if it lies so close to the open directions
HELD = 0.9  # share of the tolerance that is left, above which the data hardly improve a parameter
SMALLEST = 5e-4  # coefficients below this share of the largest are not said


@dataclass(frozen=True)
class Combination:
    """Parameters that may move together without effect on the data: name to deviation (SI), and the sentence for it."""

    coefficients: Mapping[str, float]
    words: str


@dataclass(frozen=True)
class Observability:
    """How far readings determine the machine's parameters (p).

    left (p,): posterior over prior standard deviation. spectrum (p,): singular values, largest first; directions (p,
    p): their unit vectors in rows, in units of the priors' standard deviation. open: combinations that span the
    directions with a singular value below `threshold`; gap_rad: largest angle between the two.
    """

    parameters: ParameterSet
    remaining_share: Array
    spectrum: Array
    directions: Array
    open_combinations: tuple[Combination, ...]
    threshold: float
    gap_rad: float

    @property
    def n_determined(self) -> int:
        """Directions of which the data know more than the tolerances."""
        return int(np.count_nonzero(self.spectrum > 1.0))

    @property
    def sentences(self) -> tuple[str, ...]:
        """The undetermined combinations, one sentence each; similar ones are merged."""
        return merge_sentences([c.words for c in self.open_combinations])


def observability_of(fit: Fit, threshold: float = OPEN) -> Observability:
    """Observability at a fit."""
    return analyse(fit.system, fit.model.parameters, threshold)


def planned_observability(
    model: Model, visits: Visits, readings: Sequence[Readings], theta: Array | None = None, threshold: float = OPEN
) -> Observability:
    """Observability of a campaign before it is run; values of the readings do not matter.

    theta (p,): deviations at which to look, nominal if None. At nominal an unloaded machine has no internal
    forces, so that stiffness shows in nothing: a draw within the tolerances is the fairer look.
    """
    problem = LeastSquaresProblem(model, visits, tuple(readings))
    z = np.zeros(problem.layout.size)
    if theta is not None:
        z[: len(model.parameters)] = theta / model.parameters.sigma
    return analyse(problem.linearise(z), model.parameters, threshold)


def analyse(system: TriangularSystem, parameters: ParameterSet, threshold: float = OPEN) -> Observability:
    """Observability of a linearised problem whose first unknowns are the machine's parameters."""
    count = len(parameters)
    weight = np.ones(len(system.factor))
    remaining_share = np.sqrt(np.diag(posterior_covariance(system, weight)))[:count]
    _, spectrum, directions = np.linalg.svd(marginal_factor(system, count))
    loose = directions[spectrum < threshold]
    combinations = _named_combinations(loose, parameters)
    return Observability(
        parameters,
        remaining_share,
        spectrum,
        directions,
        combinations,
        threshold,
        _principal_angle(combinations, loose, parameters),
    )


def marginal_factor(system: TriangularSystem, count: int) -> Array:
    """R (count, count) of the first unknowns' information once all others are eliminated with their priors."""
    others = len(system.factor) - count
    prior = np.hstack([np.eye(others), np.zeros((others, count))])
    rows = np.hstack([system.factor[:, count:], system.factor[:, :count]])
    r = np.asarray(np.linalg.qr(np.vstack([rows, prior]), mode="r"))
    return r[others:, others:]


def _named_combinations(loose: Array, parameters: ParameterSet) -> tuple[Combination, ...]:
    """Combinations that span the open directions: known ones first, then lists of parameters for the remaining ones."""
    combinations: list[Combination] = []
    span = np.zeros((0, len(parameters)))
    for candidate in known_combinations(parameters):
        if len(span) == len(loose):
            break
        scaled = _unit_vector(candidate.coefficients, parameters)
        if np.linalg.norm(scaled - loose.T @ (loose @ scaled)) > INSIDE:
            continue
        rest = scaled - span.T @ (span @ scaled)
        size = np.linalg.norm(rest)
        if size > 0.05:
            span = np.vstack([span, rest / size])
            combinations.append(Combination(candidate.coefficients, candidate.words))
    inside = loose @ span.T
    u, s, _ = np.linalg.svd(inside) if len(span) else (np.eye(len(loose)), np.zeros(0), None)
    remainder = u[:, np.count_nonzero(s > 0.5) :].T @ loose
    return (*combinations, *(_unnamed_combination(row, parameters) for row in _row_echelon(remainder)))


def _row_echelon(basis: Array) -> Array:
    """The same span with few entries a row: reduced row echelon form with full pivoting."""
    rows = basis.copy()
    for i in range(len(rows)):
        pivot = np.unravel_index(np.argmax(np.abs(rows[i:])), rows[i:].shape)
        rows[[i, i + int(pivot[0])]] = rows[[i + int(pivot[0]), i]]
        column = int(pivot[1])
        rows[i] /= rows[i, column]
        for k in range(len(rows)):
            if k != i:
                rows[k] -= rows[k, column] * rows[i]
    return rows


def _unnamed_combination(row: Array, parameters: ParameterSet) -> Combination:
    """A combination as a list of parameters and what each would do."""
    keep = np.flatnonzero(np.abs(row) > SMALLEST * np.max(np.abs(row)))
    value = row * parameters.sigma
    coefficients = {parameters.names[i]: float(value[i]) for i in keep}
    return Combination(coefficients, list_terms(parameters, coefficients).words)


def _unit_vector(coefficients: Mapping[str, float], parameters: ParameterSet) -> Array:
    """Unit vector (p,) of a combination in units of the priors' standard deviation."""
    vector = np.array([coefficients.get(name, 0.0) for name in parameters.names]) / parameters.sigma
    return np.asarray(vector / np.linalg.norm(vector))


def _principal_angle(combinations: Sequence[Combination], loose: Array, parameters: ParameterSet) -> float:
    """Largest principal angle between what is named and what is open."""
    if not len(loose):
        return 0.0
    if len(combinations) != len(loose):
        return float(np.pi / 2.0)
    q, _ = np.linalg.qr(np.array([_unit_vector(c.coefficients, parameters) for c in combinations]).T)
    sines = np.linalg.norm(q - loose.T @ (loose @ q), ord=2)
    return float(np.arcsin(min(1.0, float(sines))))
