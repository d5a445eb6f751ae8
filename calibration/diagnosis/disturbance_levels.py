"""Levels of a rig's ordinary disturbances, estimated from a quiet campaign: one without an effect.

The posterior (`level_posterior`) is taken as normal in the logarithms (Laplace's approximation: MacKay 2003, ch. 27).
How well the readings agree with their stated standard deviations is estimated with them, since scatter that is not
theirs would else be given to the disturbances.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from calibration.diagnosis.level_posterior import COLUMNS, LevelPosterior
from calibration.diagnosis.linear_model import linearise_recording
from calibration.diagnosis.positioning import PositioningPosterior
from calibration.recording.header import DeclaredLevels
from calibration.recording.recording import Recording

SAID_BY_READINGS = 0.7  # of the prior's standard deviation: with more left the readings say next to nothing
QUANTILE = 1.96


@dataclass(frozen=True)
class EstimatedLevel:
    """A level of a disturbance: the most likely one, limits of 95 %, and whether the readings say anything of it."""

    value: float
    low: float
    high: float
    told: bool


@dataclass(frozen=True)
class EstimatedLevels:
    """Levels by their keys in `[nuisance]`, the medians of their priors, the readings' scatter over the stated, and how
    far drives stand off anew at each visit: 0 where the readings do not say that they do."""

    by_key: Mapping[str, EstimatedLevel]
    prior: Mapping[str, float]
    scatter: EstimatedLevel
    positioning_sd_m: float


def estimate_levels(recording: Recording) -> EstimatedLevels:
    """Levels of a campaign in which nothing else is wrong, whatever it declares: priors are the default levels.

    Raises InputError if the recording is unsuitable.
    """
    default = DeclaredLevels()
    prior = {key: float(getattr(default, key)) for key in COLUMNS}
    file = recording.file.model_copy(update={"nuisance": default})
    linear = linearise_recording(replace(recording, file=file))
    positioning = PositioningPosterior(linear, linear.off_together())
    positioning_sd_m = positioning.most_likely_m()
    posterior = LevelPosterior(linear, tuple(prior)).without(positioning.explained(positioning_sd_m))
    best = posterior.most_likely()
    deviation = posterior.standard_deviations(best)
    levels = [
        EstimatedLevel(
            median * math.exp(x),
            median * math.exp(x - QUANTILE * s),
            median * math.exp(x + QUANTILE * s),
            bool(s < SAID_BY_READINGS * of_prior),
        )
        for median, x, s, of_prior in zip(
            (*prior.values(), 1.0), best.tolist(), deviation.tolist(), posterior.prior.tolist(), strict=True
        )
    ]
    return EstimatedLevels(dict(zip(prior, levels[:-1], strict=True)), prior, levels[-1], positioning_sd_m)
