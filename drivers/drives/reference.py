"""Whether a drive's position is referenced: what it says itself, and whether that is to be believed."""

from __future__ import annotations

from typing import Protocol

from drivers.drives.drive_profile import DriveProfile
from drivers.drives.drive_records import DriveExpectation
from drivers.drives.drive_setup import DriveSetup
from drivers.errors import NotReferenced

_BEYOND_M = 1e-3  # how far a drive that was stopped may stand outside its travel


class ReferencedDrive(Protocol):
    """What a reference has to know of its drive."""

    name: str
    profile: DriveProfile
    expected: DriveExpectation
    limits_m: tuple[float, float]

    @property
    def where(self) -> str:
        """Its place on the bus, for messages."""

    def position_actual_m(self) -> float:
        """Where the drive says that it stands. Raises DeviceError."""

    def setup(self) -> DriveSetup:
        """Reading and writing of its settings."""


class ReferenceState:
    """The reference of one drive. `is_valid`: whether it was referenced when last asked, and is not distrusted."""

    def __init__(self, drive: ReferencedDrive) -> None:
        self.is_valid = False
        self._drive = drive
        self._distrusted: str | None = None

    def ask(self) -> None:
        """Ask the drive whether its position is referenced."""
        self.is_valid = self._drive.setup().is_referenced() and self._distrusted is None

    def read(self) -> None:
        """The same. Raises NotReferenced."""
        self.ask()
        self.require()

    def require(self) -> None:
        """Raise NotReferenced if the position was not referenced when last asked."""
        if self.is_valid:
            return
        remedy = "home the drive (pkm-rig home --rig RIG.toml)"
        if self._drive.profile.referenced is None:
            remedy = "set its zero by its own means, or correct the travel in the machine file"
        what = "the position is not referenced" + (f": {self._distrusted}" if self._distrusted else "")
        raise NotReferenced(self._drive.name, self._drive.where, what, remedy)

    def distrust(self, why: str) -> None:
        """Take the drive for not referenced, whatever it says, until it is trusted again."""
        self._distrusted, self.is_valid = why, False

    def distrust_outside_travel(self) -> None:
        """A reference by which the drive stands outside its software limits or its travel cannot be right."""
        limits_m, travel_m = self._drive.limits_m, self._drive.expected.travel_m
        low_m, high_m = max(limits_m[0], travel_m[0]), min(limits_m[1], travel_m[1])
        stands_m = self._drive.position_actual_m()
        if not low_m - _BEYOND_M <= stands_m <= high_m + _BEYOND_M:
            self.distrust(f"it stands at {stands_m:.6f} m, outside its travel of {low_m:.6f} m to {high_m:.6f} m")

    def trust(self) -> None:
        """Homing has ended where it should: believe what the drive says. Raises NotReferenced."""
        self._distrusted = None
        self.read()
