"""The linear model of a recording: residuals of the readings and their derivatives with respect to every unknown.

Geometry, stiffness, mounting and frame remain unknowns with their priors, together with the declared disturbances, so
that an effect is credited only with what they cannot explain. Rows are readings (n) of three whitened coordinates each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.diagnosis.disturbances import disturbance_columns
from calibration.diagnosis.linearisation import FRAME_PRIOR, LinearisationPoint, Unknowns, linearise
from calibration.diagnosis.observed_model import ObservedModel, whitened_shift
from calibration.diagnosis.outlying_readings import fitting_readings, outlier_weights, project_out
from calibration.effects.context import context_of_recording
from calibration.instruments.setups import Setups
from calibration.instruments.smr_positions import ReflectorObservations, SmrPositions, StationModel
from calibration.machine.description import Machine
from calibration.model.visits import Visits
from calibration.recording.header import DisturbanceLevels
from calibration.recording.recording import Recording
from calibration.reduction.data_checks import require_enough_poses
from calibration.reduction.grouped_readings import group_by_visit, reflector_indices
from calibration.reduction.recording_setups import in_first_frame, setups_of

NEST_PRIOR_M = 5.0e-3
GATINGS = 4
LEAST_VISITS = 20
NEGLIGIBLE_INFORMATION = 2.0e-3  # information of a direction over its prior's, below which the prior alone counts
PHASES = ("calibration", "repeatability", "nests", "verification_before")


@dataclass(frozen=True)
class LinearModel(ObservedModel):
    """The linearised model of a recording's readings.

    rows (n,): rows of the recording that are used. whiten (n, 3, 3). residual (n, 3): whitened, measured minus
    modelled, extrapolated linearly to zero values of all unknowns. columns (n, 3, b): derivatives by every unknown,
    each times its prior standard deviation; names (b,) and sigma (u,): of the unknowns, sigma of the model's and the
    station's only. values (u,): of these, at the point of linearisation. q (n, 3, r): 1 - q q' is the inverse
    covariance of the readings. of_calibration: number of columns before those of the disturbances. station: as it was
    fitted; setup (n,): row of its set-ups. wrong (k,): rows that are left out because they do not fit the others.
    """

    station: StationModel
    setup: NDArray[np.intp]
    recording: Recording
    rows: NDArray[np.intp]
    wrong: NDArray[np.intp]
    whiten: Array
    residual: Array
    columns: Array
    names: tuple[str, ...]
    sigma: Array
    values: Array
    q: Array
    of_calibration: int

    def apply(self, columns: Array) -> Array:
        """Inverse covariance times whitened columns (n, 3, k) or (n, 3)."""
        return project_out(self.q, columns)

    def after_calibration(self, shift: Array) -> Array:
        """What a fit of frame, reflectors and geometry leaves of a whitened shift (n, 3)."""
        return project_out(self._q_of_calibration, shift)

    def with_levels(self, levels: DisturbanceLevels, scales: Array) -> LinearModel:
        """The same with other levels of the disturbances: scales (b,) on the columns' standard deviations."""
        file = self.recording.file.model_copy(update={"nuisance": levels})
        columns = self.columns * scales
        return replace(
            self,
            recording=replace(self.recording, file=file),
            columns=columns,
            q=inverse_covariance_factor(columns),
        )

    @cached_property
    def _q_of_calibration(self) -> Array:
        return inverse_covariance_factor(self.columns[:, :, : self.of_calibration])

    def whiten_shift(self, shift_m: Array) -> Array:
        """Shifts (n, 3) in the machine's frame, whitened."""
        return whitened_shift(self.whiten, self.frame, shift_m)


def linearise_recording(
    recording: Recording, *, judge: bool = True, held: Mapping[str, float] | None = None
) -> LinearModel:
    """Fit the model to a recording and linearise it there, wrong readings left out (outlying_readings).

    judge: whether wrong readings are looked for; the costliest part, in vain where there are none. held: values of
    unknowns, in SI units, at which it is linearised whatever the readings say; the others are fitted. Raises InputError
    if the readings do not allow it.
    """
    usable = usable_rows(recording)
    rows = usable
    for _ in range(GATINGS):
        linear, keep = _linearise_rows(recording, rows, np.setdiff1d(usable, rows), judge=judge, held=held)
        if np.all(keep):
            break
        rows = rows[keep]
    return linear


