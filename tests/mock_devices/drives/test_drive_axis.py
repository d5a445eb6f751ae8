"""The drive without its bus: handshake, stops, compensation, and times in the past."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mock_devices.can.sdo_abort import STATE_FORBIDS, VALUE_RANGE, RefusedWrite
from mock_devices.drives import cia402
from mock_devices.drives.cia402 import State
from mock_devices.drives.compensation import Compensation
from mock_devices.drives.drive_axis import AxisLimits, DriveAxis
from tests.mock_devices.images import MACHINE_ID, image

START = 100_000_000


class Axis:
    """An axis with a time that a test sets."""

    def __init__(self):
        self.t_s = 0.0
        self.emergencies = []
        self.compensation = Compensation(1, MACHINE_ID)
        limits = AxisLimits(32_000_000, 170_000_000)
        self.axis = DriveAxis(lambda: self.t_s, limits, self.compensation, START, self.emergencies.append)

    def enable(self):
        for word in (0x06, 0x07, 0x0F):
            self.axis.control(word)
        return self

    def go(self, target, bits=0x30):
        self.axis.set_target(target)
        self.axis.control(0x0F | bits)
        self.axis.control(0x0F)

    def status(self, bit):
        return bool(self.axis.statusword() & bit)

    def load(self, corrections, payload_g=0, sides=None):
        self.compensation.banks[1].write(image(corrections, payload_g=payload_g, sides=sides))
        self.compensation.activate(1, self.axis.powered)
        self.compensation.set_mode(1, self.axis.powered)
        self.compensation.payload_g = payload_g

    def partner(self, command):
        self.compensation.partner.hear(command)
        self.axis.sync()


@pytest.fixture
def axis():
    return Axis()


def test_a_set_point_is_followed_and_reached_after_the_window(axis):
    axis.enable().go(120_000_000)
    assert axis.axis.motion.is_moving(0.0)
    assert not axis.status(cia402.TARGET_REACHED)
    end_s = axis.axis.motion.end_s
    axis.t_s = end_s + 0.049
    assert not axis.status(cia402.TARGET_REACHED)
    axis.t_s = end_s + 0.051
    assert axis.status(cia402.TARGET_REACHED)
    axis.t_s = end_s + 0.2
    assert axis.axis.actual_inc() == pytest.approx(120_000_000, abs=1e-3)
    assert axis.axis.encoder_inc(axis.t_s) == pytest.approx(120_000_000, abs=1e-3)


def test_the_handshake_is_bit_4_against_bit_12(axis):
    axis.enable()
    axis.axis.set_target(110_000_000)
    axis.axis.control(0x1F)
    assert axis.status(cia402.SET_POINT_ACKNOWLEDGE)
    axis.axis.control(0x1F)  # no edge, no second set-point
    assert axis.axis.motion.set_point(0.0).count == 1
    axis.axis.control(0x0F)
    assert not axis.status(cia402.SET_POINT_ACKNOWLEDGE)


def test_a_second_set_point_waits_for_the_first_and_a_third_is_not_taken(axis):
    axis.enable().go(110_000_000, bits=0x10)
    first_end_s = axis.axis.motion.end_s
    axis.go(105_000_000, bits=0x10)
    assert axis.status(cia402.SET_POINT_ACKNOWLEDGE)  # the buffer is full
    axis.go(101_000_000, bits=0x10)
    assert axis.axis.motion.set_point(first_end_s - 1e-6).target_inc == 110_000_000
    assert axis.axis.motion.command(first_end_s)[0] == pytest.approx(110_000_000)
    axis.t_s = axis.axis.motion.end_s + 1.0
    assert axis.axis.actual_inc() == pytest.approx(105_000_000)
    assert not axis.status(cia402.SET_POINT_ACKNOWLEDGE)


def test_a_set_point_changes_the_motion_at_once_without_a_jump(axis):
    axis.enable().go(150_000_000)
    axis.t_s = 0.8
    before = axis.axis.motion.command(0.8)
    axis.go(90_000_000)
    after = axis.axis.motion.command(0.8)
    assert after[:2] == pytest.approx(before[:2])
    assert axis.axis.motion.command(0.5)[0] < before[0]  # the past is still known
    axis.t_s = axis.axis.motion.end_s + 1.0
    assert axis.axis.actual_inc() == pytest.approx(90_000_000)


def test_without_power_nothing_moves_and_the_demand_follows_the_axis(axis):
    axis.go(120_000_000)
    assert axis.axis.motion.set_point(0.0).count == 0
    assert axis.axis.demand_inc() == START
    axis.enable()
    assert axis.axis.encoder_inc(0.0) == START


def test_quick_stop_stops_on_its_ramp_and_enabling_again_goes_on_from_there(axis):
    axis.enable().go(150_000_000)
    axis.t_s = 1.0
    v = axis.axis.motion.command(1.0)[1]
    axis.axis.control(0x0B)
    assert axis.axis.state is State.QUICK_STOP_ACTIVE
    assert axis.axis.motion.end_s == pytest.approx(1.0 + v / 500_000_000)
    axis.t_s = 2.0
    assert axis.axis.motion.command(2.0)[1] == 0.0
    axis.axis.control(0x0F)
    assert axis.axis.state is State.OPERATION_ENABLED


def test_halt_stops_and_refuses_set_points_until_it_is_released(axis):
    axis.enable().go(150_000_000)
    axis.t_s = 1.0
    axis.axis.control(0x10F)
    axis.axis.control(0x11F)
    axis.t_s = 3.0
    assert axis.axis.motion.set_point(3.0).count == 1
    stopped = axis.axis.actual_inc()
    assert START < stopped < 150_000_000
    axis.axis.control(0x0F)
    axis.go(START)
    assert axis.axis.motion.set_point(3.0).count == 2


def test_switching_off_in_motion_brakes_and_holds(axis):
    axis.enable().go(150_000_000)
    axis.t_s = 1.0
    axis.axis.control(0x00)
    assert axis.axis.state is State.SWITCH_ON_DISABLED
    axis.t_s = 2.0
    held = axis.axis.encoder_inc(2.0)
    assert axis.axis.encoder_inc(20.0) == held
    assert held == pytest.approx(axis.axis.motion.command(2.0)[0])


def test_a_fault_brakes_first_and_is_reset_by_an_edge(axis):
    axis.enable().go(150_000_000)
    axis.t_s = 1.0
    axis.axis.fault(0x8611)
    assert axis.axis.state is State.FAULT_REACTION_ACTIVE
    axis.t_s = 2.0
    assert axis.status(0x08)
    assert axis.axis.state is State.FAULT
    assert axis.axis.error_code == 0x8611
    axis.axis.control(0x80)
    assert axis.axis.state is State.SWITCH_ON_DISABLED
    assert axis.emergencies == [0x8611, 0]


def test_targets_outside_the_travel_are_refused(axis):
    for target in (31_999_999, 170_000_001):
        with pytest.raises(RefusedWrite) as refusal:
            axis.axis.set_target(target)
        assert refusal.value.abort_code == VALUE_RANGE


def test_compensation_adds_the_table_to_the_command_all_the_way(axis):
    corrections = np.add.outer(1000 * np.arange(17), 300 * np.arange(17))
    axis.load(corrections)
    axis.partner(60_000_000)
    axis.enable()
    table = axis.compensation.table
    assert axis.axis.encoder_inc(0.0) == pytest.approx(START)  # no jump when it takes over
    axis.go(130_000_000)
    for t_s in np.linspace(0.0, axis.axis.motion.end_s + 0.5, 50):
        command, _, _ = axis.axis.motion.command(t_s)
        expected = command + table.correction_inc(command, 60_000_000) - axis.axis.motion.following_error(t_s)
        assert axis.axis.encoder_inc(t_s) == pytest.approx(expected)
    axis.t_s = axis.axis.motion.end_s + 1.0
    assert axis.axis.actual_inc() == pytest.approx(130_000_000)
    axis.axis.control(0x00)  # under the brake the command coordinate stays
    assert axis.axis.actual_inc() == pytest.approx(130_000_000, abs=1e-3)


def test_a_table_by_direction_adds_what_the_last_motion_asks_for(axis):
    corrections = np.add.outer(1000 * np.arange(17), 300 * np.arange(17))
    axis.load(corrections, sides=(2000, -1200))
    axis.partner(60_000_000)
    axis.enable()
    grid = axis.compensation.table.correction_inc  # without a direction the mean of both is in it

    def stands_at(target):
        axis.go(target)
        axis.t_s = axis.axis.motion.end_s + 1.0
        return axis.axis.encoder_inc(axis.t_s) - target - (grid(target, 60_000_000) - 400.0)

    assert axis.axis.encoder_inc(0.0) == pytest.approx(START)  # no jump when it takes over
    assert stands_at(110_000_000) == pytest.approx(2000.0)
    assert stands_at(120_000_000) == pytest.approx(2000.0)
    assert stands_at(119_999_950) == pytest.approx(2000.0)  # a rounding, no reversal
    assert stands_at(115_000_000) == pytest.approx(-1200.0)
    encoder = axis.axis.encoder_inc(axis.t_s)
    axis.axis.control(0x00)  # the brake, and power again: the direction is not forgotten
    axis.t_s += 1.0
    assert axis.axis.actual_inc() == pytest.approx(115_000_000, abs=1e-3)
    axis.enable()
    assert axis.axis.encoder_inc(axis.t_s) == pytest.approx(encoder)
    assert axis.axis.demand_inc() == pytest.approx(115_000_000, abs=1e-3)
    assert stands_at(115_000_000 - 120) == pytest.approx(-1200.0)
    assert stands_at(116_000_000) == pytest.approx(2000.0)


def test_small_steps_back_add_up_to_a_reversal(axis):
    axis.load(np.zeros((17, 17)), sides=(2000, -2000))
    axis.partner(60_000_000)
    axis.enable().go(110_000_000)
    for target in range(109_999_960, 109_999_800, -40):
        axis.t_s = axis.axis.motion.end_s + 1.0
        axis.go(target)
        expected = 2000.0 if 110_000_000 - target < 100 else -2000.0
        assert axis.axis.encoder_inc(axis.axis.motion.end_s + 1.0) - target == pytest.approx(expected)


def test_a_table_for_another_payload_refuses_targets_and_set_points(axis):
    axis.load(np.zeros((17, 17)))
    axis.partner(60_000_000)
    axis.enable().go(110_000_000)
    axis.compensation.payload_g = 200_000
    axis.axis.watch_motion()
    assert axis.axis.state is State.QUICK_STOP_ACTIVE
    assert axis.emergencies == [0xFF10]
    with pytest.raises(RefusedWrite) as refusal:
        axis.axis.set_target(110_000_000)
    assert refusal.value.abort_code == STATE_FORBIDS


def test_targets_outside_the_grid_are_refused_while_mode_is_on(axis):
    axis.load(np.zeros((5, 17)))
    with pytest.raises(RefusedWrite) as refusal:
        axis.axis.set_target(32_000_000 + 4 * 8_625_000 + 1)
    assert refusal.value.abort_code == VALUE_RANGE


@pytest.mark.parametrize("case", ["unknown", "stale", "outside"])
def test_an_unfit_partner_stops_set_points(axis, case):
    axis.load(np.zeros((17, 17)))
    if case == "outside":
        axis.partner(31_000_000)
    if case == "stale":
        axis.partner(60_000_000)
        for _ in range(3):
            axis.axis.sync()
    axis.enable().go(110_000_000)
    assert axis.axis.motion.set_point(0.0).count == 0
    assert axis.emergencies == [0xFF10]
    axis.partner(60_000_000)
    axis.go(110_000_000)
    assert axis.axis.motion.set_point(0.0).count == 1
    assert axis.emergencies == [0xFF10, 0]


def test_a_partner_that_falls_silent_in_motion_brings_a_quick_stop_at_the_third_sync(axis):
    axis.load(np.zeros((17, 17)))
    axis.partner(60_000_000)
    axis.enable().go(150_000_000)
    axis.t_s = 0.5
    states = []
    for _ in range(3):
        axis.axis.sync()
        states.append(axis.axis.state)
    assert states == [State.OPERATION_ENABLED, State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE]


def test_what_the_bank_refuses_and_when(axis):
    comp = axis.compensation
    with pytest.raises(RefusedWrite):
        comp.activate(1, powered=False)  # empty
    comp.banks[1].write(image(np.zeros((3, 3))))
    for call in (lambda: comp.activate(1, True), lambda: comp.set_mode(1, True)):
        with pytest.raises(RefusedWrite):
            call()
    comp.activate(1, powered=False)
    comp.set_mode(1, powered=False)
    assert not comp.valid  # payload unknown
    comp.payload_g = 0
    assert comp.valid
    with pytest.raises(RefusedWrite):
        comp.write_bank(1, b"")
    comp.write_bank(2, b"")
    comp.boot()
    assert (comp.mode, comp.payload_g, comp.active_bank) == (0, 0xFFFFFFFF, 1)
    for value in (3, 255):
        with pytest.raises(RefusedWrite):
            comp.activate(value, powered=False)
        with pytest.raises(RefusedWrite):
            comp.set_mode(value, powered=False)


@settings(max_examples=100)
@example([(208, 32_000_000, 1.0), (2, 32_000_000, 0.0625), (0, 32_000_000, 0.0)])
@given(
    st.lists(st.tuples(st.integers(0, 0x1FF), st.integers(32_000_000, 170_000_000), st.floats(0.0, 2.0)), max_size=12)
)
def test_whatever_the_master_does_the_encoder_never_jumps(steps):
    axis = Axis()
    axis.enable()
    fastest = 20_000_000.0
    for word, target, wait_s in steps:
        before = axis.axis.encoder_inc(axis.t_s)
        axis.axis.set_target(target)
        axis.axis.control(word)
        assert axis.axis.encoder_inc(axis.t_s) == pytest.approx(before, abs=1.0)
        start_s, axis.t_s = axis.t_s, axis.t_s + wait_s
        path = [axis.axis.encoder_inc(t) for t in np.linspace(start_s, axis.t_s, 40)]
        assert np.abs(np.diff(path)).max() <= 1.1 * fastest * wait_s / 39 + 1.0
