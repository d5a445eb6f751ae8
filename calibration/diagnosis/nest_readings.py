"""Readings of the floor nests in the linear model of a recording: what moves every point that the station measures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.diagnosis.linearisation import FRAME_PRIOR, LinearisationPoint, Unknowns
from calibration.diagnosis.observed_model import ObservedModel

NEST_PRIOR_M = 5.0e-3


def columns_of_all_readings(
    observed: ObservedModel,
    whiten: Array,
    unknowns: Unknowns,
    point: LinearisationPoint,
    setup: NDArray[np.intp],
) -> tuple[Array, Array]:
    """Columns (n, 3, u) and residual (n, 3) of all readings: those at poses, and those of the floor nests.

    The unknowns of the frame and of the set-ups turn and shift every point that the station measures, so they act on
    the nests too.
    """
    n, on_pose, on_floor = len(observed.smr), np.flatnonzero(observed.visit >= 0), observed.on_floor
    columns, residual = np.zeros((n, 3, unknowns.sigma.size)), np.zeros((n, 3))
    columns[on_pose], residual[on_pose] = point.columns, point.residual
    nominal = np.array([smr.position_m for smr in observed.machine.smrs])[observed.smr[on_floor]]
    missed_m = observed.position_m[on_floor] - observed.frame.to_station(nominal)
    by_frame = _frame_columns(observed, whiten, on_floor) * FRAME_PRIOR
    columns[on_floor, :, unknowns.of_frame] = by_frame
    if count := 6 * (len(unknowns.station.setups) - 1):
        by_setup = unknowns.station.setups.shift_by_error(observed.position_m[on_floor], setup[on_floor])
        columns[on_floor, :, -count:] = whiten[on_floor] @ by_setup * FRAME_PRIOR
    residual[on_floor] = np.einsum("nij,nj->ni", whiten[on_floor], missed_m)
    residual[on_floor] += np.einsum("nwu,u->nw", by_frame, point.values[unknowns.of_frame] / FRAME_PRIOR)
    return columns, residual


def _frame_columns(observed: ObservedModel, whiten: Array, rows: NDArray[np.bool_]) -> Array:
    """Whitened shifts (f, 3, 6) of some readings by the frame's rotation vector and translation."""
    lever = observed.position_m[rows] - observed.frame.translation_m
    out = np.zeros((len(lever), 3, 6))
    for k in range(3):
        out[:, :, k] = np.cross(np.eye(3)[k], lever)
        out[:, :, 3 + k] = np.eye(3)[k]
    return np.asarray(whiten[rows] @ out)


def nest_columns(observed: ObservedModel, whiten: Array) -> tuple[Array, tuple[str, ...]]:
    """Columns (n, 3, k) by the positions of the floor nests, and their names."""
    smrs = sorted(set(observed.smr[observed.on_floor].tolist()))
    out = np.zeros((len(observed.smr), 3, 3 * len(smrs)))
    for column, smr in enumerate(smrs):
        rows = np.flatnonzero(observed.smr == smr)
        out[rows, :, 3 * column : 3 * column + 3] = whiten[rows] @ observed.frame.rotation * NEST_PRIOR_M
    return out, tuple(f"nest.{observed.machine.smrs[i].name}.{c}" for i in smrs for c in "xyz")
