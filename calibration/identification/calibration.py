"""Identification of a recording: the readings that may be used, the fit, and rigid models of the same readings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.identification.estimators import identify
from calibration.identification.fit import Estimator, Fit
from calibration.identification.gate import gate_readings
from calibration.identification.observability import observability_of
from calibration.identification.positioning import with_positioning
from calibration.identification.prediction import predict_poses
from calibration.identification.problem import LeastSquaresProblem
from calibration.identification.remarks import remarks
from calibration.identification.rigid.closure import MeasuredPoses
from calibration.identification.rigid.models import RigidIdentification, fit_rigid_identifications
from calibration.instruments.setups import Setups
from calibration.instruments.smr_positions import ReflectorObservations, SmrPositions, StationModel
from calibration.model.model import Model, SystematicUncertainties
from calibration.model.operating_conditions import OperatingConditions
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits
from calibration.recording.recording import Recording
from calibration.reduction.common_points import NestEstimate, common_nests
from calibration.reduction.data_checks import require_spread_poses
from calibration.reduction.figures import figure_axes
from calibration.reduction.left_out import MODEL, LeftOutReading
from calibration.reduction.part_temperatures import remarks_on_sensors
from calibration.reduction.reduction import CALIBRATION, Reduction, last_calibration_check, reduce
from calibration.reduction.report_frame import ReportFrame
from calibration.reduction.setups import known_from_nests


@dataclass(frozen=True)
class Calibration:
    """An identified machine: the fit, the frame it is reported in, and rigid baselines of the same data."""

    reduction: Reduction
    fit: Fit
    baselines: tuple[RigidIdentification, ...]

    @property
    def report(self) -> ReportFrame:
        """The frame of the calibration readings at zero payload."""
        return self.reduction.report

    def operating_conditions(self, payload: int, temperatures_c: dict[str, float]) -> OperatingConditions:
        """A payload of the rig's list at some temperatures."""
        entry = self.reduction.recording.file.payloads[payload]
        return OperatingConditions(entry.mass_kg, entry.com_m, temperatures_c)


def calibration_part(recording: Recording) -> Recording:
    """The readings up to the nest check that closes the calibration: what identification may use.

    A later verification must not change what was identified before it.
    """
    phase = np.asarray(recording["phase"])
    rows = phase == CALIBRATION
    if not np.any(rows):
        return recording
    last = last_calibration_check(recording)
    keep = rows | (phase == "repeatability") | ((phase == "nests") & (recording["nest_check"] <= last))
    return recording.take(keep)


def identify_recording(
    recording: Recording, estimator: Estimator = "map", *, baselines: bool = True, robust: bool = False
) -> Calibration:
    """Identify a recording. Unknowns that it does not determine (stiffness with one payload) keep their prior."""
    part = calibration_part(recording)
    model = Model(
        ParameterSet.of(recording.machine),
        SystematicUncertainties.from_declared(recording.file.payloads, recording.machine),
    )
    reduction = reduce(part)
    require_spread_poses(recording.machine, reduction.calibration().visits.target_m)
    if wrong := _wrong_readings(model, reduction):
        reduction = reduce(part, wrong=wrong)
    observations = reduction.calibration()
    require_spread_poses(recording.machine, observations.visits.target_m)
    station = _station(reduction, observations)
    fit = identify(model, observations.visits, [SmrPositions(observations, station)], estimator, robust=robust)
    fit = fit if robust else with_positioning(fit)
    if len(reduction.setups) > 1:  # the fit knows better how the set-ups lie than the points that they have in common
        reduction = reduce(part, wrong=wrong, known=_fitted_setups(fit, reduction.nests))
    return Calibration(reduction, fit, _baselines(reduction, station) if baselines else ())


def _station(reduction: Reduction, observations: ReflectorObservations) -> StationModel:
    smrs = tuple(sorted(set(observations.smr.tolist())))
    accuracy = reduction.recording.file.station.accuracy.to_station_accuracy()
    station = StationModel.from_accuracy(reduction.report.frame, smrs, accuracy)
    station = replace(station, range_constant_u_m=reduction.range_constant_u_m)  # the certified length has tied it
    if len(reduction.setups) == 1:
        return station
    return replace(station, setups=known_from_nests(reduction.setups, common_nests(reduction.nests)))


