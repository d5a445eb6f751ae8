"""A path of set-points for cyclic synchronous position mode: is it permitted, and do the drives follow it?

A path is rows of one position per drive in metres, one row per SYNC.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from drivers.drives import cia402
from drivers.drives.servo_drive import DriveSample, ServoDrive
from drivers.errors import DriveFault

Row = Sequence[float]

_ROUNDING = 1e-9  # share of a step by which it may be too long


class PathWalk:
    """Goes along a path row by row; once it is to brake, ever more slowly, until it rests somewhere on it.

    `brake_rows`: rows in which it comes to rest from full speed.
    """

    def __init__(self, path_m: Sequence[Row], brake_rows: int) -> None:
        self._path_m, self._brake_rows = path_m, brake_rows
        self._place, self._rate = -1.0, 1.0

    @property
    def at_rest(self) -> bool:
        """Whether the last row given is where it stays."""
        return self._place >= len(self._path_m) - 1 or self._rate == 0.0

    def next_row(self, *, brake: bool) -> Row:
        """The next row."""
        if brake:
            self._rate = max(0.0, self._rate - 1.0 / self._brake_rows)
        self._place = min(max(0.0, self._place + self._rate), len(self._path_m) - 1.0)
        first = min(int(self._place), len(self._path_m) - 2) if len(self._path_m) > 1 else 0
        share = self._place - first
        if share == 0.0 or len(self._path_m) == 1:
            return self._path_m[first]
        after = self._path_m[first + 1]
        if share == 1.0:
            return after
        return [a + share * (b - a) for a, b in zip(self._path_m[first], after, strict=True)]


def check_path(drives: Sequence[ServoDrive], path_m: Sequence[Row], step_limit_m: float) -> None:
    """Raise ValueError for a path that leaves a drive's software limits or has a step longer than `step_limit_m`."""
    if not path_m or any(len(row) != len(drives) for row in path_m):
        raise ValueError(f"a path is rows of {len(drives)} positions")
    for drive, places_m in zip(drives, zip(*path_m, strict=True), strict=True):
        low_m, high_m = drive.limits_m
        for number, place_m in enumerate(places_m, start=1):
            drive.increments(place_m)
            if not low_m <= place_m <= high_m:
                raise ValueError(
                    f"{drive.name}: row {number} of the path, {place_m:.6f} m, is outside its software limits of "
                    f"{low_m:.6f} m to {high_m:.6f} m"
                )
        for number, (before_m, place_m) in enumerate(pairwise(places_m), start=2):
            if abs(place_m - before_m) > step_limit_m * (1.0 + _ROUNDING):
                raise ValueError(
                    f"{drive.name}: row {number} of the path is a step of {abs(place_m - before_m) * 1e3:.3f} mm, "
                    f"the velocity limit permits {step_limit_m * 1e3:.3f} mm per period"
                )


def require_on_path(
    drives: Sequence[ServoDrive], samples: Sequence[DriveSample], rows: Sequence[Row], tolerance_m: float
) -> None:
    """Raise DriveFault for a drive that reports that it ignores its targets, or whose demand is on none of these rows.

    `rows` are the row of this SYNC and the two before: a drive is on the previous row, on the one before that if it has
    missed a target, and between the last two if SYNC was sent again.
    """
    for drive, sample, places_m in zip(drives, samples, zip(*rows, strict=True), strict=True):
        if not sample.statusword & cia402.FOLLOWS_TARGET:
            raise _path_fault(drive, "it does not follow its targets (statusword bit 12)")
        if not min(places_m) - tolerance_m <= sample.demand_m <= max(places_m) + tolerance_m:
            raise _path_fault(
                drive, f"its demand is {sample.demand_m:.6f} m, which is not on the path ({places_m[-1]:.6f} m)"
            )


def _path_fault(drive: ServoDrive, what: str) -> DriveFault:
    return DriveFault(drive.name, drive.where, what, "check limits and PDOs of the drive, then clear the stop")
