"""Readings that do not fit the others: left out where they are grossly wrong, else with less weight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.diagnosis.observed_model import ObservedModel
from calibration.identification.gate import LinearReadings

HUBER, OUTLIER_SIGMA = 3.0, 4.0  # in standard deviations of one coordinate of a reading
GROSS_SIGMAS = 15.0  # of a reading's own
LARGEST_OUTLIER_SHARE = 0.025


def fitting_readings(observed: ObservedModel, residual: Array, columns: Array) -> NDArray[np.bool_]:
    """Which readings (n,) are not grossly wrong by what the others say; each part of the machine has its own scale.

    A strong effect of few readings reaches beyond six standard deviations too. Short of GROSS_SIGMAS a reading keeps
    its place, with less weight; where many are beyond, an effect is the likely cause, and all stay.
    """
    parts = [smr.on for smr in observed.machine.smrs]
    kind = np.unique(np.array(parts)[observed.smr], return_inverse=True)[1].astype(np.intp)
    readings = LinearReadings(np.zeros(columns.shape[2]), (-residual,), (columns,), (kind,))
    keep = readings.judge([np.ones(len(residual), dtype=bool)])[0].sigmas <= GROSS_SIGMAS
    return keep if np.mean(~keep) < LARGEST_OUTLIER_SHARE else np.ones(len(keep), dtype=bool)


def outlier_weights(residual: Array, q: Array) -> Array | None:
    """Huber weights (n,) of outlying readings, because real instruments have heavier tails than stated.

    None without outliers, and where there are many: then an effect is the likely cause, and all keep full weight.
    """
    weighted_residual = project_out(q, residual)
    leverage_complement = np.maximum(1.0 - np.sum(q**2, axis=2), 0.05)
    sigmas = np.max(np.abs(weighted_residual) / np.sqrt(leverage_complement), axis=1)
    if not 0.0 < np.mean(sigmas > OUTLIER_SIGMA) < LARGEST_OUTLIER_SHARE:
        return None
    return np.sqrt(np.minimum(1.0, HUBER / sigmas))


def project_out(q: Array, columns: Array) -> Array:
    """(1 - q q') times columns (n, 3, k) or (n, 3): what remains once all that q (n, 3, r) spans has been fitted."""
    flat = columns.reshape(q.shape[0] * 3, -1)
    factor = q.reshape(len(flat), -1)
    return np.asarray((flat - factor @ (factor.T @ flat)).reshape(columns.shape))
