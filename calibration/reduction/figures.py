"""Figures of a verdict: errors before and after and the noise floor, each with its uncertainty.

Definitions are in docs/reference/definitions.md; figures are of the tool point and of the platform's rotation in the
coordinates that the drives command; where they command no rotation, of all free ones.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.base.rotation import rotation_matrix
from calibration.machine.description import Machine
from calibration.reduction.reduction import CALIBRATION, Reduction

COVERAGE_FACTOR = 2.0
MIN_VISITS = 3


@dataclass(frozen=True)
class Figures:
    """RMS and maximum over n poses; u_* are standard uncertainties of the RMS values."""

    position_rms_m: float
    position_max_m: float
    orientation_rms_rad: float
    u_position_rms_m: float
    u_orientation_rms_rad: float
    n: int

    def as_dict(self) -> dict[str, float]:
        """For JSON."""
        return asdict(self)


def free_axes(machine: Machine) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of the free translations and of the free rotations (0 to 2 each)."""
    return machine.dof[machine.dof < 3], machine.dof[machine.dof >= 3] - 3


def figure_axes(machine: Machine) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices (0 to 2 each) of the translations and rotations that figures of a verdict are of.

    Those that the drives command; where they command none of a kind, the free ones, which are told but not corrected.
    """
    commanded = machine.commanded
    moves, turns = free_axes(machine)
    chosen_moves, chosen_turns = commanded[commanded < 3], commanded[commanded >= 3] - 3
    return (chosen_moves if chosen_moves.size else moves), (chosen_turns if chosen_turns.size else turns)


def figures(
    machine: Machine, position_m: Array, rotation_rad: Array, scale_u: float, reach_m: float, setup_u_m: float = 0.0
) -> Figures:
    """Figures of errors (n, 3) and (n, 3).

    The uncertainty of an RMS has the standard error of the mean square over the poses (noise
    and choice of poses) and, for positions, the scale: `scale_u` times the RMS distance `reach_m` of the
    poses from their centre, which does not average out; nor does what is not known of the station's set-ups, setup_u_m.
    """
    moves, turns = figure_axes(machine)
    square = np.sum(position_m[:, moves] ** 2, axis=1)
    angle = np.sum(rotation_rad[:, turns] ** 2, axis=1)
    rms, u_rms = rms_and_u(square)
    turn, u_turn = rms_and_u(angle)
    return Figures(
        position_rms_m=rms,
        position_max_m=float(np.sqrt(square.max())),
        orientation_rms_rad=turn,
        u_position_rms_m=float(np.hypot(np.hypot(u_rms, scale_u * reach_m), setup_u_m)),
        u_orientation_rms_rad=u_turn,
        n=len(square),
    )


def rms_and_u(square: Array) -> tuple[float, float]:
    """Root of the mean of squares (n,) and its standard uncertainty from their scatter."""
    mean = float(np.mean(square))
    u_mean = float(np.std(square, ddof=1) / np.sqrt(len(square))) if len(square) > 1 else mean
    rms = float(np.sqrt(mean))
    return rms, u_mean / (2.0 * rms) if rms > 0.0 else 0.0


def visit_figures(reduction: Reduction, phase: str, payload: int) -> Figures | None:
    """Figures of the measured errors of one phase at one payload; None where nothing was measured."""
    rows = reduction.rows(phase, payload)
    if not np.any(rows):
        return None
    position, rotation = reduction.errors(rows)
    return figures(
        reduction.recording.machine, position, rotation, *scale_part(reduction, rows), setup_part(reduction, rows)
    )


def coordinate_errors(reduction: Reduction, phase: str, payload: int) -> dict[int, float]:
    """RMS error (m, rad) of each free coordinate (0 to 5) at the visits of one phase and payload; tool point."""
    position, rotation = reduction.errors(reduction.rows(phase, payload))
    error = np.concatenate([position, rotation], axis=1)
    return {c: float(np.sqrt(np.mean(error[:, c] ** 2))) for c in reduction.recording.machine.dof.tolist()}


def scale_part(reduction: Reduction, rows: NDArray[np.bool_]) -> tuple[float, float]:
    """Relative standard uncertainty of the station's scale, and the RMS reach (m) of some poses."""
    target = reduction.observations.visits.target_m[rows, :3]
    reach = float(np.sqrt(np.mean(np.sum((target - target.mean(axis=0)) ** 2, axis=1))))
    distance = float(np.mean(np.linalg.norm(reduction.observations.position_m, axis=1)))
    return reduction.range_constant_u_m / distance, reach


