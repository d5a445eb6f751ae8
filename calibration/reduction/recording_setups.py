"""The set-ups of a recording: whether they can be tied, and the tie."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.base.errors import InputError
from calibration.base.frame import station_frame
from calibration.instruments.setups import Setups
from calibration.recording.recording import Recording
from calibration.reduction import nest_distances, setups
from calibration.reduction.common_points import CommonPoints, common_nests, repeated_poses
from calibration.reduction.nest_checks import usable_readings
from calibration.reduction.nest_gate import gate_nests
from calibration.reduction.range_constant import range_constant_of
from calibration.reduction.station_drift import DriftFree, remove_drift


def require_equal_nest_distances(recording: Recording) -> None:
    """InputError, naming the nest, if distances of nests differ by more than three of their u between set-ups."""
    usable = _usable(recording)
    constant, u = range_constant_of(usable)
    nest_distances.require_equal_nest_distances(remove_drift(usable, constant).nests, u)


def require_common_points(recording: Recording) -> None:
    """InputError, which says what to measure, if a set-up has not three points, not in a line, with the ones before.

    Floor nests count, and reflectors at a pose that was visited in an earlier set-up too: same target, payload, side
    and tables; the phase is of no account.
    """
    usable = _usable(recording)
    drift_free = remove_drift(usable, range_constant_of(usable)[0])
    setups.require_common_points(_numbers(usable, None), _groups(usable, drift_free))


def tied_by_nests(recording: Recording) -> bool:
    """Whether the nests alone tie all set-ups, so that no pose need be visited again."""
    usable = _usable(recording)
    drift_free = remove_drift(usable, range_constant_of(usable)[0])
    try:
        setups.require_common_points(_numbers(usable, None), common_nests(drift_free.nests))
    except InputError:
        return False
    return True


def setups_of(recording: Recording) -> Setups:
    """The set-ups of a recording, tied as `tie_recording` does."""
    if len(_numbers(recording, None)) == 1:
        return Setups.single(int(recording["station"][0]))
    usable = _usable(recording)
    constant, constant_u = range_constant_of(usable)
    return tie_recording(usable, remove_drift(usable, constant), constant_u)


def in_first_frame(recording: Recording, setups: Setups) -> Recording:
    """A recording with all points and covariances in the frame of the first set-up."""
    if len(setups) == 1:
        return recording
    setup = setups.rows(recording["station"])
    points = setups.to_first(recording.positions_m, setup)
    covariances = setups.covariances_in_first(recording.covariances_m2, setup)
    columns = dict(recording.columns)
    for i, a in enumerate("xyz"):
        columns[f"{a}_m"] = points[:, i]
        columns |= {f"cov_{a}{b}_m2": covariances[:, i, j] for j, b in enumerate("xyz") if j >= i}
    return replace(recording, columns=columns)


def tie_recording(
    recording: Recording, drift_free: DriftFree, range_constant_u_m: float, known: Setups | None = None
) -> Setups:
    """The set-ups of usable readings, tied to the first by nests and by poses that were visited again.

    known: those that were tied before, which keep their motions. Raises InputError if nests have moved in between, or
    if a set-up has too few points in common with the others.
    """
    numbers = _numbers(recording, known)
    if len(numbers) == 1:
        return Setups.single(int(numbers[0]))
    if known is not None and len(numbers) == len(known):
        return known
    nest_distances.require_equal_nest_distances(drift_free.nests, range_constant_u_m)
    entry = recording.file.station
    to_first = station_frame(entry.position_m, entry.heading_rad, recording.machine.gravity_m_per_s2).rotation
    return setups.tie_setups(numbers, _groups(recording, drift_free), to_first, known)


def _usable(recording: Recording) -> Recording:
    recording = gate_nests(recording)[0]
    return recording.take(usable_readings(recording))


def _numbers(recording: Recording, known: Setups | None) -> list[float]:
    before = [] if known is None else known.numbers.tolist()
    return sorted({float(number) for number in (*np.unique(recording["station"]), *before)})


def _groups(recording: Recording, drift_free: DriftFree) -> list[CommonPoints]:
    return [
        *common_nests(drift_free.nests),
        *repeated_poses(recording, drift_free.position_m, drift_free.covariance_m2),
    ]