def _linearise_rows(
    recording: Recording,
    rows: NDArray[np.intp],
    wrong: NDArray[np.intp],
    *,
    judge: bool,
    held: Mapping[str, float] | None,
) -> tuple[LinearModel, NDArray[np.bool_]]:
    """The linear model of some rows (n,) without wrong ones (k,), and which of them (n,) fit the others."""
    setups = setups_of(recording.take(np.delete(np.arange(len(recording)), wrong)))
    used = in_first_frame(recording.take(rows), setups)
    observations, visit, smr = _observations(used, setups)
    _require_enough_visits(used.machine, observations.visits)
    unknowns = Unknowns.of(used, observations, setups)
    point = linearise(unknowns, SmrPositions(observations, unknowns.station), recording.file.campaign, held)
    observed = ObservedModel(
        machine=used.machine,
        context=context_of_recording(used),
        smr=smr,
        visit=visit,
        poses=point.poses,
        frame=unknowns.station.frame(point.values[unknowns.of_model :]),
        mounted_m=unknowns.mounted_m(used.machine, point.values),
        position_m=used.positions_m,
        station_m=setups.translation_m[setups.rows(used["station"])],
    )
    whiten = np.linalg.inv(np.linalg.cholesky(used.covariances_m2))
    by_unknowns, residual = _all_readings(observed, whiten, unknowns, point, setups.rows(used["station"]))
    by_nests, nest_names = _nest_columns(observed, whiten)
    by_disturbances, disturbance_names = disturbance_columns(
        observed, whiten, recording.file.nuisance, recording.file.station.accuracy, recording.file.nest_limit_m
    )
    columns = np.concatenate([by_unknowns, by_nests, by_disturbances], axis=2)
    keep = fitting_readings(observed, whiten, residual, columns) if judge else np.ones(len(rows), dtype=np.bool_)
    q = inverse_covariance_factor(columns)
    weight = outlier_weights(residual, q)
    if weight is not None:
        columns = columns * weight[:, None, None]
        q = inverse_covariance_factor(columns)
        whiten, residual = whiten * weight[:, None, None], residual * weight[:, None]
    linear = LinearModel(
        machine=observed.machine,
        context=observed.context,
        smr=observed.smr,
        visit=observed.visit,
        poses=observed.poses,
        frame=observed.frame,
        mounted_m=observed.mounted_m,
        position_m=observed.position_m,
        station_m=observed.station_m,
        station=unknowns.station,
        setup=setups.rows(used["station"]),
        recording=recording,
        rows=rows,
        wrong=wrong,
        whiten=whiten,
        residual=residual,
        columns=columns,
        names=(*unknowns.names, *nest_names, *disturbance_names),
        sigma=unknowns.sigma,
        values=point.values,
        q=q,
        of_calibration=by_unknowns.shape[2] + by_nests.shape[2],
    )
    return linear, keep


def _all_readings(
    observed: ObservedModel,
    whiten: Array,
    unknowns: Unknowns,
    point: LinearisationPoint,
    setup: NDArray[np.intp],
) -> tuple[Array, Array]:
    """Columns (n, 3, u) and residual (n, 3) of all readings: those at poses, and those of the floor nests.

    The unknowns of the frame and of the set-ups turn and shift every point that the station measures, so they act on
    the nests too.
    """
    n, on_pose, on_floor = len(observed.smr), np.flatnonzero(observed.visit >= 0), observed.on_floor
    columns, residual = np.zeros((n, 3, unknowns.sigma.size)), np.zeros((n, 3))
    columns[on_pose], residual[on_pose] = point.columns, point.residual
    nominal = np.array([smr.position_m for smr in observed.machine.smrs])[observed.smr[on_floor]]
    missed_m = observed.position_m[on_floor] - observed.frame.to_station(nominal)
    by_frame = _frame_columns(observed, whiten, on_floor) * FRAME_PRIOR
    columns[on_floor, :, unknowns.of_frame] = by_frame
    if count := 6 * (len(unknowns.station.setups) - 1):
        by_setup = unknowns.station.setups.shift_by_error(observed.position_m[on_floor], setup[on_floor])
        columns[on_floor, :, -count:] = whiten[on_floor] @ by_setup * FRAME_PRIOR
    residual[on_floor] = np.einsum("nij,nj->ni", whiten[on_floor], missed_m)
    residual[on_floor] += np.einsum("nwu,u->nw", by_frame, point.values[unknowns.of_frame] / FRAME_PRIOR)
    return columns, residual


