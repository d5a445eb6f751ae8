"""What a machine does not repeat: how far its drives stand off anew at each visit, whatever they report.

Of a crank it is how far its joint does. The readings of one visit are off together by it, so that it is no scatter of
the readings, which are off one by one.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import minimize_scalar

from calibration.base.arrays import Array
from calibration.diagnosis.level_posterior import FEW_READINGS, QUANTILE, Explained, LevelPosterior
from calibration.diagnosis.linearised_readings import LinearisedReadings, OffTogether

MEDIAN_M, FACTOR = 2.0e-6, 5.0  # x = log(1 + sd / median) has a normal prior of this factor's logarithm about zero
LEAST_SCORE = 2.0  # standard deviations of the score by which it is worth asking for
LEAST_GAIN = 2.0  # log posterior over none
NEAR = 0.1  # of x: nearer ones say the same
SHARE_OF_LARGEST = 1.0e-9  # of what the readings say of a drive: directions with less are none


class PositioningPosterior:
    """Log posterior of the standard deviation with which drives stand off anew at each visit, over that of none.

    At the stated levels of the disturbances. off: by what the readings are off together by it. included (n, w, j):
    whitened columns of causes in the model, each times its prior standard deviation.
    """

    def __init__(self, linear: LinearisedReadings, off: OffTogether, included: Array | None = None) -> None:
        columns = linear.columns
        if included is not None:
            columns = np.concatenate([columns, linear.joined(included)], axis=2)
        self._levels = LevelPosterior(linear, included=included)
        of_columns = off.products(linear.of_numbers(columns))
        of_residual = off.products(linear.of_numbers(linear.residual)[:, :, None])
        values, vectors = np.linalg.eigh(off.products(off.response))
        told = values > SHARE_OF_LARGEST * values.max(initial=0.0)
        turned, scale = np.swapaxes(vectors, 1, 2), np.sqrt(values[told])
        self._values = values[told]
        self._columns = (turned @ of_columns)[told] / scale[:, None]
        self._residual = (turned @ of_residual)[told][:, 0] / scale

    def most_likely_m(self, least_gain: float = LEAST_GAIN) -> float:
        """The most likely one, or 0 where it is no likelier than none by at least so much log posterior."""
        if self._score() < LEAST_SCORE:
            return 0.0
        bounds = (0.0, QUANTILE * math.log(FACTOR))
        best = minimize_scalar(
            lambda x: -self._at_most_likely_scatter(MEDIAN_M * math.expm1(x)),
            bounds=bounds, method="bounded", options={"xatol": NEAR},
        )  # fmt: skip
        gain = -float(best.fun) - self._at_most_likely_scatter(0.0)  # readings that scatter more may explain it too
        return MEDIAN_M * math.expm1(float(best.x)) if gain > least_gain else 0.0

    def log_evidence(self, sd_m: float) -> float:
        """Where readings scatter as stated."""
        stated = np.zeros(len(self._levels.prior))
        return self._standing_off(sd_m).log_density(stated) + _log_prior(sd_m) - self._levels.log_density(stated)

    def _at_most_likely_scatter(self, sd_m: float) -> float:
        return self._standing_off(sd_m).highest_as_stated() + _log_prior(sd_m)

    def explained(self, sd_m: float) -> Explained:
        """What drives that stand off by it explain of the readings."""
        ratio = sd_m**2 * self._values
        weight = np.sqrt(ratio / (1.0 + ratio))
        columns, residual = weight[:, None] * self._columns, weight * self._residual
        log_determinant = float(np.sum(np.log1p(ratio)))
        return Explained(columns.T @ columns, columns.T @ residual, float(residual @ residual), log_determinant)

    def _standing_off(self, sd_m: float) -> LevelPosterior:
        return self._levels.without(self.explained(sd_m))

    def _score(self) -> float:
        """Slope of the log likelihood over a small variance, in standard deviations of what noise makes of it."""
        coefficients, covariance = self._levels.fit()
        left = self._values * (self._residual - self._columns @ coefficients) ** 2
        expected = self._values * (1.0 - np.sum((self._columns @ covariance) * self._columns, axis=1))
        return float(np.sum(left - expected) / math.sqrt(2.0 * np.sum(expected**2)))


def most_likely_positioning_m(linear: LinearisedReadings) -> float:
    """The most likely standard deviation of readings without a cause, 0 where they are too few or too many to ask."""
    off = linear.off_together()
    if off is None or linear.degrees_of_freedom < FEW_READINGS:
        return 0.0
    return PositioningPosterior(linear, off).most_likely_m()


def _log_prior(sd_m: float) -> float:
    return -0.5 * (math.log1p(sd_m / MEDIAN_M) / math.log(FACTOR)) ** 2
