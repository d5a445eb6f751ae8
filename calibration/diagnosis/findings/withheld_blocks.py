"""How far the gap shrinks: the model with and without the effects, on withheld regions of the workspace.

With C^-1 = 1 - q q' of all readings, those of a block are predicted from all others without a new fit:
e = (C^-1)_bb^-1 (C^-1 y)_b is the difference of the readings of block b from their prediction (Rasmussen and Williams
2006, eq. 5.12, for blocks). The true error is estimated without noise: under the full model the noise-free readings
have the mean y - C^-1 y and the covariance q q'. What that model does not have is in neither error; from visit to visit
it is seen in how far they scatter, and half of that is added to both: the other half may be noise of whole visits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.diagnosis.non_parametric import left_at_platform
from calibration.diagnosis.result import GapFigures

REGIONS = 5
SAMPLES = 400
# Relative standard deviations of the errors with and without an effect, because no model of an effect is exact. Tuned
# on simulated rigs so that the interval of the shrink contains the true one as often as stated (docs/decisions/0007).
MODEL_ERROR_AFTER, MODEL_ERROR_BEFORE = 0.12, 0.03
LEFT_SHARE = 0.5  # of how far visits scatter: a model's lack and noise that their readings share are as likely
SEED = 20  # of the samples, so that repeated diagnoses agree


@dataclass(frozen=True)
class GapField:
    """Errors of what is read of the platform, in c lengths each (`gap_scale`), of readings (m), in m.

    rows (m,): readings of the linear model. before, after (m, c): estimated error of predictions, noise removed. spread
    (m, c, b): factor of its covariance. left_m: RMS of what the model of the noise-free readings does not have either.
    noise_m: RMS of the readings' noise.
    """

    rows: NDArray[np.intp]
    before: Array
    after: Array
    spread: Array
    left_m: float
    noise_m: float


def regions(linear: LinearisedReadings) -> NDArray[np.intp]:
    """Region (v,) of the workspace of each visit: equal counts, by angle about the centre, the centre separate."""
    at = linear.places()
    span = np.ptp(at, axis=0)
    place = (at - at.mean(axis=0)) / np.where(span > 0.0, span, 1.0)
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


def region_of_readings(linear: LinearisedReadings, region: NDArray[np.intp]) -> NDArray[np.intp]:
    """Region (n,) of each reading from those of the visits (v,); -1 for floor nests."""
    return np.where(linear.home_visit >= 0, region[np.maximum(linear.home_visit, 0)], -1)


def withheld_differences(likelihood: MarginalLikelihood, region: NDArray[np.intp]) -> Array:
    """Whitened differences (n, w) of the readings from predictions that did not use their region (v,)."""
    of_reading = region_of_readings(likelihood.linear, region)
    out = np.zeros_like(likelihood.weighted_residual)
    for block in range(int(region.max()) + 1):
        rows = np.flatnonzero(of_reading == block)
        q = likelihood.q[rows].reshape(-1, likelihood.q.shape[2])
        weighted_residual = likelihood.weighted_residual[rows].ravel()
        block_matrix = np.eye(q.shape[1]) - q.T @ q
        differences = weighted_residual + q @ np.linalg.solve(block_matrix, q.T @ weighted_residual)
        out[rows] = differences.reshape(len(rows), -1)
    return out


def gap_field(truth_likelihood: MarginalLikelihood, before: Array, after: Array) -> GapField:
    """Errors of predictions, from `withheld_differences` (n, w) with and without the effects.

    truth_likelihood: the model by which the noise-free readings are estimated.
    """
    linear = truth_likelihood.linear
    scale = linear.gap_scale
    rows, metres = scale.rows, scale.metres
    before, after = linear.joined(before), linear.joined(after)
    noise = np.einsum("ncj,nj->nc", metres, truth_likelihood.weighted_residual[rows])
    spread = np.einsum("ncj,njb->ncb", metres, linear.joined(truth_likelihood.q)[rows])
    variance = scale.variance - np.sum(spread**2, axis=2)
    noise_m = float(np.sqrt(np.mean(noise**2) * np.mean(scale.variance) / np.mean(variance)))
    return GapField(
        rows=rows,
        before=np.einsum("ncj,nj->nc", metres, before[rows]) - noise,
        after=np.einsum("ncj,nj->nc", metres, after[rows]) - noise,
        spread=spread,
        left_m=_left_m(truth_likelihood),
        noise_m=noise_m,
    )


def _left_m(truth_likelihood: MarginalLikelihood) -> float:
    """RMS of shifts of the platform from visit to visit that the model lacks, as read."""
    linear, scale = truth_likelihood.linear, truth_likelihood.linear.gap_scale
    square = 0.0
    channels = truth_likelihood.channels.pose_channels()
    for channel, of_channel in zip(channels, left_at_platform(truth_likelihood), strict=True):
        response = linear.joined(truth_likelihood.response(channel))[scale.rows]
        square += float(of_channel * np.mean(np.einsum("ncj,nj->nc", scale.metres, response) ** 2))
    return float(np.sqrt(LEFT_SHARE * square))


def gap_figures(field: GapField) -> GapFigures:
    """RMS before and after, and the shrink with its 95 % interval, by samples of the noise-free readings."""
    rng = np.random.default_rng(SEED)
    flat = field.spread.reshape(-1, field.spread.shape[2])
    deviation = flat @ rng.standard_normal((flat.shape[1], SAMPLES))
    count = flat.shape[0]
    squares = np.sum(deviation**2, axis=0)
    before, after = field.before.ravel(), field.after.ravel()
    before_squares = (before @ before + 2.0 * (before @ deviation) + squares) / count + field.left_m**2
    after_squares = (after @ after + 2.0 * (after @ deviation) + squares) / count + field.left_m**2
    after_squares = after_squares * np.exp(2.0 * MODEL_ERROR_AFTER * rng.standard_normal(SAMPLES))
    before_squares = before_squares * np.exp(2.0 * MODEL_ERROR_BEFORE * rng.standard_normal(SAMPLES))
    shrink = 1.0 - np.sqrt(after_squares / before_squares)
    low, high = np.quantile(shrink, [0.025, 0.975])
    return GapFigures(
        before_m=float(np.sqrt(np.mean(before_squares))),
        after_m=float(np.sqrt(np.mean(after_squares))),
        noise_floor_m=field.noise_m,
        shrink=float(np.median(shrink)),
        shrink_interval=(float(low), float(high)),
        withheld=f"{REGIONS} regions of the workspace in turn",
    )
