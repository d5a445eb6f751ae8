"""Columns of which many readings have none of the first ones: products and triangular solves without the zeros."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from calibration.base.arrays import Array

GROUPS = 16  # at most, of readings with about as many leading zeros


class StaggeredColumns:
    """Columns (n, w, k), best with those first that concern few readings."""

    def __init__(self, columns: Array) -> None:
        self.shape = columns.shape
        self.of_readings = columns
        step = -(-columns.shape[2] // GROUPS)
        first = np.argmax(np.any(columns != 0.0, axis=1), axis=1) // step * step
        self._groups = [(np.flatnonzero(first == zeros), int(zeros)) for zeros in np.unique(first)]

    def _part(self, rows: NDArray[np.intp], zeros: int) -> Array:
        """Columns (w m, k - zeros) of some readings (m,), without the leading ones."""
        return self.of_readings[rows, :, zeros:].reshape(-1, self.shape[2] - zeros)

    @cached_property
    def gram(self) -> Array:
        """A' A (k, k), A being the columns of all readings."""
        out = np.zeros((self.shape[2], self.shape[2]))
        for rows, zeros in self._groups:
            part = self._part(rows, zeros)
            out[zeros:, zeros:] += part.T @ part
        return out

    def divide(self, lower: NDArray[np.floating]) -> Array:
        """A L'^-1 (n, w, k) in place of the columns, with a lower triangular matrix (k, k)."""
        for rows, zeros in self._groups:
            part = self._part(rows, zeros)
            solved = solve_triangular(lower[zeros:, zeros:], part.T, lower=True, overwrite_b=True, check_finite=False)
            self.of_readings[rows, :, zeros:] = solved.T.reshape(len(rows), self.shape[1], -1)
        return self.of_readings
