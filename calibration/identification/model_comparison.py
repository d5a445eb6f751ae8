"""Comparison of identified models by how well they predict the verification poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.identification.calibration import Calibration
from calibration.identification.prediction import predict_poses
from calibration.reduction.figures import Figures, figure_axes, figures, scale_part
from calibration.reduction.reduction import Reduction


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
    _, turns = figure_axes(reduction.recording.machine)
    return float(np.sqrt(np.mean(np.sum(rotation[:, turns] ** 2, axis=1))))


def predicted_errors(calibration: Calibration, reduction: Reduction, phase: str, payload: int) -> dict[int, float]:
    """RMS error (m, rad) of each free coordinate that the model predicts of the visits of a phase, as they were led.

    Of coordinates that the drives do not command too: a correction of the others changes them, by this much. Where
    tables in the drives correct, the recorded drives are without their correction; there this is of no use.
    """
    visits = reduction.observations.visits.take(reduction.rows(phase, payload))
    predicted = predict_poses(calibration.fit, reduction.report, visits)
    error = np.concatenate(reduction.report.tool_error(predicted, visits.target_m), axis=1)
    return {c: float(np.sqrt(np.mean(error[:, c] ** 2))) for c in reduction.recording.machine.dof.tolist()}
