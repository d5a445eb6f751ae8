"""Readings of a recording, grouped by the visits in which they were made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.model.visits import Visits
from calibration.recording.recording import Recording


@dataclass(frozen=True)
class GroupedReadings:
    """Observations of some rows of a recording, and the first row (v,) of each of their visits in it."""

    observations: ReflectorObservations
    heads: NDArray[np.intp]

    def mean(self, values: Array) -> Array:
        """Means (v,) by visit of one value for each observation (r,)."""
        return mean_by_visit(values, self.observations.visit)


def group_by_visit(
    recording: Recording, rows: NDArray[np.intp], position_m: Array, covariance_m2: Array
) -> GroupedReadings:
    """The readings at some rows (r,), by visit in ascending order; several of one reflector in a visit are kept apart.

    position_m (n, 3) and covariance_m2 (n, 3, 3): of all rows, in the station's frame. A visit has the drives, target
    and payload of its first reading, and the mean part temperatures of all its readings.
    """
    _, first, visit = np.unique(recording["visit"][rows], return_index=True, return_inverse=True)
    visit, heads = visit.astype(np.intp), rows[first]
    visits = Visits(
        drives=recording.drives("actual_m")[heads],
        target_m=recording.targets_m()[heads],
        payload_kg=recording["payload_mass_kg"][heads],
        payload_com_m=recording.payload_com_m()[heads],
        temperatures_c={name: mean_by_visit(t[rows], visit) for name, t in recording.temperatures_c().items()},
    )
    smr = reflector_indices(recording)[rows]
    return GroupedReadings(ReflectorObservations(visits, visit, smr, position_m[rows], covariance_m2[rows]), heads)


def reflector_indices(recording: Recording) -> NDArray[np.intp]:
    """Index (n,) of each reading's reflector in the machine file."""
    index = {smr.name: i for i, smr in enumerate(recording.machine.smrs)}
    return np.array([index[str(name)] for name in recording["smr"]], dtype=np.intp)


def mean_by_visit(values: Array, visit: NDArray[np.intp]) -> Array:
    """Means (v,) of values (r,) by visit (r,), which counts from 0 without gaps."""
    return np.asarray(np.bincount(visit, values) / np.bincount(visit))
