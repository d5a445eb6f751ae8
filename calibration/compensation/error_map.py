"""Predicted errors of the tool over the workspace, without and with a table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from calibration.base.arrays import Array
from calibration.compensation.tables import CompensationTable
from calibration.identification.calibration import Calibration, pose_u
from calibration.identification.prediction import predict_poses
from calibration.machine.inverse import nominal_drives


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
        pose = predict_poses(calibration.fit, report, table.conditions.at_poses(at, target))
        return report.tool_error(pose, target)[0][:, :2]

    after = error(drives + correction_at(table, drives))
    return ErrorMap(
        target[:, :2], error(drives), after, pose_u(calibration, table.conditions.at_poses(drives, target))[0]
    )


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
