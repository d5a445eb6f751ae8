"""Levels of a rig's ordinary disturbances, estimated from a quiet campaign: one without an effect.

The readings' marginal likelihood over the levels, all unknowns of the calibration integrated out, times log-normal
priors about the declared or default levels; the posterior is taken as normal in the logarithms (Laplace's
approximation: MacKay 2003, ch. 27). How well the readings agree with their stated standard deviations is estimated
with them, since scatter that is not theirs would else be given to the disturbances.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from calibration.base.arrays import Array
from calibration.diagnosis.disturbances import drift_per_sqrt_h
from calibration.diagnosis.linear_model import LinearModel, linearise_recording
from calibration.recording.header import DeclaredLevels
from calibration.recording.recording import Recording

COLUMNS = {"drift_m": "drift.", "reseat_m": "reseat.", "reversal_m": "reversal.", "temperature_k": "temperature."}
FACTOR = 3.0  # one standard deviation of a level's logarithm
FACTOR_OF_READINGS = 1.3  # the same of the readings' scatter over the stated one
SAID_BY_READINGS = 0.7  # of the prior's standard deviation: with more left the readings say next to nothing
STEP = 0.05  # of a logarithm, for second differences
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
    """Levels by their keys in `[nuisance]`, the medians of their priors, and the readings' scatter over the stated."""

    by_key: Mapping[str, EstimatedLevel]
    prior: Mapping[str, float]
    scatter: EstimatedLevel


def estimate_levels(recording: Recording) -> EstimatedLevels:
    """Levels of a campaign in which nothing else is wrong, whatever it declares: priors are the default levels.

    Raises InputError if the recording is unsuitable.
    """
    default = DeclaredLevels()
    prior = {key: float(getattr(default, key)) for key in COLUMNS}
    file = recording.file.model_copy(update={"nuisance": default})
    linear = linearise_recording(replace(recording, file=file))
    posterior = _Posterior(linear, tuple(prior))
    best = minimize(lambda x: -posterior.log_density(x), np.zeros(len(prior) + 1), method="L-BFGS-B").x
    covariance = np.linalg.inv(-_second_derivatives(posterior, best))
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
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
    return EstimatedLevels(dict(zip(prior, levels[:-1], strict=True)), prior, levels[-1])


class _Posterior:
    """Log posterior of the logarithms (k + 1,) of the levels over their priors', and of the readings' scatter."""

    def __init__(self, linear: LinearModel, keys: Sequence[str]) -> None:
        self.prior = np.array([*[math.log(FACTOR)] * len(keys), math.log(FACTOR_OF_READINGS)])
        self._of_key = [np.array([name.startswith(COLUMNS[key]) for name in linear.names]) for key in keys]
        self._stated_share = self._share_of_stated_drift(linear)
        flat, y = linear.columns.reshape(-1, linear.columns.shape[2]), linear.residual.ravel()
        self._gram, self._along, self._square, self._count = flat.T @ flat, flat.T @ y, float(y @ y), len(y)

    def log_density(self, x: Array) -> float:
        """Up to a constant."""
        scale = np.ones(len(self._along))
        for columns, level in zip(self._of_key, np.exp(x[:-1]), strict=True):
            scale[columns] = np.sqrt(self._stated_share[columns] + (1.0 - self._stated_share[columns]) * level**2)
        variance = math.exp(2.0 * x[-1])
        matrix = np.eye(len(scale)) + scale[:, None] * self._gram * scale / variance
        lower = np.linalg.cholesky(matrix)
        along = np.linalg.solve(lower, scale * self._along) / variance
        square = self._square / variance - float(along @ along)
        determinant = self._count * math.log(variance) + 2.0 * float(np.sum(np.log(np.diag(lower))))
        return -0.5 * (square + determinant) - 0.5 * float(np.sum((x / self.prior) ** 2))

    @staticmethod
    def _share_of_stated_drift(linear: LinearModel) -> Array:
        """Share (c,) of a column's variance that the station's stated accuracy has, whatever the level."""
        shares = np.zeros(len(linear.names))
        levels, accuracy = linear.recording.file.nuisance, linear.recording.file.station.accuracy
        none = levels.model_copy(update={"drift_m": 0.0})
        for i, name in enumerate(linear.names):
            if name.startswith("drift."):
                axis = name.split(".")[2]
                shares[i] = (drift_per_sqrt_h(axis, none, accuracy) / drift_per_sqrt_h(axis, levels, accuracy)) ** 2
        return shares


def _second_derivatives(posterior: _Posterior, x: Array) -> Array:
    """Matrix (k, k) of second derivatives of the log density, by central differences."""
    k, steps = len(x), STEP * np.eye(len(x))
    out = np.empty((k, k))
    for i in range(k):
        for j in range(i + 1):
            corners = [posterior.log_density(x + a * steps[i] + b * steps[j]) for a in (1, -1) for b in (1, -1)]
            out[i, j] = out[j, i] = (corners[0] - corners[1] - corners[2] + corners[3]) / (4.0 * STEP**2)
    return out
