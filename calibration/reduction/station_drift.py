"""A recording's points without the station's drift, which begins anew in every set-up."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.recording.recording import Recording
from calibration.recording.sessions import breaks_s
from calibration.reduction.common_points import NESTS, NestEstimate
from calibration.reduction.drift_filter import Breaks, DriftEstimate, estimate_drift


@dataclass(frozen=True)
class DriftFree:
    """Points (r, 3) without drift and range constant, each in the frame of its set-up when that began, covariances
    (r, 3, 3), and the nests of each set-up by its number."""

    position_m: Array
    covariance_m2: Array
    nests: Mapping[float, NestEstimate]


def remove_drift(recording: Recording, range_constant_m: float) -> DriftFree:
    """Follow the drift of each set-up through its nests and take it out; a set-up without nests keeps its points."""
    raw = recording.positions_m
    position = raw - range_constant_m * raw / np.linalg.norm(raw, axis=1)[:, None]
    covariance = recording.covariances_m2
    nests = {}
    for number in np.unique(recording["station"]).tolist():
        own = np.flatnonzero(recording["station"] == number)
        part = recording.take(own)
        on_nest = np.flatnonzero(np.asarray(part["phase"]) == NESTS)
        if not on_nest.size:
            continue
        names, drift = _drift(part, on_nest, position[own], covariance[own])
        position[own], covariance[own] = drift.remove(position[own], covariance[own])
        of_pose = np.asarray(part["phase"]) != NESTS
        common = drift.covariance[of_pose].mean(axis=0) if np.any(of_pose) else np.zeros((6, 6))
        common = np.roll(common, 3, axis=(0, 1))  # rotation first
        nests[number] = NestEstimate(names, drift.nests_m, drift.nest_covariance_m2, common)
    return DriftFree(position, covariance, nests)


def _drift(
    part: Recording, on_nest: NDArray[np.intp], position_m: Array, covariance_m2: Array
) -> tuple[tuple[str, ...], DriftEstimate]:
    t = part["t_rig_s"]
    rows = on_nest[np.argsort(t[on_nest], kind="stable")]
    names, nest = np.unique(np.asarray(part["smr"])[rows], return_inverse=True)
    accuracy = part.file.station.accuracy
    distance_m = float(np.mean(np.linalg.norm(position_m[rows], axis=1)))
    breaks = Breaks(breaks_s(part), part.file.nest_limit_m, distance_m)
    drift = estimate_drift(t[rows], nest, position_m[rows], covariance_m2[rows], accuracy, t, breaks)
    return tuple(names.tolist()), drift
