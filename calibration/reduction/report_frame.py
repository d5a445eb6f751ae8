"""The frame in which before and after are stated, and platform poses in it.

docs/definitions: the rigid motion and the reflectors' mounting are fitted once, to readings at zero payload
against commanded poses, and then fixed, so that no figure contains a frame offset.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.base.frame import Frame
from calibration.base.outliers import MOST_ELSEWHERE, are_elsewhere
from calibration.base.rotation import rotation_matrix, rotation_vector, skew
from calibration.instruments.smr_positions import ReflectorObservations
from calibration.machine.description import Machine

MAX_MISS_TOLERANCES = 20.0  # mounting tolerances beyond which a reflector is taken to be mislabelled


@dataclass(frozen=True)
class ReportFrame:
    """Frame of the machine as commanded, and the positions of the reflectors on the platform.

    smrs: indices in the machine file; mounting_m (k, 3): their positions in the platform frame.
    """

    machine: Machine
    frame: Frame
    smrs: tuple[int, ...]
    mounting_m: Array

    def points(self, coordinates: Array) -> Array:
        """Reflector positions (n, k, 3) in the station's frame for poses (n, 6)."""
        turned = np.einsum("nij,kj->nki", rotation_matrix(coordinates[:, 3:]), self.mounting_m)
        points: Array = (coordinates[:, None, :3] + turned) @ self.frame.rotation.T + self.frame.translation_m
        return points

    def poses(self, points_m: Array, start: Array) -> Array:
        """Poses (n, 6) over the free coordinates that fit reflector positions (n, k, 3) best, equal weights.

        For predictions and noise-free positions; noisy readings go through the pose filter. start (n, 6).
        """
        dof = self.machine.dof
        pose = start.copy()
        for _ in range(6):
            error = (points_m - self.points(pose)).reshape(len(pose), -1, 1)
            jac = self.jacobian(pose).reshape(len(pose), -1, 6)[:, :, dof]
            normal = jac.transpose(0, 2, 1)
            step = np.asarray(np.linalg.solve(normal @ jac, normal @ error)[:, :, 0], dtype=np.float64)
            pose = apply_increment(pose, step, dof)
            if np.max(np.abs(step), initial=0.0) < 1e-13:
                break
        return pose

    def jacobian(self, coordinates: Array) -> Array:
        """Derivative (n, k, 3, 6) of `points` with a left increment of the pose."""
        lever = np.einsum("nij,kj->nki", rotation_matrix(coordinates[:, 3:]), self.mounting_m)
        out = np.empty((*lever.shape, 6))
        out[..., :3] = self.frame.rotation
        out[..., 3:] = -self.frame.rotation @ skew(lever)
        return out

    def tool_error(self, coordinates: Array, target: Array) -> tuple[Array, Array]:
        """Position error (n, 3) of the tool point and rotation error (n, 3) of poses (n, 6) against targets."""
        tool = self.machine.tool_point_m
        rotation, target_rotation = rotation_matrix(coordinates[:, 3:]), rotation_matrix(target[:, 3:])
        position = coordinates[:, :3] + rotation @ tool - target[:, :3] - target_rotation @ tool
        return position, rotation_vector(rotation @ target_rotation.transpose(0, 2, 1))


def apply_increment(coordinates: Array, step: Array, dof: NDArray[np.intp]) -> Array:
    """Poses (n, 6) after left increments (n, f) of the free coordinates."""
    full = np.zeros_like(coordinates)
    full[:, dof] = step
    turned = rotation_matrix(full[:, 3:]) @ rotation_matrix(coordinates[:, 3:])
    return np.concatenate([coordinates[:, :3] + full[:, :3], rotation_vector(turned)], axis=1)


