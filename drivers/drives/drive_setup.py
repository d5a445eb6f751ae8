"""What is compared and set before a drive is used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.can.can_line import NMT_PRE_OPERATIONAL, CanLine
from drivers.can.drive_object import DriveObject
from drivers.can.sdo import SdoAccess
from drivers.drives import objects, pdo
from drivers.drives.drive_profile import DriveProfile
from drivers.drives.drive_records import DriveExpectation, DriveIdentity
from drivers.drives.pdo import PdoMapping
from drivers.errors import ConnectionFailed, IdentityMismatch, NoAnswer

_CIA402 = 402
_QUICK_STOP = 3
_FACTOR_TOLERANCE = 1e-9
_PERIOD_TOLERANCE = 1e-9


@dataclass(frozen=True)
class DriveSetup:
    """The steps of connecting to one node. All raise NoAnswer, SdoRefused and ConnectionFailed."""

    line: CanLine
    sdo: SdoAccess
    node_id: int
    name: str
    where: str
    profile: DriveProfile

    def find(self) -> None:
        """Raise ConnectionFailed if the node is absent, IdentityMismatch if it is no drive."""
        try:
            device_type = self.sdo.read(objects.DEVICE_TYPE, retry=False)
        except NoAnswer as error:
            seen_nodes = ", ".join(str(node) for node in sorted(self.line.seen_nodes)) or "none"
            raise ConnectionFailed(
                self.name,
                self.where,
                f"no drive answers with node id {self.node_id} (heartbeats seen: {seen_nodes})",
                "check power, cable, bit rate and the node id in the rig file",
            ) from error
        if device_type & 0xFFFF != _CIA402:
            raise self._mismatch(f"device type 0x{device_type:08X} is no CiA 402 drive")

    def read_identity(self, expected: DriveExpectation) -> DriveIdentity:
        """Read the identity. Raises IdentityMismatch."""
        identity = DriveIdentity(
            *(self.sdo.read(e) for e in (objects.VENDOR, objects.PRODUCT, objects.REVISION, objects.SERIAL))
        )
        for field in ("vendor", "product", "serial"):
            expected_value = getattr(expected, field)
            if expected_value not in (None, getattr(identity, field)):
                actual = getattr(identity, field)
                raise self._mismatch(f"{field} is 0x{actual:X}, 0x{expected_value:X} is configured")
        return identity

    def compare_factors(self, expected: DriveExpectation) -> None:
        """Raise IdentityMismatch if the units of the factor group differ from those configured.

        For makes without a factor group the rig file's value is used unchecked.
        """
        if not self.profile.factor_group:
            return
        read = self.sdo.read
        divisors = [read(e) for e in (objects.FEED_REVOLUTIONS, objects.ENCODER_INCREMENTS, objects.GEAR_MOTOR)]
        if 0 in divisors:
            raise self._mismatch("the factor group holds a zero")
        feed_m = read(objects.FEED) * 1e-6 * read(objects.ENCODER_REVOLUTIONS) * read(objects.GEAR_SHAFT)
        step_m = feed_m / math.prod(divisors)
        configured_m = expected.metres_per_increment
        if abs(step_m - configured_m) > _FACTOR_TOLERANCE * configured_m:
            raise self._mismatch(
                f"an increment is {step_m:.9g} m by the factor group, {configured_m:.9g} m is configured"
            )

    def set_pdos(self, partner_node_id: int | None) -> None:
        """Read the PDO mapping and write the parts that differ. Raises IdentityMismatch if it is not kept."""
        bank = self.profile.compensation
        partner = () if bank is None else (bank.partner_command, bank.partner_velocity)
        self._set_mappings(pdo.required_mappings(self.node_id, partner_node_id, partner))

    def set_cyclic_pdo(self) -> None:
        """The PDO for targets in cyclic mode. Raises IdentityMismatch if it is not kept."""
        self._set_mappings([pdo.cyclic_mapping(self.node_id)])

    def set_interpolation_period(self, period_s: float) -> None:
        """Set the time between SYNCs in cyclic mode (0x60C2). Raises ValueError if the object cannot express it."""
        units, exponent = interpolation_period(period_s)
        self.set_and_compare(objects.INTERPOLATION_UNITS, units)
        self.set_and_compare(objects.INTERPOLATION_EXPONENT, exponent)

    def _set_mappings(self, required: Sequence[PdoMapping]) -> None:
        wrong = pdo.mappings_to_write(self.sdo, required)
        if not wrong:
            return
        self.line.send_nmt(NMT_PRE_OPERATIONAL, self.node_id)
        for mapping in wrong:
            pdo.write_mapping(self.sdo, mapping)
        if pdo.mappings_to_write(self.sdo, wrong):
            raise self._mismatch("the drive does not keep the PDO mapping")

    def is_referenced(self) -> bool:
        """Whether the drive reports that its position is referenced; True for makes that cannot lose it."""
        entry, mask = self.profile.referenced, self.profile.referenced_mask
        return entry is None or self.sdo.read_twice(entry) & mask == mask

    def watch_master(self, master_node_id: int, limit_ms: int) -> None:
        """Have the drive stop by itself when the master's heartbeat stays away; no effect if the make cannot."""
        if self.profile.watchdog:
            self.set_and_compare(objects.ABORT_CONNECTION_OPTION, _QUICK_STOP)
            self.set_and_compare(objects.HEARTBEAT_CONSUMER, master_node_id << 16 | limit_ms)

    def set_and_compare(self, entry: DriveObject, value: int) -> None:
        """Write a setting and read it back. Raises IdentityMismatch if it is not kept."""
        self.sdo.write(entry, value)
        value_read_back = self.sdo.read(entry)
        if value_read_back != value:
            raise self._mismatch(f"{entry}: {value} was written, {value_read_back} is read back")

    def _mismatch(self, what: str) -> IdentityMismatch:
        return IdentityMismatch(self.name, self.where, what, "check drive and rig file against each other")


def interpolation_period(period_s: float) -> tuple[int, int]:
    """A period as units (1 to 255) and power of ten of a second (-6 to 0), of 0x60C2.

    Raises ValueError if there is no such pair; milliseconds are tried first, which every make supports.
    """
    for exponent in (-3, -4, -5, -6, -2, -1, 0):
        units = period_s / 10.0**exponent
        if math.isfinite(units) and 1 <= round(units) <= 255 and abs(units - round(units)) <= _PERIOD_TOLERANCE * units:
            return round(units), exponent
    raise ValueError(
        f"a period of {period_s} s cannot be expressed in object 0x60C2: use 1 to 255 times a power of ten"
    )
