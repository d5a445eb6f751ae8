"""Figures of standards, of campaigns whose visits were made for them and of no others."""

from __future__ import annotations

import numpy as np

from calibration.base.errors import InputError
from calibration.machine.description import COORDINATES
from calibration.reduction.figures import figure_axes
from calibration.reduction.reduction import CALIBRATION, Reduction
from calibration.reduction.standard_figures import axis_figures, pose_figures
from pkm_rig.results.standard_results import AxisResult, PosesResult, StandardResult
from pkm_rig.rig.campaign_sections import MadeFor
from pkm_rig.rig.standard_visits import AXIS_RUNS, AXIS_TARGETS, POSE_CYCLES, axis_directions

LEAST_CYCLES = 0.9  # of those of ISO 9283, that must be left after wrong readings


def standard_result(reduction: Reduction, made_for: MadeFor) -> StandardResult:
    """The figures of a campaign made for a standard. InputError where visits that it needs are missing."""
    if made_for == "ISO 9283":
        return _poses_result(reduction)
    return _axis_result(reduction, made_for.rpartition(" ")[2])


def _axis_result(reduction: Reduction, axis: str) -> AxisResult:
    rows, column = reduction.rows(CALIBRATION), COORDINATES.index(axis)
    machine = reduction.recording.machine
    info, target = reduction.info, reduction.observations.visits.target_m[rows]
    error = reduction.errors(rows)[0][:, column]
    up = np.all(info.direction[rows] == axis_directions(machine, target, axis), axis=1)
    pose = info.pose[rows]
    numbers = sorted(set(pose.tolist()), key=lambda number: float(target[pose == number][0, column]))
    groups = [[error[(pose == number) & (up == side)] for number in numbers] for side in (True, False)]
    runs = min((len(group) for side in groups for group in side), default=0)
    if len(numbers) < AXIS_TARGETS or runs < AXIS_RUNS:
        raise InputError(
            f"{len(numbers)} targets, the least often visited {runs} times from a side, of {AXIS_TARGETS} and "
            f"{AXIS_RUNS}; go on with the campaign, or measure it anew"
        )
    up_m, down_m = (np.array([group[:AXIS_RUNS] for group in side]) for side in groups)
    span = target[:, column]
    return AxisResult(axis, (float(span.min()), float(span.max())), _payload_kg(reduction), axis_figures(up_m, down_m))


def _poses_result(reduction: Reduction) -> PosesResult:
    rows = reduction.rows(CALIBRATION)
    error = reduction.errors(rows)[0][:, figure_axes(reduction.recording.machine)[0]]
    pose, target = reduction.info.pose[rows], reduction.observations.visits.target_m[rows, :3]
    poses = []
    for number in sorted(set(pose.tolist()), reverse=True):  # P1 is visited last in a cycle
        of_pose = pose == number
        if np.count_nonzero(of_pose) < LEAST_CYCLES * POSE_CYCLES:
            raise InputError(
                f"a pose has {np.count_nonzero(of_pose)} of {POSE_CYCLES} cycles; go on with the campaign, or measure "
                "it anew"
            )
        at = tuple(float(value) for value in target[of_pose][0])
        poses.append(((at[0], at[1], at[2]), pose_figures(error[of_pose])))
    return PosesResult(_payload_kg(reduction), tuple(poses))


def _payload_kg(reduction: Reduction) -> float:
    payloads = set(reduction.info.payload[reduction.rows(CALIBRATION)].tolist())
    return max((reduction.recording.file.payloads[number].mass_kg for number in payloads), default=0.0)
