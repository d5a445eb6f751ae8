"""The constants of the verdict that make the right answers most probable, from the evidence that diagnoses have kept.

Of a recording the probabilities follow from the evidence of each effect, of the causes together, of departures and
alternatives, and from eight constants (`calibration.diagnosis.verdict`): no recording is looked at again. Maximised
is the log score, each source with the same weight, with a log-normal prior about the release's constants; ranges are
by Laplace's approximation. The two constants of the uncertainty of sizes are fitted likewise, apart from the others
(`sizes`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, logsumexp

from calibration.diagnosis.settings import FITTED, VERDICT, VerdictSettings

Array = NDArray[np.float64]
NONE, UNKNOWN = "none", "unknown"
BY_SIZE = ("u_of_form", "u_of_absorbed")
BY_EVIDENCE = tuple(name for name in FITTED if isinstance(getattr(VERDICT, name), float) and name not in BY_SIZE)
BY_SEARCH = tuple(name for name in FITTED if name not in (*BY_EVIDENCE, *BY_SIZE))  # these need another diagnosis
FACTOR = 2.0  # one standard deviation of the prior of a constant about the release's
FARTHEST = 8.0  # times or over the release's
LEAST_P = 1.0e-6  # a right answer that was called impossible
STEPS, START, DIFFERENCE = 800, 0.4, 0.05
QUANTILE = 1.96


class Scored(Protocol):
    """Cases that have a log score by the settings."""

    def __len__(self) -> int: ...

    def log_scores(self, settings: VerdictSettings) -> Array:
        """Of each case (n,)."""
        ...


@dataclass(frozen=True)
class Kept:
    """Evidence of cases (n): log_evidence (n, e) of effects, -inf where one was not tested; explained, excess,
    none_elsewhere, departure_gain (n,); right (n, e + 2): which of the effects, `none` and `unknown` are right."""

    names: tuple[str, ...]
    log_evidence: Array
    explained: Array
    excess: Array
    none_elsewhere: Array
    departure_gain: Array
    right: NDArray[np.bool_]

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, Any]]) -> Kept:
        """Of rows with `evidence` and `right`."""
        names = tuple(dict.fromkeys(name for row in rows for name in row["evidence"]["log_evidence"]))
        evidence = [row["evidence"] for row in rows]

        def each(key: str) -> Array:
            return np.array([e[key] for e in evidence], dtype=np.float64)

        return cls(
            names=names,
            log_evidence=np.array([[e["log_evidence"].get(name, -np.inf) for name in names] for e in evidence]),
            explained=each("explained"),
            excess=each("excess"),
            none_elsewhere=each("none_elsewhere"),
            departure_gain=each("departure_gain"),
            right=np.array([[name in row["right"] for name in (*names, NONE, UNKNOWN)] for row in rows]),
        )

    def __len__(self) -> int:
        return len(self.explained)

    def probabilities(self, settings: VerdictSettings) -> Array:
        """Of each effect, `none` and `unknown` (n, e + 2): `verdict_probabilities` of all cases at once."""
        logs = self.log_evidence
        strongest = np.max(logs, axis=1)
        explained = np.maximum(self.explained, 0.0)
        most = np.maximum(strongest, explained + self.excess)
        any_effect = expit(most - self.none_elsewhere - settings.none_prior_log_odds)
        threshold = settings.threshold_of_excess(explained)
        left_over = self.excess + settings.departure_share * self.departure_gain
        odds = settings.odds_of_unknown(left_over / threshold)
        exceeded = odds / (1.0 + odds)
        by_causes = expit(np.maximum(strongest, explained) - self.none_elsewhere - settings.none_prior_log_odds)
        any_named = np.minimum((1.0 - exceeded) * any_effect, by_causes)
        by_no_cause = (1.0 - exceeded) * any_effect - any_named
        unknown = exceeded * any_effect + by_no_cause * expit(self.excess - settings.excess_threshold)
        misleading = settings.misleading_probability
        told = (1.0 - misleading) * _tempered(logs, settings.temperature_share)
        named = (told + misleading * _tempered(logs, settings.misleading_temperature_share)) * any_named[:, None]
        return np.column_stack([named, np.maximum(1.0 - unknown - any_named, 0.0), unknown])

    def log_scores(self, settings: VerdictSettings) -> Array:
        """Logarithms (n,) of the probability of the right answers together."""
        return np.asarray(np.log(np.maximum(np.sum(self.probabilities(settings) * self.right, axis=1), LEAST_P)))

    def right_verdicts(self, settings: VerdictSettings) -> NDArray[np.bool_]:
        """Cases (n,) whose most probable answer is right."""
        best = np.argmax(self.probabilities(settings), axis=1)
        return self.right[np.arange(len(self)), best]


def _tempered(logs: Array, share: float) -> Array:
    """Probabilities (n, e) of effects from log evidence (n, e), divided by a temperature that grows with the strongest
    of each case."""
    divided = logs / (1.0 + share * np.maximum(np.max(logs, axis=1, keepdims=True), 0.0))
    return np.asarray(np.exp(divided - logsumexp(divided, axis=1, keepdims=True)))


@dataclass(frozen=True)
class Fitted:
    """Settings of highest score, and where 95 % of the posterior of each lies, (low, high) by name."""

    settings: VerdictSettings
    ranges: Mapping[str, tuple[float, float]]

    def holds(self, name: str) -> bool:
        """Whether the release's constant is within its range."""
        low, high = self.ranges[name]
        return low <= getattr(VERDICT, name) <= high


