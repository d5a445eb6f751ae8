"""Checks of an identification: poses held out of a refit, and Monte Carlo through the estimator."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calibration.base.errors import InputError
from calibration.identification.calibration import Calibration, identify_recording, pose_u
from calibration.identification.fit import Estimator
from calibration.identification.prediction import monte_carlo, predict_poses, predict_tool
from calibration.recording.recording import Recording
from calibration.reduction.figures import figures
from calibration.reduction.reduction import CALIBRATION

HELD_OUT_EVERY = 5
MC_SEED = 1


def cross_check(identified: Calibration, draws: int) -> dict[str, float]:
    """RMS standard uncertainty of the tool over the visited poses, linear and by Monte Carlo through the estimator."""
    fit = identified.fit
    poses_and_loads = np.column_stack([fit.visits.target_m, fit.visits.payload_kg])
    visits = fit.visits.take(np.unique(poses_and_loads, axis=0, return_index=True)[1])
    out: dict[str, float] = {"draws": draws}
    for name, predicted in (("linear", predict_tool(fit, visits)), ("drawn", monte_carlo(fit, visits, MC_SEED, draws))):
        out[f"{name}_u_position_m"] = float(np.sqrt(np.mean(np.sum(predicted.u[:, :3] ** 2, axis=1))))
        out[f"{name}_u_orientation_rad"] = float(np.sqrt(np.mean(np.sum(predicted.u[:, 3:] ** 2, axis=1))))
    return out


def held_out_error(
    identified: Calibration, estimator: Estimator, *, robust: bool = False
) -> tuple[dict[str, float], dict[str, float]]:
    """Error of a refit at every fifth pose, which it was not given (noise included), and its standard uncertainty."""
    reduction = identified.reduction
    held_out = _are_held_out(reduction.info.pose, reduction.info.number) & reduction.rows(CALIBRATION)
    if not np.any(held_out):
        raise InputError("held-out poses: no reading of them passed the gate; check which reflector is which")
    refit = identify_recording(_without_held_out(reduction.recording), estimator, baselines=False, robust=robust)
    visits = reduction.observations.visits.take(held_out)
    report = reduction.report
    predicted = predict_poses(refit.fit, report, visits)
    position, rotation = report.tool_error(reduction.poses.coordinates[held_out], predicted)
    error = figures(reduction.recording.machine, position, rotation, 0.0, 0.0)
    u_position, u_rotation = pose_u(replace(refit, reduction=reduction), visits)
    return (
        {"position_rms_m": error.position_rms_m, "orientation_rms_rad": error.orientation_rms_rad},
        {
            "position_rms_m": float(np.sqrt(np.mean(u_position**2))),
            "orientation_rms_rad": float(np.sqrt(np.mean(u_rotation**2))),
        },
    )


def _are_held_out(pose: NDArray[np.intp], visit: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Every fifth pose; of those that have no number every fifth visit."""
    return np.where(pose >= 0, pose, visit) % HELD_OUT_EVERY == 0


def _without_held_out(recording: Recording) -> Recording:
    """The recording without the calibration readings that are held out."""
    calibration = np.asarray(recording["phase"]) == CALIBRATION
    drop = calibration & _are_held_out(recording["pose"].astype(np.intp), recording["visit"].astype(np.intp))
    if np.all(drop[calibration]):
        raise InputError(f"recording {recording.file.campaign}: too few poses to hold any out; measure more")
    return recording.take(~drop)