def _fitted_setups(fit: Fit, nests: Mapping[float, NestEstimate]) -> Setups:
    """The set-ups as the fit found them."""
    station = fit.station
    columns = fit.layout.instrument_slices[0]
    error, by_unknowns = station.setup_error(fit.machine, fit.unknowns[columns])
    setups = station.setups.without_error(error, by_unknowns @ fit.covariance[columns, columns] @ by_unknowns.T)
    return setups.with_common_drift({number: nest.drift_covariance for number, nest in nests.items()})


def _wrong_readings(model: Model, reduction: Reduction) -> tuple[LeftOutReading, ...]:
    """Readings of the calibration, the pose filter's refused ones too, that do not fit what the others say."""
    visits = reduction.info.phase == CALIBRATION
    uid = reduction.uid[visits[reduction.offered.visit]]
    offered = reduction.offered.of_visits(visits)
    readings = SmrPositions(offered, _station(reduction, offered))
    on_platform = np.array([smr.on == "platform" for smr in model.machine.smrs])[offered.smr]
    gated = gate_readings(LeastSquaresProblem(model, offered.visits, [readings]), [on_platform.astype(np.intp)])[0]
    wrong = np.flatnonzero(~gated.keep)
    size_m = np.linalg.norm(np.linalg.solve(readings.whiten[wrong], gated.deviation[wrong, :, None]), axis=(1, 2))
    row = {uid: row for row, uid in enumerate(reduction.recording["uid"].tolist())}
    return tuple(
        LeftOutReading.of_recording(reduction.recording, row[str(uid[i])], m, gated.sigmas[i], MODEL)
        for i, m in zip(wrong, size_m, strict=True)
    )


def _baselines(reduction: Reduction, station: StationModel) -> tuple[RigidIdentification, ...]:
    """Rigid identifications of the same readings, their poses in the report frame."""
    observations, report = reduction.calibration(), reduction.report
    rows = reduction.info.phase == CALIBRATION

    def fit(model: Model, visits: NDArray[np.bool_]) -> Fit:
        part = observations.of_visits(visits)
        return identify(model, part.visits, [SmrPositions(part, station)])

    def predict(fitted: Fit, visits: Visits) -> Array:
        return predict_poses(fitted, report, visits)

    measured = MeasuredPoses(observations.visits, reduction.poses.coordinates[rows], reduction.poses.covariance[rows])
    return fit_rigid_identifications(reduction.recording.machine, observations.visits, fit, predict, measured)


def pose_u(calibration: Calibration, visits: Visits) -> tuple[Array, Array]:
    """Standard uncertainties (n,) of the predicted tool position (m) and rotation (rad), from the fit's covariance."""
    root = np.linalg.cholesky(calibration.fit.covariance)
    base = predict_poses(calibration.fit, calibration.report, visits)
    moves, turns = figure_axes(calibration.report.machine)
    position, rotation = np.zeros(len(visits)), np.zeros(len(visits))
    for column in root.T:
        moved = replace(calibration.fit, unknowns=calibration.fit.unknowns + column)
        pose = predict_poses(moved, calibration.report, visits)
        shift, turn = calibration.report.tool_error(pose, base)
        position += np.sum(shift[:, moves] ** 2, axis=1)
        rotation += np.sum(turn[:, turns] ** 2, axis=1)
    return np.sqrt(position), np.sqrt(rotation)


def identified_summary(identified: Calibration) -> dict[str, Any]:
    """Parameters with uncertainty, for the store and for JSON."""
    fit = identified.fit
    observed = observability_of(fit)
    parameters = {
        p.name: {
            "value": float(value),
            "u": float(u),
            "unit": p.unit,
            "observable": bool(u < 0.5 * p.sigma),
            "left": float(u / p.sigma),
        }
        for p, value, u in zip(fit.model.parameters.parameters, fit.theta, fit.theta_u, strict=True)
    }
    return {
        "estimator": fit.estimator,
        "parameters": parameters,
        "rank": observed.n_determined,
        "unknowns": fit.layout.size,
        "chi2_per_dof": fit.chi2_per_dof,
        "positioning_sd_m": fit.positioning_sd_m,
        "aliased": list(observed.sentences),
        "remarks": [*remarks_on_sensors(identified.reduction.sensors), *remarks(fit)],
        "range_constant_m": identified.reduction.range_constant_m,
        "u_range_constant_m": identified.reduction.range_constant_u_m,
        "dropped": identified.reduction.dropped,
        "left_out": [reading.as_dict() for reading in identified.reduction.left_out],
    }