def setup_part(reduction: Reduction, rows: NDArray[np.bool_]) -> float:
    """Standard uncertainty (m) of the RMS position error of some visits from the motions between set-ups."""
    if len(reduction.setups) == 1:
        return 0.0
    report, machine = reduction.report, reduction.recording.machine
    moves = figure_axes(machine)[0]
    error = reduction.errors(rows)[0][:, moves]
    pose = reduction.poses.coordinates[rows]
    tool = report.frame.to_station(pose[:, :3] + rotation_matrix(pose[:, 3:]) @ machine.tool_point_m)
    by_motion = report.frame.rotation.T @ reduction.setups.shift_by_error(tool, reduction.info.setup[rows])
    rms = float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
    slope = np.einsum("ni,nix->x", error, by_motion[:, moves]) / (len(error) * rms)
    return float(np.sqrt(slope @ reduction.setups.error_covariance @ slope))


def noise_floor(reduction: Reduction) -> Figures | None:
    """RMS scatter of the measured pose over repeated visits, for the averaging of the verification.

    Visits of one target, direction and payload, at least three; None where there are none.
    """
    info, rows = reduction.info, np.flatnonzero(reduction.rows(CALIBRATION))
    position, rotation = reduction.report.tool_error(
        reduction.poses.coordinates[rows], reduction.observations.visits.target_m[rows]
    )
    groups: dict[tuple[object, ...], list[int]] = {}
    for i, v in enumerate(rows):
        key = (int(info.pose[v]), int(info.payload[v]), *info.direction[v].tolist())
        groups.setdefault(key, []).append(i)
    repeated = [g for g in groups.values() if len(g) >= MIN_VISITS]
    if not repeated:
        return None
    moves, turns = figure_axes(reduction.recording.machine)
    freedom = sum(len(g) - 1 for g in repeated)
    scatter = [position[g] - position[g].mean(axis=0) for g in repeated]
    turn = [rotation[g] - rotation[g].mean(axis=0) for g in repeated]
    square = np.concatenate([np.sum(s[:, moves] ** 2, axis=1) for s in scatter])
    angle = np.concatenate([np.sum(s[:, turns] ** 2, axis=1) for s in turn])
    share = _averaging(reduction)
    rms = float(np.sqrt(square.sum() / freedom)) * share
    turn_rms = float(np.sqrt(angle.sum() / freedom)) * share
    return Figures(
        position_rms_m=rms,
        position_max_m=float(np.sqrt(square.max())) * share,
        orientation_rms_rad=turn_rms,
        u_position_rms_m=rms / np.sqrt(2.0 * freedom * moves.size),
        u_orientation_rms_rad=turn_rms / np.sqrt(2.0 * freedom * max(1, turns.size)),
        n=freedom,
    )


def _averaging(reduction: Reduction) -> float:
    """Ratio of the verification's noise to the calibration's, from their numbers of averaged readings."""
    info = reduction.info
    calibration = info.samples[info.phase == CALIBRATION]
    verification = info.samples[np.char.startswith(info.phase.astype(str), "verification")]
    if verification.size == 0:
        return 1.0
    return float(np.sqrt(np.mean(1.0 / verification) / np.mean(1.0 / calibration)))
