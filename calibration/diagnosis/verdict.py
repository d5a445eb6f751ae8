"""From evidence to probabilities.

Evidence assumes that a basis set is exact, which no real part is, and the stronger the signal, the larger this model
error. Differences of log evidence are therefore divided by a temperature that grows with the evidence, and the excess
of non-parametric alternatives is compared with a share of it. And sometimes an effect acts in a way that none of its
basis sets has: then another may describe it far better, and what the differences are is of little weight.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import expit

from calibration.base.arrays import Array
from calibration.diagnosis.basis_set_evidence import log_sum
from calibration.diagnosis.result import NONE, UNKNOWN, KeptEvidence
from calibration.diagnosis.search import SearchResult
from calibration.diagnosis.settings import VERDICT, VerdictSettings


def probabilities(search_result: SearchResult, none_elsewhere: float = 0.0) -> dict[str, float]:
    """Probability by name of each effect as the main cause, of NONE and of UNKNOWN; they add up to one.

    none_elsewhere: log evidence that `none` has at other levels of the disturbances than those of the search, over its
    evidence at these.
    """
    kept = kept_evidence(search_result, none_elsewhere)
    return verdict_probabilities(
        kept.log_evidence,
        kept.explained,
        kept.excess,
        none_elsewhere=kept.none_elsewhere,
        departure_gain=kept.departure_gain,
    )


def kept_evidence(search_result: SearchResult, none_elsewhere: float = 0.0) -> KeptEvidence:
    """What the probabilities follow from."""
    logs = {cause.effect.name: cause.log_evidence for cause in search_result.ranking}
    excess = search_result.excess_log_evidence
    return KeptEvidence(logs, search_result.log_evidence, excess, none_elsewhere, search_result.departure_gain)


def verdict_probabilities(
    log_evidence: Mapping[str, float],
    explained: float,
    excess: float,
    settings: VerdictSettings = VERDICT,
    *,
    none_elsewhere: float = 0.0,
    departure_gain: float = 0.0,
) -> dict[str, float]:
    """The same from the log evidence of each effect alone, of the causes together, and what alternatives have more.

    departure_gain: of the causes' log evidence, what departures from their forms add that are not expected. A form that
    has to bend far to fit is as good as an arbitrary function: a share of it counts as excess.
    """
    logs = np.array(list(log_evidence.values()))
    strongest = float(logs.max()) if logs.size else 0.0
    explained = max(explained, 0.0)
    any_effect = float(expit(max(strongest, explained + excess) - none_elsewhere - settings.none_prior_log_odds))
    left_over = (excess + settings.departure_share * departure_gain) / float(settings.threshold_of_excess(explained))
    odds = float(settings.odds_of_unknown(left_over))
    exceeded = odds / (1.0 + odds) if logs.size else 1.0
    # What only an arbitrary function explains is no reason for an effect that explains nothing, but evidence against
    # `none`, where it is more than undeclared disturbances may be.
    by_causes = float(expit(max(strongest, explained) - none_elsewhere - settings.none_prior_log_odds))
    any_named = min((1.0 - exceeded) * any_effect, by_causes) if logs.size else 0.0
    by_no_cause = (1.0 - exceeded) * any_effect - any_named
    unknown = exceeded * any_effect + by_no_cause * float(expit(excess - settings.excess_threshold))
    of_each = _probabilities_of_effects(logs, settings) if logs.size else logs
    out = {name: float(p) for name, p in zip(log_evidence, any_named * of_each, strict=True)}
    return out | {NONE: max(1.0 - unknown - any_named, 0.0), UNKNOWN: unknown}


def _probabilities_of_effects(logs: Array, settings: VerdictSettings) -> Array:
    """Probability (e,) of each effect if it is one of them, from their log evidence (e,)."""
    strongest = max(float(logs.max()), 0.0)

    def tempered(share: float) -> Array:
        divided = logs / (1.0 + share * strongest)
        return np.asarray(np.exp(divided - log_sum(divided)))

    misleading = settings.misleading_probability
    told = (1.0 - misleading) * tempered(settings.temperature_share)
    return told + misleading * tempered(settings.misleading_temperature_share)


def presence_probability(gain: float, explained: float, ranking: Mapping[str, float]) -> float:
    """Probability that a further effect is present, given the others.

    gain: log evidence that it adds at all its places; explained: that of all causes together. What is left of the
    others' forms, which are not exact, explains as much as an arbitrary function may beside them; and it may be
    another effect, of which no basis set has the form.
    """
    named = 1.0 - ranking[NONE] - ranking[UNKNOWN]
    more = max(gain - VERDICT.none_prior_log_odds, 0.0)
    by_model_error = float(VERDICT.threshold_of_excess(explained))
    return named * (1.0 - VERDICT.misleading_probability) * more / (more + by_model_error)
