"""How far the gap shrinks: the model with and without the effects, on regions of the workspace that were withheld.

With C^-1 = 1 - q q' of all readings, those of a block are predicted from all others without any new fit:
e = (C^-1)_bb^-1 (C^-1 y)_b is what the readings of block b differ from their prediction (Rasmussen and Williams 2006,
eq. 5.12, for blocks). The true error is estimated without noise: under the full model the noise-free readings have the
mean y - C^-1 y and the covariance q q'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.diagnosis.evidence import Readout
from calibration.diagnosis.linear_model import Baseline
from calibration.diagnosis.result import GapFigures

REGIONS = 5
LEAST_VISITS = 3
SAMPLES = 400
FORM_AFTER, FORM_BEFORE = (
    0.12,
    0.03,
)  # relative, standard deviations found on simulated rigs (docs/explanation/withheld.md)
SEED = 20  # of the samples, so that a diagnosis says the same twice


@dataclass(frozen=True)
class Field:
    """Errors of the platform's reflectors, of the machine's moving coordinates (c), readings (m), in m.

    rows (m,): readings of the baseline. before, after (m, c): estimated error of predictions, noise removed. spread
    (m, c, b): factor of its covariance. noise_m: RMS of the readings' noise.
    """

    rows: NDArray[np.intp]
    before: Array
    after: Array
    spread: Array
    noise_m: float


def regions(baseline: Baseline) -> NDArray[np.intp]:
    """Region (v,) of the workspace of each visit: equal counts, by angle about the middle, the middle apart."""
    moves = baseline.machine.commanded
    place = baseline.poses.visits.target_m[:, moves]
    span = np.ptp(place, axis=0)
    place = (place - place.mean(axis=0)) / np.where(span > 0.0, span, 1.0)
    if place.shape[1] == 1:
        order = np.argsort(place[:, 0], kind="stable")
        out = np.empty(len(place), dtype=np.intp)
        out[order] = np.arange(len(place)) * REGIONS // len(place)
        return out
    radius = np.linalg.norm(place[:, :2], axis=1)
    inner = radius <= np.quantile(radius, 1.0 / REGIONS)
    angle = np.arctan2(place[:, 1], place[:, 0])
    out = np.zeros(len(place), dtype=np.intp)
    outer = np.flatnonzero(~inner)
    order = outer[np.argsort(angle[outer], kind="stable")]
    out[order] = 1 + np.arange(len(order)) * (REGIONS - 1) // max(len(order), 1)
    return out


def withheld(readout: Readout, region: NDArray[np.intp]) -> Array:
    """Whitened differences (n, 3) of the readings of every visit from predictions that did not use its region."""
    known = readout.baseline
    of_reading = np.where(known.visit >= 0, region[np.maximum(known.visit, 0)], -1)
    out = np.zeros_like(readout.left)
    for block in range(int(region.max()) + 1):
        rows = np.flatnonzero(of_reading == block)
        q = readout.q[rows].reshape(-1, readout.q.shape[2])
        left = readout.left[rows].ravel()
        inner = np.eye(q.shape[1]) - q.T @ q
        out[rows] = (left + q @ np.linalg.solve(inner, q.T @ left)).reshape(-1, 3)
    return out


def field(readout: Readout, before: Array, after: Array) -> Field:
    """Errors of predictions, from differences (n, 3) of `withheld`; the readout says what the truth is taken to be."""
    known = readout.baseline
    rows = np.flatnonzero(known.on_platform)
    moves = known.machine.dof[known.machine.dof < 3]
    # Whitened to metres in the machine's frame, of the coordinates that the machine moves.
    to_m = np.linalg.inv(known.whiten[rows])
    turn = known.frame.rotation.T[moves]
    metres = np.einsum("ci,nij->ncj", turn, to_m)
    noise = np.einsum("ncj,nj->nc", metres, readout.left[rows])
    spread = np.einsum("ncj,njb->ncb", metres, readout.q[rows])
    variance = np.sum(metres**2, axis=2) - np.sum(spread**2, axis=2)
    noise_m = float(np.sqrt(np.mean(noise**2) * np.mean(np.sum(metres**2, axis=2)) / np.mean(variance)))
    return Field(
        rows,
        np.einsum("ncj,nj->nc", metres, before[rows]) - noise,
        np.einsum("ncj,nj->nc", metres, after[rows]) - noise,
        spread,
        noise_m,
    )


def figures(found: Field) -> GapFigures:
    """RMS before and after, and the shrink with its 95 % interval, by samples of the noise-free readings."""
    rng = np.random.default_rng(SEED)
    flat = found.spread.reshape(-1, found.spread.shape[2])
    deviation = flat @ rng.standard_normal((flat.shape[1], SAMPLES))
    count = flat.shape[0]
    squares = np.sum(deviation**2, axis=0)
    before = found.before.ravel()
    after = found.after.ravel()
    b2 = (before @ before + 2.0 * (before @ deviation) + squares) / count
    a2 = (after @ after + 2.0 * (after @ deviation) + squares) / count
    # Forms are never exact, and the error that is left suffers most from it.
    a2 = a2 * np.exp(2.0 * FORM_AFTER * rng.standard_normal(SAMPLES))
    b2 = b2 * np.exp(2.0 * FORM_BEFORE * rng.standard_normal(SAMPLES))
    shrink = 1.0 - np.sqrt(a2 / b2)
    low, high = np.quantile(shrink, [0.025, 0.975])
    return GapFigures(
        before_m=float(np.sqrt(np.mean(b2))),
        after_m=float(np.sqrt(np.mean(a2))),
        noise_floor_m=found.noise_m,
        shrink=float(np.median(shrink)),
        shrink_interval=(float(low), float(high)),
        withheld=f"{REGIONS} regions of the workspace in turn",
    )


def repeated_m(baseline: Baseline) -> float | None:
    """Noise floor: RMS scatter of the platform's reflectors over visits of one target, side and payload.

    In the machine's frame, of a coordinate that the machine moves, at rest; None where no target was visited often
    enough (LEAST_VISITS) alike.
    """
    m, moves = baseline.moments, baseline.machine.dof[baseline.machine.dof < 3]
    rows = np.flatnonzero(baseline.on_platform & ~m.moving)
    places = ((baseline.position_m[rows] - baseline.frame.translation_m) @ baseline.frame.rotation)[:, moves]
    target = np.round(baseline.poses.visits.target_m[baseline.visit[rows]], 7)
    alike = np.column_stack([target, m.direction[rows], m.payload_kg[rows], baseline.smr[rows]])
    group = np.unique(alike, axis=0, return_inverse=True)[1].ravel()
    visits = np.bincount(group)
    known = visits[group] >= LEAST_VISITS
    if not np.any(known):
        return None
    mean = np.stack([np.bincount(group, x) for x in places.T], axis=1) / visits[:, None]
    square = float(np.sum((places - mean[group])[known] ** 2))
    freedom = int(np.sum(visits[visits >= LEAST_VISITS] - 1)) * len(moves)
    return float(np.sqrt(square / freedom))


def predicted_m(readout: Readout, differences: Array) -> Array:
    """Predicted positions (n, 3) in the station's frame from whitened differences (n, 3) of the readings from them."""
    known = readout.baseline
    return known.position_m - np.linalg.solve(known.whiten, differences[:, :, None])[:, :, 0]
