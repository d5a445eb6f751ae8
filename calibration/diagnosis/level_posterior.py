"""How likely levels of the ordinary disturbances are, and of the machine's errors over their tolerances, by a
recording's readings and by what is declared.

The readings' marginal likelihood over the levels, all unknowns of the calibration integrated out, times log-normal
priors about the declared or default levels (MacKay 2003, ch. 28).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, lapack
from scipy.optimize import minimize

from calibration.base.arrays import Array
from calibration.diagnosis.disturbances import drift_per_sqrt_h
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.model.parameters import KINDS
from calibration.recording.header import DisturbanceLevels

COLUMNS = {"drift_m": "drift.", "reseat_m": "reseat.", "reversal_m": "reversal.", "temperature_k": "temperature."}
TOLERANCES = "tolerances"  # level of all errors of the machine's geometry over what the machine file states
GEOMETRY = tuple(f"{kind}." for kind in KINDS if kind != "ln_stiffness")
FACTOR = 3.0  # one standard deviation of the logarithm of a level that is not declared
FACTOR_DECLARED = 2.0  # of one that is
MOST_SIGMAS = 5.0  # of the prior: farther levels are not looked at
QUANTILE = 1.645  # 95 %, one-sided
STEP = 0.05  # of a logarithm, for second derivatives
FACTOR_OF_READINGS = 2.0  # of the readings' scatter over the stated one
FEW_READINGS = 15.0  # degrees of freedom, with fewer of which nothing tells scatter from a cause
SCATTERS = 24  # that are looked at, as stated and up to the 95 % point
MORE_SCATTER = 0.2  # of their variance over the stated one, that is worth another look


@dataclass(frozen=True)
class Explained:
    """What something that moves several readings together explains of the products of columns (b) and of the residual.

    gram (b, b), along (b,), square; log_determinant: of the readings' covariance over the one without.
    """

    gram: Array
    along: Array
    square: float
    log_determinant: float


class LevelPosterior:
    """Log posterior of the logarithms (k + 1,) of the levels over their priors', and of the readings' scatter.

    keys (k): of `[nuisance]`, or TOLERANCES; a level that is declared as zero has no columns and stays. included
    (n, w, j): whitened columns of causes in the model, each times its prior standard deviation.
    """

    def __init__(
        self, linear: LinearisedReadings, keys: Sequence[str] = (*COLUMNS, TOLERANCES), included: Array | None = None
    ) -> None:
        declared = linear.levels
        self.keys = tuple(keys)
        stated = {*declared.model_fields_set, TOLERANCES}
        factors = [FACTOR_DECLARED if key in stated else FACTOR for key in keys]
        self.prior = np.log([*factors, FACTOR_OF_READINGS])
        columns, fixed = linear.columns, 0
        if included is not None:
            columns, fixed = np.concatenate([columns, linear.joined(included)], axis=2), included.shape[2]
        self._of_key = [
            np.array([*(name.startswith(COLUMNS.get(key, GEOMETRY)) for name in linear.names), *[False] * fixed])
            for key in keys
        ]
        self._stated_share = np.concatenate([_share_of_stated_drift(linear), np.zeros(fixed)])
        flat, y = columns.reshape(-1, columns.shape[2]), linear.residual.ravel()
        self._gram, self._along, self._square = flat.T @ flat, flat.T @ y, float(y @ y)
        self._count, self._tells_scatter = linear.numbers_read, linear.degrees_of_freedom >= FEW_READINGS
        self._log_determinant = 0.0
        self._with_level = np.any(self._of_key, axis=0)
        self._of_rest: dict[float, _WithoutRest] = {}

    def without(self, explained: Explained) -> LevelPosterior:
        """The same where readings are off together, which explains a part of their products."""
        other = copy(self)
        other._gram, other._along = self._gram - explained.gram, self._along - explained.along
        other._square, other._log_determinant = self._square - explained.square, explained.log_determinant
        other._of_rest = {}
        return other

    def fit(self) -> tuple[Array, Array]:
        """Coefficients (c,) of all columns at the stated levels, over their standard deviations, and covariance."""
        covariance = np.asarray(np.linalg.inv(np.eye(len(self._gram)) + self._gram), np.float64)
        return covariance @ self._along, covariance

    def log_density(self, x: Array) -> float:
        """Up to a constant."""
        return self._density(x)[0]

    def highest_as_stated(self) -> float:
        """The highest log density at the stated levels, by how much the readings scatter, unless they are few."""
        values, vectors = np.linalg.eigh(self._gram)
        values, along = np.maximum(values, 0.0), (vectors.T @ self._along) ** 2
        x = np.linspace(0.0, self._tells_scatter * QUANTILE * self.prior[-1], SCATTERS)
        variance = np.exp(2.0 * x)[:, None]
        square = self._square - np.sum(along / (variance + values), axis=1)
        determinant = 2.0 * x * self._count + self._log_determinant + np.sum(np.log1p(values / variance), axis=1)
        return float(np.max(-0.5 * (square / variance[:, 0] + determinant + (x / self.prior[-1]) ** 2)))

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
        """The same with no level above the 95 % point of its prior, no tolerance below the stated one, and readings
        that scatter as stated, or more."""
        stated = self._ordinary(scattering=False)
        return self._ordinary(scattering=True) if self._scatters_more(stated) else stated

    def most_likely_as_stated(self) -> Array:
        """The same with readings that scatter as stated."""
        return self._ordinary(scattering=False)

    def most_likely_scatter(self) -> Array:
        """The same with the stated and default levels: readings alone may scatter more, unless they are few."""
        stated = np.zeros_like(self.prior)
        if not self._scatters_more(stated):
            return stated
        highest = stated.copy()
        highest[-1] = QUANTILE * self.prior[-1]
        return self._most_likely(stated, highest)

    def _scatters_more(self, x: Array) -> bool:
        return bool(self._tells_scatter and self.gradient(x)[-1] > MORE_SCATTER * self._count)

    def _ordinary(self, *, scattering: bool) -> Array:
        lowest, highest = -MOST_SIGMAS * self.prior, QUANTILE * self.prior
        if TOLERANCES in self.keys:
            lowest[self.keys.index(TOLERANCES)] = 0.0
        lowest[-1] = 0.0
        highest[-1] *= scattering
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
        # C = v (1 + L S^2 L' / v): everything by M = 1 + S G S / v with G = L' L; S L' C^-1 y is M^-1 S L' y / v.
        variance = math.exp(2.0 * x[-1])
        if variance not in self._of_rest:
            self._of_rest[variance] = _WithoutRest.of(self._gram, self._along, self._with_level, variance)
        rest, scale = self._of_rest[variance], self.scales(x)[self._with_level]
        along = scale * rest.along
        factor = cho_factor(np.eye(len(scale)) + scale[:, None] * rest.gram * scale / variance, lower=True)
        inverse = cho_solve(factor, np.eye(len(scale)), overwrite_b=True)
        score = inverse @ along / variance
        square = (self._square - rest.square - float(along @ score)) / variance
        determinant = self._count * math.log(variance) + self._log_determinant + rest.log_determinant
        determinant += 2.0 * float(np.sum(np.log(np.diag(factor[0]))))
        value = -0.5 * (square + determinant) - 0.5 * float(np.sum((x / self.prior) ** 2))
        # d/dx = 1/2 r' dC r - 1/2 tr(C^-1 dC) with r = C^-1 y.
        by_column = 0.5 * (score**2 - (1.0 - np.diag(inverse)))  # the information S L' C^-1 L S is 1 - M^-1
        slope = np.empty(len(x))
        for k, (every, level) in enumerate(zip(self._of_key, np.exp(x[:-1]), strict=True)):
            columns, stated = every[self._with_level], self._stated_share[every]
            moving = 2.0 * (1.0 - stated) * level**2 / scale[columns] ** 2
            slope[k] = float(by_column[columns] @ moving)
        of_rest = scale[:, None] * rest.squares * scale / variance**2
        scores = float(score @ score) + rest.square_of_score(scale * score)
        trace = float(np.trace(inverse)) + rest.trace + float(np.sum(inverse * of_rest))
        slope[-1] = square - scores - (self._count - len(self._along) + trace)
        return value, slope - x / self.prior**2


@dataclass(frozen=True)
class _WithoutRest:
    """Products of the columns (l) that have a level, once all others (f) are eliminated, which have none: with those G,
    a and v as in `LevelPosterior`, A = 1 + G_ff / v and U = A^-1 G_fl.

    gram (l, l), along (l,): without what the others explain. square, log_determinant, trace: a_f' A^-1 a_f / v,
    log |A|, tr A^-1. squares (l, l), products (l,), square_of_along: U' U, U' A^-1 a_f, |A^-1 a_f|^2.
    """

    variance: float
    gram: Array
    along: Array
    square: float
    log_determinant: float
    trace: float
    squares: Array
    products: Array
    square_of_along: float

    @classmethod
    def of(cls, gram: Array, along: Array, with_level: NDArray[np.bool_], variance: float) -> _WithoutRest:
        """Of the products of all columns."""
        rest = ~with_level
        across = gram[np.ix_(rest, with_level)]
        lower = np.linalg.cholesky(np.eye(int(rest.sum())) + gram[np.ix_(rest, rest)] / variance)
        solved = cho_solve((lower, True), np.column_stack([across, along[rest]]))
        by_rest, of_along = solved[:, :-1], solved[:, -1]
        return cls(
            variance,
            gram[np.ix_(with_level, with_level)] - across.T @ by_rest / variance,
            along[with_level] - across.T @ of_along / variance,
            float(along[rest] @ of_along) / variance,
            2.0 * float(np.sum(np.log(np.diag(lower)))),
            float(np.sum(lapack.dtrtri(lower, lower=1)[0] ** 2)),
            by_rest.T @ by_rest,
            by_rest.T @ of_along,
            float(of_along @ of_along),
        )

    def square_of_score(self, coefficients: Array) -> float:
        """Sum of squares of the others' scores, from those of the columns with a level, times their scale."""
        linear, square = float(self.products @ coefficients), float(coefficients @ self.squares @ coefficients)
        return (self.square_of_along - 2.0 * linear + square) / self.variance**2


def scaled_levels(levels: DisturbanceLevels, factors: Mapping[str, float]) -> DisturbanceLevels:
    """Levels times factors, by key; that of the tolerances is no disturbance's."""
    return levels.model_copy(update={key: getattr(levels, key) * factors[key] for key in COLUMNS if key in factors})


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