def fit_report_frame(machine: Machine, observations: ReflectorObservations, start: Frame) -> ReportFrame:
    """Fit frame and mounting to readings against their visits' commanded poses.

    The observations should be without payload; reflectors that are not on the platform are ignored, and so are single
    readings of quite another place.
    The mounting's prior (its tolerance) fixes the gauge between a shift of all reflectors and one
    of the frame. Raises InputError with fewer than 4 poses or fewer than 3 platform reflectors.
    """
    smrs = tuple(i for i in sorted(set(observations.smr.tolist())) if machine.smrs[i].on == "platform")
    if len(smrs) < 3 or len(set(observations.visit.tolist())) < 4:
        raise InputError("frame: needs 3 platform SMRs measured at 4 or more poses at zero payload; measure more")
    nominal = np.array([machine.smrs[i].position_m for i in smrs])
    _require_spread_points(nominal)
    rows = np.isin(observations.smr, smrs)
    column = np.searchsorted(smrs, observations.smr[rows])
    target = observations.visits.target_m[observations.visit[rows]]
    turn = rotation_matrix(target[:, 3:])
    # The machine's own errors are much larger than the station's angle noise. Weighted by that noise alone, they would
    # be traded against the less accurate range: a tilted frame.
    error_m = machine.file.tolerances.strut_length_m
    whiten = np.linalg.inv(np.linalg.cholesky(observations.covariance_m2[rows] + error_m**2 * np.eye(3)))
    sigma = machine.file.tolerances.smr_position_m / np.sqrt(3.0)

    def unpack(x: Array) -> tuple[Frame, Array]:
        return start.with_increment(x[:6]), nominal + sigma * x[6:].reshape(-1, 3)

    def miss_m(x: Array) -> Array:
        frame, mounting = unpack(x)
        point = target[:, :3] + np.einsum("rij,rj->ri", turn, mounting[column])
        return np.asarray(frame.to_station(point) - observations.position_m[rows])

    def residual(x: Array) -> Array:
        error = np.einsum("rij,rj->ri", whiten, miss_m(x))[keep]
        return np.concatenate([error.ravel(), x[6:]])

    def jacobian(x: Array) -> Array:
        frame, mounting = unpack(x)
        lever = np.einsum("rij,rj->ri", turn, mounting[column])
        out = np.zeros((len(column), 3, x.size))
        out[:, :, :3] = -skew((target[:, :3] + lever) @ frame.rotation.T)
        out[:, :, 3:6] = np.eye(3)
        first = 6 + 3 * column[:, None] + np.arange(3)
        np.put_along_axis(out, first[:, None, :], sigma * frame.rotation @ turn, axis=2)
        white = np.einsum("rij,rjx->rix", whiten, out)[keep].reshape(-1, x.size)
        return np.vstack([white, np.eye(x.size)[6:]])

    keep, values = np.ones(len(column), dtype=bool), np.zeros(6 + nominal.size)
    while True:
        # Rotation and translation of a frame 3 m away are strongly correlated: exact derivatives, tight limits.
        values = least_squares(residual, values, jac=jacobian, method="lm", xtol=1e-14, ftol=1e-14, gtol=1e-14).x
        fitting = np.flatnonzero(keep)
        elsewhere = are_elsewhere(np.linalg.norm(miss_m(values)[fitting], axis=1), spoiled=True)
        if not np.any(elsewhere) or np.mean(keep) < 1.0 - MOST_ELSEWHERE:
            break
        keep[fitting[elsewhere]] = False
    frame, mounting = unpack(values)
    off = np.linalg.norm(mounting - nominal, axis=1)
    if np.max(off) > MAX_MISS_TOLERANCES * machine.file.tolerances.smr_position_m:
        raise InputError(
            f"frame: reflector {machine.smrs[smrs[int(np.argmax(off))]].name} seems to sit {np.max(off) * 1e3:.0f} mm "
            "from its place in the machine file; check which reflector is which and where it is mounted"
        )
    return ReportFrame(machine, frame, smrs, mounting)


def _require_spread_points(points: Array) -> None:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if spread[1] < 0.01:
        raise InputError("frame: the platform SMRs lie on a line; move one at least 10 mm off it")
