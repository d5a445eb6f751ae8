"""Two drives moved, sampled and stopped together."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Iterator

import pytest

from drivers.drives.cia402 import NEW_SET_POINT, QUICK_STOP, State
from drivers.errors import DriveFault, MotionTimeout, NoAnswer, SdoRefused, Stopped
from tests.drivers.scripted_drive import Rig

_channels = itertools.count()


@pytest.fixture
def rig() -> Iterator[Rig]:
    rig = Rig(f"drive group {next(_channels)}")
    with rig.clock.activity():
        rig.connect()
        rig.group.enable()
        yield rig
    rig.close()


def test_move(rig: Rig) -> None:
    samples = rig.group.move_to([0.1, -0.2], 0.1, 1.0)
    assert [s.position_m for s in samples] == pytest.approx([0.1, -0.2])
    assert samples[0].torque_fraction == pytest.approx(-0.25)
    assert samples[0].state is State.OPERATION_ENABLED
    assert rig.clock.now_s() >= 0.2
    again = rig.group.move_to([0.2, -0.1], 0.1)
    assert [s.position_m for s in again] == pytest.approx([0.2, -0.1])


def test_as_many_positions_as_drives_are_needed(rig: Rig) -> None:
    for drive in rig.drives.values():
        drive.writes.clear()
        drive.controlwords.clear()
    with pytest.raises(ValueError, match="2 drives, 1 positions"):
        rig.group.move_to([0.1], 0.1)
    assert not any(drive.writes or drive.controlwords for drive in rig.drives.values())
    rig.group.move_to([0.1, -0.2], 0.1)


def test_a_bit_left_from_the_move_before_is_not_believed(rig: Rig) -> None:
    rig.group.move_to([0.1, 0.1], 0.1)
    rig.drives[1].stuck = True
    rig.drives[1].steps_to_go = 0
    with pytest.raises(MotionTimeout, match=r"drive 1.*not at rest"):
        rig.group.move_to([0.2, 0.2], 0.1, limit_s=1.0)
    rig.clock.sleep_s(0.001)  # frames in flight arrive before time goes on
    assert rig.drives[1].controlwords[-1] == rig.drives[2].controlwords[-1] == QUICK_STOP
    assert rig.group.stop_reason is not None


def test_one_refusal_and_none_starts(rig: Rig) -> None:
    rig.group.move_to([0.1, 0.1], 0.1)
    rig.drives[2].refuse[0x607A, 0] = 0x06090030
    for drive in rig.drives.values():
        drive.controlwords.clear()
    with pytest.raises(SdoRefused, match="drive 2"):
        rig.group.move_to([0.3, 9.0], 0.1)
    assert rig.drives[1].integer(0x607A) == 10_000_000  # put back
    assert all(NEW_SET_POINT not in drive.controlwords for drive in rig.drives.values())
    assert rig.group.stop_reason is None


def test_a_set_point_that_is_not_acknowledged(rig: Rig) -> None:
    rig.drives[2].acknowledge = False
    rig.emergency(2, 0xFF10)
    with pytest.raises(MotionTimeout, match=r"drive 2.*not acknowledged.*0xFF10"):
        rig.group.move_to([0.1, 0.1], 0.1)
    rig.clock.sleep_s(0.001)  # frames in flight arrive before time goes on
    assert rig.drives[1].controlwords[-1] == QUICK_STOP


def test_a_fault_of_one_stops_all(rig: Rig) -> None:
    rig.drives[2].stuck = True

    def fail() -> None:
        rig.drives[2].status = 0x08

    rig.clock.call_at(rig.clock.now_s() + 0.5, fail)
    with pytest.raises(DriveFault, match="drive 2"):
        rig.group.move_to([0.1, 0.1], 0.1)
    rig.clock.sleep_s(0.001)  # frames in flight arrive before time goes on
    assert rig.drives[1].controlwords[-1] == QUICK_STOP
    with pytest.raises(Stopped, match="in fault"):
        rig.group.move_to([0.1, 0.1], 0.1)
    rig.group.clear_stop()
    rig.drives[2].stuck = False
    rig.group.fault_reset()
    rig.group.enable()
    rig.group.move_to([0.1, 0.1], 0.1)


def test_stop_from_another_thread(rig: Rig) -> None:
    rig.drives[1].stuck = True
    rig.clock.call_at(rig.clock.now_s() + 0.5, lambda: rig.group.stop_all("guard open"))
    with pytest.raises(Stopped, match="guard open"):
        rig.group.move_to([0.1, 0.1], 0.1)
    with pytest.raises(Stopped, match="guard open"):
        rig.group.enable()
    rig.group.clear_stop()
    rig.group.enable()
    rig.drives[1].stuck = False
    rig.group.move_to([0.1, 0.1], 0.1)


def test_stopping_waits_for_no_transfer(rig: Rig) -> None:
    servo = rig.servos[0]
    with servo.sdo._lock:  # a transfer under way
        rig.group.stop_all("now")
    servo.state()
    rig.clock.sleep_s(0.001)  # frames in flight arrive before time goes on
    assert rig.drives[1].controlwords[-1] == QUICK_STOP


def test_a_drive_that_is_not_enabled(rig: Rig) -> None:
    rig.group.disable()
    with pytest.raises(DriveFault, match="not enabled but in switch on disabled"):
        rig.group.move_to([0.1, 0.1], 0.1)


def test_a_drive_that_cannot_be_disabled_is_named_and_the_other_is_without_power(rig: Rig) -> None:
    rig.drives[1].control = lambda word: None  # type: ignore[method-assign]
    with pytest.raises(MotionTimeout, match="drive 1"):
        rig.group.disable()
    assert rig.servos[1].state() is State.SWITCH_ON_DISABLED


def test_enabling_fails_together(rig: Rig) -> None:
    rig.group.disable()
    rig.drives[2].status = 0x08
    with pytest.raises(DriveFault, match="drive 2"):
        rig.group.enable()
    assert rig.servos[0].state() is State.SWITCH_ON_DISABLED


def test_a_silent_drive_is_named(rig: Rig) -> None:
    rig.drives[2].silent_pdo = True
    with pytest.raises(NoAnswer, match=r"drive 2.*no PDO after SYNC, heartbeat alive"):
        rig.group.sample()
    rig.drives[2].silent_pdo = False
    assert len(rig.group.sample()) == 2


def test_samples_from_two_threads(rig: Rig) -> None:
    failures: list[Exception] = []

    def watch() -> None:
        try:
            for _ in range(50):
                rig.group.sample()
        except Exception as error:
            failures.append(error)

    other = threading.Thread(target=watch)
    other.start()
    for _ in range(50):
        assert rig.group.sample()[0].position_m == 0.0
    other.join(10.0)
    assert failures == []


@pytest.mark.parametrize("positions", [[0.1], [float("nan"), 0.1]])
def test_bad_positions(rig: Rig, positions: list[float]) -> None:
    with pytest.raises(ValueError, match="position"):
        rig.group.move_to(positions, 0.1)
    assert all((0x607A, 0) not in drive.writes for drive in rig.drives.values())


def test_a_move_by_the_frame(rig: Rig) -> None:
    """What the two drives hear, without the SYNCs and the answers: targets by SDO, bit 4 up and down on both."""
    for drive in rig.drives.values():
        drive.controlwords.clear()
        drive.writes.clear()
    rig.group.move_to([0.1, -0.2], 0.1, 1.0)
    for drive in rig.drives.values():
        assert drive.writes == [(0x6081, 0), (0x6083, 0), (0x6084, 0), (0x607A, 0)]
        assert drive.controlwords == [0x001F, 0x000F]
    assert rig.drives[1].integer(0x607A) == 10_000_000
    assert rig.drives[2].integer(0x607A) == -20_000_000
