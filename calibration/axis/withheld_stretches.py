"""How far the gap of an axis shrinks: the model with and without the effects, on stretches of time in turn."""

from __future__ import annotations

import numpy as np

from calibration.axis.likelihood import AxisLikelihood
from calibration.axis.noise import from_cosines
from calibration.axis.result import AxisGap
from calibration.base.arrays import Array
from calibration.diagnosis.findings.withheld_blocks import MODEL_ERROR_AFTER, MODEL_ERROR_BEFORE

STRETCHES = 5  # longer than a motion: what is withheld for a moment is vouched for by its neighbours
MOST = 500  # samples, averaged in groups: the matrices are full
NORMAL_95 = 1.96


def gap_figures(before: AxisLikelihood, after: AxisLikelihood) -> AxisGap:
    """The gap without and with the effects, each fitted without the stretch that it predicts."""
    group = -(-(len(before.gap) + 1) // MOST)
    squares = [_withheld_squares(likelihood, group) for likelihood in (before, after)]
    noise_floor = float(np.sqrt(after.power[-1]))
    means = [max(float(np.mean(s)) - noise_floor**2 / group, 0.0) for s in squares]
    log_ratio, u = _log_ratio(squares[0], squares[1], noise_floor**2 / group)
    u = float(np.sqrt(u**2 + MODEL_ERROR_AFTER**2 + MODEL_ERROR_BEFORE**2))
    found = after.model.shape[1] > before.model.shape[1]
    low, high = 1.0 - np.exp(log_ratio + NORMAL_95 * u), 1.0 - np.exp(log_ratio - NORMAL_95 * u)
    return AxisGap(
        before=float(np.sqrt(means[0])),
        after=float(np.sqrt(means[1] if found else means[0])),
        noise_floor=noise_floor,
        shrink=float(1.0 - np.exp(log_ratio)) if found else 0.0,
        shrink_interval=(float(low), float(high)) if found else (0.0, 0.0),
        withheld=f"{STRETCHES} stretches of time in turn",
    )


def _withheld_squares(likelihood: AxisLikelihood, group: int) -> Array:
    """Mean square (b,) of what a fit to all else misses of each stretch."""
    gap = _grouped(from_cosines(likelihood.gap)[:, None], group)[:, 0]
    columns = _grouped(from_cosines(likelihood.model), group)
    offset = np.full((len(gap), 1), 1e3 * max(float(np.std(gap)), 1e-300))
    columns = np.concatenate([columns, offset], axis=1)
    cosine = from_cosines(np.eye(len(gap) - 1))
    noise = (cosine * (likelihood.power[: len(gap) - 1] / group)) @ cosine.T
    noise += (likelihood.power[0] / group / len(gap)) * np.ones_like(noise)  # of its mean, as of its slowest wave
    stretch = np.arange(len(gap)) * STRETCHES // len(gap)
    out = np.empty(STRETCHES)
    for number in range(STRETCHES):
        kept, held = np.flatnonzero(stretch != number), np.flatnonzero(stretch == number)
        weighted = np.linalg.solve(noise[np.ix_(kept, kept)], columns[kept])
        information = np.eye(columns.shape[1]) + columns[kept].T @ weighted
        coefficients = np.linalg.solve(information, weighted.T @ gap[kept])
        out[number] = np.mean((gap[held] - columns[held] @ coefficients) ** 2)
    return out


def _log_ratio(before: Array, after: Array, floor: float) -> tuple[float, float]:
    """Logarithm of RMS after over before, and its standard uncertainty by leaving out each stretch."""

    def log(keep: Array) -> float:
        a, b = float(np.mean(after[keep])) - floor, float(np.mean(before[keep])) - floor
        return 0.5 * float(np.log(max(a, 1e-4 * b, 1e-300) / max(b, 1e-300)))

    everything = np.ones(len(before), dtype=bool)
    each = np.array([log(np.arange(len(before)) != i) for i in range(len(before))])
    spread = np.sqrt((len(each) - 1) * np.mean((each - each.mean()) ** 2))
    return log(everything), float(spread)


def _grouped(columns: Array, group: int) -> Array:
    whole = len(columns) // group * group
    return np.asarray(columns[:whole].reshape(-1, group, columns.shape[1]).mean(axis=1))
