"""One drive over the in-process bus."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import pytest

from drivers.drives import objects
from drivers.drives.cia402 import State
from drivers.drives.servo_drive import Heartbeat
from drivers.errors import (
    ConnectionFailed,
    DriveFault,
    IdentityMismatch,
    MotionTimeout,
    NoAnswer,
    NotReferenced,
    SdoRefused,
    StaleData,
)
from tests.drivers.scripted_drive import Rig

_channels = itertools.count()


@pytest.fixture
def rig() -> Iterator[Rig]:
    rig = Rig(f"servo drive {next(_channels)}")
    with rig.clock.activity():
        yield rig
    rig.close()


def test_connect(rig: Rig) -> None:
    drive = rig.servos[0]
    assert drive.heartbeat() is Heartbeat.NEVER
    assert not drive.reference.is_valid
    identity = drive.connect()
    assert drive.reference.is_valid
    assert identity.serial == 7
    assert drive.limits_m == pytest.approx((-1.0, 1.0))
    assert drive.rated_torque_n_m == pytest.approx(2.0)
    assert drive.heartbeat() is Heartbeat.ALIVE
    assert rig.drives[1].integer(0x1017) == 500
    assert not any(0x1400 <= index < 0x1B00 for index, _ in rig.drives[1].writes)


@pytest.mark.parametrize("node_id", [0, 128])
def test_no_node_has_an_id_outside_1_to_127(rig: Rig, node_id: int) -> None:
    with pytest.raises(ValueError, match=rf"node id {node_id} is not in 1\.\.127"):
        rig.servo(node_id)


def test_an_absent_node_is_named(rig: Rig) -> None:
    rig.servos[1].connect()
    with pytest.raises(ConnectionFailed, match=r"node id 9 \(heartbeats seen: 2\)"):
        rig.servo(9).connect()


def test_an_absent_node_is_asked_once(rig: Rig) -> None:
    asked: list[tuple[int, int]] = []
    take = rig._take
    rig._take = lambda cob_id, data: (asked.append((cob_id, data[0])), take(cob_id, data))  # type: ignore
    with pytest.raises(ConnectionFailed):
        rig.servo(9).connect()
    assert asked.count((0x609, 0x40)) == 1


@pytest.mark.parametrize("wrong", [{"vendor": 1}, {"product": 2}, {"serial": 3}, {"metres_per_increment": 2e-8}])
def test_another_drive_or_other_units(rig: Rig, wrong: dict[str, float]) -> None:
    with pytest.raises(IdentityMismatch, match="is configured"):
        rig.servo(1, **wrong).connect()


@pytest.mark.parametrize("beyond_m", [5e-4, 2e-3])
@pytest.mark.parametrize("end", ["low", "high"])
def test_a_drive_may_stand_up_to_a_millimetre_outside_its_travel(rig: Rig, beyond_m: float, end: str) -> None:
    """By as much as it runs on when it is stopped; farther off its reference is not believed. It stands at 0."""
    drive = rig.servo(1, travel_m=(beyond_m, 0.5) if end == "low" else (-0.5, -beyond_m))
    if beyond_m < 1e-3:
        drive.connect()
    else:
        with pytest.raises(NotReferenced, match="outside its travel"):
            drive.connect()


def test_a_zero_in_the_factor_group(rig: Rig) -> None:
    rig.drives[1].objects[0x6091, 1] = bytes(4)
    with pytest.raises(IdentityMismatch, match="zero"):
        rig.servos[0].connect()


@pytest.mark.parametrize(
    ("entry", "value", "metres_per_increment"),
    [
        ((0x608F, 1), 2_000_000, 5e-9),
        ((0x608F, 2), 2, 2e-8),
        ((0x6091, 1), 2, 5e-9),
        ((0x6091, 2), 2, 2e-8),
        ((0x6092, 1), 20_000, 2e-8),
        ((0x6092, 2), 2, 5e-9),
    ],
)
def test_units_are_those_of_the_factor_group(
    rig: Rig, entry: tuple[int, int], value: int, metres_per_increment: float
) -> None:
    """Encoder resolution, gear and feed of CiA 402: each of its six numbers halves or doubles the increment."""
    rig.drives[1].objects[entry] = value.to_bytes(4, "little")
    rig.servo(1, metres_per_increment=metres_per_increment).connect()


def test_a_wrong_mapping_is_written_once(rig: Rig) -> None:
    rig.drives[1].objects[0x1A00, 2] = bytes(4)
    rig.servos[0].connect()
    assert rig.drives[1].integer(0x1A00, 2) == 0x60640020
    assert rig.drives[1].integer(0x1800, 1) & 0x800007FF == 0x181
    assert {index for index, _ in rig.drives[1].writes if index < 0x1B00} == {0x1017, 0x1800, 0x1A00}


def test_enable_and_disable(rig: Rig) -> None:
    drive = rig.servos[0]
    drive.connect()
    drive.enable()
    assert drive.state() is State.OPERATION_ENABLED
    drive.quick_stop()
    assert drive.state() is State.QUICK_STOP_ACTIVE
    drive.enable()
    drive.disable()
    assert drive.state() is State.SWITCH_ON_DISABLED


def test_a_fault_has_its_emergency_in_the_text(rig: Rig) -> None:
    drive = rig.servos[0]
    drive.connect()
    rig.drives[1].status = 0x08
    rig.emergency(1, 0x8611)
    with pytest.raises(DriveFault, match=r"0x8611 .following error"):
        drive.enable()
    drive.fault_reset()
    drive.enable()


def test_a_state_that_is_never_reached(rig: Rig) -> None:
    drive = rig.servos[0]
    drive.connect()
    rig.drives[1].status = 0x00
    rig.drives[1].control = lambda word: None  # type: ignore[method-assign]
    with pytest.raises(MotionTimeout, match="operation enabled not reached"):
        drive.enable()


def test_profile_writes_only_changes(rig: Rig) -> None:
    drive = rig.servos[0]
    drive.connect()
    rig.drives[1].writes.clear()
    drive.set_profile(0.1, 1.0)
    drive.set_profile(0.1, 1.0)
    drive.set_profile(0.2)
    assert rig.drives[1].writes == [(0x6081, 0), (0x6083, 0), (0x6084, 0), (0x6081, 0)]
    assert rig.drives[1].integer(0x6081) == 20_000_000
    with pytest.raises(ValueError, match="positive"):
        drive.set_profile(0.0)


@pytest.mark.parametrize("position_m", [float("nan"), float("inf"), 30.0])
def test_no_such_position(rig: Rig, position_m: float) -> None:
    with pytest.raises(ValueError, match="impossible position"):
        rig.servos[0].write_target(position_m)


@pytest.mark.parametrize(
    ("code", "text"), [(0x06090030, "grid"), (0x08000022, "no valid table"), (0x1234, "0x00001234")]
)
def test_refusals_are_readable(rig: Rig, code: int, text: str) -> None:
    rig.drives[1].refuse[0x607A, 0] = code
    with pytest.raises(SdoRefused, match=text) as caught:
        rig.servos[0].write_target(0.1)
    assert caught.value.abort_code == code


def test_a_write_without_answer_is_not_sent_again(rig: Rig) -> None:
    rig.drives[1].silent = True
    with pytest.raises(NoAnswer, match="target position"):
        rig.servos[0].write_target(0.1)
    rig.drives[1].silent = False
    assert rig.drives[1].writes == []
    rig.servos[0].write_target(0.2)
    assert rig.drives[1].writes == [(0x607A, 0)]


def test_an_object_that_is_too_short(rig: Rig) -> None:
    rig.drives[1].objects[0x6076, 0] = b"\1"
    with pytest.raises(Exception, match="1 bytes instead of 4"):
        rig.servos[0].sdo.read(objects.RATED_TORQUE)


def test_heartbeat_late_then_lost(rig: Rig) -> None:
    drive = rig.servos[0]
    drive.connect()
    rig.drives[1].silent = True
    rig.clock.sleep_s(1.2)
    assert drive.heartbeat() is Heartbeat.LATE
    drive.check()
    rig.clock.sleep_s(2.0)
    assert drive.heartbeat() is Heartbeat.LOST
    with pytest.raises(StaleData, match="no heartbeat for 3"):
        drive.check()


def test_a_restart_is_noticed(rig: Rig) -> None:
    drive = rig.servos[0]
    drive.connect()
    rig.heartbeat(1, 0)
    rig.clock.sleep_s(0.01)
    with pytest.raises(DriveFault, match="restarted"):
        drive.check()
    drive.connect()
    drive.check()


def test_nothing_works_on_a_closed_line(rig: Rig) -> None:
    rig.line.close()
    assert not rig.line._reader.is_alive()
    for action in (rig.servos[0].connect, rig.servos[0].quick_stop, rig.group.sample):
        with pytest.raises(ConnectionFailed, match="closed"):
            action()