def fit(sources: Sequence[Scored], names: Sequence[str] = BY_EVIDENCE) -> Fitted:
    """The constants (k,) with these names of highest log score on some sources."""
    cost = _cost(sources, names)
    best = _lowest(cost, len(names))
    spread = _standard_deviations(cost, best)
    low, high = (values_at(best + side * QUANTILE * spread, names) for side in (-1.0, 1.0))
    ranges = {name: (float(low[k]), float(high[k])) for k, name in enumerate(names)}
    return Fitted(settings_at(best, names), ranges)


def settings_at(x: Array, names: Sequence[str] = BY_EVIDENCE) -> VerdictSettings:
    """The release's settings with those of these names times exp(x)."""
    return replace(VERDICT, **dict(zip(names, values_at(x, names).tolist(), strict=True)))


def values_at(x: Array, names: Sequence[str] = BY_EVIDENCE) -> Array:
    """Those (k,) alone."""
    return np.array([getattr(VERDICT, name) for name in names]) * np.exp(x)


def _cost(sources: Sequence[Scored], names: Sequence[str]) -> Callable[[Array], float]:
    """Negative log posterior of the logarithms (k,) of factors on the release's constants."""
    total = sum(len(kept) for kept in sources)

    def cost(x: Array) -> float:
        settings = settings_at(x, names)
        mean = float(np.mean([np.mean(kept.log_scores(settings)) for kept in sources]))
        return 0.5 * float(np.sum((x / np.log(FACTOR)) ** 2)) - total * mean

    return cost


def _lowest(cost: Callable[[Array], float], count: int) -> Array:
    bounds = [(-np.log(FARTHEST), np.log(FARTHEST))] * count
    simplex = np.vstack([np.zeros(count), START * np.eye(count)])
    options = {"maxfev": STEPS, "xatol": 1e-3, "fatol": 1e-4, "initial_simplex": simplex}
    found = minimize(cost, np.zeros(count), method="Nelder-Mead", bounds=bounds, options=options)
    return np.asarray(found.x)


def _standard_deviations(cost: Callable[[Array], float], x: Array) -> Array:
    """Of the logarithms (k,), by the second derivatives of the cost (Laplace); no larger than the prior's."""
    steps, count = DIFFERENCE * np.eye(len(x)), len(x)
    second = np.empty((count, count))
    for i in range(count):
        for j in range(i + 1):
            a, b = steps[i], steps[j]
            corners = cost(x + a + b) - cost(x + a - b) - cost(x - a + b) + cost(x - a - b)
            second[i, j] = second[j, i] = corners / (4.0 * DIFFERENCE**2)
    values, vectors = np.linalg.eigh(second)
    least = 1.0 / np.log(FACTOR) ** 2  # a floor of the probability has no second derivative
    return np.asarray(np.sqrt(np.sum(vectors**2 / np.maximum(values, least), axis=1)))
