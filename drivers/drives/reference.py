"""Whether a drive's position is referenced: what the drive reports, and whether that can be trusted."""

from __future__ import annotations

from typing import Protocol

from drivers.drives.drive_profile import DriveProfile
from drivers.drives.drive_records import DriveExpectation
from drivers.drives.drive_setup import DriveSetup
from drivers.errors import NotReferenced

_OVERRUN_M = 1e-3  # by how much a drive that was stopped may be outside its travel


class ReferencedDrive(Protocol):
    """What is needed of the drive."""

    name: str
    profile: DriveProfile
    expected: DriveExpectation
    limits_m: tuple[float, float]

    @property
    def where(self) -> str:
        """Node and line, for messages."""

    def position_actual_m(self) -> float:
        """The position that the drive reports. Raises DeviceError."""

    def setup(self) -> DriveSetup:
        """Access to its settings."""


class ReferenceState:
    """The reference of one drive. `is_valid`: it was referenced when last asked, and is not distrusted."""

    def __init__(self, drive: ReferencedDrive) -> None:
        self.is_valid = False
        self._drive = drive
        self._distrusted: str | None = None

    def ask(self) -> None:
        """Ask the drive whether its position is referenced."""
        self.is_valid = self._drive.setup().is_referenced() and self._distrusted is None

    def read(self) -> None:
        """Ask the drive. Raises NotReferenced."""
        self.ask()
        self.require()

    def require(self) -> None:
        """Raise NotReferenced if the position was not referenced when last asked."""
        if self.is_valid:
            return
        remedy = "home the drive (pkm-rig home --rig RIG.toml)"
        if self._drive.profile.referenced is None:
            remedy = "set its zero with the make's own tool, or correct the travel in the machine file"
        what = "the position is not referenced" + (f": {self._distrusted}" if self._distrusted else "")
        raise NotReferenced(self._drive.name, self._drive.where, what, remedy)

    def distrust(self, why: str) -> None:
        """Treat the drive as not referenced, whatever it reports, until `trust`."""
        self._distrusted, self.is_valid = why, False

    def distrust_outside_travel(self) -> None:
        """Distrust a reference by which the drive is outside its software limits or its travel."""
        limits_m, travel_m = self._drive.limits_m, self._drive.expected.travel_m
        low_m, high_m = max(limits_m[0], travel_m[0]), min(limits_m[1], travel_m[1])
        position_m = self._drive.position_actual_m()
        if not low_m - _OVERRUN_M <= position_m <= high_m + _OVERRUN_M:
            self.distrust(f"it is at {position_m:.6f} m, outside its travel of {low_m:.6f} m to {high_m:.6f} m")

    def trust(self) -> None:
        """Homing has ended at the right position: trust the drive's report again. Raises NotReferenced."""
        self._distrusted = None
        self.read()
