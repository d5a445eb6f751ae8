"""What all readings of a group have in common, as if each of them had it by itself.

Where responses to a channel are multiplied by what each reading was taken at, the covariance of two readings has no
place; that of each by itself has.
"""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.linearised_readings import OffTogether

HALVINGS = 30  # of the interval in which a factor lies


def whitening_of_each(off: OffTogether, sd: float) -> Array:
    """Matrices (r, w, w) that whiten once more readings that are off together, by numbers with a standard deviation.

    A reading has its own part of the covariance, I + c sd^2 J J', with such a factor c, between 1 and the number of
    readings in the group, that these say as much of the d numbers, in the trace of the information, as by the
    covariance of all.
    """
    response = off.response
    groups, of_reading = np.unique(off.group, return_inverse=True)
    own, vectors = np.linalg.eigh(response @ np.swapaxes(response, 1, 2))
    own = np.maximum(own, 0.0)
    together = np.maximum(np.linalg.eigvalsh(off.products(response)), 0.0)
    expected = np.sum(together / (1.0 + sd**2 * together), axis=1)

    def grown(factor: Array) -> Array:
        return np.asarray(1.0 + sd**2 * factor[of_reading, None] * own)

    least, most = np.ones(len(groups)), np.maximum(np.bincount(of_reading).astype(np.float64), 1.0)
    for _ in range(HALVINGS):
        middle = np.sqrt(least * most)
        says = np.bincount(of_reading, np.sum(own / grown(middle), axis=1))
        least, most = np.where(says > expected, middle, least), np.where(says > expected, most, middle)
    return np.asarray((vectors / np.sqrt(grown(np.sqrt(least * most)))[:, None, :]) @ np.swapaxes(vectors, 1, 2))
