"""Readings of a machine: reflectors in a station's frame, coordinates of the tool, distances.

Each kind is one module with the same shape (`Readings`): its own unknowns with priors, and whitened residuals with
derivatives for the visits that it was given.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.machine.description import Machine
from calibration.model.model import Poses, Unknown


@dataclass(frozen=True)
class WhitenedResiduals:
    """Whitened residuals (r, w), prediction minus reading, and derivatives (r, w, u) with the model's unknowns and
    (r, w, k) with the instrument's own."""

    residual: Array
    by_model: Array
    by_own: Array


class Readings(Protocol):
    """Readings of one instrument, r of them with w numbers each."""

    def __len__(self) -> int:
        """Number of readings."""

    @property
    def width(self) -> int:
        """Numbers (w) a reading."""

    @property
    def free_rigid_motion(self) -> bool:
        """Whether the readings determine poses only up to a rigid motion."""

    def unknowns(self, machine: Machine) -> tuple[Unknown, ...]:
        """The instrument's own unknowns."""

    def visit_indices(self) -> NDArray[np.intp]:
        """Visits that each reading needs, (r, 1) or (r, 2)."""

    def take(self, rows: NDArray[np.intp]) -> Readings:
        """Some of the readings."""

    def with_noise(self, white: Array) -> Readings:
        """The readings with whitened noise (r, w) added: their residuals fall by as much."""

    def compare(
        self, poses: Poses, local: NDArray[np.intp], instrument_unknowns: Array, *, derivatives: bool = True
    ) -> WhitenedResiduals:
        """Compare with predicted poses; local: row of `poses` of every entry of `visit_indices`."""


ReadingBlock = tuple[NDArray[np.intp], Readings, NDArray[np.intp], NDArray[np.intp]]


def split_by_visits(readings: Readings, size: int) -> Iterator[ReadingBlock]:
    """Blocks of readings that need about `size` visits each: rows, readings, their visits, local rows of these."""
    needed = readings.visit_indices()
    if not len(needed):
        return
    order = np.argsort(needed[:, 0], kind="stable")
    first = needed[order, 0]
    cuts = np.searchsorted(first, np.arange(size, int(first[-1]) + 1, size))
    for rows in np.split(order, cuts):
        if rows.size:
            visits, local = np.unique(needed[rows], return_inverse=True)
            yield rows, readings.take(rows), visits, local.reshape(needed[rows].shape)
