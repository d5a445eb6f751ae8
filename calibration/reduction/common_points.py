"""Points that a station measured from more than one set-up: floor nests, and reflectors at poses visited again.

Floor nests stay where they are. A pose that is visited again, from the same side, with the same payload and the same
tables, returns within the machine's repeatability; what warmer or colder parts and other drive coordinates change is
taken from the nominal model.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.model.model import Model
from calibration.model.parameters import ParameterSet
from calibration.recording.recording import Recording
from calibration.reduction.grouped_readings import group_by_visit

REPEATABILITY_M = 3.0e-6  # standard deviation of a reflector at a pose that is visited again, one coordinate
NESTS = "nests"


@dataclass(frozen=True)
class NestEstimate:
    """Places of nests in the frame of one set-up: names (k,), position_m (k, 3), covariance_m2 (3 k, 3 k).

    drift_covariance (6, 6): what is not known of the drift between them and the readings of poses, on average: rotation
    vector and translation. It is common to the readings, as slow as it is.
    """

    names: tuple[str, ...]
    position_m: Array
    covariance_m2: Array
    drift_covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))


@dataclass(frozen=True)
class CommonPoints:
    """Observations (n) of points that belong together, because their errors are correlated or because they are one.

    point (n,): which of the points; setup (n,): number of the set-up; position_m (n, 3) in the set-up's frame;
    covariance_m2 (3 n, 3 n); expected_m (n, 3): how far the point is from where it was first, machine's frame.
    """

    names: tuple[str, ...]
    point: NDArray[np.intp]
    setup: Array
    position_m: Array
    covariance_m2: Array
    expected_m: Array


def common_nests(nests: Mapping[float, NestEstimate]) -> list[CommonPoints]:
    """The nests of all set-ups (number to estimate) in one group: those of one set-up share the errors of its drift."""
    if not nests:
        return []
    names = tuple(sorted({name for nest in nests.values() for name in nest.names}))
    point = [names.index(name) for nest in nests.values() for name in nest.names]
    size = 3 * len(point)
    covariance, first = np.zeros((size, size)), 0
    for nest in nests.values():
        own = slice(first, first + len(nest.covariance_m2))
        covariance[own, own] = nest.covariance_m2
        first = own.stop
    setup = np.concatenate([np.full(len(nest.names), number) for number, nest in nests.items()])
    position = np.concatenate([nest.position_m for nest in nests.values()])
    return [CommonPoints(names, np.array(point, dtype=np.intp), setup, position, covariance, np.zeros((len(point), 3)))]


def repeated_poses(recording: Recording, position_m: Array, covariance_m2: Array) -> Iterator[CommonPoints]:
    """Reflectors at poses that were visited in more than one set-up, one point each; positions (r, 3) without drift."""
    rows = np.flatnonzero(np.asarray(recording["phase"]) != NESTS)
    keys = _pose_keys(recording)[rows]
    setup = recording["station"][rows]
    _, key = np.unique(keys, axis=0, return_inverse=True)
    pairs = np.unique(np.column_stack([key.ravel(), setup]), axis=0)
    again = np.isin(key.ravel(), np.flatnonzero(np.bincount(pairs[:, 0].astype(np.intp)) > 1))
    rows, key = rows[again], key.ravel()[again]
    if not rows.size:
        return
    expected = _nominal_m(recording, rows)
    for number in np.unique(key):
        own = rows[key == number]
        covariance = np.zeros((3 * len(own), 3 * len(own)))
        for i, row in enumerate(own):
            covariance[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = covariance_m2[row] + REPEATABILITY_M**2 * np.eye(3)
        modelled = expected[key == number]
        name = f"{recording['smr'][own[0]]} at pose {int(recording['pose'][own[0]])}"
        none = np.zeros(len(own), dtype=np.intp)
        yield CommonPoints(
            (name,), none, recording["station"][own], position_m[own], covariance, modelled - modelled[0]
        )


def _pose_keys(recording: Recording) -> Array:
    """What must be the same for a reflector to be in the same place again, (r, k)."""
    _, smr = np.unique(np.asarray(recording["smr"]), return_inverse=True)
    targets, sides = np.round(recording.targets_m(), 9), recording.drives("direction")
    return np.column_stack([smr, targets, sides, recording["payload"], recording["compensation"]])


def _nominal_m(recording: Recording, rows: NDArray[np.intp]) -> Array:
    """Places (n, 3) of the measured reflectors by the nominal model; zero where it finds none."""
    machine = recording.machine
    observations = group_by_visit(recording, rows, recording.positions_m, recording.covariances_m2).observations
    model = Model(ParameterSet.of(machine))
    poses = model.predict(np.zeros(len(model)), observations.visits)
    out = np.zeros((len(rows), 3))
    for smr in np.unique(observations.smr):
        own = np.flatnonzero(observations.smr == smr)
        out[own] = poses.reflector_m(int(smr), machine.smrs[smr].position_m)[observations.visit[own]]
    return np.nan_to_num(out)
