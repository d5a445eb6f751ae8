"""Joint fit of calibration and causes with the nonlinear model: the solution that a twin is made of.

The diagnosis is linear at the machine that calibration alone finds. Once the causes belong to the model, geometry and
above all stiffness release what they had absorbed of them, which takes them out of the range of one linearisation:
Gauss-Newton continues from there, over the unknowns of the calibration (all of `LinearModel.columns`, with their
priors) and the causes' coefficients. The causes' own columns remain those of the diagnosis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.frame import Frame
from calibration.diagnosis.evidence import MarginalLikelihood
from calibration.diagnosis.linear_model import LinearModel, require_recording
from calibration.diagnosis.nest_readings import NEST_PRIOR_M
from calibration.diagnosis.ranking import Cause, as_found, columns_of_cause, shares_of_places
from calibration.diagnosis.twin.twin_model import FittedMachine, full_model
from calibration.instruments.smr_positions import ReflectorObservations, SmrPositions, StationModel

MAX_STEPS = 12
MAX_HALVINGS = 6
CONVERGED_SIGMA = 0.01  # RMS change of the last step, in standard deviations of a reading
NO_EQUILIBRIUM = 1e9  # residual of a model without an equilibrium: worse than any other


@dataclass(frozen=True)
class Solution:
    """z (b,): unknowns of the linear model over their standard deviations; c (k,): coefficients of all causes over
    theirs, common ones once.

    fitted_machine: of these unknowns; ranges: range constant, scale and refraction by name; coefficients: of each
    cause; disturbance_shift (n, 3): whitened shifts of all readings by the declared disturbances and by errors of
    the set-ups' motions.
    """

    z: Array
    c: Array
    fitted_machine: FittedMachine
    ranges: dict[str, float]
    coefficients: tuple[Array, ...]
    disturbance_shift: Array


@dataclass(frozen=True)
class _Linearisation:
    """The model at z: whitened columns (n, 3, b) and residual of the readings (n, 3) there; poses (v, 6)."""

    z: Array
    columns: Array
    residual: Array
    poses: Array


class JointFit:
    """The joint fit of a linear model's readings with some causes."""

    def __init__(self, likelihood: MarginalLikelihood, causes: Sequence[Cause]) -> None:
        self._linear = linear = require_recording(likelihood.linear)
        self._causes, self._found = tuple(causes), as_found(causes)
        columns = [columns_of_cause(likelihood, cause) for cause in self._found]
        self._cause_columns = np.concatenate([*columns, np.empty((*linear.residual.shape, 0))], axis=2)
        self._on_pose = rows = np.flatnonzero(linear.visit >= 0)
        # The unknowns of the frame count from the frame at which the model is linear, not from where its fit began.
        self._station = replace(linear.station, start=linear.frame)
        first = linear.names.index("frame.rx")
        self._offset = np.zeros(linear.sigma.size)
        self._offset[first : first + 6] = linear.values[first : first + 6]
        spread = np.linalg.inv(linear.whiten[rows])
        covariances = spread @ spread.transpose(0, 2, 1)  # including the weights of outliers
        observations = ReflectorObservations(
            linear.poses.visits,
            linear.visit[rows],
            linear.smr[rows],
            linear.position_m[rows],
            covariances,
            linear.setup[rows],
        )
        self._readings = SmrPositions(observations, self._station)

    @cached_property
    def solution(self) -> Solution:
        """Of all readings."""
        all_rows = np.ones(len(self._linear.smr), dtype=bool)
        return self._build_solution(
            *self._gauss_newton(self._at_linear_model, np.zeros(self._cause_columns.shape[2]), all_rows)
        )

    def without(self, rows: NDArray[np.intp]) -> Solution:
        """The solution without some rows of readings."""
        keep = np.ones(len(self._linear.smr), dtype=bool)
        keep[rows] = False
        return self._build_solution(*self._gauss_newton(self._at_solution, self.solution.c, keep))

    @cached_property
    def _at_linear_model(self) -> _Linearisation:
        linear, count = self._linear, self._linear.sigma.size
        z = np.zeros(linear.columns.shape[2])
        z[:count] = linear.values / linear.sigma
        residual = linear.residual - linear.columns @ z
        return _Linearisation(z, linear.columns, residual, linear.poses.equilibrium.coordinates())

    @cached_property
    def _at_solution(self) -> _Linearisation:
        return self._linearise(self.solution.z, self._at_linear_model.poses)

    def _gauss_newton(self, start: _Linearisation, c: Array, keep: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Unknowns z (b,) and c (k,); a step that does not reduce the loss is halved."""
        current, best = start, self._loss(start, c, keep)
        for _ in range(MAX_STEPS):
            z_new, c_new = self._solve(current, keep)
            change = current.columns @ (z_new - current.z) + self._cause_columns @ (c_new - c)
            if float(np.sqrt(np.mean(change[keep] ** 2))) < CONVERGED_SIGMA:
                return z_new, c_new
            step_length = 1.0
            for _ in range(MAX_HALVINGS):
                z, trial_c = current.z + step_length * (z_new - current.z), c + step_length * (c_new - c)
                trial = self._linearise(z, current.poses)
                loss = self._loss(trial, trial_c, keep)
                if loss <= best:
                    break
                step_length *= 0.5
            else:
                return current.z, c
            current, c, best = trial, trial_c, loss
        return current.z, c

    def _loss(self, at: _Linearisation, c: Array, keep: NDArray[np.bool_]) -> float:
        residual = at.residual - self._cause_columns @ c
        return float(np.sum(residual[keep] ** 2) + at.z @ at.z + c @ c)

    def _solve(self, at: _Linearisation, keep: NDArray[np.bool_]) -> tuple[Array, Array]:
        columns = np.concatenate([at.columns, self._cause_columns], axis=2)[keep]
        flat = columns.reshape(-1, columns.shape[2])
        target = (at.residual + at.columns @ at.z)[keep].ravel()
        unknowns = np.linalg.solve(flat.T @ flat + np.eye(flat.shape[1]), flat.T @ target)
        return unknowns[: at.z.size], unknowns[at.z.size :]

    def _linearise(self, z: Array, start: Array) -> _Linearisation:
        """The model at z, its poses searched from `start` (v, 6)."""
        linear, rows, count = self._linear, self._on_pose, self._linear.sigma.size
        values = z[:count] * linear.sigma
        model = linear.poses.model
        with np.errstate(all="ignore"):
            poses = model.predict(values[: len(model)], linear.poses.visits, start)
        if not np.all(poses.equilibrium.converged):
            return _Linearisation(z, linear.columns, np.full_like(linear.residual, NO_EQUILIBRIUM), start)
        compared = self._readings.compare(poses, linear.visit[rows, None], (values - self._offset)[len(model) :])
        columns = linear.columns.copy()
        columns[rows, :, :count] = np.concatenate([compared.by_model, compared.by_own], axis=2) * linear.sigma
        residual = linear.residual - linear.columns @ z
        residual[rows] = -compared.residual - columns[rows][:, :, count:] @ z[count:]
        return _Linearisation(z, columns, residual, poses.equilibrium.coordinates())

    def _build_solution(self, z: Array, c: Array) -> Solution:
        linear, count, names = self._linear, self._linear.sigma.size, self._linear.names
        values = z[:count] * linear.sigma
        by_name = dict(zip(names[:count], values.tolist(), strict=True))
        frame = self._station.frame((values - self._offset)[len(linear.poses.model) :])
        ranges = {name: value for name, value in by_name.items() if name.startswith(("range.", "refraction."))}
        mounted = self._mounted_m(z, by_name)
        for i, smr in enumerate(linear.machine.smrs):
            if smr.on == "floor":  # the unknowns of a nest contain what the station reports, its range errors included
                reported = _as_station_reports_m(linear, frame, ranges, mounted[i : i + 1])[0]
                mounted[i] -= (reported - frame.to_station(mounted[i : i + 1])[0]) @ frame.rotation
        disturbances = next((k for k, n in enumerate(names) if k >= count and not n.startswith("nest.")), len(names))
        moved = [k for k, n in enumerate(names[:count]) if n.startswith("setup.")]
        disturbance_shift = linear.columns[:, :, disturbances:] @ z[disturbances:]
        if moved:
            disturbance_shift += linear.columns[:, :, moved] @ z[moved]
        return Solution(
            z=z,
            c=c,
            fitted_machine=FittedMachine(_all_unknowns(linear, values), frame, mounted),
            ranges=ranges,
            coefficients=self._at_each_place(c),
            disturbance_shift=disturbance_shift,
        )

    def _at_each_place(self, c: Array) -> tuple[Array, ...]:
        """Coefficients of each cause at its place."""
        of_part: dict[int, Array] = {}
        begin = 0
        for cause in self._found:
            shares = shares_of_places(cause) if cause.in_common else np.ones(len(cause.parts))
            for share, part in zip(shares.tolist(), cause.parts, strict=True):
                end = begin + part.prior_deviations.size
                of_part[id(part.best)] = share * c[begin:end] * part.prior_deviations
                begin = begin if cause.in_common else end
            begin = end
        return tuple(of_part[id(cause.best)] for cause in self._causes)

    def _mounted_m(self, z: Array, by_name: dict[str, float]) -> Array:
        """Positions (smrs, 3) of the reflectors on their parts; of nests, with the range errors of the station."""
        linear, count = self._linear, self._linear.sigma.size
        nests = dict(zip(linear.names[count:], (z[count:] * NEST_PRIOR_M).tolist(), strict=True))
        mounted = linear.mounted_m.copy()
        for i, smr in enumerate(linear.machine.smrs):
            for k, axis in enumerate("xyz"):
                mounted[i, k] = smr.position_m[k] + by_name.get(f"mounting.{smr.name}.{axis}", 0.0)
                mounted[i, k] += nests.get(f"nest.{smr.name}.{axis}", 0.0)
        return mounted


def machine_of_linear_model(linear: LinearModel) -> FittedMachine:
    """The machine at which a linear model was linearised."""
    return FittedMachine(_all_unknowns(linear, linear.values), linear.frame, linear.mounted_m)


def _all_unknowns(linear: LinearModel, values: Array) -> Array:
    """Values of all unknowns of the full model, from those of a linear model."""
    model = linear.poses.model
    fitted = dict(zip([u.name for u in model.unknowns], values[: len(model)].tolist(), strict=True))
    return np.array([fitted.get(u.name, 0.0) for u in full_model(linear.machine).unknowns])


def as_station_reports_m(linear: LinearModel, solution: Solution, positions_m: Array) -> Array:
    """Positions (n, 3) in the machine's frame as the station reports them, in its own frame."""
    return _as_station_reports_m(linear, solution.fitted_machine.frame, solution.ranges, positions_m)


def _as_station_reports_m(linear: LinearModel, frame: Frame, ranges: dict[str, float], positions_m: Array) -> Array:
    accuracy = linear.recording.file.station.accuracy.to_station_accuracy()
    station = StationModel.from_accuracy(frame, (), accuracy, known_frame=True)
    unknowns = np.array([ranges.get(u.name, 0.0) for u in station.unknowns(linear.machine)])
    return station.observe(linear.machine, unknowns, positions_m)[0]
