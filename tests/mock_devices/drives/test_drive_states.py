"""The drive under any order of events: controlwords, targets, tables, payloads, faults, restarts, a lost master."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from mock_devices.can.sdo_abort import RefusedWrite
from mock_devices.drives import cia402
from mock_devices.drives.cia402 import State
from mock_devices.drives.compensation import Compensation
from mock_devices.drives.drive_axis import AxisLimits, DriveAxis
from mock_devices.drives.table_bank import BankStatus
from tests.mock_devices.images import MACHINE_ID, image

LOW, HIGH = -100_000_000, 100_000_000
LONGEST_STOP_S = 0.041  # from the profile velocity on the quick stop ramp
GRID = (LOW, 50_000_000)
WORDS = st.one_of(
    st.sampled_from([0x00, 0x02, 0x06, 0x07, 0x0F, 0x1F, 0x3F, 0x7F, 0x80, 0x10F]), st.integers(0, 0xFFFF)
)


class DriveEvents(RuleBasedStateMachine):
    """Time passes between events as the machine likes; what was refused must have changed nothing."""

    @initialize(absolute=st.booleans())
    def start(self, absolute):
        self.t_s = 0.0
        self.emergencies = []
        self.compensation = Compensation(1, MACHINE_ID)
        limits = AxisLimits(LOW, HIGH)
        self.axis = DriveAxis(
            lambda: self.t_s, limits, self.compensation, 0.0, self.emergencies.append, absolute=absolute
        )
        self.applied = None
        self.was_powered = False
        self.cyclic = False  # targets come as steep as the machine likes then, and so may stops

    @rule(word=WORDS)
    def control(self, word):
        self.axis.control(word)

    @rule()
    def enable(self):
        self.wait(1.0)
        for word in (0x00, 0x80, 0x06, 0x07, 0x0F):
            self.axis.control(word)

    @rule(word=st.sampled_from([0x00, 0x06, 0x07]))
    def take_power(self, word):
        self.axis.control(word)

    @rule(position=st.integers(LOW, HIGH))
    def go(self, position):
        self.set_target(position)
        for word in (0x1F, 0x0F):
            self.axis.control(word)

    @rule(position=st.integers(2 * LOW, 2 * HIGH))
    def set_target(self, position):
        before = self.axis.target_inc
        try:
            self.axis.set_target(position)
        except RefusedWrite:
            assert self.axis.target_inc == before
        else:
            assert LOW <= position <= HIGH

    @rule(bank=st.integers(1, 2), payload_g=st.sampled_from([0, 200_000]), whole=st.booleans())
    def write_bank(self, bank, payload_g, whole):
        before = self.compensation.banks[bank].image
        data = image([[5000] * 5] * 5, payload_g=payload_g, own=GRID, partner=GRID)
        try:
            self.compensation.write_bank(bank, data if whole else data[:-1])
        except RefusedWrite:
            assert self.compensation.banks[bank].image == before
            assert bank == self.compensation.active_bank
        else:
            assert not (self.compensation.mode and bank == self.compensation.active_bank)

    @rule(bank=st.integers(1, 2))
    def compensate(self, bank):
        """What a master does, as far as the drive lets it."""
        self.axis.control(0x00)
        self.mode(0)
        self.write_bank(bank, 0, True)
        self.activate(bank)
        self.mode(1)
        self.payload(0)

    @rule(bank=st.integers(0, 3))
    def activate(self, bank):
        before = self.compensation.active_bank
        try:
            self.compensation.activate(bank, self.axis.powered)
        except RefusedWrite:
            assert self.compensation.active_bank == before
        else:
            assert not self.axis.powered

    @rule(mode=st.integers(0, 2))
    def mode(self, mode):
        before = self.compensation.mode
        try:
            self.compensation.set_mode(mode, self.axis.powered)
        except RefusedWrite:
            assert self.compensation.mode == before
        else:
            assert not self.axis.powered

    @rule(payload_g=st.sampled_from([0, 200_000, 0xFFFFFFFF]))
    def payload(self, payload_g):
        self.compensation.payload_g = payload_g
        self.axis.watch_motion()

    @rule(partner=st.one_of(st.none(), st.integers(LOW, HIGH)))
    def sync(self, partner):
        if partner is not None:
            self.compensation.partner.hear(partner)
        self.axis.sync()

    @rule(mode=st.sampled_from([1, 6, 8, 3]))
    def operation_mode(self, mode):
        before = self.axis.mode
        try:
            self.axis.set_mode(mode)
        except RefusedWrite:
            assert self.axis.mode == before
        self.cyclic = self.cyclic or self.axis.mode == 8

    @rule(method=st.sampled_from([33, 34, 35, 37]), offset=st.integers(LOW, HIGH))
    def home(self, method, offset):
        self.axis.homing.set_method(method)
        self.axis.homing.offset_inc = offset
        before = self.axis.true_position_inc(self.t_s)
        self.axis.set_mode(6)
        for word in (0x1F, 0x0F, 0x1F):
            self.axis.control(word)
        assert abs(self.axis.true_position_inc(self.t_s) - before) <= 1.0

    @rule()
    def fault(self):
        self.axis.fault(0x2310)
        assert self.axis.state in (State.FAULT, State.FAULT_REACTION_ACTIVE)

    @rule(option=st.integers(0, 3))
    def master_lost(self, option):
        self.axis.abort_connection_option = option
        self.axis.abort_connection()
        if option:
            assert self.axis.state is not State.OPERATION_ENABLED

    @rule()
    def master_back(self):
        self.axis.connection_is_back()

    @rule()
    def restart(self):
        before = self.axis.true_position_inc(self.t_s)
        self.axis.boot()
        assert self.compensation.mode == 0
        assert abs(self.axis.true_position_inc(self.t_s) - before) <= 1.0
        assert self.axis.absolute or not self.axis.homing.referenced

    @rule(duration_s=st.floats(0.0, 20.0))
    def wait(self, duration_s):
        self.t_s += duration_s

    @invariant()
    def a_mode_has_a_whole_table_or_permits_no_motion(self):
        active = self.compensation.active_bank
        if self.compensation.mode and (not active or self.compensation.banks[active].status is not BankStatus.WHOLE):
            assert not self.compensation.permits_motion()

    @invariant()
    def the_applied_table_never_changes_under_power(self):
        powered, applied = self.axis.powered, self.compensation.table_in_use
        if powered and self.was_powered:
            assert applied is self.applied
        self.was_powered, self.applied = powered, applied

    @invariant()
    def nothing_goes_on_without_power(self):
        if not self.axis.powered and not self.cyclic:
            assert self.axis.motion.end_s <= self.t_s + LONGEST_STOP_S

    @invariant()
    def the_statusword_tells_the_state(self):
        word = self.axis.statusword()
        assert word & cia402.STATE_MASK & ~0x20 == self.axis.state.value & ~0x20

    @invariant()
    def homing_is_under_way_or_done_but_not_both(self):
        homing = self.axis.homing
        assert homing.begun_s is None or not (homing.referenced or homing.attained or homing.failed)
        assert homing.referenced or not homing.attained

    @invariant()
    def an_error_was_said(self):
        if self.axis.error_code:
            assert self.axis.error_code in self.emergencies


TestDriveEvents = DriveEvents.TestCase
TestDriveEvents.settings = settings(max_examples=100, stateful_step_count=40, deadline=None, derandomize=True)
