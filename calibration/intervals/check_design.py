"""The design of a check on a machine: which reading shows which change, and which poses to visit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.intervals.check_estimate import CheckDesign
from calibration.intervals.watched import (
    WatchedChanges,
    carried_shift,
    smr_response,
    station_nuisance,
    tool_response,
)
from calibration.machine.description import Machine
from calibration.model.model import Poses

NUISANCES = 8  # rotation (3) and translation (3) of the station, constant and scale of its ranges


@dataclass(frozen=True)
class CheckReadings:
    """Readings of a check, one row a reading of a reflector.

    visit (r,): row of the visited poses; smr (r,): row of the reflector in the machine file; place_m (r, 3): where it
    is predicted in the machine frame; whiten (r, 3, 3): inverse Cholesky factor of the reading's covariance there.
    """

    visit: NDArray[np.intp]
    smr: NDArray[np.intp]
    place_m: Array
    whiten: Array

    def whitened(self, shift_m: Array) -> Array:
        """Shifts (r, 3, ...) in standard deviations, (3 r, ...)."""
        white = np.einsum("rij,rj...->ri...", self.whiten, shift_m)
        return np.asarray(white.reshape(-1, *shift_m.shape[2:]))

    def rows_of_visits(self, visits: int) -> NDArray[np.intp]:
        """Rows of the whitened numbers (3 r) of the first visits, and of all floor nests (visit below zero)."""
        return np.flatnonzero(np.repeat(self.visit < visits, 3))


def check_design(
    readings: CheckReadings,
    poses: Poses,
    workspace: Poses,
    mounting_m: Array,
    watched: WatchedChanges,
    *,
    station_m: Array,
    range_u: tuple[float, float],
    prior: Array,
    reference: Array,
) -> CheckDesign:
    """The design of a check.

    poses (v): where the machine is visited, workspace (g): where its error is asked for. mounting_m (s, 3): places of
    all reflectors on their parts. Parameters are those of the machine (p), then mounting errors of reflectors on moving
    parts (3 each, in the order of the machine file): prior and reference are covariances of p + 3 q. range_u: standard
    uncertainty of the constant (m) and the scale (1) of ranges. Nests have the visit -1 and no response.
    """
    machine = poses.model.machine
    moving = [i for i, smr in enumerate(machine.smrs) if smr.on != "floor"]
    count = len(poses.model.parameters)
    size = count + 3 * len(moving)
    if prior.shape != (size, size) or reference.shape != (size, size):
        raise InputError(f"check: covariances must be {size} by {size}: machine parameters, then mountings")
    response = smr_response(poses, tuple(moving), mounting_m[moving])
    shift = np.zeros((len(readings.visit), 3, size))
    for k, smr in enumerate(moving):
        rows = np.flatnonzero(readings.smr == smr)
        at = readings.visit[rows]
        shift[rows, :, :count] = response[at, k]
        shift[rows, :, count + 3 * k : count + 3 * k + 3] = poses.mounting_derivatives(smr)[at]
    tool = tool_response(workspace).reshape(-1, count)
    padded = np.concatenate([watched.combination, _carried_reflectors(machine, watched.names, moving)])
    return CheckDesign(
        by_parameter=readings.whitened(shift),
        nuisance=readings.whitened(station_nuisance(readings.place_m, station_m)),
        nuisance_u=np.array([np.inf] * 6 + list(range_u)),
        workspace=np.concatenate([tool, np.zeros((len(tool), 3 * len(moving)))], axis=1),
        points=len(workspace.visits),
        watched=WatchedChanges(watched.names, padded),
        prior=prior,
        reference=reference,
    )


def _carried_reflectors(machine: Machine, names: Sequence[str], moving: Sequence[int]) -> Array:
    """Shifts (3 q, w) of reflectors on their parts with a unit of each change: those on a slider go with its offset."""
    out = np.zeros((3 * len(moving), len(names)))
    for column, name in enumerate(names):
        for k, smr in enumerate(machine.smrs[i] for i in moving):
            if smr.on == "slider" and name == f"drive_offset.{machine.drive_names[smr.drive]}":
                out[3 * k : 3 * k + 3, column] = carried_shift(machine, smr.drive, smr.position_m)
    return out


def choose_poses(design: CheckDesign, visit: NDArray[np.intp], count: int) -> tuple[int, ...]:
    """Visits of a design, the most informative first, so that a check may stop after any of them.

    visit (m,): visit of each of the design's numbers, -1 for nests, which are always measured. One visit after the
    other is added that makes the watched change that is known worst, by what it does to the tool, known best; no visit
    is chosen twice.
    """
    candidates = [int(v) for v in np.unique(visit[visit >= 0])]
    if count > len(candidates):
        raise InputError(f"check: {count} poses of {len(candidates)} candidates: allow fewer or offer more")
    chosen: list[int] = []
    for _ in range(count):
        worst = {v: _worst_u(design, np.isin(visit, [-1, *chosen, v])) for v in candidates if v not in chosen}
        chosen.append(min(worst, key=lambda v: worst[v]))
    return tuple(chosen)


def _worst_u(design: CheckDesign, keep: NDArray[np.bool_]) -> float:
    """Largest standard uncertainty of a watched change, in metres of the tool; the fourth power smooths the maximum."""
    some = design.rows(keep)
    information = np.maximum(np.sum(some.columns**2, axis=0), 1e-12)
    return float(np.mean((some.error_per_change**2 / information) ** 2))
