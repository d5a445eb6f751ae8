"""Cyclic synchronous position mode of the mock drive, over its bus by another make's client, and its period alone."""

from __future__ import annotations

import canopen
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mock_devices.can.sdo_abort import RefusedWrite
from mock_devices.drives.cyclic_position import CyclicPosition
from mock_devices.drives.mock_drive import DriveServer, MockAxis
from tests.mock_devices.images import MACHINE_ID

SYNC, FAULT_STATE, OPERATION_ENABLED = 0x080, 0x08, 0x27


class Master:
    """The client, with what the drive has said by EMCY."""

    def __init__(self, bus, drive):
        self.network = canopen.Network(bus)
        self.network.NOTIFIER_CYCLE = 0.05
        self.network.connect()
        self.node = self.network.add_node(canopen.RemoteNode(1, drive._node.object_dictionary))
        self.node.sdo.RESPONSE_TIMEOUT = 5.0
        self.emergencies = []
        self.network.subscribe(0x081, lambda _id, data, _t: self.emergencies.append(int.from_bytes(data[:2], "little")))

    def __getitem__(self, index):
        return self.node.sdo[index]

    def prepare(self, period_ms):
        self[0x60C2][1].raw, self[0x60C2][2].raw = period_ms, -3
        self[0x6060].raw = 8
        assert self[0x6061].raw == 8
        for word in (0x06, 0x07, 0x0F):
            self[0x6040].raw = word

    def lead(self, target):
        self[0x607A].raw = target
        self.network.send_message(SYNC, b"")

    def state(self):
        return self[0x6041].raw & 0x6F


@pytest.fixture
def drive(bus_factory, clock):
    drive = DriveServer(
        1,
        MockAxis(name="left", partner_node_id=2, machine_id=MACHINE_ID, travel_m=(-1.0, 1.0), start_m=0.0),
        bus_factory(),
        clock,
    )
    yield drive
    drive.close()


@pytest.fixture
def master(bus_factory, drive):
    master = Master(bus_factory(), drive)
    yield master
    master.network.disconnect()


def test_each_target_is_reached_one_period_after_its_sync(master, clock):
    master.prepare(10)
    with pytest.raises(canopen.SdoAbortedError):
        master[0x6060].raw = 3
    ramps = 2  # what the ends of the ramps leave, in increments
    for before, target in ((0, 10_000), (10_000, 25_000), (25_000, 20_000), (20_000, 20_000)):
        master.lead(target)
        clock.sleep_s(0.005)
        assert master[0x6062].raw == pytest.approx(0.5 * (before + target), abs=ramps)
        clock.sleep_s(0.005)
        assert master[0x6062].raw == pytest.approx(target, abs=ramps)
    assert master.emergencies == []


def test_a_target_alone_moves_nothing_before_its_sync(master, clock):
    master.prepare(10)
    master[0x607A].raw = 10_000
    clock.sleep_s(1.0)
    assert master[0x6062].raw == 0


def test_a_target_of_before_is_gone_to_at_any_sync(master, drive, clock):
    master[0x607A].raw = 10_000
    master.prepare(10)
    assert master[0x607A].raw == 10_000
    master.network.send_message(SYNC, b"")
    clock.sleep_s(0.010)
    assert drive.encoder_m(clock.now_s()) == pytest.approx(1e-4, abs=1e-5)


def test_it_says_whether_it_follows_its_targets(master):
    follows = 1 << 12
    assert not master[0x6041].raw & follows
    master.prepare(10)
    assert master[0x6041].raw & follows
    with pytest.raises(canopen.SdoAbortedError):
        master[0x607A].raw = 110_000_000
    assert not master[0x6041].raw & follows
    master[0x607A].raw = 0
    assert master[0x6041].raw & follows
    master[0x6040].raw = 0x07
    assert not master[0x6041].raw & follows


def test_a_sync_that_stays_away_in_motion_is_a_fault(master, drive, clock):
    master.prepare(10)
    master.lead(10_000)
    clock.sleep_s(0.010)
    master.lead(20_000)
    clock.sleep_s(0.029)
    assert master.state() == OPERATION_ENABLED
    clock.sleep_s(0.002)
    assert master.emergencies == [0x8700]
    clock.sleep_s(0.1)
    assert master.state() == FAULT_STATE
    stands = drive.encoder_m(clock.now_s())
    master.lead(30_000)
    clock.sleep_s(0.1)
    assert drive.encoder_m(clock.now_s()) == pytest.approx(stands, abs=1e-9)
    master[0x6040].raw = 0x00
    master[0x6040].raw = 0x80
    assert master.emergencies == [0x8700, 0]


def test_a_drive_that_stands_on_its_target_misses_no_sync(master, clock):
    master.prepare(10)
    for target in (10_000, 10_000):
        master.lead(target)
        clock.sleep_s(0.010)
    clock.sleep_s(60.0)
    assert master.state() == OPERATION_ENABLED
    master.lead(20_000)
    master[0x6040].raw = 0x07  # without power it waits for nothing
    clock.sleep_s(60.0)
    assert master.emergencies == []


def test_a_step_that_the_motor_cannot_make_is_a_following_error(master, drive, clock):
    master.prepare(10)
    master.lead(3_000_000)  # 30 mm in 10 ms
    clock.sleep_s(0.1)
    assert master.emergencies == [0x8611]
    assert master.state() == FAULT_STATE
    assert master[0x6041].raw & 0x2000
    assert drive.encoder_m(clock.now_s()) == pytest.approx(0.0, abs=1e-8)


def test_a_lag_beyond_the_window_is_a_following_error(master, clock):
    master[0x6065].raw = 100
    master.prepare(10)
    for target in (100_000, 200_000, 300_000):
        master.lead(target)
        clock.sleep_s(0.010)
    assert master.emergencies == [0x8611]
    assert master.state() in (FAULT_STATE, 0x0F)


@given(units=st.integers(-10, 300), exponent=st.integers(-128, 127))
def test_a_period_is_taken_whole_or_refused(units, exponent):
    cyclic = CyclicPosition()
    before = (cyclic.units, cyclic.exponent)
    try:
        cyclic.set_units(units)
        cyclic.set_exponent(exponent)
    except RefusedWrite:
        assert not (1 <= units <= 255 and -6 <= exponent <= 0)
        assert cyclic.units in (before[0], units)
        assert cyclic.exponent == before[1]
    else:
        assert cyclic.period_s == pytest.approx(units * 10.0**exponent)
