"""Calibration and causes found together: the solution of the joint linear model, of all readings or without a block.

With C the readings' covariance under the whole model and w = C^-1 y, unknowns are a' w and coefficients of the causes
d^2 h' w (a, h: their columns; d: prior standard deviations). Without a block b, w of the other readings is
w - (C^-1)_b (C^-1)_bb^-1 w_b: no new fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.gap.baseline import NEST_PRIOR_M, REFRACTION_U_PER_M, Baseline
from calibration.gap.evidence import Readout
from calibration.gap.search import Cause
from calibration.gap.twin_parts import Fit, whole_model
from calibration.machine import Array
from calibration.measurements.smr_positions import Station


@dataclass(frozen=True)
class Solution:
    """fit: of machine and station; ranges: range constant, scale and refraction by name; coefficients: of each cause.

    wander (n, 3): whitened shifts of all readings by the declared nuisance.
    """

    fit: Fit
    ranges: dict[str, float]
    coefficients: tuple[Array, ...]
    wander: Array


def solved(readout: Readout, causes: Sequence[Cause], without: NDArray[np.intp] | None = None) -> Solution:
    """The solution of a readout to which the causes belong; without: rows (b,) of readings that it must not use."""
    known = readout.baseline
    weights = readout.left if without is None else _without(readout, without)
    z = known.columns.reshape(-1, known.columns.shape[2]).T @ weights.ravel()
    coefficients = tuple(
        cause.deviations**2 * np.einsum("nwk,nw->k", readout.columns(cause.acts), weights) for cause in causes
    )
    return _solution(known, z, coefficients)


def _without(readout: Readout, rows: NDArray[np.intp]) -> Array:
    flat = readout.q.reshape(-1, readout.q.shape[2])
    q, left = readout.q[rows].reshape(-1, flat.shape[1]), readout.left[rows].ravel()
    differences = left + q @ np.linalg.solve(np.eye(q.shape[1]) - q.T @ q, q.T @ left)
    weights = readout.left + (flat @ (q.T @ differences)).reshape(readout.left.shape)
    weights[rows] = 0.0
    return np.asarray(weights)


def _solution(known: Baseline, z: Array, coefficients: tuple[Array, ...]) -> Solution:
    count = known.sigma.size
    values = z[:count] * known.sigma
    names = known.names
    at = dict(zip(names[:count], values.tolist(), strict=True))
    before = fit_before(known)
    first = names.index("frame.rx")
    mounted = before.mounted_m.copy()
    nests = dict(zip(names[count:], (z[count:] * NEST_PRIOR_M).tolist(), strict=True))
    for i, smr in enumerate(known.machine.smrs):
        for k, c in enumerate("xyz"):
            if f"mounting.{smr.name}.{c}" in at:
                mounted[i, k] = smr.position_m[k] + at[f"mounting.{smr.name}.{c}"]
            mounted[i, k] += nests.get(f"nest.{smr.name}.{c}", 0.0)
    # Columns of the frame are its increments at the frame where it is linear, not at the one the fit began with.
    frame = known.frame.moved(values[first : first + 6] - known.values[first : first + 6])
    fit = Fit(_whole(known, values), frame, mounted)
    nuisance = next((k for k, n in enumerate(names) if k >= count and not n.startswith("nest.")), len(names))
    wander = np.einsum("nwu,u->nw", known.columns[:, :, nuisance:], z[nuisance:])
    ranges = {name: value for name, value in at.items() if name.startswith(("range.", "refraction."))}
    return Solution(fit, ranges, coefficients, wander)


def fit_before(known: Baseline) -> Fit:
    """The machine at which a baseline is linear."""
    return Fit(_whole(known, known.values), known.frame, known.mounted_m)


def _whole(known: Baseline, values: Array) -> Array:
    """Values of all unknowns of the machine's model, from those of a baseline."""
    fitted = dict(zip([u.name for u in known.poses.model.unknowns], values.tolist(), strict=False))
    return np.array([fitted.get(u.name, 0.0) for u in whole_model(known.machine).unknowns])


def stated_m(known: Baseline, solution: Solution, places_m: Array) -> Array:
    """Places (n, 3) of the machine's frame as the station states them."""
    accuracy = known.recording.file.station.accuracy
    station = Station(
        solution.fit.frame,
        (),
        accuracy.range_constant_u_m,
        accuracy.range_scale_u,
        REFRACTION_U_PER_M,
        known_frame=True,
    )
    own = np.array([solution.ranges.get(u.name, 0.0) for u in station.unknowns(known.machine)])
    return station.see(known.machine, own, places_m)[0]
