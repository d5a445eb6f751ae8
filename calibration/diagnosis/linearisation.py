"""The point at which the model of a recording is linear: its unknowns, and the steps that lead there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame, station_frame
from calibration.instruments.setups import Setups
from calibration.instruments.smr_positions import ReflectorObservations, SmrPositions, StationModel
from calibration.machine.description import Machine
from calibration.model.model import Model, Poses, SystematicUncertainties
from calibration.model.parameters import ParameterSet
from calibration.recording.recording import Recording
from calibration.reduction.report_frame import fit_report_frame

FRAME_PRIOR = 5.0e-3  # m and rad, about the frame that was fitted to the commanded poses
LINEARISATION_STEPS = 2
STIFFNESS_LIMIT_SIGMA = 3.0


@dataclass(frozen=True)
class Unknowns:
    """Unknowns (u) of the machine's model, then of the station's: names and prior standard deviations."""

    model: Model
    station: StationModel
    names: tuple[str, ...]
    sigma: Array

    @classmethod
    def of(cls, used: Recording, observations: ReflectorObservations, setups: Setups) -> Unknowns:
        """All unknowns that the readings used concern."""
        machine = used.machine
        systematic = SystematicUncertainties.from_declared(
            used.file.payloads, machine, used.file.nuisance.temperature_k
        )
        model = Model(ParameterSet.of(machine), systematic)
        smrs = tuple(sorted(set(observations.smr.tolist())))
        accuracy = used.file.station.accuracy.to_station_accuracy()
        station = StationModel.from_accuracy(initial_frame(used, observations), smrs, accuracy)
        if len(setups) > 1:  # the nests are readings of the same model
            station = replace(station, setups=setups.with_error(FRAME_PRIOR))
        unknowns = (*model.unknowns, *station.unknowns(machine))
        sigma = np.array([unknown.sigma for unknown in unknowns])
        out = cls(model, station, tuple(unknown.name for unknown in unknowns), sigma)
        sigma[out.of_frame] = FRAME_PRIOR
        return out

    @property
    def of_model(self) -> int:
        """Number of the model's unknowns: those of the station follow."""
        return len(self.model)

    @property
    def of_frame(self) -> slice:
        """Where the six unknowns of the station's frame are."""
        first = self.of_model + self.station.frame_column
        return slice(first, first + 6)

    def mounted_m(self, machine: Machine, values: Array) -> Array:
        """Fitted positions (smrs, 3) of the reflectors on their parts; those of the machine file if not measured."""
        of_station = values[self.of_model :]
        return np.array([
            self.station.mounting_m(machine, of_station, i) if i in self.station.smrs else smr.position_m
            for i, smr in enumerate(machine.smrs)
        ])  # fmt: skip


@dataclass(frozen=True)
class LinearisationPoint:
    """The model at values (u,) of its unknowns: poses; of the readings at poses (r), whitened: columns (r, 3, u), each
    times sigma, and residual (r, 3), extrapolated to zero values."""

    values: Array
    poses: Poses
    columns: Array
    residual: Array


def linearise(
    unknowns: Unknowns, readings: SmrPositions, campaign: str, held: Mapping[str, float] | None = None
) -> LinearisationPoint:
    """Gauss-Newton steps from nominal values to a point at which the model is linear, as if nothing disturbed it.

    held: values of unknowns, in SI units, that no step moves; of those that the campaign does not have none is needed.
    """
    start = np.array([(held or {}).get(name, 0.0) for name in unknowns.names])
    point = linearise_at(unknowns, readings, campaign, start, readings.observations.visits.target_m)
    for _ in range(LINEARISATION_STEPS):
        values = most_likely(unknowns, point.columns, point.residual, held)
        point = linearise_at(unknowns, readings, campaign, values, point.poses.equilibrium.coordinates())
    return point


def linearise_at(
    unknowns: Unknowns, readings: SmrPositions, campaign: str, values: Array, start: Array
) -> LinearisationPoint:
    """The model at some values (u,); start (v, c): coordinates of the poses, by which they are found.

    Raises InputError if they are not.
    """
    model, sigma, observations = unknowns.model, unknowns.sigma, readings.observations
    poses = model.predict(values[: len(model)], observations.visits, start)
    if not np.all(poses.equilibrium.converged):
        raise InputError(
            f"recording {campaign}: the model finds no equilibrium for a visit; check units, drive coordinates and "
            "that the machine file fits the machine"
        )
    compared = readings.compare(poses, observations.visit[:, None], values[len(model) :])
    columns = np.concatenate([compared.by_model, compared.by_own], axis=2) * sigma
    residual = np.einsum("nwu,u->nw", columns, values / sigma) - compared.residual
    return LinearisationPoint(values, poses, columns, residual)


def most_likely(unknowns: Unknowns, columns: Array, residual: Array, held: Mapping[str, float] | None = None) -> Array:
    """Values (u,) of the unknowns, in SI units, by a linear model of whitened columns (n, 3, c) and residual (n, 3).

    Their columns come first; those of what else may be in the readings follow.
    """
    held, stiffness = held or {}, unknowns.model.parameters.rows("ln_stiffness")
    count = len(unknowns.names)
    flat = columns.reshape(-1, columns.shape[2])
    free = np.ones(flat.shape[1], dtype=np.bool_)
    free[:count] = [name not in held for name in unknowns.names]
    scaled = np.zeros(flat.shape[1])
    scaled[:count] = np.array([held.get(name, 0.0) for name in unknowns.names]) / unknowns.sigma
    of_free = flat[:, free]
    right = of_free.T @ (residual.ravel() - flat[:, ~free] @ scaled[~free])
    scaled[free] = np.linalg.solve(of_free.T @ of_free + np.eye(of_free.shape[1]), right)
    # A strong effect can drive the stiffness to any value; the point of linearisation has to remain plausible.
    scaled[stiffness] = np.clip(scaled[stiffness], -STIFFNESS_LIMIT_SIGMA, STIFFNESS_LIMIT_SIGMA)
    return np.asarray(scaled[:count] * unknowns.sigma)


def initial_frame(used: Recording, observations: ReflectorObservations) -> Frame:
    """The station's frame by the commanded poses."""
    entry = used.file.station
    return fit_report_frame(used.machine, observations, station_frame(entry.position_m, entry.heading_rad)).frame
