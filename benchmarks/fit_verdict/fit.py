"""The constants of the verdict that make the right answers most probable, from the evidence that diagnoses have kept.

Of a recording the probabilities follow from the evidence of each effect, of the causes together, of alternatives, and
from six constants (`calibration.diagnosis.verdict`): no recording is looked at again. Maximised is the log score, each
source with the same weight, with a log-normal prior about the release's constants; ranges are by bootstrap over cases.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, logsumexp

from calibration.diagnosis.settings import FITTED, VERDICT, VerdictSettings

Array = NDArray[np.float64]
NONE, UNKNOWN = "none", "unknown"
BY_EVIDENCE = tuple(name for name in FITTED if isinstance(getattr(VERDICT, name), float))
BY_SEARCH = tuple(name for name in FITTED if name not in BY_EVIDENCE)  # these need another diagnosis
FACTOR = 2.0  # one standard deviation of the prior of a constant about the release's
FARTHEST = 8.0  # times or over the release's
LEAST_P = 1.0e-6  # a right answer that was called impossible
SEED, STEPS = 7, 400


@dataclass(frozen=True)
class Kept:
    """Evidence of cases (n): log_evidence (n, e) of effects, -inf where one was not tested; explained, excess,
    none_elsewhere (n,); right (n, e + 2): which of the effects, `none` and `unknown` are right."""

    names: tuple[str, ...]
    log_evidence: Array
    explained: Array
    excess: Array
    none_elsewhere: Array
    right: NDArray[np.bool_]

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, Any]]) -> Kept:
        """Of rows with `evidence` and `right`."""
        names = tuple(dict.fromkeys(name for row in rows for name in row["evidence"]["log_evidence"]))
        evidence = [row["evidence"] for row in rows]
        return cls(
            names,
            np.array([[e["log_evidence"].get(name, -np.inf) for name in names] for e in evidence]),
            *(np.array([e[key] for e in evidence]) for key in ("explained", "excess", "none_elsewhere")),
            np.array([[name in row["right"] for name in (*names, NONE, UNKNOWN)] for row in rows]),
        )

    def __len__(self) -> int:
        return len(self.explained)

    def take(self, rows: NDArray[np.intp]) -> Kept:
        """Some cases, which may be repeated."""
        return replace(
            self,
            log_evidence=self.log_evidence[rows],
            explained=self.explained[rows],
            excess=self.excess[rows],
            none_elsewhere=self.none_elsewhere[rows],
            right=self.right[rows],
        )

    def probabilities(self, settings: VerdictSettings) -> Array:
        """Of each effect, `none` and `unknown` (n, e + 2): `verdict_probabilities` of all cases at once."""
        logs = self.log_evidence
        strongest = np.max(logs, axis=1)
        explained = np.maximum(self.explained, 0.0)
        most = np.maximum(strongest, explained + self.excess)
        any_effect = expit(most - self.none_elsewhere - settings.none_prior_log_odds)
        width = settings.excess_width + settings.excess_width_share * explained
        threshold = settings.excess_threshold + settings.excess_share * explained
        unknown = expit((self.excess - threshold) / width)
        tempered = logs / (1.0 + settings.temperature_share * np.maximum(strongest, 0.0))[:, None]
        named = np.exp(tempered - logsumexp(tempered, axis=1, keepdims=True)) * (any_effect * (1.0 - unknown))[:, None]
        return np.column_stack([named, 1.0 - any_effect, any_effect * unknown])

    def log_scores(self, settings: VerdictSettings) -> Array:
        """Logarithms (n,) of the probability of the right answers together."""
        return np.asarray(np.log(np.maximum(np.sum(self.probabilities(settings) * self.right, axis=1), LEAST_P)))

    def right_verdicts(self, settings: VerdictSettings) -> NDArray[np.bool_]:
        """Cases (n,) whose most probable answer is right."""
        best = np.argmax(self.probabilities(settings), axis=1)
        return self.right[np.arange(len(self)), best]


@dataclass(frozen=True)
class Fitted:
    """Settings of highest score, and where the middle 95 % of bootstrap samples lie, (low, high) by name."""

    settings: VerdictSettings
    ranges: Mapping[str, tuple[float, float]]

    def holds(self, name: str) -> bool:
        """Whether the release's constant is within its range."""
        low, high = self.ranges[name]
        return low <= getattr(VERDICT, name) <= high


def fit(sources: Sequence[Kept], samples: int) -> Fitted:
    """The constants of highest log score on some sources; samples: of the bootstrap."""
    best = _highest(sources, np.zeros(len(BY_EVIDENCE)))
    rng = np.random.default_rng(SEED)
    drawn = []
    for _ in range(samples):
        again = [kept.take(rng.integers(0, len(kept), len(kept))) for kept in sources]
        drawn.append(_values(_highest(again, best)))
    spread = np.quantile(drawn, [0.025, 0.975], axis=0) if drawn else np.tile(_values(best), (2, 1))
    ranges = {name: (float(spread[0, k]), float(spread[1, k])) for k, name in enumerate(BY_EVIDENCE)}
    return Fitted(settings_at(best), ranges)


def settings_at(x: Array) -> VerdictSettings:
    """The release's settings with those of BY_EVIDENCE times exp(x)."""
    return replace(VERDICT, **dict(zip(BY_EVIDENCE, _values(x).tolist(), strict=True)))


def _values(x: Array) -> Array:
    return np.array([getattr(VERDICT, name) for name in BY_EVIDENCE]) * np.exp(x)


def _highest(sources: Sequence[Kept], start: Array) -> Array:
    """Logarithms (k,) of factors on the release's constants."""
    total = sum(len(kept) for kept in sources)

    def cost(x: Array) -> float:
        settings = settings_at(x)
        mean = float(np.mean([np.mean(kept.log_scores(settings)) for kept in sources]))
        return 0.5 * float(np.sum((x / np.log(FACTOR)) ** 2)) - total * mean

    bounds = [(-np.log(FARTHEST), np.log(FARTHEST))] * len(start)
    found = minimize(cost, start, method="Nelder-Mead", bounds=bounds, options={"maxfev": STEPS, "xatol": 1e-2})
    return np.asarray(found.x)
