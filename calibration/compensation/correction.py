"""The correction over the drives' space of any machine: what to add to each drive so that the tool is where commanded.

It is predicted by an identified model for one load and one set of temperatures, at poses within those that were
measured: beyond them there is none, and tables hold their last value.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.stats import qmc

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.identification.fit import Fit
from calibration.identification.prediction import predict_poses
from calibration.machine.description import Machine
from calibration.machine.inverse import nominal_closure, nominal_drives, platform_poses, pseudo_inverses
from calibration.model.operating_conditions import OperatingConditions
from calibration.reduction.report_frame import ReportFrame

# (drives (n, d), targets (n, 6)) -> tool errors (n, 6) in m and rad
ToolError = Callable[[Array, Array], Array]

PLANE_SAMPLES = 81  # an axis, where two coordinates are commanded
SAMPLES = 2048  # where there are more
CHECK_SAMPLES = 1024
SEED = 15
STEP = 1e-5  # of a drive, m or rad, for differences
ITERATIONS = 8
CONVERGED = 1e-10  # last step of a drive, m or rad
ACCEPTED = 1e-8  # the same, where it converges no further
MIN_SOLVED_SHARE = 0.99


@dataclass(frozen=True)
class Samples:
    """Poses of a machine: targets (n, 6), drive positions (n, d) commanded for them, corrections (n, d) of those."""

    target_m: Array
    drives: Array
    correction: Array

    def __len__(self) -> int:
        return len(self.target_m)


@dataclass(frozen=True)
class Correction:
    """The correction of a machine at one load: samples to fit tables to, and others to check them at.

    box (k, 2): limits of the commanded coordinates within which it holds.
    """

    machine: Machine
    box: Array
    fitted: Samples
    check: Samples

    @classmethod
    def sampled(
        cls,
        machine: Machine,
        error: ToolError,
        box: Array | None = None,
        shift: Callable[[Array], Array] | None = None,
    ) -> Correction:
        """The correction that takes `error` away, within a box (k, 2) or the workspace.

        shift: of the drives (n, d) at poses (n, 6), to which it is nearest (see `correct_drives`).
        """
        box = machine.commanded_limits if box is None else box
        fitted, check = fit_targets(machine, box), check_targets(machine, box)
        target = np.concatenate([fitted, check])
        nominal = nominal_drives(machine, target)
        corrected = correct_drives(machine, error, target, None if shift is None else shift(target))
        good = np.all(np.isfinite(corrected), axis=1)
        if np.mean(good) < MIN_SOLVED_SHARE:
            raise InputError(
                f"compensation: for {np.count_nonzero(~good)} of {len(good)} poses the model finds no drive positions; "
                "check the identification"
            )
        parts = [
            Samples(target[rows][good[rows]], nominal[rows][good[rows]], (corrected - nominal)[rows][good[rows]])
            for rows in (slice(0, len(fitted)), slice(len(fitted), None))
        ]
        return cls(machine, box, *parts)


def model_error(fit: Fit, report: ReportFrame, load: OperatingConditions) -> ToolError:
    """Tool errors that an identified model predicts under a load, in the report frame."""

    def error(drives: Array, target_m: Array) -> Array:
        pose = predict_poses(fit, report, load.at_poses(drives, target_m))
        return np.concatenate(report.tool_error(pose, target_m), axis=1)

    return error


def fit_targets(machine: Machine, box: Array) -> Array:
    """Targets (n, 6) that cover a box with its edges: a grid of two coordinates, else corners and a Sobol sequence."""
    if len(box) <= 2:
        axes = [np.linspace(low, high, PLANE_SAMPLES) for low, high in box]
        return platform_poses(machine, np.array(list(product(*axes))))
    unit = 0.5 - 0.5 * np.cos(np.pi * qmc.Sobol(len(box), seed=SEED).random(SAMPLES))
    inside = box[:, 0] + (box[:, 1] - box[:, 0]) * unit
    return platform_poses(machine, np.concatenate([np.array(list(product(*box))), inside]))


def check_targets(machine: Machine, box: Array) -> Array:
    """Other targets (n, 6), evenly spread over the box, its corners among them."""
    unit = qmc.Sobol(len(box), seed=SEED + 1).random(CHECK_SAMPLES)
    inside = box[:, 0] + (box[:, 1] - box[:, 0]) * unit
    return platform_poses(machine, np.concatenate([np.array(list(product(*box))), inside]))


def drive_jacobian(error: ToolError, drives: Array, target_m: Array) -> Array:
    """Derivatives (n, 6, d) of tool errors with the drives, by differences."""
    now = error(drives, target_m)
    ahead = STEP * np.eye(drives.shape[1])
    return np.stack([(error(drives + step, target_m) - now) / STEP for step in ahead], axis=2)


def correct_drives(machine: Machine, error: ToolError, target_m: Array, shift: Array | None = None) -> Array:
    """Drive coordinates (n, d) that bring the tool onto targets (n, 6); NaN where none is found.

    Newton's method with the nominal machine's Jacobian (the chord method: one evaluation of `error` an iteration), on
    the coordinates that the drives command. The identified machine's own differs from it by its errors' share of its
    dimensions, so that each iteration leaves less than a hundredth. With more drives than coordinates the span of the
    Jacobian's rows depends on stiffness, which is known less well: there it is taken from differences of `error`, once.
    All steps lie in that span, so that the solution is the one nearest to the nominal drives, or to these plus `shift`
    (n, d).
    """
    commanded = machine.commanded
    drives, jac = nominal_closure(machine, target_m)
    drives = drives if shift is None else drives + shift
    if drives.shape[1] > commanded.size:
        jac = drive_jacobian(error, drives, target_m)
    inverse = pseudo_inverses(jac[:, commanded])
    size = np.full(len(drives), np.inf)
    for _ in range(ITERATIONS):
        change = np.einsum("ndk,nk->nd", inverse, error(drives, target_m)[:, commanded])
        drives = drives - change
        size = np.max(np.abs(change), axis=1)
        if not np.nanmax(size, initial=0.0) > CONVERGED:
            break
    drives[~(size < ACCEPTED)] = np.nan
    return drives
