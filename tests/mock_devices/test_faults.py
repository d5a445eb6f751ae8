"""Faults by name: parsing, counting, and that every one does what it says."""

from __future__ import annotations

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mock_devices.can.faulty_bus import FaultyBus
from mock_devices.faults import FAULTS, Fault, FaultPlan, parse_fault
from mock_devices.station.station_server import LineGone, StationServer
from mock_devices.stepped_clock import SteppedClock
from tests.either import either


def test_parse():
    assert parse_fault("serial-lost@17") == Fault("serial-lost", 17)
    assert str(parse_fault("can-bus-off@1")) == "can-bus-off@1"
    for wrong in ("serial-lost", "serial-lost@0", "serial-lost@-1", "nothing@1", "@", "serial-lost@x"):
        with pytest.raises(ValueError, match="fault"):
            parse_fault(wrong)


@given(st.text(max_size=60))
def test_any_text_is_a_fault_or_a_value_error(text):
    fault, complaint = either(lambda: parse_fault(text), ValueError)
    if fault is not None:
        assert fault.name in FAULTS
        assert fault.at >= 1
    else:
        assert complaint is not None
        assert "fault" in complaint


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_strikes_at_its_operation_once_or_from_then_on(name):
    plan = FaultPlan([Fault(name, 3)])
    struck = [plan.strikes(name) for _ in range(5)]
    assert struck == [False, False, True, FAULTS[name].lasting, FAULTS[name].lasting]
    assert plan.struck == (name,)
    assert plan.lasts(name) == FAULTS[name].lasting
    plan.clear()
    assert not plan.strikes(name)
    assert not plan.lasts(name)
    with pytest.raises(ValueError, match="twice"):
        FaultPlan([Fault(name, 1), Fault(name, 2)])


class Line(StationServer):
    """The common part, without a line of its own."""

    def __init__(self, plan):
        super().__init__(self, plan)

    def respond(self, line):
        return b"%%R1P,0,%s:0,0.123456789\r\n" % line

    def _close_line(self): ...

    def _serve(self): ...


def out(plan, count=2):
    line = Line(plan)
    try:
        return [b"".join(line._answers([b"%d" % n])) for n in range(count)]
    finally:
        line._thread.start()
        line.close()


GOOD = [b"%R1P,0,0:0,0.123456789\r\n", b"%R1P,0,1:0,0.123456789\r\n"]


@pytest.mark.parametrize(
    ("name", "check"),
    [
        ("serial-dropped-byte", lambda a: len(a) == len(GOOD[0]) - 1),
        ("serial-doubled-byte", lambda a: len(a) == len(GOOD[0]) + 1),
        ("serial-garbled-byte", lambda a: sum(x != y for x, y in zip(a, GOOD[0], strict=True)) == 1),
        ("serial-lost", lambda a: a == b""),
        ("serial-split", lambda a: a == GOOD[0]),
    ],
)
def test_a_spoilt_answer_is_followed_by_a_good_one(name, check):
    first, second = out(FaultPlan([Fault(name, 1)]))
    assert check(first)
    assert second == GOOD[1]
    assert out(FaultPlan([Fault(name, 1)]))[0] == first  # the same byte every time


def test_late_and_previous_answers():
    assert out(FaultPlan([Fault("serial-late", 1)])) == [b"", GOOD[0] + GOOD[1]]
    assert out(FaultPlan([Fault("serial-previous", 2)])) == [GOOD[0], GOOD[0]]


def test_a_line_that_goes():
    with pytest.raises(LineGone):
        out(FaultPlan([Fault("serial-gone", 1)]))


@pytest.fixture
def two_buses(bus_factory):
    plan = FaultPlan()
    return FaultyBus(bus_factory(), plan), bus_factory(), plan


def frame(number):
    return can.Message(arbitration_id=number, is_extended_id=False)


def test_a_lost_frame_either_way(two_buses):
    host, other, plan = two_buses
    plan.arm([Fault("can-lost-frame", 2)])
    for number in (1, 2, 3):
        host.send(frame(number))
    assert [other.recv(0.1).arbitration_id for _ in range(2)] == [1, 3]
    plan.clear()
    plan.arm([Fault("can-lost-frame", 1)])
    other.send(frame(4))
    other.send(frame(5))
    assert host.recv(0.1) is None
    assert host.recv(0.1).arbitration_id == 5
    host.shutdown()


def test_bus_off_and_a_dead_peer(two_buses):
    host, other, plan = two_buses
    plan.arm([Fault("can-peer-dead", 1)])
    host.send(frame(1))
    assert other.recv(0.0) is None
    plan.clear()
    plan.arm([Fault("can-bus-off", 2)])
    host.send(frame(1))
    with pytest.raises(can.CanOperationError, match="bus off"):
        host.send(frame(2))
    with pytest.raises(can.CanOperationError, match="bus off"):
        host.recv(0.0)
    host.shutdown()


@pytest.mark.parametrize(("name", "step_s"), [("time-step", 10.0), ("time-step-back", -10.0)])
def test_a_clock_that_jumps(clock, name, step_s):
    stepped = SteppedClock(clock, FaultPlan([Fault(name, 2)]))
    stepped.sleep_s(1.0)
    assert stepped.now_s() == clock.now_s()
    stepped.sleep_s(1.0)
    assert stepped.now_s() == clock.now_s() + step_s
    called_s = []
    stepped.call_at(stepped.now_s() + 0.5, lambda: called_s.append(clock.now_s()))
    before_s = clock.now_s()
    stepped.sleep_s(1.0)
    assert called_s == [before_s + 0.5]
