"""What is to be explained: readings against the machine's own model, linear in everything that calibration may move.

Geometry, stiffness, mounting and frame are unknowns with their priors all along, together with the declared nuisance,
so that an effect is only judged by what they cannot take up. Rows are readings (n), each with three whitened numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame, station_frame
from calibration.diagnosis.disturbances import nuisance_columns
from calibration.effects.context import Moments, moments_of
from calibration.instruments.smr_positions import REFRACTION_U_PER_M, ReflectorObservations, SmrPositions, StationModel
from calibration.machine.description import Machine
from calibration.model.model import Model, Poses, SystematicUncertainties
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits
from calibration.recording.recording import Recording
from calibration.reduction.data_checks import require_enough_poses
from calibration.reduction.report_frame import fit_report_frame

NEST_PRIOR_M = 5.0e-3
FRAME_PRIOR = 5.0e-3  # m and rad about the frame that was fitted to commanded poses
FIRST_STEPS = 2
LEAST_VISITS = 20
HUBER, FAR_OFF = 3.0, 4.0  # in standard deviations of one number of a reading
MOST_OUTLIERS = 0.025
MOST_SIGMA = 3.0
UNSEEN = 2.0e-3  # information of a direction, over its prior's, below which readings say nothing of it


@dataclass(frozen=True)
class Seen:
    """Readings of reflectors (n) on a modelled machine, measured or only thought of.

    smr (n,): index in the machine file. poses: of the visits; visit (n,): their rows, -1 for floor nests. frame: from
    the machine's to the station's; mounted_m (smrs, 3): fitted places of the reflectors on their parts; position_m
    (n, 3): station's frame.
    """

    machine: Machine
    moments: Moments
    smr: NDArray[np.intp]
    visit: NDArray[np.intp]
    poses: Poses
    frame: Frame
    mounted_m: Array
    position_m: Array

    @property
    def on_platform(self) -> NDArray[np.bool_]:
        """Readings (n,) of the platform's reflectors."""
        return np.array([s.on == "platform" for s in self.machine.smrs])[self.smr]


@dataclass(frozen=True)
class Baseline(Seen):
    """The linearised model of a recording's readings.

    rows (n,): rows of the recording that are used. whiten (n, 3, 3). residual (n, 3): whitened, measured minus modelled
    with all unknowns at nominal, by the linear model. columns (n, 3, b): by every unknown, each times its prior
    standard deviation; names and sigma (b,) are the unknowns'. values (u,): of the model's and the station's unknowns,
    at which it is linear. q (n, 3, r): 1 - q q' is the inverse of the readings' covariance.
    """

    recording: Recording
    rows: NDArray[np.intp]
    whiten: Array
    residual: Array
    columns: Array
    names: tuple[str, ...]
    sigma: Array
    values: Array
    q: Array

    def apply(self, whitened: Array) -> Array:
        """Inverse covariance times columns (n, 3, k) or (n, 3)."""
        return taken_out(self.q, whitened)

    def whitened(self, shift_m: Array) -> Array:
        """Shifts (n, 3) in the machine's frame, whitened."""
        return np.einsum("nij,nj->ni", self.whiten, shift_m @ self.frame.rotation.T)


