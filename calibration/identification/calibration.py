"""Analyses of a stored campaign: identification with its baselines, predictions, tables. No device is touched."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from calibration.base.arrays import Array
from calibration.compensation.tables import CompensationTable, build_table
from calibration.identification.estimators import Estimator, Fit, identify
from calibration.identification.prediction import predict_poses
from calibration.identification.rigid.closure import MeasuredPoses
from calibration.identification.rigid.models import Baseline, fit_baselines
from calibration.instruments.smr_positions import REFRACTION_U_PER_M, SmrPositions, Station
from calibration.machine.inverse import nominal_drives
from calibration.model.load import Load
from calibration.model.model import Model, Systematic
from calibration.model.parameters import ParameterSet
from calibration.model.visits import Visits
from calibration.recording.recording import Recording
from calibration.reduction.data_checks import check_cover
from calibration.reduction.figures import Figures, figures, free_axes, scale_part
from calibration.reduction.reduction import CALIBRATION, Reduction, last_calibration_check, reduce
from calibration.reduction.report_frame import ReportFrame


@dataclass(frozen=True)
class Calibration:
    """An identified machine: the fit, the frame it is reported in, and rigid baselines of the same data."""

    reduction: Reduction
    fit: Fit
    baselines: tuple[Baseline, ...]

    @property
    def report(self) -> ReportFrame:
        """The frame of the calibration readings at zero payload."""
        return self.reduction.report

    def load(self, payload: int, temperatures_c: dict[str, float]) -> Load:
        """A payload of the rig's list at some temperatures."""
        entry = self.reduction.recording.file.payloads[payload]
        return Load(entry.mass_kg, entry.com_m, temperatures_c)

    def table(self, payload: int, temperatures_c: dict[str, float]) -> CompensationTable:
        """Compensation table for a payload at some temperatures."""
        return build_table(self.fit, self.report, self.load(payload, temperatures_c))


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
    return replace(recording, columns={name: column[keep] for name, column in recording.columns.items()})


def identify_recording(
    recording: Recording, estimator: Estimator = "map", *, baselines: bool = True, robust: bool = False
) -> Calibration:
    """Identify a recording. What its readings leave open, such as stiffness with one payload, its prior holds."""
    reduction = reduce(calibration_part(recording))
    seen = reduction.calibration()
    check_cover(recording.machine, seen.visits.target_m)
    smrs = tuple(sorted(set(seen.smr.tolist())))
    stated = recording.file.station.accuracy
    station = Station(
        reduction.report.frame, smrs, reduction.range_constant_u_m, stated.range_scale_u, REFRACTION_U_PER_M
    )
    model = Model(ParameterSet.of(recording.machine), Systematic.stated(recording.file.payloads, recording.machine))
    fit = identify(model, seen.visits, [SmrPositions(seen, station)], estimator, robust=robust)
    return Calibration(reduction, fit, _baselines(reduction, station) if baselines else ())


def _baselines(reduction: Reduction, station: Station) -> tuple[Baseline, ...]:
    """Rigid identifications of the same readings, their poses in the report frame."""
    seen, report = reduction.calibration(), reduction.report
    rows = reduction.info.phase == CALIBRATION

    def fit(model: Model, visits: NDArray[np.bool_]) -> Fit:
        some = seen.of_visits(visits)
        return identify(model, some.visits, [SmrPositions(some, station)])

    def stated(found: Fit, visits: Visits) -> Array:
        return predict_poses(found, report, visits)

    measured = MeasuredPoses(seen.visits, reduction.poses.coordinates[rows], reduction.poses.covariance[rows])
    return fit_baselines(reduction.recording.machine, seen.visits, fit, stated, measured)


def prediction_figures(reduction: Reduction, rows: NDArray[np.bool_], predicted: Array) -> Figures:
    """Figures of measured minus predicted poses (v, 6) of some visits."""
    measured = reduction.poses.coordinates[rows]
    position, rotation = reduction.report.tool_error(measured, predicted)
    return figures(reduction.recording.machine, position, rotation, *scale_part(reduction, rows))


