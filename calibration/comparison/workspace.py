"""What changes of the machine do to its tool point over the workspace."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calibration.base.arrays import Array
from calibration.base.frame import Frame
from calibration.base.rotation import rotation_matrix, skew
from calibration.comparison.candidates import Move, drive_function
from calibration.comparison.result import WorkspaceChange
from calibration.comparison.search import Found
from calibration.diagnosis.channels import Channels
from calibration.diagnosis.linearised_readings import LinearisedReadings
from calibration.diagnosis.observed_model import ObservedModel
from calibration.machine.description import FIXED, Smr
from calibration.machine.inverse import nominal_drives
from calibration.model.model import Poses
from calibration.model.visits import Visits

FINE, COARSE = 11, 3  # points along the two widest coordinates of the tool, and along its third


def grid_of_workspace(machine_model: LinearisedReadings, machine_values: Mapping[str, float]) -> tuple[Poses, Array]:
    """Poses of the fitted machine over the workspace without payload, and which (n,) lie on the level of the picture.

    Orientations that the drives command are those in the middle. Points that the drives do not reach are left out.
    """
    machine, model = machine_model.machine, machine_model.poses.model
    limits = machine.workspace
    widths = np.ptp(limits[:3], axis=1)
    fine = set(np.argsort(-widths, kind="stable")[:2].tolist())
    axes = [limits[c].mean(keepdims=True) for c in range(6)]
    for c in np.flatnonzero(widths > 0.0).tolist():
        axes[c] = np.linspace(float(limits[c, 0]), float(limits[c, 1]), FINE if c in fine else COARSE)
    points = np.array(list(itertools.product(*axes)))
    third = ({0, 1, 2} - fine).pop()
    shown = np.abs(points[:, third] - axes[third][len(axes[third]) // 2]) < 1e-9
    target = points.copy()
    target[:, :3] -= rotation_matrix(points[:, 3:]) @ machine.tool_point_m
    drives = nominal_drives(machine, target)
    reached = np.all(np.isfinite(drives), axis=1)
    visits = Visits.at_reference_temperature(machine, drives[reached], target[reached])
    values = np.array([machine_values.get(unknown.name, 0.0) for unknown in model.unknowns])
    return model.predict(values, visits), shown[reached]


class WorkspaceChanges:
    """Shifts of the tool point over the workspace by moves, on the machine that was fitted."""

    def __init__(self, linear: LinearisedReadings, machine_values: Mapping[str, float]) -> None:
        poses, self.shown = grid_of_workspace(linear, machine_values)
        count, tool = len(poses.visits), linear.machine.tool_point_m
        machine = replace(linear.machine, smrs=(Smr("tool", "platform", FIXED, tool),))
        whole = np.arange(count)
        observed = ObservedModel(
            machine=machine,
            context=linear.context,
            smr=np.zeros(count, dtype=np.intp),
            visit=whole,
            poses=poses,
            frame=Frame(np.eye(3), np.zeros(3)),
            mounted_m=tool[None],
            position_m=poses.tool_m(),
        )
        self._observed, self._channels = observed, Channels(observed)
        self._by_unknown = poses.platform_point_derivatives(tool)
        self._names = [unknown.name for unknown in poses.model.unknowns]

    def shift_m(self, move: Move) -> Array:
        """Shift (n, 3) of the tool by one unit of a move."""
        if move.unknown:
            return np.asarray(self._by_unknown[:, :, self._names.index(move.unknown)])
        shift = self._channels.shift_m(move.channel)
        if move.function == "one":
            return shift
        machine = self._observed.machine
        drive = machine.drive_names.index(move.channel.partition(".")[2])
        return np.asarray(
            shift * drive_function(machine, drive, self._observed.poses.visits.drives[:, drive], move)[:, None]
        )

    def of_changes(self, changes: Sequence[Found]) -> WorkspaceChange:
        """What changes of the machine do together. The uncertainty takes them as independent."""
        moves = [move for change in changes for move in change.way.moves]
        coefficients = np.concatenate([change.coefficients for change in changes])
        covariance = np.zeros((len(moves), len(moves)))
        start = 0
        for change in changes:
            own = slice(start, start + len(change.coefficients))
            covariance[own, own] = change.covariance
            start = own.stop
        by_move = np.stack([self.shift_m(move) for move in moves], axis=2)
        shift = by_move @ coefficients
        rms = float(np.sqrt(np.mean(np.sum(shift**2, axis=1))))
        # d rms / d c = sum of shift . (d shift / d c) over (n rms)
        gradient = np.einsum("ni,nik->k", shift, by_move) / (len(shift) * max(rms, 1e-15))
        tool = self._observed.position_m
        return WorkspaceChange(
            tool_m=tool,
            shift_m=shift,
            shown=self.shown,
            rms_m=rms,
            u_rms_m=float(np.sqrt(gradient @ covariance @ gradient)),
            max_m=float(np.max(np.linalg.norm(shift, axis=1))),
            rest_rms_m=_without_rigid_motion(shift, tool),
        )


def _without_rigid_motion(shift_m: Array, tool_m: Array) -> float:
    """RMS of shifts (n, 3) at points (n, 3) once the best small rigid motion is taken off."""
    lever = tool_m - tool_m.mean(axis=0)
    motion = np.concatenate([np.broadcast_to(np.eye(3), (len(lever), 3, 3)), -skew(lever)], axis=2).reshape(-1, 6)
    left = shift_m.ravel() - motion @ (np.linalg.pinv(motion) @ shift_m.ravel())
    return float(np.sqrt(np.sum(left**2) / len(shift_m)))
