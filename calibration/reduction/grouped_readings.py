"""Readings of a recording, grouped by the visits in which they were made."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.frame import station_frame
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
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
    recording: Recording,
    rows: NDArray[np.intp],
    position_m: Array,
    covariance_m2: Array,
    setup: NDArray[np.intp] | None = None,
) -> GroupedReadings:
    """The readings at some rows (r,), by visit in ascending order; several of one reflector in a visit are kept apart.

    position_m (n, 3), covariance_m2 (n, 3, 3), in the station's frame, and setup (n,): of all rows. A visit has the
    target and payload of its first reading, and the mean drives and part temperatures of all its readings. Drives may
    move a little between the readings of a visit: each position is that at the visit's drives, moved there by the
    nominal machine.
    """
    _, first, visit = np.unique(recording["visit"][rows], return_index=True, return_inverse=True)
    visit, heads = visit.astype(np.intp), rows[first]
    drives = recording.drives("actual_m")[rows]
    since_first = drives - drives[first][visit]  # exactly zero where nothing has moved, as their mean is
    visits = Visits(
        drives=drives[first] + np.array([mean_by_visit(column, visit) for column in since_first.T]).T.copy(),
        target_m=recording.targets_m()[heads],
        payload_kg=recording["payload_mass_kg"][heads],
        payload_com_m=recording.payload_com_m()[heads],
        temperatures_c={name: mean_by_visit(t[rows], visit) for name, t in recording.temperatures_of_parts_c().items()},
    )
    smr = reflector_indices(recording)[rows]
    position = position_m[rows] - _moved_by_drives(recording, visits, visit, smr, drives)
    seen_from = np.zeros(len(rows), dtype=np.intp) if setup is None else setup[rows]
    return GroupedReadings(ReflectorObservations(visits, visit, smr, position, covariance_m2[rows], seen_from), heads)


def _moved_by_drives(
    recording: Recording, visits: Visits, visit: NDArray[np.intp], smr: NDArray[np.intp], drives: Array
) -> Array:
    """How far (r, 3) reflectors were from where they are at their visit's drives, for the drives (r, d) of readings.

    In the station's frame, by its rough heading. Zero at poses that the nominal machine cannot take: they are refused
    elsewhere.
    """
    out = np.zeros((len(visit), 3))
    moved = np.flatnonzero(np.any(drives != visits.drives[visit], axis=1))
    if moved.size == 0:
        return out
    machine = recording.machine
    model = Model(ParameterSet(machine, ()), with_loads=False)
    at_visit = visits.take(visit[moved])
    there, here = (model.predict(np.zeros(0), at) for at in (replace(at_visit, drives=drives[moved]), at_visit))
    for index in np.unique(smr[moved]):
        of_smr = np.flatnonzero(smr[moved] == index)
        mounting_m = machine.smrs[index].position_m
        out[moved[of_smr]] = (there.reflector_m(index, mounting_m) - here.reflector_m(index, mounting_m))[of_smr]
    entry = recording.file.station
    out[~np.all(np.isfinite(out), axis=1)] = 0.0
    return np.asarray(out @ station_frame(entry.position_m, entry.heading_rad, machine.gravity_m_per_s2).rotation.T)


def replaced_readings(recording: Recording) -> NDArray[np.bool_]:
    """Readings (n,) of visits that were given up and measured anew."""
    if "replaces_visit" not in recording.columns:
        return np.zeros(len(recording), dtype=bool)
    replaced = recording["replaces_visit"]
    of_a_pose = np.asarray(recording["phase"]) != "nests"
    return of_a_pose & np.isin(recording["visit"], replaced[replaced >= 0.0])


def reflector_indices(recording: Recording) -> NDArray[np.intp]:
    """Index (n,) of each reading's reflector in the machine file."""
    index = {smr.name: i for i, smr in enumerate(recording.machine.smrs)}
    return np.array([index[str(name)] for name in recording["smr"]], dtype=np.intp)


def mean_by_visit(values: Array, visit: NDArray[np.intp]) -> Array:
    """Means (v,) of values (r,) by visit (r,), which counts from 0 without gaps."""
    return np.asarray(np.bincount(visit, values) / np.bincount(visit))