def baseline_of(recording: Recording) -> Baseline:
    """Fit the model to a recording and linearise it there; InputError where the readings do not allow it."""
    rows = usable_rows(recording)
    used = recording.take(rows)
    machine = recording.machine
    moments = moments_of(used)
    smr = np.array([[s.name for s in machine.smrs].index(str(name)) for name in used["smr"]], dtype=np.intp)
    on_floor = np.array([s.on == "floor" for s in machine.smrs])[smr]
    whiten = np.linalg.inv(np.linalg.cholesky(used.covariances_m2))
    seen, visit = _observations(used, smr, on_floor)
    _check_number(machine, seen.visits)
    frame = _start(used, seen)
    model = Model(
        ParameterSet.of(machine),
        SystematicUncertainties.from_declared(used.file.payloads, machine, used.file.nuisance.temperature_k),
    )
    accuracy = used.file.station.accuracy
    smrs = tuple(sorted(set(seen.smr.tolist())))
    station = StationModel(frame, smrs, accuracy.range_constant_u_m, accuracy.range_scale_u, REFRACTION_U_PER_M)
    readings = SmrPositions(seen, station)
    own = station.unknowns(machine)
    sigma = np.array([u.sigma for u in (*model.unknowns, *own)])
    sigma[len(model) + station.frame_column : len(model) + station.frame_column + 6] = FRAME_PRIOR
    on_pose = np.flatnonzero(~on_floor)
    values, poses, columns, right = _linearised(model, readings, sigma, recording.file.campaign)
    frame = station.frame(values[len(model) :])
    residual = np.zeros((len(smr), 3))
    residual[on_pose] = right
    everything = [_all_rows(columns, on_pose, len(smr))]
    names = [u.name for u in (*model.unknowns, *own)]
    mounted = [_mounted(machine, station, values[len(model) :], i) for i in range(len(machine.smrs))]
    bare = Baseline(
        machine=machine, moments=moments, smr=smr, visit=visit, poses=poses, frame=frame, mounted_m=np.array(mounted),
        position_m=used.positions_m, recording=recording, rows=rows, whiten=whiten, residual=residual,
        columns=everything[0], names=tuple(names), sigma=sigma, values=values, q=np.empty((0, 3, 0)),
    )  # fmt: skip
    nests, nest_names, predicted = _nest_columns(bare, on_floor)
    residual[on_floor] = np.einsum("nij,nj->ni", whiten[on_floor], used.positions_m[on_floor] - predicted)
    # Nests move with the frame too: its unknowns turn and shift whatever the station sees.
    first = len(model) + station.frame_column
    increments = values[first : first + 6]
    everything[0][on_floor, :, first : first + 6] = _frame_columns(bare, on_floor) * FRAME_PRIOR
    residual[on_floor] += np.einsum(
        "nwu,u->nw", everything[0][on_floor, :, first : first + 6], increments / FRAME_PRIOR
    )
    more, more_names = nuisance_columns(bare)
    everything += [nests, more]
    columns = np.concatenate(everything, axis=2)
    linear = replace(
        bare, columns=columns, names=(*names, *nest_names, *more_names), residual=residual, q=_whole(columns)
    )
    return _without_outliers(linear)


def _without_outliers(linear: Baseline) -> Baseline:
    """Single readings that lie far off count for less (Huber's weights): instruments have heavier tails than stated.

    Where many do, it is an effect that has them there, and all count fully.
    """
    left = linear.apply(linear.residual)
    open_part = np.maximum(1.0 - np.sum(linear.q**2, axis=2), 0.05)
    size = np.max(np.abs(left) / np.sqrt(open_part), axis=1)
    if not 0.0 < np.mean(size > FAR_OFF) < MOST_OUTLIERS:
        return linear
    weight = np.sqrt(np.minimum(1.0, HUBER / size))
    columns = linear.columns * weight[:, None, None]
    return replace(
        linear,
        whiten=linear.whiten * weight[:, None, None],
        residual=linear.residual * weight[:, None],
        columns=columns,
        q=_whole(columns),
    )


def _linearised(model: Model, readings: SmrPositions, sigma: Array, campaign: str) -> tuple[Array, Poses, Array, Array]:
    """Unknowns where the model is linearised, poses, whitened columns (r, 3, u) times sigma, readings less model."""
    seen, soft = readings.observations, model.parameters.rows("ln_stiffness")
    values, start = np.zeros(sigma.size), seen.visits.target_m
    for step in range(FIRST_STEPS + 1):
        poses = model.predict(values[: len(model)], seen.visits, start)
        if not np.all(poses.equilibrium.converged):
            raise InputError(
                f"recording {campaign}: the model finds no equilibrium for a visit; check units, drive coordinates and "
                "that the machine file fits the machine"
            )
        compared = readings.compare(poses, seen.visit[:, None], values[len(model) :])
        columns = np.concatenate([compared.by_model, compared.by_own], axis=2) * sigma
        right = np.einsum("nwu,u->nw", columns, values / sigma) - compared.residual
        if step == FIRST_STEPS:
            break
        flat = columns.reshape(-1, sigma.size)
        found = np.linalg.solve(flat.T @ flat + np.eye(sigma.size), flat.T @ right.ravel())
        # A strong effect may ask for any stiffness; where the model is linearised, it stays plausible.
        found[soft] = np.clip(found[soft], -MOST_SIGMA, MOST_SIGMA)
        values, start = found * sigma, poses.equilibrium.coordinates()
    return values, poses, columns, right


def usable_rows(recording: Recording) -> NDArray[np.intp]:
    """Rows that a diagnosis uses: calibration, repeatability and nests, without the station's warnings or tables."""
    phase = np.asarray(recording["phase"])
    keep = np.isin(phase, ("calibration", "repeatability", "nests", "verification_before"))
    keep &= (recording["flags"] == 0.0) & ((recording["compensation"] == 0.0) | (phase == "nests"))
    if not np.any(keep & (phase != "nests")):
        raise InputError(
            f"recording {recording.file.campaign}: no unflagged readings without compensation; measure a calibration"
        )
    return np.flatnonzero(keep)


