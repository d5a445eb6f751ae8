"""Predicted tool poses and their uncertainty, linear and by Monte Carlo.

A station of unknown frame that sees reflectors of unknown mounting knows a pose only up to one rigid motion of the
machine and one of the tool on its platform. Both are fixed once by the readings (docs/reference/definitions.md,
frame), so that neither is an error: the best fit by such motions over all visits is removed from the derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.rotation import rotation_vector, skew
from calibration.identification.fit import Fit
from calibration.identification.positioning import drive_responses
from calibration.identification.problem import Layout, LeastSquaresProblem
from calibration.instruments.readings import Readings
from calibration.model.model import Model, Poses
from calibration.model.visits import Visits
from calibration.reduction.report_frame import ReportFrame

ROTATION_LEVER_M = 0.3  # weighs rotations against shifts in a fit of rigid motions
MONTE_CARLO_DRAWS = 1000


@dataclass(frozen=True)
class ToolDerivatives:
    """Derivatives of tool points (n, 3, u) in m and orientations (n, 3, u) in rad with all unknowns."""

    position: Array
    orientation: Array

    @property
    def both(self) -> Array:
        """(n, 6, u)."""
        return np.concatenate([self.position, self.orientation], axis=1)


def tool_derivatives(
    model: Model, layout: Layout, readings: Sequence[Readings], values: Array, visits: Visits
) -> ToolDerivatives:
    """Derivatives at values (u,) of the unknowns, in the machine's frame.

    If a station's frame is unknown, without what one rigid motion each of machine and tool explains over these visits;
    they should cover the workspace.
    """
    poses = model.predict(values[: len(model)], visits)
    free = unprojected_derivatives(model, layout, poses)
    if any(part.free_rigid_motion for part in readings):
        return _without_rigid_motions(free.position, free.orientation, poses.tool_m(), poses.equilibrium.rotation)
    return free


def unprojected_derivatives(model: Model, layout: Layout, poses: Poses) -> ToolDerivatives:
    """The same of predicted poses, rigid motions of machine and tool included."""
    n = len(poses.visits)
    position, orientation = np.zeros((n, 3, layout.size)), np.zeros((n, 3, layout.size))
    position[:, :, : len(model)] = poses.platform_point_derivatives(model.machine.tool_point_m)
    orientation[:, :, : len(model)] = poses.jacobian[:, 3:]
    return ToolDerivatives(position, orientation)


def rigid_motions(tool_m: Array, rotation: Array) -> Array:
    """What motions of the machine (on the left) and of the tool (on the right) do to tool poses, (6 n, 12).

    tool_m (n, 3), rotation (n, 3, 3). Rows: three shifts, three rotations times ROTATION_LEVER_M, pose by pose.
    """
    n, eye = len(tool_m), np.broadcast_to(np.eye(3), (len(tool_m), 3, 3))
    none = np.zeros((n, 3, 3))
    moved = np.concatenate([eye, -skew(tool_m), rotation, none], axis=2)
    turned = np.concatenate([none, eye, none, rotation], axis=2)
    return np.concatenate([moved, ROTATION_LEVER_M * turned], axis=1).reshape(6 * n, 12)


def _without_rigid_motions(position: Array, orientation: Array, tool_m: Array, rotation: Array) -> ToolDerivatives:
    """Remove the best fit by such motions."""
    n = len(tool_m)
    gauge = rigid_motions(tool_m, rotation)
    both = np.concatenate([position, ROTATION_LEVER_M * orientation], axis=1).reshape(6 * n, -1)
    remaining = (both - gauge @ (np.linalg.pinv(gauge) @ both)).reshape(n, 6, -1)
    return ToolDerivatives(remaining[:, :3], remaining[:, 3:] / ROTATION_LEVER_M)


@dataclass(frozen=True)
class PredictedPoses:
    """Predicted tool poses of visits: coordinates (n, 6) and their covariance (n, 6, 6)."""

    coordinates: Array
    covariance: Array

    @property
    def u(self) -> Array:
        """Standard uncertainties (n, 6) in m and rad."""
        return np.sqrt(np.maximum(np.diagonal(self.covariance, axis1=1, axis2=2), 0.0))


def predict_tool(fit: Fit, visits: Visits) -> PredictedPoses:
    """Tool poses with the covariance of the fit propagated linearly (GUM)."""
    d = tool_derivatives(fit.model, fit.layout, fit.instruments, fit.unknowns, visits).both
    poses = fit.predict(visits)
    coordinates = np.concatenate([poses.tool_m(), rotation_vector(poses.equilibrium.rotation)], axis=1)
    return PredictedPoses(coordinates, d @ fit.covariance @ d.transpose(0, 2, 1))


def monte_carlo(fit: Fit, visits: Visits, seed: int, draws: int = MONTE_CARLO_DRAWS) -> PredictedPoses:
    """The same by propagation of distributions (JCGM 101) through the default estimator itself.

    Each draw takes new errors for every reading and every prior, and for drives that do not repeat, fits again with the
    full model and predicts. Drawing from the linear covariance instead would be wrong: stiffness and misfit are each
    known poorly, but their product well. Costs a fit a draw; a standard deviation from n draws is good to
    1 / sqrt(2 n). InputError for other estimators and for less than two draws.
    """
    if fit.estimator != "map" or draws < 2:
        raise InputError("monte carlo: it needs the estimator 'map' and at least 2 draws; choose both")
    rng = np.random.default_rng(seed)
    sigma = fit.layout.sigma
    z = fit.unknowns / sigma
    poses = fit.predict(visits)
    tool, rotation = poses.tool_m(), poses.equilibrium.rotation
    gauged = any(part.free_rigid_motion for part in fit.instruments)
    perfect = [part.with_noise(r) for part, r in zip(fit.instruments, fit.residuals, strict=True)]
    total, square = np.zeros((len(visits), 6)), np.zeros((len(visits), 6, 6))
    responses = drive_responses(fit) if fit.positioning_sd_m > 0.0 else []
    for _ in range(draws):
        noisy = [part.with_noise(rng.standard_normal((len(part), part.width))) for part in perfect]
        if responses:
            off_m = fit.positioning_sd_m * rng.standard_normal(fit.visits.drives.shape)
            noisy = [part.with_noise(some.shift(off_m)) for part, some in zip(noisy, responses, strict=True)]
        problem = LeastSquaresProblem(fit.model, fit.visits, noisy, centre=z + rng.standard_normal(z.size))
        draw = fit.model.predict((problem.minimise(z, np.arange(z.size), 1.0) * sigma)[: len(fit.model)], visits)
        shift = (draw.tool_m() - tool)[:, :, None]
        turn = rotation_vector(draw.equilibrium.rotation @ rotation.transpose(0, 2, 1))[:, :, None]
        derivatives = _without_rigid_motions(shift, turn, tool, rotation) if gauged else ToolDerivatives(shift, turn)
        error = derivatives.both[:, :, 0]
        total += error
        square += error[:, :, None] * error[:, None, :]
    mean = total / draws
    covariance = square / draws - mean[:, :, None] * mean[:, None, :]
    return PredictedPoses(np.concatenate([tool, rotation_vector(rotation)], axis=1) + mean, covariance)


def predict_poses(fit: Fit, report: ReportFrame, visits: Visits) -> Array:
    """Predicted platform poses (v, 6) in the report frame; NaN rows where there is no equilibrium.

    As the station would measure them: common errors of its ranges act on measured and predicted poses alike.
    """
    poses = fit.predict(visits)
    positions_m = np.stack([poses.reflector_m(i, fit.mounting_m(i)) for i in report.smrs], axis=1)
    points = fit.as_station_reports(positions_m.reshape(-1, 3)).reshape(positions_m.shape)
    return report.poses(points, poses.equilibrium.coordinates())
