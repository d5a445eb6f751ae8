"""Visits of the test cycles of ISO 230-2 and ISO 9283, along axes that no single drive has."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.machine.description import COORDINATES, Machine
from calibration.machine.inverse import nominal_drives, platform_poses
from pkm_rig.rig.campaign_sections import CampaignSettings, MadeFor, VisitEntry, VisitsSection

AXIS_TARGETS, AXIS_RUNS = 11, 5
POSE_CYCLES, POSE_SHARE = 30, 0.8  # of the workspace's extent, that the outer poses of ISO 9283 span
STREAM = 5
STEP_M = 1.0e-5


def axis_visits(machine: Machine, settings: CampaignSettings, axis: str) -> VisitsSection:
    """The standard test cycle of ISO 230-2 along x, y or z, the other coordinates at the middle of the workspace.

    Eleven targets from the lowest to the highest, each approached from below, then back, each from above, five times.
    Their places are irregular, by the campaign's seed, so that an error with a period is not met at one phase always.
    InputError for a coordinate that the machine does not command.
    """
    column = _column(machine, axis)
    made_for: MadeFor = f"ISO 230-2 {axis}"  # type: ignore[assignment]
    low, high = machine.commanded_limits.T
    part = np.random.default_rng([settings.seed, STREAM]).uniform(0.2, 0.8, AXIS_TARGETS)
    rows = np.tile((low + high) / 2.0, (AXIS_TARGETS, 1))
    rows[:, column] = low[column] + (high - low)[column] * (np.arange(AXIS_TARGETS) + part) / AXIS_TARGETS
    rows = np.round(rows, 6)
    up = axis_directions(machine, platform_poses(machine, rows), axis)
    run = [_visit(row, sides) for row, sides in zip(rows, up, strict=True)]
    back = [_visit(row, -sides) for row, sides in zip(rows[::-1], up[::-1], strict=True)]
    return VisitsSection(visits=tuple((*run, *back) * AXIS_RUNS), made_for=made_for)


def pose_visits(machine: Machine) -> VisitsSection:
    """Thirty cycles of ISO 9283: P5, P4, P3, P2, P1; P1 the workspace's middle, the others in a diagonal plane."""
    low, high = machine.commanded_limits.T
    middle, half = (low + high) / 2.0, POSE_SHARE * (high - low) / 2.0
    sides = [np.zeros(len(low))]
    for first, others in ((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)):
        sides.append(np.array([first, *[others] * (len(low) - 1)]))
    rows = np.round([middle + half * side for side in sides], 6)
    from_below = np.ones(len(machine.drive_names))
    return VisitsSection(visits=tuple(_visit(row, from_below) for row in rows[::-1]) * POSE_CYCLES, made_for="ISO 9283")


def axis_directions(machine: Machine, poses: Array, axis: str) -> Array:
    """Side (n, d), +1 or -1, from which each drive comes where the tool approaches poses (n, 6) along +axis."""
    ahead = poses.copy()
    ahead[:, COORDINATES.index(axis)] += STEP_M
    change = nominal_drives(machine, ahead) - nominal_drives(machine, poses)
    return np.where(change >= 0.0, 1.0, -1.0)


def _column(machine: Machine, axis: str) -> int:
    commanded = [COORDINATES[c] for c in machine.commanded]
    translations = [name for name in commanded if name in ("x", "y", "z")]
    if axis not in translations:
        raise InputError(
            f"--virtual-axis {axis}: {machine.name} does not command it; choose {' or '.join(translations) or 'none'}"
        )
    return commanded.index(axis)


def _visit(row: Array, sides: Array) -> VisitEntry:
    return VisitEntry.model_validate({
        "target": tuple(float(value) for value in row), "direction": tuple(int(side) for side in sides),
    })  # fmt: skip
