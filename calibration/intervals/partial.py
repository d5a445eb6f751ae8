"""The prior of a calibration that measures only what has become uncertain."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.intervals.drift import WEEK_S, DriftSettings
from calibration.intervals.extent import Measurement
from calibration.intervals.watched import WatchedChanges


def grown_covariance(
    covariance: Array, watched: WatchedChanges, change_u: Array, age_s: float, drift: DriftSettings
) -> Array:
    """A former calibration's covariance (p, p) after some time without any event.

    Each watched parameter has walked as the settings say, in standard uncertainties change_u (w,) of a check with all
    poses. Combinations of several parameters are left out: their parts have walked already.
    """
    if age_s < 0.0:
        raise InputError("partial calibration: the former one lies ahead: the clock was set back")
    single = np.count_nonzero(watched.combination, axis=0) == 1
    walked = drift.walk_per_sqrt_week * np.sqrt(age_s / WEEK_S) * change_u[single]
    return np.asarray(covariance + watched.combination[:, single] * walked**2 @ watched.combination[:, single].T)


def released_covariance(
    covariance: Array, watched: WatchedChanges, error_per_change: Array, measurement: Measurement, error_m: float
) -> Array:
    """The same with what is measured anew left free.

    A drive's offset for each drive of a `drive offset`; everything watched for a `full` one; nothing of the geometry
    for an `expansion`, whose unknowns are the model's own. Free is: with a standard deviation that moves the tool by
    error_m (RMS over the workspace); error_per_change (w,) as checks have it.
    """
    if error_m <= 0.0:
        raise InputError("partial calibration: the error that is left free must be above zero")
    if measurement.extent == "expansion":
        return covariance
    names = [f"drive_offset.{drive}" for drive in measurement.drives]
    unknown = [name for name in names if name not in watched.names]
    if measurement.extent == "drive offset" and (unknown or not names):
        raise InputError(f"partial calibration: no offset of {', '.join(measurement.drives) or 'any drive'} is watched")
    chosen = [i for i, name in enumerate(watched.names) if measurement.extent == "full" or name in names]
    sd = error_m / np.maximum(error_per_change[chosen], 1e-12)
    return np.asarray(covariance + watched.combination[:, chosen] * sd**2 @ watched.combination[:, chosen].T)
