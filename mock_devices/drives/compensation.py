"""The compensation bank of a drive (objects 0x2100 to 0x2102) and what it knows of its partner.

The drive may move with compensation only while the active table is the one for the payload that is on.
"""

from __future__ import annotations

from mock_devices.can.sdo_abort import STATE_FORBIDS, VALUE_RANGE, RefusedWrite
from mock_devices.drives.table_bank import Bank, BankStatus, Table

OFF, KEPT, TRIAL = 0, 1, 2
UNKNOWN_PAYLOAD = 0xFFFFFFFF
MOST_SYNCS_WITHOUT_PARTNER = 2


class PartnerLink:
    """The partner's command: heard by RPDO2 at any time, taken over at each SYNC."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Nothing was heard yet."""
        self.command_inc: int | None = None
        self._heard_inc: int | None = None
        self._age = 0

    def hear(self, command_inc: int) -> None:
        """RPDO2 has brought a command."""
        self._heard_inc = command_inc

    def sync(self) -> None:
        """Take what was heard since the SYNC before."""
        if self._heard_inc is not None:
            self.command_inc, self._heard_inc, self._age = self._heard_inc, None, 0
        else:
            self._age += 1

    @property
    def fresh(self) -> bool:
        """Whether the command is known and not older than two SYNCs."""
        return self.command_inc is not None and self._age <= MOST_SYNCS_WITHOUT_PARTNER


class Compensation:
    """Mode, banks, active bank and payload of one drive."""

    def __init__(self, node_id: int, machine_id: bytes) -> None:
        self.banks = {1: Bank(node_id, machine_id), 2: Bank(node_id, machine_id)}
        self.partner = PartnerLink()
        self.mode = OFF
        self.trial_ms = 0
        self.active_bank = 0
        self.payload_g = UNKNOWN_PAYLOAD

    def boot(self) -> None:
        """Forget what does not outlive a restart: mode, trial, payload, partner. Banks and their choice stay."""
        self.partner.forget()
        self.mode, self.trial_ms = OFF, 0
        self.payload_g = UNKNOWN_PAYLOAD

    @property
    def table(self) -> Table | None:
        """The active table, whether mode is on or not."""
        return self.banks[self.active_bank].table if self.active_bank else None

    @property
    def table_in_use(self) -> Table | None:
        """The table that corrects commands."""
        return self.table if self.mode else None

    @property
    def valid(self) -> bool:
        """Mode on, a table active, and it is for the payload that is on."""
        table = self.table_in_use
        return table is not None and table.payload_g == self.payload_g

    def set_mode(self, mode: int, powered: bool) -> None:
        """Object 0x2100:01; a trial needs a time-out. Raises RefusedWrite."""
        if mode not in (OFF, KEPT, TRIAL):
            raise RefusedWrite(VALUE_RANGE)
        if powered or (mode == TRIAL and not self.trial_ms):
            raise RefusedWrite(STATE_FORBIDS)
        self.mode = mode

    def set_trial_ms(self, trial_ms: int) -> None:
        """Object 0x2100:0C. Raises RefusedWrite during a trial."""
        if self.mode == TRIAL:
            raise RefusedWrite(STATE_FORBIDS)
        self.trial_ms = trial_ms

    def activate(self, bank: int, powered: bool) -> None:
        """Object 0x2100:02. Raises RefusedWrite."""
        if bank not in (0, 1, 2):
            raise RefusedWrite(VALUE_RANGE)
        if powered or (bank and self.banks[bank].status is not BankStatus.WHOLE):
            raise RefusedWrite(STATE_FORBIDS)
        self.active_bank = bank

    def write_bank(self, bank: int, image: bytes) -> None:
        """Object 0x2101:01 or 0x2102:01. Raises RefusedWrite while it is in use."""
        if self.mode and bank == self.active_bank:
            raise RefusedWrite(STATE_FORBIDS)
        self.banks[bank].write(image)

    def check_target(self, target_inc: int) -> None:
        """What writing 0x607A asks while mode is on. Raises RefusedWrite."""
        if not self.mode:
            return
        table = self.table
        if table is None or not self.valid:
            raise RefusedWrite(STATE_FORBIDS)
        if not table.own.covers(target_inc):
            raise RefusedWrite(VALUE_RANGE)

    def permits_motion(self) -> bool:
        """Whether a motion may start or go on: always with mode off; else as docs/reference/drive-objects.md says."""
        if not self.mode:
            return True
        table, partner = self.table, self.partner.command_inc
        if table is None or partner is None or not self.valid or not self.partner.fresh:
            return False
        return table.partner.covers(partner)
