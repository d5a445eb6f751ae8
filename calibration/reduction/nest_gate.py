"""Wrong readings of the floor nests: each is judged by all others of its set-up, before and after it.

The readings of nests at unknown places, seen by a station that drifts as a random walk, are one Gaussian vector with
covariance K. What the others say of reading i is off by e_i = ([K^-1]_ii)^-1 [K^-1 y]_i with covariance ([K^-1]_ii)^-1
(Rasmussen and Williams, Gaussian Processes for Machine Learning, 5.4.2). The first reading is judged like any other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.outliers import GATE_SIGMAS, scale_of
from calibration.base.rotation import skew
from calibration.recording.header import AccuracyEntry
from calibration.recording.recording import Recording
from calibration.reduction.left_out import NEST, LeftOutReading

AT_ONCE = 600  # readings that are judged together: their covariance is a full matrix
NEST_PRIOR_M = 0.1  # about the median of a nest's readings: next to nothing is known of its place


def gate_nests(recording: Recording) -> tuple[Recording, tuple[LeftOutReading, ...]]:
    """A recording without wrong readings of nests, and these."""
    is_nest = np.asarray(recording["phase"]) == "nests"
    keep = np.ones(len(recording), dtype=bool)
    left_out = []
    for setup in np.unique(recording["station"][is_nest]):
        rows = np.flatnonzero(is_nest & (recording["station"] == setup))
        rows = rows[np.argsort(recording["t_rig_s"][rows], kind="stable")]
        for some in np.array_split(rows, -(-len(rows) // AT_ONCE)):
            _, nest = np.unique(np.asarray(recording["smr"])[some], return_inverse=True)
            readings = NestReadings(
                recording["t_rig_s"][some],
                nest.astype(np.intp),
                recording["nest_check"][some],
                recording.positions_m[some],
                recording.covariances_m2[some],
            )
            wrong = wrong_nest_readings(readings, recording.file.station.accuracy)
            keep[some[wrong.rows]] = False
            for row, size_m, sigmas in zip(some[wrong.rows], wrong.size_m, wrong.sigmas, strict=True):
                left_out.append(LeftOutReading.of_recording(recording, int(row), size_m, sigmas, NEST))
    return (recording.take(keep), tuple(left_out)) if left_out else (recording, ())


@dataclass(frozen=True)
class NestReadings:
    """Readings (n,) of the nests from one set-up: rig time, nest, nest check, position (n, 3), covariance (n, 3, 3)."""

    t_s: Array
    nest: NDArray[np.intp]
    check: Array
    position_m: Array
    covariance_m2: Array

    def __len__(self) -> int:
        return len(self.t_s)


@dataclass(frozen=True)
class WrongNestReadings:
    """Rows (k,) of the wrong readings; how far they are off the others (k,), in m and in own standard deviations."""

    rows: NDArray[np.intp]
    size_m: Array
    sigmas: Array


def wrong_nest_readings(readings: NestReadings, accuracy: AccuracyEntry) -> WrongNestReadings:
    """Readings beyond the gate, the worst first, while another nest of their check speaks for the station.

    If all nests of a check are off, or a nest from one check to the next alike, the station or the nest has moved: such
    readings stay, for the nest check to fail (`nest_checks.usable_readings`). The scale of the standard deviations is
    that of the others once the worst is left out: of a handful of readings, at a campaign's begin, a single wrong one
    would widen it by itself.
    """
    n = len(readings)
    covariance = _covariance(readings, accuracy)
    place = np.stack([np.median(readings.position_m[readings.nest == i], axis=0) for i in readings.nest])
    left = np.arange(n)
    inverse = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
    off_m = readings.position_m - place
    judged = _judge(inverse, off_m)
    wrong, sizes, sigmas = [], [], []
    while left.size > 1:
        distance, deviation = judged
        worst = int(np.argmax(distance))
        others = _without(inverse, worst)
        judged = _judge(others, np.delete(off_m[left], worst, axis=0))
        own = float(distance[worst]) / scale_of(judged[0], 3)
        if own <= GATE_SIGMAS:
            break
        wrong.append(int(left[worst]))
        sizes.append(float(np.linalg.norm(deviation[worst])))
        sigmas.append(own)
        left, inverse = np.delete(left, worst), others
    alone = np.array([_stands_alone(readings, i, wrong, covariance) for i in wrong], dtype=bool)
    order = np.flatnonzero(alone)
    return WrongNestReadings(np.array(wrong, dtype=np.intp)[order], np.array(sizes)[order], np.array(sigmas)[order])


def _covariance(readings: NestReadings, accuracy: AccuracyEntry) -> Array:
    """Of all coordinates (3 n, 3 n): the nests' places, the drift and the readings' own."""
    n = len(readings)
    level, direction = accuracy.drift_of_level_rad_per_sqrt_h, accuracy.drift_rad_per_sqrt_h
    rate = np.array([*[accuracy.drift_m_per_sqrt_h] * 3, level, level, direction]) ** 2 / 3600.0
    design = np.concatenate([np.tile(np.eye(3), (n, 1, 1)), -skew(readings.position_m)], axis=2)
    start = float(np.min(readings.t_s, initial=np.inf))
    walked_s = np.minimum(readings.t_s[:, None], readings.t_s[None, :]) - start
    same = (readings.nest[:, None] == readings.nest[None, :]) * NEST_PRIOR_M**2
    out = np.einsum("iax,x,jbx,ij->iajb", design, rate, design, walked_s, optimize=True)
    out += np.einsum("ij,ab->iajb", same, np.eye(3))
    out[np.arange(n), :, np.arange(n)] += readings.covariance_m2
    return np.asarray(out.reshape(3 * n, 3 * n))


def _judge(inverse: Array, off_m: Array) -> tuple[Array, Array]:
    """Of each reading (n,) its distance from what the others say, in standard deviations, and the deviation (n, 3)."""
    n = len(off_m)
    own = np.stack([inverse[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(n)])
    pull = (inverse @ off_m.ravel()).reshape(n, 3)
    deviation = np.asarray(np.linalg.solve(own, pull[:, :, None])[:, :, 0], dtype=np.float64)
    return np.sqrt(np.maximum(np.einsum("ni,ni->n", deviation, pull), 0.0)), deviation


def _without(inverse: Array, row: int) -> Array:
    """The inverse of the covariance of the other readings."""
    gone = np.arange(3 * row, 3 * row + 3)
    rest = np.delete(np.arange(len(inverse)), gone)
    across = inverse[np.ix_(rest, gone)]
    return np.asarray(inverse[np.ix_(rest, rest)] - across @ np.linalg.solve(inverse[np.ix_(gone, gone)], across.T))


def _stands_alone(readings: NestReadings, row: int, wrong: list[int], covariance: Array) -> bool:
    """Whether another nest of its check is not wrong, and its nest was not off alike at the check before or after."""
    good = np.ones(len(readings), dtype=bool)
    good[wrong] = False
    check = readings.check == readings.check[row]
    if not np.any(good & check & (readings.nest != readings.nest[row])):
        return False
    checks = np.unique(readings.check)
    place = int(np.searchsorted(checks, readings.check[row]))
    near = checks[max(0, place - 1) : place + 2]
    for other in wrong:
        if other == row or readings.nest[other] != readings.nest[row] or readings.check[other] not in near:
            continue
        if readings.check[other] != readings.check[row] and _agree(readings, row, other, covariance):
            return False
    return True


def _agree(readings: NestReadings, one: int, other: int, covariance: Array) -> bool:
    """Whether two readings of a nest differ by no more than the gate allows."""
    apart = readings.position_m[one] - readings.position_m[other]
    a, b = slice(3 * one, 3 * one + 3), slice(3 * other, 3 * other + 3)
    spread = covariance[a, a] + covariance[b, b] - covariance[a, b] - covariance[b, a]
    return bool(np.sqrt(apart @ np.linalg.solve(spread, apart)) <= GATE_SIGMAS)
