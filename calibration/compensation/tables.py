"""Compensation: drive corrections that put the tool point where it is commanded, as a table a drive.

The correction is predicted by an identified model, in the report frame, for one payload and one set of
temperatures; the table is bilinear over the commanded positions of both drives.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.compensation.correction import check_targets, correct_drives, model_error
from calibration.compensation.grid import (
    BEYOND_WORKSPACE_M,
    CHECKED,
    GRID_MARGIN_M,
    MOST_ADDED,
    POINTS,
    POINTS_PER_AXIS,
)
from calibration.compensation.limits import require_size_and_slope
from calibration.compensation.measured_range import MeasuredRange
from calibration.identification.calibration import Calibration
from calibration.identification.fit import Fit
from calibration.machine import equilibrium
from calibration.machine.description import Machine
from calibration.machine.inverse import nominal_closure, nominal_drives
from calibration.model.operating_conditions import OperatingConditions
from calibration.reduction.figures import noise_floor
from calibration.reduction.report_frame import ReportFrame


@dataclass(frozen=True)
class CompensationTable:
    """Corrections of all drives over one grid.

    start_m, step_m (d,): grid of commanded positions, drive by drive; correction_m (d, N, N, ...): axis 1 + a is the
    commanded position of drive a. Add the correction to the command. interpolation_rms_m, interpolation_max_m: errors
    of the tool's position that interpolation adds within the workspace. by_direction_m (d, 2): added as well after a
    drive's motion in positive and in negative direction; the mean of both is zero.
    """

    start_m: Array
    step_m: Array
    correction_m: Array
    conditions: OperatingConditions
    interpolation_rms_m: float = float("nan")
    interpolation_max_m: float = float("nan")
    by_direction_m: Array = field(default_factory=lambda: np.zeros((2, 2)))

    def with_reversals(self, machine: Machine, reversal_m: Array) -> CompensationTable:
        """Against reversal values (d,): half of it either side. InputError where a correction becomes too large."""
        by_direction = 0.5 * np.stack([reversal_m, -reversal_m], axis=1)
        largest = np.abs(self.correction_m).max(axis=(1, 2)) + np.abs(by_direction).max(axis=1)
        require_size_and_slope(machine, largest[None], np.zeros((1, len(largest))))
        return replace(self, by_direction_m=by_direction)

    @property
    def temperature_c(self) -> float:
        """Mean of the temperatures for which the table was computed."""
        return float(np.mean(list(self.conditions.temperatures_c.values())))


def corrected_drives(fit: Fit, report: ReportFrame, target_m: Array, load: OperatingConditions) -> Array:
    """Drive coordinates (n, d) that put the tool point on the targets (n, 6); NaN where none is found."""
    return correct_drives(report.machine, model_error(fit, report, load), target_m)


def build_table(
    fit: Fit, report: ReportFrame, load: OperatingConditions, noise_m: float | None = None
) -> CompensationTable:
    """Table for one load over the box of the workspace.

    noise_m: of a measured position; the grid is the coarsest of POINTS whose interpolation adds at most MOST_ADDED of
    it (RMS over the workspace), or the finest. Without it POINTS_PER_AXIS. InputError for a correction that is too
    large or too steep. Nodes whose pose lies beyond the workspace take the correction of the nearest pose of a slightly
    larger one, so that every cell that touches the workspace is exact and no node is extrapolated far.
    """
    machine = report.machine
    if set(machine.drive_kinds) != {"slider"} or len(machine.drive_names) != 2:
        raise InputError(
            f"compensation: tables are for machines with two sliders; {machine.name} has "
            f"{len(machine.drive_names)} drives ({', '.join(machine.drive_kinds)}); use corrected_drives pose by pose"
        )
    check = check_targets(machine, machine.commanded_limits)[:CHECKED]
    nominal, jac = nominal_closure(machine, check)
    exact = corrected_drives(fit, report, check, load) - nominal
    for points in (POINTS_PER_AXIS,) if noise_m is None else POINTS:
        table = _table_of(fit, report, load, points)
        left = np.einsum("ncd,nd->nc", jac[:, machine.commanded], correction_at(table, nominal) - exact)
        added_m = np.linalg.norm(left, axis=1)
        rms_m = float(np.sqrt(np.mean(added_m**2)))
        if noise_m is not None and rms_m <= MOST_ADDED * noise_m:
            break
    steep = [np.max(np.abs(np.diff(table.correction_m, axis=a + 1)), axis=(1, 2)) / table.step_m[a] for a in range(2)]
    require_size_and_slope(machine, table.correction_m.reshape(2, -1).T, np.array(steep))
    return replace(table, interpolation_rms_m=rms_m, interpolation_max_m=float(added_m.max()))


def _table_of(fit: Fit, report: ReportFrame, load: OperatingConditions, points: int) -> CompensationTable:
    machine = report.machine
    box = drive_box(machine)
    axes = [np.linspace(lo, hi, points) for lo, hi in box]
    nodes = np.array(list(product(*axes)))
    pose, reached = _clamped_poses(machine, nodes)
    correction = corrected_drives(fit, report, pose, load) - nominal_drives(machine, pose)
    usable = reached & np.all(np.isfinite(correction), axis=1)
    if np.count_nonzero(usable) < len(nodes) // 2:
        raise InputError("compensation: the model reaches less than half of the table; check the identification")
    for unreachable in np.flatnonzero(~usable):
        nearest = np.argmin(np.where(usable, np.sum((nodes - nodes[unreachable]) ** 2, axis=1), np.inf))
        correction[unreachable] = correction[nearest]
    shape = (points,) * len(axes)
    return CompensationTable(
        start_m=box[:, 0],
        step_m=(box[:, 1] - box[:, 0]) / (points - 1),
        correction_m=np.moveaxis(correction.reshape(*shape, -1), -1, 0),
        conditions=load,
    )


def table_for_payload(identified: Calibration, payload: int, temperatures_c: dict[str, float]) -> CompensationTable:
    """Table for a payload of the rig's list at some temperatures.

    InputError beyond the loads and temperatures that were measured, and where the poses leave a part of the workspace
    unmeasured.
    """
    conditions, measured = identified.operating_conditions(payload, temperatures_c), MeasuredRange.of(identified)
    measured.require(conditions)
    measured.require_workspace()
    floor = noise_floor(identified.reduction)
    return build_table(identified.fit, identified.report, conditions, None if floor is None else floor.position_rms_m)


def _clamped_poses(machine: Machine, nodes: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Nominal pose of each node (n, 6), pulled into the enlarged workspace, and whether one was found."""
    rigid = replace(machine, moving_mass_kg=0.0)
    at = equilibrium.make_conditions(rigid, len(nodes))
    rest = equilibrium.solve(rigid, machine.nominal, nodes, at)
    found, reached = rest.coordinates(), rest.converged.copy()
    for row in np.flatnonzero(~reached):  # from the nearest node that was found: the search begins too far away else
        near = found[np.argmin(np.where(reached, np.sum((nodes - nodes[row]) ** 2, axis=1), np.inf))]
        one = equilibrium.make_conditions(rigid, 1)
        again = equilibrium.solve(rigid, machine.nominal, nodes[row : row + 1], one, near[None])
        if again.converged[0]:
            found[row], reached[row] = again.coordinates()[0], True
    pose = np.zeros((len(nodes), 6))
    lo, hi = machine.workspace[:2, 0] - BEYOND_WORKSPACE_M, machine.workspace[:2, 1] + BEYOND_WORKSPACE_M
    pose[:, :2] = np.clip(np.nan_to_num(found[:, :2]), lo, hi)
    return pose, reached


def drive_box(machine: Machine) -> Array:
    """Smallest box (d, 2) of drive positions that covers the workspace, with a margin."""
    corners = [np.linspace(lo, hi, 9) for lo, hi in machine.commanded_limits]
    target = np.zeros((9 ** len(corners), 6))
    target[:, machine.commanded] = list(product(*corners))
    drives = nominal_drives(machine, target)
    return np.stack([drives.min(axis=0) - GRID_MARGIN_M, drives.max(axis=0) + GRID_MARGIN_M], axis=1)


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
