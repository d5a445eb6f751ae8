"""The two banks for compensation tables in a drive: write the idle one, verify it, activate it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from drivers.drives.drive_profile import BankObjects, CompensationObjects
from drivers.drives.servo_drive import ServoDrive
from drivers.drives.table_image import TableImage, decode_table, encode_table, image_crc
from drivers.errors import TableError

UNKNOWN_PAYLOAD = 0xFFFFFFFF


class CompensationMode(Enum):
    """Whether a drive uses its active table: not at all, for good, or until its master stays away."""

    OFF = 0
    KEPT = 1
    TRIAL = 2


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

    mode: CompensationMode
    valid: bool
    active: int
    crc: int
    generation: int
    payload_kg: float | None
    banks: tuple[Bank, Bank]

    @property
    def on(self) -> bool:
        """Whether the active table is used, on trial or kept."""
        return self.mode is not CompensationMode.OFF

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
            mode=self.mode(),
            valid=read(self.objects.valid) == 1,
            active=read(self.objects.active),
            crc=read(self.objects.crc),
            generation=read(self.objects.generation),
            payload_kg=None if payload_g == UNKNOWN_PAYLOAD else payload_g * 1e-3,
            banks=(self._bank(1), self._bank(2)),
        )

    def mode(self) -> CompensationMode:
        """Whether the active table is used. Raises TableError for a mode that is none."""
        value = self.drive.sdo.read(self.objects.mode)
        try:
            return CompensationMode(value)
        except ValueError:
            raise self._error(f"compensation mode {value} is unknown", "check the drive's profile") from None

    def read_image(self, number: int) -> TableImage:
        """The table in a bank. Raises TableError if it is damaged."""
        return decode_table(self.image_bytes(number), self.drive.metres_per_increment)

    def image_bytes(self, number: int) -> bytes:
        """What is in a bank, whole or not."""
        return self.drive.sdo.read_bytes(self._objects_of(number).image)

    def write_inactive(self, image: TableImage) -> WrittenTable:
        """Write a table to the idle bank, read it back byte for byte and compare the drive's CRC.

        Raises TableError if they differ, or if the drive reports a damaged table or one for another drive.
        """
        if image.metres_per_increment != self.drive.metres_per_increment:
            raise self._error("the table uses other increments than the drive", "compute the table anew")
        return self._write_idle(encode_table(image))

    def load(self, data: bytes) -> WrittenTable:
        """Have these bytes in a bank: in the one that holds them already, or written to the idle one.

        Raises TableError as `write_inactive` does.
        """
        crc, generation = image_crc(data), decode_table(data).generation
        for bank in self.state().banks:
            if bank.status is BankStatus.WHOLE and (bank.crc, bank.generation) == (crc, generation):
                return WrittenTable(bank.number, crc, generation)
        return self._write_idle(data)

    def _write_idle(self, data: bytes) -> WrittenTable:
        image, number = decode_table(data), self.state().idle
        if image.node_id != self.drive.node_id:
            raise self._error(f"the table is for node {image.node_id}", "write it to that drive")
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

    def uses(self, image: bytes) -> bool:
        """Whether this very table is active and used."""
        state = self.state()
        return state.on and (state.crc, state.generation) == (image_crc(image), decode_table(image).generation)

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

    def set_mode(self, mode: CompensationMode) -> None:
        """Use the active table or not; a drive that has no trial keeps it. Raises SdoRefused while it is enabled."""
        if mode is CompensationMode.TRIAL and self.objects.trial is None:
            mode = CompensationMode.KEPT
        self.drive.sdo.write(self.objects.mode, mode.value)
        if self.mode() is not mode:
            raise self._error("the compensation mode was not accepted", "disable the drive and try again")

    def set_trial_timeout(self, timeout_s: float) -> None:
        """For how long the master may stay away during the next trial (rig time); no effect on a drive without trials.

        Raises ValueError for a time that is no number of milliseconds, SdoRefused during a trial.
        """
        trial = self.objects.trial
        if trial is None:
            return
        milliseconds = round(timeout_s * 1e3) if math.isfinite(timeout_s) else 0
        if not 0 < milliseconds < 2**32:
            raise ValueError(f"impossible time-out of a trial: {timeout_s} s")
        self.drive.sdo.write(trial, milliseconds)
        if self.drive.sdo.read(trial) != milliseconds:
            raise self._error("the time-out of a trial was not accepted", "check the drive's profile")

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
