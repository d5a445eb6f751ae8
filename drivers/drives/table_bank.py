"""The two banks for compensation tables in a drive: write the idle one, verify, switch over, roll back."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum

from drivers.drives.drive_profile import BankObjects, CompensationObjects
from drivers.drives.servo_drive import ServoDrive
from drivers.drives.table_image import TableImage, decode_table, encode_table, image_crc
from drivers.errors import DeviceError, TableError

UNKNOWN_PAYLOAD = 0xFFFFFFFF


class BankStatus(Enum):
    """State of a bank's content."""

    EMPTY = 0
    WHOLE = 1
    DAMAGED = 2


@dataclass(frozen=True)
class Bank:
    """One bank as the drive describes it."""

    number: int
    status: BankStatus
    crc: int
    generation: int
    payload_kg: float


@dataclass(frozen=True)
class CompensationState:
    """State of a drive's compensation. `payload_kg` is None while it is unknown to the drive."""

    on: bool
    valid: bool
    active: int
    crc: int
    generation: int
    payload_kg: float | None
    banks: tuple[Bank, Bank]

    @property
    def idle(self) -> int:
        """The bank to write to: the one that is not active, or an empty, damaged or older one if none is."""
        if self.active in (1, 2):
            return 3 - self.active
        return min(self.banks, key=lambda b: (b.status is BankStatus.WHOLE, b.generation)).number

    @property
    def next_generation(self) -> int:
        """The generation of the next table: one more than the newest in either bank."""
        whole = [bank.generation for bank in self.banks if bank.status is BankStatus.WHOLE]
        return max([self.generation, *whole]) + 1


@dataclass(frozen=True)
class WrittenTable:
    """A table in a bank, verified by reading it back."""

    bank: int
    crc: int
    generation: int


