"""Predicted errors of the tool over the workspace, without and with a table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.compensation.correction import model_error
from calibration.compensation.tables import CompensationTable, correction_at
from calibration.identification.calibration import Calibration, pose_u
from calibration.machine.inverse import nominal_drives
from calibration.model.operating_conditions import OperatingConditions
from calibration.reduction.figures import COVERAGE_FACTOR


@dataclass(frozen=True)
class ErrorMap:
    """Predicted tool errors on a grid of the workspace: target (n, 2), error before and after (n, 2), in m.

    u_m (n,): standard uncertainty of the predicted position; the last coordinate changes fastest.
    """

    target_m: Array
    before_m: Array
    after_m: Array
    u_m: Array

    @property
    def is_uncertain(self) -> NDArray[np.bool_]:
        """Where (n,) U (k = 2) of the prediction exceeds the error that is corrected: nothing is known to improve."""
        return np.asarray(COVERAGE_FACTOR * self.u_m > np.linalg.norm(self.before_m, axis=1))


def error_map(calibration: Calibration, table: CompensationTable, per_axis: int = 11) -> ErrorMap:
    """Predicted errors on a grid of the workspace, without and with a table."""
    return predicted_errors(calibration, table.conditions, lambda drives: correction_at(table, drives), per_axis)


def predicted_errors(
    calibration: Calibration, load: OperatingConditions, correct: Callable[[Array], Array], per_axis: int = 11
) -> ErrorMap:
    """The same with any correction: (n, d) of commanded drive positions (n, d)."""
    machine = calibration.reduction.recording.machine
    axes = [np.linspace(lo, hi, per_axis) for lo, hi in machine.workspace[:2]]
    target = np.zeros((per_axis**2, 6))
    target[:, :2] = np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)
    drives = nominal_drives(machine, target)
    error = model_error(calibration.fit, calibration.report, load)
    before, after = (error(at, target)[:, :2] for at in (drives, drives + correct(drives)))
    return ErrorMap(target[:, :2], before, after, pose_u(calibration, load.at_poses(drives, target))[0])
