"""Limits on a correction before it goes into a control: its size, its slope, and its change against the former one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.compensation.decomposition import DriveTables, corrections_at
from calibration.compensation.formats.control import slopes
from calibration.machine.description import Machine
from calibration.model.operating_conditions import OperatingConditions

LARGEST = 2e-3  # m or rad: a larger one is a wrong machine file, a lost reference or a swapped reflector
STEEPEST = 0.02  # change a unit of travel; drives follow their commands to far less
MOST_CHANGE = 2e-4  # m or rad, against what was written for the same load before
LOAD_TOLERANCE_KG = 1e-6


@dataclass(frozen=True)
class FormerCorrection:
    """What was written before: drive positions (n, d), corrections there (n, d), and where it is from, in words."""

    drives: Array
    correction: Array
    source: str


def micro_unit(kind: str) -> str:
    """The unit in which a drive's corrections are told to people."""
    return "urad" if kind == "crank" else "um"


def check_size_and_slope(machine: Machine, tables: Sequence[DriveTables], drives: Array) -> None:
    """InputError for a correction that is too large or too steep at some of the drive positions (n, d)."""
    parts = zip(machine.drive_names, machine.drive_kinds, tables, corrections_at(tables, drives).T, strict=True)
    for name, kind, own, correction in parts:
        unit = micro_unit(kind)
        largest, slope = float(np.max(np.abs(correction))), float(np.max(np.abs(slopes(own, drives))))
        if not largest <= LARGEST:
            raise InputError(
                f"drive {name}: a correction of {largest * 1e6:.0f} {unit} (limit {LARGEST * 1e6:.0f}); look for a "
                "lost reference, swapped reflectors or a wrong machine file"
            )
        if not slope <= STEEPEST:
            raise InputError(
                f"drive {name}: the correction changes by {slope:.4f} a unit of travel (limit {STEEPEST:g}); look at "
                "the residuals and the poses of the campaign"
            )


def check_change(
    machine: Machine, tables: Sequence[DriveTables], former: FormerCorrection | None, *, accept: bool
) -> float | None:
    """The largest change (m or rad) against the former correction; InputError for one too large, unless accepted."""
    if former is None or former.drives.shape[1] != len(tables):
        return None
    change = np.abs(corrections_at(tables, former.drives) - former.correction).max(axis=0)
    drive = int(np.argmax(change))
    unit = micro_unit(machine.drive_kinds[drive])
    if not accept and not change[drive] <= MOST_CHANGE:
        raise InputError(
            f"drive {machine.drive_names[drive]}: the correction differs by {change[drive] * 1e6:.0f} {unit} from that "
            f"of {former.source} (limit {MOST_CHANGE * 1e6:.0f}); if the machine was altered give --accept-change"
        )
    return float(change[drive])


def check_load(conditions: OperatingConditions, measured_kg: Array) -> None:
    """InputError for a payload outside those that were measured."""
    low, high = float(np.min(measured_kg)), float(np.max(measured_kg))
    if not low - LOAD_TOLERANCE_KG <= conditions.payload_kg <= high + LOAD_TOLERANCE_KG:
        raise InputError(
            f"payload {conditions.payload_kg:g} kg: {low:g} to {high:g} kg were measured, beyond them there is no "
            "correction; measure a campaign with it"
        )