def _observations(
    used: Recording, smr: NDArray[np.intp], on_floor: NDArray[np.bool_]
) -> tuple[ReflectorObservations, NDArray[np.intp]]:
    rows = np.flatnonzero(~on_floor)
    _, first, visit = np.unique(used["visit"][rows], return_index=True, return_inverse=True)
    heads, count = rows[first], np.bincount(visit)

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(visit, values[rows]) / count)

    visits = Visits(
        drives=used.drives("actual_m")[heads],
        target_m=used.targets_m()[heads],
        payload_kg=used["payload_mass_kg"][heads],
        payload_com_m=used.payload_com_m()[heads],
        temperatures_c={name: mean(t) for name, t in used.temperatures_c().items()},
    )
    all_visits = np.full(len(smr), -1, dtype=np.intp)
    all_visits[rows] = visit
    seen = ReflectorObservations(
        visits, visit.astype(np.intp), smr[rows], used.positions_m[rows], used.covariances_m2[rows]
    )
    return seen, all_visits


def _start(used: Recording, seen: ReflectorObservations) -> Frame:
    entry = used.file.station
    return fit_report_frame(used.machine, seen, station_frame(entry.position_m, entry.heading_rad)).frame


def _check_number(machine: Machine, visits: Visits) -> None:
    require_enough_poses(machine, visits.target_m)
    if len(visits) < LEAST_VISITS:
        raise InputError(f"{len(visits)} visits are too few for a diagnosis; measure {LEAST_VISITS} or more")


def _mounted(machine: Machine, station: StationModel, own: Array, smr: int) -> Array:
    return station.mounting_m(machine, own, smr) if smr in station.smrs else machine.smrs[smr].position_m


def _all_rows(columns: Array, rows: NDArray[np.intp], count: int) -> Array:
    out = np.zeros((count, 3, columns.shape[2]))
    out[rows] = columns
    return out


def _nest_columns(bare: Baseline, on_floor: NDArray[np.bool_]) -> tuple[Array, tuple[str, ...], Array]:
    """Columns (n, 3, k) of where the nests stand, their names, and nominal places (f, 3) in the station's frame."""
    smrs = sorted(set(bare.smr[on_floor].tolist()))
    out = np.zeros((len(bare.smr), 3, 3 * len(smrs)))
    for column, smr in enumerate(smrs):
        rows = np.flatnonzero(bare.smr == smr)
        out[rows, :, 3 * column : 3 * column + 3] = bare.whiten[rows] @ bare.frame.rotation * NEST_PRIOR_M
    nominal = np.array([s.position_m for s in bare.machine.smrs])[bare.smr[on_floor]]
    names = tuple(f"nest.{bare.machine.smrs[i].name}.{c}" for i in smrs for c in "xyz")
    return out, names, bare.frame.to_station(nominal)


def _frame_columns(bare: Baseline, rows: NDArray[np.bool_]) -> Array:
    """Whitened shifts (f, 3, 6) of some readings with the frame's rotation vector and translation."""
    turned = bare.position_m[rows] - bare.frame.translation_m
    out = np.zeros((len(turned), 3, 6))
    for k in range(3):
        out[:, :, k] = np.cross(np.eye(3)[k], turned)
        out[:, :, 3 + k] = np.eye(3)[k]
    return np.asarray(bare.whiten[rows] @ out)


def taken_out(q: Array, columns: Array) -> Array:
    """(1 - q q') times columns (n, 3, k) or (n, 3): what is left of them once all that q (n, 3, r) spans is fitted."""
    flat = columns.reshape(q.shape[0] * 3, -1)
    known = q.reshape(len(flat), -1)
    return np.asarray((flat - known @ (known.T @ flat)).reshape(columns.shape))


def _whole(columns: Array) -> Array:
    """q (n, 3, b): 1 - q q' is the inverse of 1 + A A' for columns A; directions that priors hold are left out."""
    flat = columns.reshape(-1, columns.shape[2])
    values, vectors = np.linalg.eigh(flat.T @ flat)
    seen = values > UNSEEN
    q = flat @ (vectors[:, seen] / np.sqrt(1.0 + values[seen]))
    return np.ascontiguousarray(q).reshape(*columns.shape[:2], -1)
