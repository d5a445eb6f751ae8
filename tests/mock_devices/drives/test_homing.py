"""Homing of the mock drive: what it does to its position, and that the axis itself never jumps."""

from __future__ import annotations

import canopen
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mock_devices.drives import cia402
from mock_devices.drives.compensation import Compensation
from mock_devices.drives.drive_axis import AxisLimits, DriveAxis
from mock_devices.drives.homing import INDEX_INC, Homing
from mock_devices.drives.mock_drive import DriveServer, MockAxis
from tests.mock_devices.images import MACHINE_ID, image

PLACE = 100_300_000.0
START, GO = 0x0F, 0x1F
REACHED, ATTAINED, FAILED = cia402.TARGET_REACHED, cia402.SET_POINT_ACKNOWLEDGE, cia402.FOLLOWING_ERROR


class Axis:
    """An axis with an incremental encoder, and a time that a test sets."""

    def __init__(self, *, absolute=False):
        self.t_s = 0.0
        self.emergencies = []
        self.compensation = Compensation(1, MACHINE_ID)
        limits = AxisLimits(32_000_000, 170_000_000)
        self.drive = DriveAxis(
            lambda: self.t_s, limits, self.compensation, PLACE, self.emergencies.append, absolute=absolute
        )

    def ready(self, method, offset_inc=101_000_000):
        self.drive.homing.set_method(method)
        self.drive.homing.offset_inc = offset_inc
        self.drive.set_mode(6)
        for word in (0x06, 0x07, 0x0F):
            self.drive.control(word)
        return self

    def bits(self):
        return self.drive.statusword() & (REACHED | ATTAINED | FAILED)

    @property
    def place(self):
        return self.drive.true_position_inc(self.t_s)


@pytest.fixture
def axis():
    return Axis()


def test_after_a_start_an_incremental_encoder_counts_from_zero_and_an_absolute_one_knows(axis):
    assert (axis.drive.actual_inc(), axis.place, axis.drive.homing.referenced) == (0.0, PLACE, False)
    absolute = Axis(absolute=True).drive
    absolute.boot()
    assert (absolute.actual_inc(), absolute.homing.referenced) == (PLACE, True)


@pytest.mark.parametrize(("method", "mark"), [(33, 100_000_000), (34, 101_000_000)])
def test_it_goes_to_the_next_index_and_is_at_the_home_offset_there(axis, method, mark):
    axis.ready(method)
    assert axis.bits() == REACHED
    axis.drive.control(GO)
    assert axis.bits() == 0
    axis.t_s = 1.0
    assert abs(axis.place - PLACE) == pytest.approx(200_000, rel=0.05)  # at 2 mm/s
    axis.t_s = 20.0
    assert axis.bits() == REACHED | ATTAINED
    assert axis.place == pytest.approx(mark, abs=1.0)
    assert axis.drive.actual_inc() == pytest.approx(101_000_000, abs=1.0)
    assert axis.drive.homing.referenced
    axis.drive.set_mode(1)
    axis.drive.control(START)
    axis.drive.set_target(102_000_000)
    axis.drive.control(0x3F)
    axis.t_s = 40.0
    assert axis.place - mark == pytest.approx(1_000_000, abs=1.0)


@pytest.mark.parametrize("method", [35, 37])
def test_it_takes_the_place_where_it_stands(axis, method):
    axis.ready(method, offset_inc=55)
    axis.drive.control(GO)
    assert axis.bits() == REACHED | ATTAINED
    assert (axis.drive.actual_inc(), axis.drive.demand_inc(), axis.place) == (55.0, 55.0, PLACE)


@pytest.mark.parametrize("word", [0x0F, 0x11F, 0x02, 0x00])
def test_homing_that_is_broken_off_stops_and_leaves_no_reference(axis, word):
    axis.ready(34)
    axis.drive.control(GO)
    axis.t_s = 1.0
    axis.drive.control(word)
    stands = axis.drive.true_position_inc(1.1)
    axis.t_s = 20.0
    assert axis.place == pytest.approx(stands, abs=1.0)
    assert not axis.drive.homing.referenced
    assert not axis.bits() & ATTAINED