def _frame_columns(observed: ObservedModel, whiten: Array, rows: NDArray[np.bool_]) -> Array:
    """Whitened shifts (f, 3, 6) of some readings by the frame's rotation vector and translation."""
    lever = observed.position_m[rows] - observed.frame.translation_m
    out = np.zeros((len(lever), 3, 6))
    for k in range(3):
        out[:, :, k] = np.cross(np.eye(3)[k], lever)
        out[:, :, 3 + k] = np.eye(3)[k]
    return np.asarray(whiten[rows] @ out)


def _nest_columns(observed: ObservedModel, whiten: Array) -> tuple[Array, tuple[str, ...]]:
    """Columns (n, 3, k) by the positions of the floor nests, and their names."""
    smrs = sorted(set(observed.smr[observed.on_floor].tolist()))
    out = np.zeros((len(observed.smr), 3, 3 * len(smrs)))
    for column, smr in enumerate(smrs):
        rows = np.flatnonzero(observed.smr == smr)
        out[rows, :, 3 * column : 3 * column + 3] = whiten[rows] @ observed.frame.rotation * NEST_PRIOR_M
    return out, tuple(f"nest.{observed.machine.smrs[i].name}.{c}" for i in smrs for c in "xyz")


def usable_rows(recording: Recording) -> NDArray[np.intp]:
    """Rows for a diagnosis: calibration, repeatability, nests, verification; no flags of the station, no tables."""
    phase = np.asarray(recording["phase"])
    keep = np.isin(phase, PHASES)
    keep &= (recording["flags"] == 0.0) & ((recording["compensation"] == 0.0) | (phase == "nests"))
    if not np.any(keep & (phase != "nests")):
        raise InputError(
            f"recording {recording.file.campaign}: no unflagged readings without compensation; measure a calibration"
        )
    return np.flatnonzero(keep)


def _observations(used: Recording, setups: Setups) -> tuple[ReflectorObservations, NDArray[np.intp], NDArray[np.intp]]:
    """Readings at poses; of all readings (n,): the row of the visit (-1 for floor nests), the reflector's index."""
    smr = reflector_indices(used)
    rows = np.flatnonzero(np.array([s.on != "floor" for s in used.machine.smrs])[smr])
    observations = group_by_visit(
        used, rows, used.positions_m, used.covariances_m2, setups.rows(used["station"])
    ).observations
    all_visits = np.full(len(smr), -1, dtype=np.intp)
    all_visits[rows] = observations.visit
    return observations, all_visits, smr


def _require_enough_visits(machine: Machine, visits: Visits) -> None:
    require_enough_poses(machine, visits.target_m)
    if len(visits) < LEAST_VISITS:
        raise InputError(f"{len(visits)} visits are too few for a diagnosis; measure {LEAST_VISITS} or more")


def inverse_covariance_factor(columns: Array) -> Array:
    """q (n, 3, r) such that 1 - q q' is the inverse of 1 + A A' for columns A (n, 3, b).

    Directions that are determined by the priors alone are omitted.
    """
    flat = columns.reshape(-1, columns.shape[2])
    values, vectors = np.linalg.eigh(flat.T @ flat)
    informative = values > NEGLIGIBLE_INFORMATION
    q = flat @ (vectors[:, informative] / np.sqrt(1.0 + values[informative]))
    return np.ascontiguousarray(q).reshape(*columns.shape[:2], -1)
