"""Weights of readings that are farther off than normal noise: by the model alone, and once more beside the causes.

Without the causes a reading that an effect has moved looks like a wrong one, and a wrong one like an effect. So weights
by the model alone are given only where few readings are far off; those beside the causes are given once, for a second
search, and are then the same for all hypotheses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.outliers import GATE_SIGMAS, own_sigmas
from calibration.diagnosis.any_change import stands
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linearised_readings import project_out
from calibration.diagnosis.outlying_readings import (
    GROSS_SIGMAS,
    SINGULAR,
    JudgedReadings,
    come_by_chance,
    lengths_m,
)
from calibration.reduction.left_out import BESIDE_CAUSES

NORMAL_SIGMAS, FAR_SIGMAS = 3.0, 4.0  # by the model alone of the worst coordinate, beside the causes of the reading
DEGREES_OF_FREEDOM = 4.0
MOST_FAR = 0.025  # share of all readings
MOST_OF_A_REFLECTOR, FEW = 0.05, 2.0  # share of its readings; what never are many
MOST_OF_A_STAND = 0.5  # of its readings: where so many are off, something has moved what they are on
LEAST_LEVERAGE_LEFT = 0.05


def student_weights(sigmas: Array) -> Array:
    """Weights (n,) of readings that are so many standard deviations off (n,), to multiply whitened readings with.

    Beyond NORMAL_SIGMAS those of a Student distribution (Lange, Little and Taylor, J. Am. Stat. Assoc. 84 (1989) 881),
    so that the farther off a reading is the less it pulls; below, 1: noise that is stated as normal is normal there,
    and evidence would be too small if its readings weighed less.
    """
    at_knee = DEGREES_OF_FREEDOM + NORMAL_SIGMAS**2
    return np.asarray(np.sqrt(np.minimum(1.0, at_knee / (DEGREES_OF_FREEDOM + sigmas**2))))


def weights_by_model(residual: Array, q: Array) -> Array | None:
    """Weights (n,) by whitened residuals (n, 3), 1 - q q' being the inverse covariance of the readings.

    None where no reading is far off, and where many are: then an effect is the likely cause.
    """
    sigmas = _sigmas(project_out(q, residual), q)
    return student_weights(sigmas) if 0.0 < np.mean(sigmas > FAR_SIGMAS) < MOST_FAR else None


@dataclass(frozen=True)
class SecondJudgement:
    """Which readings (n) are wrong once the causes are in the model, and the weight (n,) of each."""

    readings: JudgedReadings
    weight: Array


def judge_beside_causes(likelihood: MarginalLikelihood, weight: Array) -> SecondJudgement | None:
    """Which readings are wrong with the causes in the model of the likelihood; weight (n,): of its readings so far, by
    which they are judged as stated: wrong ones are no reason to expect more scatter.

    Only those that are off while most others of their stand are not: what has moved, as by a slip of a drive, moves all
    of them. None without a gross one, as another search would find the same, and where so many are far off, of all or
    of one reflector, that something else is the cause.
    """
    linear, factor = likelihood.linear, likelihood.q
    information = np.eye(linear.residual.shape[1]) - factor @ factor.transpose(0, 2, 1)
    information = information + SINGULAR * np.eye(linear.residual.shape[1])
    deviation = np.asarray(np.linalg.solve(information, likelihood.weighted_residual[:, :, None])[:, :, 0])
    distance = np.sqrt(np.maximum(np.sum(deviation * likelihood.weighted_residual, axis=1), 0.0)) / weight
    sigmas = own_sigmas(distance, linear.residual.shape[1], linear.on_platform + 2 * linear.on_floor)
    far = sigmas > FAR_SIGMAS
    single = far & _among_fitting_ones(stands(linear), far)
    wrong = single & (sigmas > GATE_SIGMAS)
    many = np.mean(single) >= MOST_FAR or _are_many(wrong, linear.smr)
    if not (come_by_chance(linear, single) if many else np.any(wrong & (sigmas > GROSS_SIGMAS))):
        return None
    size_m = lengths_m(linear.whiten[wrong], deviation[wrong])
    readings = JudgedReadings(~wrong, sigmas, size_m, BESIDE_CAUSES, np.zeros(0))
    return SecondJudgement(readings, np.where(single | ~far, student_weights(sigmas), 1.0))


def _are_many(wrong: NDArray[np.bool_], smr: NDArray[np.intp]) -> bool:
    """Whether so many readings of one reflector smr (n,) are wrong (n,) that something must have happened to it."""
    _, index = np.unique(smr, return_inverse=True)
    return bool(np.any(np.bincount(index, wrong) > np.maximum(FEW, MOST_OF_A_REFLECTOR * np.bincount(index))))


def _among_fitting_ones(stand: NDArray[np.intp], off: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Readings (n,) that are alone at their stand (n,) or most of whose fellows are not off (n,)."""
    of_stand = np.bincount(stand)
    return np.asarray((of_stand == 1)[stand] | (np.bincount(stand, off) < MOST_OF_A_STAND * of_stand)[stand])


def _sigmas(weighted_residual: Array, q: Array) -> Array:
    """By how many of its own standard deviations the worst coordinate of each reading (n,) is off the fit of all."""
    left = np.maximum(1.0 - np.sum(q**2, axis=2), LEAST_LEVERAGE_LEFT)
    return np.asarray(np.max(np.abs(weighted_residual) / np.sqrt(left), axis=1))
