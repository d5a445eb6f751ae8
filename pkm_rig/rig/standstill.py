"""Whether the drives stay where a visit has brought them: nothing but this rig is to move them."""

from __future__ import annotations

from collections.abc import Sequence

from calibration.base.arrays import Array
from drivers.drives.servo_drive import DriveSample, ServoDrive
from drivers.errors import DrivesMoved


class Standstill:
    """Compares the drives at each reading of a visit with its target, with its first reading and with their demand.

    Where `limit_m` is exceeded somebody else has moved them, or they have crept: the readings do not belong together.
    A following error beyond that of a drive at rest, `following_m`, is one too, or a position that came spoilt.
    """

    def __init__(self, drives: Sequence[ServoDrive], limit_m: float, following_m: float) -> None:
        self._drives, self._limit_m, self._following_m = tuple(drives), limit_m, following_m
        self._visit = -1
        self._first_m: list[float] = []

    def check(self, visit: int, target_m: Array, samples: Sequence[DriveSample]) -> DrivesMoved | None:
        """What is to be said about the drive that has moved, None while all stand; `samples` at one SYNC."""
        if visit != self._visit:
            self._visit, self._first_m = visit, [sample.position_m for sample in samples]
        for drive, sample, first_m, demand_m in zip(self._drives, samples, self._first_m, target_m, strict=True):
            for since, moved_m, limit_m in (
                ("since its first reading", sample.position_m - first_m, self._limit_m),
                ("since its target was reached", sample.demand_m - demand_m, self._limit_m),
                ("away from its demand", sample.position_m - sample.demand_m, self._following_m),
            ):
                if not abs(moved_m) <= limit_m:
                    return DrivesMoved(
                        drive.name,
                        drive.where,
                        f"moved by {moved_m * 1e6:.1f} um during visit {visit}, {since} (limit {limit_m * 1e6:g} um)",
                        "look for another CAN master, a drive that creeps, or raise [limits] moved_m",
                    )
        return None
