"""From evidence to probabilities.

Evidence takes a form at its word; a real part never follows one exactly, and the more there is to see, the more that
counts. Differences are therefore divided by a temperature that grows with the evidence, and an excess of form-free
alternatives is held against a share of it. The constants were fitted on simulated rigs whose forms differ from ours
(docs/explanation/withheld.md); none of them is specific to an effect.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import expit

from calibration.diagnosis.evidence import log_sum
from calibration.diagnosis.result import NONE, UNKNOWN
from calibration.diagnosis.search import Cause, Explanation

NOTHING = 7.0  # of log evidence: prior odds of `none`
PLAIN_EXCESS = 12.0
EXCESS_SHARE = 0.03
WIDTH = 4.0
WIDTH_SHARE = 0.008
TEMPERATURE_SHARE = 0.01


def probabilities(found: Explanation) -> dict[str, float]:
    """Probability by name of each effect as the main cause, of NONE and of UNKNOWN; they add up to one."""
    strongest = found.ranking[0].log_evidence if found.ranking else 0.0
    total = max(found.log_evidence, 0.0)
    something = float(expit(max(strongest, total + found.excess) - NOTHING))
    unknown = float(expit((found.excess - PLAIN_EXCESS - EXCESS_SHARE * total) / (WIDTH + WIDTH_SHARE * total)))
    logs = np.array([cause.log_evidence for cause in found.ranking])
    ranked = np.empty(0)
    if logs.size:
        temperature = 1.0 + TEMPERATURE_SHARE * max(strongest, 0.0)
        ranked = np.exp(logs / temperature - log_sum(logs / temperature))
    else:
        unknown = 1.0
    out = {
        cause.effect.name: float(p)
        for cause, p in zip(found.ranking, something * (1.0 - unknown) * ranked, strict=True)
    }
    return out | {NONE: 1.0 - something, UNKNOWN: something * unknown}


def presence(cause: Cause, ranking: Mapping[str, float]) -> float:
    """Probability that a further cause is there, the others given: its evidence is over them."""
    known = 1.0 - ranking[NONE] - ranking[UNKNOWN]
    return float(known * expit(cause.log_evidence - NOTHING))
