"""Calibration and causes found together, with the nonlinear model: the solution that a twin is made of.

The diagnosis is linear at the machine that calibration alone finds. Once the causes belong to the model, geometry and
above all stiffness move by what they had taken up of them, further than one linearisation holds: Gauss-Newton goes on
from there, over calibration's unknowns (all of `Baseline.columns`, with their priors) and the causes' coefficients.
The causes' own columns stay those of the diagnosis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.frame import Frame
from calibration.diagnosis.evidence import Readout
from calibration.diagnosis.linear_model import NEST_PRIOR_M, Baseline
from calibration.diagnosis.search import Cause
from calibration.diagnosis.twin.twin_model import Fit, whole_model
from calibration.instruments.smr_positions import REFRACTION_U_PER_M, ReflectorObservations, SmrPositions, StationModel

MOST_STEPS = 12
HALVINGS = 6
SETTLED = 0.01  # RMS of what a step still changes, in standard deviations of a reading


@dataclass(frozen=True)
class Solution:
    """z (b,): unknowns of the baseline over their standard deviations; c (k,): coefficients of all causes over theirs.

    fit: of machine and station; ranges: range constant, scale and refraction by name; coefficients: of each cause;
    wander (n, 3): whitened shifts of all readings by the declared nuisance.
    """

    z: Array
    c: Array
    fit: Fit
    ranges: dict[str, float]
    coefficients: tuple[Array, ...]
    wander: Array


@dataclass(frozen=True)
class _Linear:
    """The model at z: columns (n, 3, b) and what it misses of the readings (n, 3) there, whitened; poses (v, 6)."""

    z: Array
    columns: Array
    missed: Array
    rest: Array


class Joint:
    """The joint fit of a baseline's readings with some causes."""

    def __init__(self, readout: Readout, causes: Sequence[Cause]) -> None:
        self._known = known = readout.baseline
        self._causes = tuple(causes)
        deviations = [cause.deviations for cause in causes]
        self._deviations = np.concatenate([*deviations, np.empty(0)])
        columns = [readout.columns(cause.acts) for cause in causes]
        self._acting = np.concatenate([*columns, np.empty((*known.residual.shape, 0))], axis=2) * self._deviations
        self._on_pose = np.flatnonzero(known.visit >= 0)
        count = known.sigma.size
        self._first = known.names.index("frame.rx")
        accuracy = known.recording.file.station.accuracy
        smrs = tuple(sorted(set(known.smr[self._on_pose].tolist())))
        # The frame's unknowns count from the one where the baseline is linear, not from where its fit began.
        self._station = StationModel(
            known.frame, smrs, accuracy.range_constant_u_m, accuracy.range_scale_u, REFRACTION_U_PER_M
        )
        self._before = np.zeros(count)
        self._before[self._first : self._first + 6] = known.values[self._first : self._first + 6]
        rows = self._on_pose
        spread = np.linalg.inv(known.whiten[rows])
        covariances = spread @ spread.transpose(0, 2, 1)  # the baseline's weights among them
        visits = known.poses.visits
        self._readings = SmrPositions(
            ReflectorObservations(visits, known.visit[rows], known.smr[rows], known.position_m[rows], covariances),
            self._station,
        )

    @cached_property
    def solution(self) -> Solution:
        """Of all readings."""
        return self._solution(
            *self._search(self._at_baseline, np.zeros(self._deviations.size), np.ones(len(self._known.smr), dtype=bool))
        )

    def without(self, rows: NDArray[np.intp]) -> Solution:
        """The same without some rows of readings."""
        keep = np.ones(len(self._known.smr), dtype=bool)
        keep[rows] = False
        return self._solution(*self._search(self._at_solution, self.solution.c, keep))

    @cached_property
    def _at_baseline(self) -> _Linear:
        known, count = self._known, self._known.sigma.size
        z = np.zeros(known.columns.shape[2])
        z[:count] = known.values / known.sigma
        return _Linear(z, known.columns, known.residual - known.columns @ z, known.poses.equilibrium.coordinates())

    @cached_property
    def _at_solution(self) -> _Linear:
        return self._linear(self.solution.z, self._at_baseline.rest)

    def _search(self, at: _Linear, c: Array, keep: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Unknowns z (b,) and c (k,) by Gauss-Newton, steps that gain nothing halved."""
        best = self._loss(at, c, keep)
        for _ in range(MOST_STEPS):
            z_new, c_new = self._solve(at, keep)
            change = at.columns @ (z_new - at.z) + self._acting @ (c_new - c)
            if float(np.sqrt(np.mean(change[keep] ** 2))) < SETTLED:
                return z_new, c_new
            share = 1.0
            for _ in range(HALVINGS):
                z, tried = at.z + share * (z_new - at.z), c + share * (c_new - c)
                trial = self._linear(z, at.rest)
                loss = self._loss(trial, tried, keep)
                if loss <= best:
                    break
                share *= 0.5
            else:
                return at.z, c
            at, c, best = trial, tried, loss
        return at.z, c

    def _loss(self, at: _Linear, c: Array, keep: NDArray[np.bool_]) -> float:
        missed = at.missed - self._acting @ c
        return float(np.sum(missed[keep] ** 2) + at.z @ at.z + c @ c)

    def _solve(self, at: _Linear, keep: NDArray[np.bool_]) -> tuple[Array, Array]:
        columns = np.concatenate([at.columns, self._acting], axis=2)[keep]
        flat = columns.reshape(-1, columns.shape[2])
        right = (at.missed + at.columns @ at.z)[keep].ravel()
        found = np.linalg.solve(flat.T @ flat + np.eye(flat.shape[1]), flat.T @ right)
        return found[: at.z.size], found[at.z.size :]

    def _linear(self, z: Array, start: Array) -> _Linear:
        """The model at z, its poses searched from `start`."""
        known, rows, count = self._known, self._on_pose, self._known.sigma.size
        values = z[:count] * known.sigma
        model = known.poses.model
        with np.errstate(all="ignore"):
            poses = model.predict(values[: len(model)], known.poses.visits, start)
        if not np.all(poses.equilibrium.converged):
            return _Linear(z, known.columns, np.full_like(known.residual, 1e9), start)
        compared = self._readings.compare(poses, known.visit[rows, None], (values - self._before)[len(model) :])
        columns = known.columns.copy()
        columns[rows, :, :count] = np.concatenate([compared.by_model, compared.by_own], axis=2) * known.sigma
        missed = known.residual - known.columns @ z
        missed[rows] = -compared.residual - columns[rows][:, :, count:] @ z[count:]
        return _Linear(z, columns, missed, poses.equilibrium.coordinates())

    def _solution(self, z: Array, c: Array) -> Solution:
        known, count, names = self._known, self._known.sigma.size, self._known.names
        values = z[:count] * known.sigma
        at = dict(zip(names[:count], values.tolist(), strict=True))
        mounted = known.mounted_m.copy()
        nests = dict(zip(names[count:], (z[count:] * NEST_PRIOR_M).tolist(), strict=True))
        for i, smr in enumerate(known.machine.smrs):
            for k, axis in enumerate("xyz"):
                mounted[i, k] = smr.position_m[k] + at.get(f"mounting.{smr.name}.{axis}", 0.0)
                mounted[i, k] += nests.get(f"nest.{smr.name}.{axis}", 0.0)
        frame = self._station.frame((values - self._before)[len(known.poses.model) :])
        nuisance = next((k for k, n in enumerate(names) if k >= count and not n.startswith("nest.")), len(names))
        sizes = [cause.deviations.size for cause in self._causes]
        fit = Fit(_whole(known, values), frame, mounted)
        ranges = {name: value for name, value in at.items() if name.startswith(("range.", "refraction."))}
        for i, smr in enumerate(known.machine.smrs):
            if smr.on == "floor":  # a nest's unknowns hold what the station states, its errors of range included
                stated = _stated_m(known, fit.frame, ranges, mounted[i : i + 1])[0]
                mounted[i] -= (stated - fit.frame.to_station(mounted[i : i + 1])[0]) @ fit.frame.rotation
        return Solution(
            z=z,
            c=c,
            fit=fit,
            ranges=ranges,
            coefficients=tuple(np.split(c * self._deviations, np.cumsum(sizes)[:-1])) if sizes else (),
            wander=known.columns[:, :, nuisance:] @ z[nuisance:],
        )


def fit_before(known: Baseline) -> Fit:
    """The machine at which a baseline is linear."""
    return Fit(_whole(known, known.values), known.frame, known.mounted_m)


def _whole(known: Baseline, values: Array) -> Array:
    """Values of all unknowns of the machine's model, from those of a baseline."""
    model = known.poses.model
    fitted = dict(zip([u.name for u in model.unknowns], values[: len(model)].tolist(), strict=True))
    return np.array([fitted.get(u.name, 0.0) for u in whole_model(known.machine).unknowns])


def stated_m(known: Baseline, solution: Solution, places_m: Array) -> Array:
    """Places (n, 3) of the machine's frame as the station states them."""
    return _stated_m(known, solution.fit.frame, solution.ranges, places_m)


def _stated_m(known: Baseline, frame: Frame, ranges: dict[str, float], places_m: Array) -> Array:
    accuracy = known.recording.file.station.accuracy
    constant_u_m, scale_u = accuracy.range_constant_u_m, accuracy.range_scale_u
    station = StationModel(frame, (), constant_u_m, scale_u, REFRACTION_U_PER_M, known_frame=True)
    own = np.array([ranges.get(u.name, 0.0) for u in station.unknowns(known.machine)])
    return station.observe(known.machine, own, places_m)[0]
