"""The tables of all drives of a machine, switched together: activate on all or on none, off on all, back again."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from drivers.drives import objects
from drivers.drives.table_bank import CompensationMode, TableBank
from drivers.errors import DeviceError, TableError


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


def answering(banks: Sequence[TableBank]) -> list[TableBank]:
    """The banks of drives that answer one short question; a silent one costs a single time-out."""
    found = []
    for bank in banks:
        with suppress(DeviceError):
            bank.drive.sdo.read(objects.DEVICE_TYPE, retry=False)
            found.append(bank)
    return found


def switch_off(banks: Sequence[TableBank]) -> None:
    """Use no table on any drive that can be reached; raises the first failure afterwards."""
    failures: list[DeviceError] = []
    for bank in banks:
        try:
            bank.set_mode(CompensationMode.OFF)
        except DeviceError as error:
            failures.append(error)
    if failures:
        raise failures[0]


def use_on_trial(banks: Sequence[TableBank], images: Sequence[bytes], timeout_s: float) -> None:
    """Write an image into each drive, activate all, use them on trial; the drives are without power.

    Raises DeviceError; compensation is then off on every drive that can be reached.
    """
    switch_off(banks)
    try:
        _activate(banks, images)
        for bank in banks:
            bank.set_trial_timeout(timeout_s)
        for bank in banks:
            bank.set_mode(CompensationMode.TRIAL)
    except BaseException:
        with suppress(DeviceError):
            switch_off(banks)
        raise


def bring_to(banks: Sequence[TableBank], images: Sequence[bytes | None], timeout_s: float, *, on: bool) -> None:
    """Have each drive's active bank hold an image (None: no bank active), and all use them for good, or none.

    What was done before is found, so this may break off anywhere and be repeated. Raises DeviceError.
    """
    present = [image for image in images if image is not None]
    if not on or len(present) < len(banks):
        switch_off(banks)
        _activate(banks, images)
        return
    if not all(bank.uses(image) for bank, image in zip(banks, present, strict=True)):
        use_on_trial(banks, present, timeout_s)
    for bank in banks:
        bank.set_mode(CompensationMode.KEPT)


def _activate(banks: Sequence[TableBank], images: Sequence[bytes | None]) -> None:
    activations = []
    for bank, image in zip(banks, images, strict=True):
        if image is None:
            activations.append(Activation(bank, 0, 0, 0))
        else:
            written = bank.load(image)
            activations.append(Activation(bank, written.bank, written.crc, written.generation))
    activate_all(activations)