def test_a_fault_and_a_change_of_mode_break_it_off(axis):
    for end in (lambda: axis.drive.fault(0x2310), lambda: axis.drive.set_mode(1)):
        axis.drive.control(0x80)
        axis.ready(34)
        axis.drive.control(GO)
        axis.t_s += 0.5
        end()
        axis.t_s += 20.0
        axis.drive.refresh()
        assert not axis.drive.homing.referenced
        assert not axis.drive.motion.is_moving(axis.t_s)


def test_it_is_refused_under_compensation(axis):
    axis.compensation.banks[1].write(image([[0] * 5] * 5))
    axis.compensation.activate(1, False)
    axis.compensation.set_mode(1, False)
    axis.ready(34)
    axis.drive.control(GO)
    assert axis.bits() == REACHED | FAILED
    assert not axis.drive.motion.is_moving(axis.t_s)


def test_a_restart_in_motion_is_no_jump_and_loses_the_reference(axis):
    axis.ready(37)
    axis.drive.control(GO)
    axis.drive.set_mode(1)
    axis.drive.control(START)
    axis.drive.set_target(120_000_000)
    axis.drive.control(0x3F)
    axis.t_s = 0.5
    before = axis.place
    axis.drive.boot()
    assert axis.place == pytest.approx(before, abs=1.0)
    axis.t_s = 5.0
    assert axis.place > before
    assert axis.drive.actual_inc() == pytest.approx(0.0, abs=1e-6)
    assert not axis.drive.homing.referenced


@pytest.mark.parametrize("off", [-1e-6, 0.0, 1e-6])
def test_an_axis_that_stands_on_an_index_goes_to_the_next(off):
    for method, sign in ((33, -1), (34, 1)):
        assert Homing(method=method).way_inc(3 * INDEX_INC + off) == pytest.approx(sign * INDEX_INC, abs=1e-3)


@given(place=st.floats(-1e9, 1e9), method=st.sampled_from([33, 34, 35, 37]))
def test_the_mark_is_within_a_revolution_and_on_the_right_side(place, method):
    homing = Homing()
    homing.set_method(method)
    way = homing.way_inc(place)
    assert abs(way) <= INDEX_INC + 0.5
    if method in (33, 34):
        assert way * (1 if method == 34 else -1) > 0.0
        assert (place + way) / INDEX_INC == pytest.approx(round((place + way) / INDEX_INC), abs=1e-6)


def test_over_the_bus_by_another_makes_client(bus_factory, clock):
    drive = DriveServer(
        1,
        MockAxis(
            name="left",
            partner_node_id=2,
            machine_id=MACHINE_ID,
            travel_m=(0.3, 1.7),
            start_m=1.003,
            absolute_encoder=False,
        ),
        bus_factory(),
        clock,
    )
    network = canopen.Network(bus_factory())
    network.connect()
    node = network.add_node(1, drive._node.object_dictionary)
    sdo = node.sdo
    assert [sdo[0x2103][1].raw, sdo[0x6064].raw] == [0, 0]
    with pytest.raises(canopen.SdoAbortedError):
        sdo[0x6098].raw = 17
    sdo[0x6098].raw, sdo[0x607C].raw = 34, 101_000_000
    sdo[0x6099][1].raw, sdo[0x6099][2].raw, sdo[0x609A].raw = 500_000, 100_000, 1_000_000
    sdo[0x6060].raw = 6
    assert sdo[0x6061].raw == 6
    for word in (0x06, 0x07, 0x0F, 0x1F):
        sdo[0x6040].raw = word
    assert sdo[0x6041].raw & 0x3400 == 0
    clock.sleep_s(5.0)
    assert sdo[0x6041].raw & 0x3400 == 0x1400
    assert [sdo[0x2103][1].raw, sdo[0x6064].raw, sdo[0x607A].raw] == [1, 101_000_000, 101_000_000]
    assert drive.encoder_m(clock.now_s()) == pytest.approx(1.01, abs=1e-8)
    drive.power_cycle()
    assert [sdo[0x2103][1].raw, sdo[0x6064].raw] == [0, 0]
    assert drive.encoder_m(clock.now_s()) == pytest.approx(1.01, abs=1e-8)
    network.disconnect()
    drive.close()