def model_comparison(calibration: Calibration, reduction: Reduction, payload: int) -> dict[str, Figures]:
    """How well each identification predicts the uncompensated verification poses at one payload.

    `reduction` is of the whole recording; predictions are made in its report frame.
    """
    rows = reduction.rows("verification_before", payload)
    if not np.any(rows):
        return {}
    visits = reduction.observations.visits.take(rows)
    ours = prediction_figures(reduction, rows, predict_poses(calibration.fit, reduction.report, visits))
    out = {"deformation_aware": ours}
    for baseline in calibration.baselines:
        out[baseline.name] = prediction_figures(reduction, rows, baseline.predict(visits))
    return out


def orientation_prediction(calibration: Calibration, reduction: Reduction, phase: str, payload: int) -> float | None:
    """RMS of measured minus predicted orientation (rad): what two drives cannot correct but the model knows."""
    rows = reduction.rows(phase, payload)
    if not np.any(rows):
        return None
    visits = reduction.observations.visits.take(rows)
    predicted = predict_poses(calibration.fit, reduction.report, visits)
    _, rotation = reduction.report.tool_error(reduction.poses.coordinates[rows], predicted)
    _, turns = free_axes(reduction.recording.machine)
    return float(np.sqrt(np.mean(np.sum(rotation[:, turns] ** 2, axis=1))))


@dataclass(frozen=True)
class ErrorMap:
    """Predicted tool errors over the workspace: target (n, 2), error before and after (n, 2), in m."""

    target_m: Array
    before_m: Array
    after_m: Array
    u_m: Array


def error_map(calibration: Calibration, table: CompensationTable, per_axis: int = 11) -> ErrorMap:
    """Predicted errors on a grid of the workspace, without and with a table; u (n,): standard uncertainty."""
    machine = calibration.reduction.recording.machine
    axes = [np.linspace(lo, hi, per_axis) for lo, hi in machine.workspace[:2]]
    target = np.zeros((per_axis**2, 6))
    target[:, :2] = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
    drives = nominal_drives(machine, target)
    report = calibration.report

    def error(at: Array) -> Array:
        pose = predict_poses(calibration.fit, report, table.load.visits(at, target))
        return report.tool_error(pose, target)[0][:, :2]

    after = error(drives + correction_at(table, drives))
    return ErrorMap(target[:, :2], error(drives), after, pose_u(calibration, table.load.visits(drives, target))[0])


def correction_at(table: CompensationTable, drives_m: Array) -> Array:
    """Bilinear corrections (n, d) of a two-drive table, as the drives apply them; NaN outside the grid."""
    count = table.correction_m.shape[1]
    axes = [table.start_m[a] + table.step_m[a] * np.arange(count) for a in range(2)]
    return np.stack(
        [
            RegularGridInterpolator(axes, table.correction_m[a], bounds_error=False)(drives_m)
            for a in range(drives_m.shape[1])
        ],
        axis=1,
    )


def pose_u(calibration: Calibration, visits: Visits) -> tuple[Array, Array]:
    """Standard uncertainties (n,) of the predicted tool position (m) and rotation (rad), from the fit's covariance."""
    root = np.linalg.cholesky(calibration.fit.covariance)
    base = predict_poses(calibration.fit, calibration.report, visits)
    moves, turns = free_axes(calibration.report.machine)
    position, rotation = np.zeros(len(visits)), np.zeros(len(visits))
    for column in root.T:
        moved = replace(calibration.fit, unknowns=calibration.fit.unknowns + column)
        pose = predict_poses(moved, calibration.report, visits)
        shift, turn = calibration.report.tool_error(pose, base)
        position += np.sum(shift[:, moves] ** 2, axis=1)
        rotation += np.sum(turn[:, turns] ** 2, axis=1)
    return np.sqrt(position), np.sqrt(rotation)
