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

LARGEST = 2e-3  # m or rad: a larger one is a wrong machine file, a lost reference or a swapped reflector
STEEPEST = 0.02  # change a unit of travel; drives follow their commands to far less
MOST_CHANGE = 2e-4  # m or rad, against what was written for the same load before


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
    slope = np.stack([np.max(np.abs(slopes(own, drives)), axis=1) for own in tables], axis=1)
    require_size_and_slope(machine, corrections_at(tables, drives), slope)


def require_size_and_slope(machine: Machine, correction: Array, slope: Array) -> None:
    """InputError for corrections (n, d), m or rad, that are too large, or change too much a unit of travel (m, d)."""
    largest, steepest = np.max(np.abs(correction), axis=0), np.max(np.abs(slope), axis=0)
    for a, (name, kind) in enumerate(zip(machine.drive_names, machine.drive_kinds, strict=True)):
        unit = micro_unit(kind)
        if not largest[a] <= LARGEST:
            raise InputError(
                f"drive {name}: a correction of {largest[a] * 1e6:.0f} {unit} (limit {LARGEST * 1e6:.0f}); look for a "
                "lost reference, swapped reflectors or a wrong machine file"
            )
        if not steepest[a] <= STEEPEST:
            raise InputError(
                f"drive {name}: the correction changes by {steepest[a]:.4f} a unit of travel (limit {STEEPEST:g}); "
                "look at the residuals and the poses of the campaign"
            )


def check_change(
    machine: Machine, tables: Sequence[DriveTables], former: FormerCorrection | None, *, accept: bool
) -> float | None:
    """The largest change (m or rad) against the former correction; InputError for one too large, unless accepted."""
    if former is None or former.drives.shape[1] != len(tables):
        return None
    return require_change(
        machine, corrections_at(tables, former.drives) - former.correction, former.source, accept=accept
    )


def require_change(machine: Machine, change: Array, source: str, *, accept: bool) -> float:
    """The largest of changes (n, d), m or rad, of corrections against those of `source`; InputError if too large."""
    size = np.abs(change).max(axis=0)
    drive = int(np.argmax(size))
    unit = micro_unit(machine.drive_kinds[drive])
    if not accept and not size[drive] <= MOST_CHANGE:
        raise InputError(
            f"drive {machine.drive_names[drive]}: the correction differs by {size[drive] * 1e6:.0f} {unit} from that "
            f"of {source} (limit {MOST_CHANGE * 1e6:.0f}); if the machine was altered give --accept-change"
        )
    return float(size[drive])
