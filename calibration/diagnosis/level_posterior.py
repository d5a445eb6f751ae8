"""How likely levels of the ordinary disturbances are, by a recording's readings and by what is declared.

The readings' marginal likelihood over the levels, all unknowns of the calibration integrated out, times log-normal
priors about the declared or default levels (MacKay 2003, ch. 28).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from calibration.base.arrays import Array
from calibration.diagnosis.disturbances import drift_per_sqrt_h
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.recording.header import DisturbanceLevels

COLUMNS = {"drift_m": "drift.", "reseat_m": "reseat.", "reversal_m": "reversal.", "temperature_k": "temperature."}
FACTOR = 3.0  # one standard deviation of the logarithm of a level that is not declared
FACTOR_DECLARED = 2.0  # of one that is
MOST_SIGMAS = 5.0  # of the prior: farther levels are not looked at
QUANTILE = 1.645  # 95 %, one-sided
STEP = 0.05  # of a logarithm, for second derivatives
FACTOR_OF_READINGS = 1.3  # of the readings' scatter over the stated one


class LevelPosterior:
    """Log posterior of the logarithms (k + 1,) of the levels over their priors', and of the readings' scatter.

    keys (k): of `[nuisance]`; a level that is declared as zero has no columns and stays. included (n, w, j): whitened
    columns of causes in the model, each times its prior standard deviation.
    """

    def __init__(
        self, linear: LinearisedReadings, keys: Sequence[str] = tuple(COLUMNS), included: Array | None = None
    ) -> None:
        declared = linear.levels
        self.keys = tuple(keys)
        factors = [FACTOR_DECLARED if key in declared.model_fields_set else FACTOR for key in keys]
        self.prior = np.log([*factors, FACTOR_OF_READINGS])
        columns, fixed = linear.columns, 0
        if included is not None:
            columns, fixed = np.concatenate([columns, included], axis=2), included.shape[2]
        self._of_key = [
            np.array([*(name.startswith(COLUMNS[key]) for name in linear.names), *[False] * fixed]) for key in keys
        ]
        self._stated_share = np.concatenate([_share_of_stated_drift(linear), np.zeros(fixed)])
        flat, y = columns.reshape(-1, columns.shape[2]), linear.residual.ravel()
        self._gram, self._along, self._square, self._count = flat.T @ flat, flat.T @ y, float(y @ y), len(y)

    def log_density(self, x: Array) -> float:
        """Up to a constant."""
        return self._density(x)[0]

    def gradient(self, x: Array) -> Array:
        """Derivatives (k + 1,) of the log density."""
        return self._density(x)[1]

    def gain(self, x: Array) -> float:
        """Log density over that of the declared and default levels."""
        return self.log_density(x) - self.log_density(np.zeros_like(x))

    def standard_deviations(self, x: Array) -> Array:
        """Of the logarithms (k + 1,) about the most likely ones, by the second derivatives there."""
        steps = STEP * np.eye(len(x))
        second = np.array([self.gradient(x + step) - self.gradient(x - step) for step in steps]) / (2.0 * STEP)
        covariance = np.linalg.inv(-0.5 * (second + second.T))
        return np.asarray(np.sqrt(np.maximum(np.diag(covariance), 0.0)))

    def most_likely(self) -> Array:
        """The logarithms (k + 1,) of highest density."""
        farthest = MOST_SIGMAS * self.prior
        return self._most_likely(-farthest, farthest)

    def most_likely_ordinary(self) -> Array:
        """The same with no level above the 95 % point of its prior, and readings that scatter as stated."""
        lowest, highest = -MOST_SIGMAS * self.prior, QUANTILE * self.prior
        lowest[-1] = highest[-1] = 0.0
        return self._most_likely(lowest, highest)

    def _most_likely(self, lowest: Array, highest: Array) -> Array:
        def descending(x: Array) -> tuple[float, Array]:
            value, slope = self._density(x)
            return -value, -slope

        bounds = np.column_stack([lowest, highest])
        return np.asarray(minimize(descending, np.zeros(len(bounds)), jac=True, method="L-BFGS-B", bounds=bounds).x)

    def levels(self, x: Array) -> Mapping[str, float]:
        """Factors on the declared or default levels, by key."""
        return {key: math.exp(value) for key, value in zip(self.keys, x[:-1].tolist(), strict=True)}

    def scales(self, x: Array) -> Array:
        """Factors (c,) on the standard deviations of the model's columns, included ones last."""
        scale = np.ones(len(self._along))
        for columns, level in zip(self._of_key, np.exp(x[:-1]), strict=True):
            scale[columns] = np.sqrt(self._stated_share[columns] + (1.0 - self._stated_share[columns]) * level**2)
        return scale

    def _density(self, x: Array) -> tuple[float, Array]:
        # C = v (1 + L S^2 L' / v): everything by M = 1 + S G S / v with G = L' L.
        scale, variance = self.scales(x), math.exp(2.0 * x[-1])
        gram = scale[:, None] * self._gram * scale
        factor = cho_factor(np.eye(len(scale)) + gram / variance, lower=True)
        along = scale * self._along
        weighted = cho_solve(factor, along) / variance
        square = (self._square - float(along @ weighted)) / variance
        determinant = self._count * math.log(variance) + 2.0 * float(np.sum(np.log(np.diag(factor[0]))))
        value = -0.5 * (square + determinant) - 0.5 * float(np.sum((x / self.prior) ** 2))
        # d/dx = 1/2 r' dC r - 1/2 tr(C^-1 dC) with r = C^-1 y.
        inverse = np.diag(cho_solve(factor, np.eye(len(scale)), overwrite_b=True))
        score = (along - gram @ weighted) / variance
        by_column = 0.5 * (score**2 - (1.0 - inverse))  # the information S L' C^-1 L S is 1 - M^-1
        slope = np.empty(len(x))
        for k, (columns, level) in enumerate(zip(self._of_key, np.exp(x[:-1]), strict=True)):
            moving = 2.0 * (1.0 - self._stated_share[columns]) * level**2 / scale[columns] ** 2
            slope[k] = float(by_column[columns] @ moving)
        residual = (self._square - 2.0 * float(along @ weighted) + float(weighted @ gram @ weighted)) / variance
        slope[-1] = residual - (self._count - len(scale) + float(np.sum(inverse)))
        return value, slope - x / self.prior**2


def scaled_levels(levels: DisturbanceLevels, factors: Mapping[str, float]) -> DisturbanceLevels:
    """Levels times factors, by key."""
    return levels.model_copy(update={key: getattr(levels, key) * factor for key, factor in factors.items()})


def _share_of_stated_drift(linear: LinearisedReadings) -> Array:
    """Share (c,) of a column's variance that the station's stated accuracy has, whatever the level."""
    shares = np.zeros(len(linear.names))
    levels, accuracy = linear.levels, linear.accuracy
    if accuracy is None:  # no station
        return shares
    none = levels.model_copy(update={"drift_m": 0.0})
    for i, name in enumerate(linear.names):
        if name.startswith("drift."):
            axis = name.split(".")[2]
            shares[i] = (drift_per_sqrt_h(axis, none, accuracy) / drift_per_sqrt_h(axis, levels, accuracy)) ** 2
    return shares
