"""What all readings of a group have in common, as if each of them had it by itself.

Where responses to a channel are multiplied by what each reading was taken at, the covariance of two readings has no
place; that of each by itself has.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array

HALVINGS = 30  # of the interval in which a factor lies


def whitening_of_each(response: Array, group: NDArray[np.intp], sd: float) -> Array:
    """Matrices (n, w, w) that whiten readings once more, of which those of a group (n,) are off together.

    response (n, w, d): whitened shifts of the readings for one unit of each number by which a group is off, with a
    standard deviation in each. A reading has its own part of the covariance, I + c sd^2 J J', with such a factor c,
    between 1 and the number of readings in the group, that these say as much of the d numbers, in the trace of the
    information, as by the covariance of all.
    """
    groups, of_reading = np.unique(group, return_inverse=True)
    own, vectors = np.linalg.eigh(response @ np.swapaxes(response, 1, 2))
    own = np.maximum(own, 0.0)
    square = np.zeros((len(groups), response.shape[2], response.shape[2]))
    np.add.at(square, of_reading, np.swapaxes(response, 1, 2) @ response)
    together = np.maximum(np.linalg.eigvalsh(square), 0.0)
    expected = np.sum(together / (1.0 + sd**2 * together), axis=1)

    def grown(factor: Array) -> Array:
        return np.asarray(1.0 + sd**2 * factor[of_reading, None] * own)

    least, most = np.ones(len(groups)), np.maximum(np.bincount(of_reading).astype(np.float64), 1.0)
    for _ in range(HALVINGS):
        middle = np.sqrt(least * most)
        says = np.bincount(of_reading, np.sum(own / grown(middle), axis=1))
        least, most = np.where(says > expected, middle, least), np.where(says > expected, most, middle)
    return np.asarray((vectors / np.sqrt(grown(np.sqrt(least * most)))[:, None, :]) @ np.swapaxes(vectors, 1, 2))