class TableBank:
    """The compensation of one drive.

    All methods raise SdoRefused, NoAnswer, ProtocolError and ConnectionFailed if communication fails.
    """

    def __init__(self, drive: ServoDrive) -> None:
        self.drive = drive

    @property
    def objects(self) -> CompensationObjects:
        """Where the drive keeps its compensation. Raises TableError if it has none."""
        compensation_objects = self.drive.profile.compensation
        if compensation_objects is None:
            raise self._error(
                f"a '{self.drive.profile.name}' has no table bank", "name another profile in the rig file"
            )
        return compensation_objects

    def state(self) -> CompensationState:
        """The content of the banks, and which one is active."""
        read = self.drive.sdo.read_twice
        payload_g = read(self.objects.payload)
        return CompensationState(
            on=read(self.objects.mode) == 1,
            valid=read(self.objects.valid) == 1,
            active=read(self.objects.active),
            crc=read(self.objects.crc),
            generation=read(self.objects.generation),
            payload_kg=None if payload_g == UNKNOWN_PAYLOAD else payload_g * 1e-3,
            banks=(self._bank(1), self._bank(2)),
        )

    def read_image(self, number: int) -> TableImage:
        """The table in a bank. Raises TableError if it is damaged."""
        data = self.drive.sdo.read_bytes(self._objects_of(number).image)
        return decode_table(data, self.drive.metres_per_increment)

    def write_inactive(self, image: TableImage) -> WrittenTable:
        """Write a table to the idle bank, read it back byte for byte and compare the drive's CRC.

        Raises TableError if they differ, or if the drive reports a damaged table or one for another drive.
        """
        if image.node_id != self.drive.node_id:
            raise self._error(f"the table is for node {image.node_id}", "write it to that drive")
        if image.metres_per_increment != self.drive.metres_per_increment:
            raise self._error("the table uses other increments than the drive", "compute the table anew")
        data, number = encode_table(image), self.state().idle
        self.drive.sdo.write_bytes(self._objects_of(number).image, data)
        if self.drive.sdo.read_bytes(self._objects_of(number).image) != data:
            raise self._error(f"bank {number} reads back other bytes than were written", "write the table again")
        bank = self._bank(number)
        if bank.status is not BankStatus.WHOLE:
            raise self._error(
                f"the drive finds bank {number} {bank.status.name.lower()}", "check machine name and node id"
            )
        if (bank.crc, bank.generation) != (image_crc(data), image.generation):
            raise self._error(f"bank {number} has another CRC or generation", "write the table again")
        return WrittenTable(number, bank.crc, bank.generation)

    def activate(self, number: int, crc: int, generation: int) -> None:
        """Switch to a bank after verifying its content, and read back; the drive must be disabled.

        Raises TableError, and SdoRefused while operation is enabled.
        """
        bank = self._bank(number)
        if bank.status is not BankStatus.WHOLE or (bank.crc, bank.generation) != (crc, generation):
            raise self._error(
                f"bank {number} is {bank.status.name.lower()}, CRC {bank.crc:08X}, generation"
                f" {bank.generation}; expected CRC {crc:08X}, generation {generation}",
                "write the table again",
            )
        self.drive.sdo.write(self.objects.activate, number)
        self.confirm(number, crc, generation)

    def deactivate(self) -> None:
        """Use no table. Raises SdoRefused while operation is enabled."""
        self.drive.sdo.write(self.objects.activate, 0)
        if self.drive.sdo.read(self.objects.active) != 0:
            raise self._error("the bank is still active", "disable the drive and try again")

    def confirm(self, number: int, crc: int, generation: int) -> None:
        """Raise TableError unless this very table is active."""
        read = self.drive.sdo.read_twice
        active = (read(self.objects.active), read(self.objects.crc), read(self.objects.generation))
        if active != (number, crc, generation):
            raise self._error(
                f"bank {active[0]}, CRC {active[1]:08X}, generation {active[2]} is active instead of"
                f" bank {number}, CRC {crc:08X}, generation {generation}",
                "activate the table again",
            )

    def set_mode(self, on: bool) -> None:
        """Switch compensation on or off. Raises SdoRefused while operation is enabled."""
        self.drive.sdo.write(self.objects.mode, int(on))
        if self.drive.sdo.read(self.objects.mode) != int(on):
            raise self._error("the compensation mode was not accepted", "disable the drive and try again")

    def set_payload(self, mass_kg: float | None) -> None:
        """Tell the drive the present payload (None: unknown). Raises ValueError for an impossible mass."""
        if mass_kg is not None and not 0.0 <= mass_kg < UNKNOWN_PAYLOAD * 1e-3 - 1.0:
            raise ValueError(f"impossible payload: {mass_kg} kg")
        grams = UNKNOWN_PAYLOAD if mass_kg is None else round(mass_kg * 1e3)
        self.drive.sdo.write(self.objects.payload, grams)

    def _objects_of(self, number: int) -> BankObjects:
        return self.objects.banks[number - 1]

    def _bank(self, number: int) -> Bank:
        read = self.drive.sdo.read_twice
        status = read(self._objects_of(number).status)
        return Bank(
            number=number,
            status=BankStatus(status) if status in (0, 1, 2) else BankStatus.DAMAGED,
            crc=read(self._objects_of(number).crc),
            generation=read(self._objects_of(number).generation),
            payload_kg=read(self._objects_of(number).payload) * 1e-3,
        )

    def _error(self, what: str, remedy: str) -> TableError:
        return TableError(self.drive.name, self.drive.where, what, remedy)


@dataclass(frozen=True)
class Activation:
    """One drive's part in an activation: bank number (0: none), CRC and generation that must be in it."""

    bank: TableBank
    number: int
    crc: int
    generation: int

    def carry_out(self) -> None:
        """Switch over."""
        if self.number == 0:
            self.bank.deactivate()
        else:
            self.bank.activate(self.number, self.crc, self.generation)

    def confirm(self) -> None:
        """Read back."""
        if self.number != 0:
            self.bank.confirm(self.number, self.crc, self.generation)


def activate_all(activations: Sequence[Activation]) -> list[Activation]:
    """Switch all drives over, or none; returns what was active before, in a form to switch back with.

    If one fails, those already switched return to their previous bank and the error is raised. If that fails too, a
    TableError says so: the drives then have different tables and must not move.
    """
    previous = [_active(activation.bank) for activation in activations]
    switched: list[Activation] = []
    try:
        for activation, before in zip(activations, previous, strict=True):
            switched.append(before)
            activation.carry_out()
        for activation in activations:
            activation.confirm()
    except DeviceError as error:
        stuck = [before.bank.drive for before in reversed(switched) if not _go_back(before)]
        if stuck:
            names = ", ".join(drive.name for drive in stuck)
            raise TableError(
                names,
                stuck[0].where,
                f"restoring the previous table failed after: {error}",
                "do not move; connect again",
            ) from error
        raise
    return previous


def _active(bank: TableBank) -> Activation:
    state = bank.state()
    return Activation(bank, state.active, state.crc, state.generation)


def _go_back(before: Activation) -> bool:
    with suppress(DeviceError):
        before.carry_out()
        before.confirm()
        return True
    return False
