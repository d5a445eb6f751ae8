"""Drives that watch their master, lose frames, restart or lose their reference: our drivers and the mock drives."""

from __future__ import annotations

import contextlib
import itertools

import pytest

from drivers.can.drive_object import DriveObject
from drivers.drives.cia402 import State
from drivers.drives.drive_profile import load_profile
from drivers.drives.servo_drive import DriveExpectation, ServoDrive
from drivers.drives.table_bank import TableBank
from drivers.errors import DriveFault, IdentityMismatch, NoAnswer, NotReferenced, ProtocolError, SdoRefused, TableError
from mock_devices.faults import Fault, FaultPlan
from tests.drivers.drive_bench import Open

HISTORY = DriveObject(0x1003, 1, "<I", "latest error")
ACTIVATE = DriveObject(0x2100, 2, "<B", "activate", reads_back=False)


def test_drives_stop_by_themselves_when_the_master_is_gone(opened: Open) -> None:
    bench = opened()
    bench.group.enable()
    died_s: list[float] = []

    def die() -> None:
        bench.beating = False
        bench.bus.loses = lambda _frame: True
        died_s.append(bench.clock.now_s())

    bench.clock.call_at(bench.clock.now_s() + 1.0, die)
    with pytest.raises(NoAnswer):
        bench.group.move_to([0.4, 0.4], 0.1)
    bench.clock.sleep_s(3.0)
    stands_m = [server.encoder_m(bench.clock.now_s()) for server in bench.servers]
    assert all(position < 0.1 * (1.0 + 0.25 + 1.5 + 0.3) for position in stands_m)
    assert all(server.axis.state.name == "QUICK_STOP_ACTIVE" for server in bench.servers)
    assert all(server.axis.error_code == 0x8130 for server in bench.servers)
    bench.bus.loses = lambda _frame: False
    bench.beating = True
    bench.beat()
    bench.clock.sleep_s(0.1)
    assert all(server.axis.error_code == 0 for server in bench.servers)
    assert bench.drives[0].sdo.read(HISTORY) == 0x8130
    bench.group.clear_stop()
    bench.group.enable()
    bench.group.move_to([0.0, 0.0], 0.1)


def test_a_beating_master_is_never_missed_and_leaving_is_no_alarm(opened: Open) -> None:
    bench = opened()
    bench.clock.sleep_s(600.0)
    for drive in bench.drives:
        drive.stop_master_watchdog()
    bench.beating = False
    bench.clock.sleep_s(60.0)
    assert all(not drive.emergencies for drive in bench.drives)


@pytest.mark.parametrize(("option", "state"), [(0, "OPERATION_ENABLED"), (1, "FAULT"), (2, "SWITCH_ON_DISABLED")])
def test_other_reactions_to_a_lost_master(opened: Open, option: int, state: str) -> None:
    bench = opened()
    bench.group.enable()
    bench.drives[0].sdo.write(DriveObject(0x6007, 0, "<h", "option"), option)
    bench.beating = False
    bench.clock.sleep_s(3.0)
    bench.servers[0].axis.refresh()
    assert bench.servers[0].axis.state.name == state


def test_one_fault_stops_the_other_at_once(opened: Open) -> None:
    bench = opened()
    bench.group.enable()
    struck_s = bench.clock.now_s() + 1.013
    bench.clock.call_at(struck_s, bench.servers[1].inject_fault)
    with pytest.raises(DriveFault, match="0x2310"):
        bench.group.move_to([0.4, 0.4], 0.1)
    stop_s = 0.1 / 5.0  # from 0.1 m/s at the quick stop's 5 m/s^2
    assert bench.servers[0].axis.motion.end_s - struck_s <= stop_s + 1e-3


@pytest.mark.parametrize("number", range(1, 26))
def test_a_lost_frame_in_a_write_is_not_written_twice(opened: Open, number: int) -> None:
    bench = opened(blocks=bool(number % 2))
    image = DriveObject(0x2101, 1, "", "image")
    count = itertools.count(1)
    bench.bus.loses = lambda frame: frame.arbitration_id == 0x601 and next(count) == number
    writes: list[int] = []
    store = bench.servers[0].compensation.write_bank
    bench.servers[0].compensation.write_bank = (  # type: ignore[method-assign]
        lambda bank, data: (writes.append(bank), store(bank, data))[1]
    )
    data = bytes(range(100))
    bench.drives[0].sdo.write_bytes(image, data)
    assert bench.drives[0].sdo.read_bytes(image) == data
    assert writes == [1]


def test_a_write_whose_answer_is_lost_is_read_back_and_not_written_twice(opened: Open) -> None:
    bench = opened()
    count = itertools.count(1)
    bench.bus.misses = lambda frame: frame.arbitration_id == 0x581 and next(count) == 1
    speed = DriveObject(0x6081, 0, "<I", "speed")
    bench.drives[0].sdo.write(speed, 4711)
    assert bench.drives[0].sdo.read(speed) == 4711
    written = [f for f in bench.bus.sent if f.arbitration_id == 0x601 and bytes(f.data[:4]) == b"\x23\x81\x60\x00"]
    assert len(written) == 1


def test_what_cannot_be_read_back_is_not_written_again(opened: Open) -> None:
    bench = opened()
    count = itertools.count(1)
    bench.bus.loses = lambda frame: frame.arbitration_id == 0x601 and next(count) == 1
    with pytest.raises(NoAnswer):
        bench.drives[0].sdo.write(ACTIVATE, 0)
    assert sum(f.arbitration_id == 0x601 and bytes(f.data[1:4]) == b"\x00\x21\x02" for f in bench.bus.sent) == 1


def test_a_late_answer_is_not_taken_for_the_next_one(opened: Open) -> None:
    bench = opened()
    sdo = bench.drives[0].sdo
    sdo.write(DriveObject(0x6081, 0, "<I", "speed"), 4711)
    bench.bus.late = 0x581
    assert sdo.read(DriveObject(0x6083, 0, "<I", "acceleration")) == 100_000_000
    assert sdo.read(DriveObject(0x6081, 0, "<I", "speed")) == 4711


@pytest.mark.parametrize("name", ["sdo-abort", "sdo-toggle", "drive-reboot"])
def test_faults_in_a_table_write_end_in_the_table_or_a_typed_error(opened: Open, name: str) -> None:
    plan = FaultPlan()
    bench = opened(plan, blocks=False)
    plan.arm([Fault(name, 4)])
    image, data = DriveObject(0x2101, 1, "", "image"), bytes(range(100))
    allowed = () if name == "sdo-toggle" else (SdoRefused, ProtocolError, NoAnswer)
    with contextlib.suppress(*allowed):
        bench.drives[0].sdo.write_bytes(image, data)
    plan.clear()
    bench.clock.sleep_s(0.01)
    bench.drives[0].connect()
    bench.drives[0].sdo.write_bytes(image, data)
    assert bench.drives[0].sdo.read_bytes(image) == data


def test_a_lost_reference_is_refused(opened: Open) -> None:
    bench = opened()
    bench.servers[0].axis.homing.referenced = False
    with pytest.raises(NotReferenced, match="home the drive"):
        bench.drives[0].connect()


def test_a_drive_of_another_make_has_no_bank_and_no_watchdog(opened: Open) -> None:
    bench = opened()
    plain = ServoDrive(bench.line, 1, "q1", bench.clock, profile=load_profile("plain-402"))
    plain.connect()
    with pytest.raises(TableError, match="no table bank"):
        TableBank(plain).state()
    unlike = ServoDrive(
        bench.line, 1, "q1", bench.clock, DriveExpectation(metres_per_increment=2e-8), profile=load_profile("plain-402")
    )
    with pytest.raises(IdentityMismatch, match="factor group"):
        unlike.connect()
    for drive in (plain, unlike):
        drive.close()


@pytest.mark.parametrize("cob_id", [0x201, 0x202, 0x080])
def test_a_lost_controlword_or_sync_does_not_end_a_move(opened: Open, cob_id: int) -> None:
    for number in range(1, 8):
        bench = opened()
        bench.group.enable()
        count = itertools.count(1)
        bench.bus.loses = lambda f, count=count, n=number: f.arbitration_id == cob_id and next(count) == n  # type: ignore[misc]
        samples = bench.group.move_to([0.02, -0.02], 0.1)
        assert [s.position_m for s in samples] == pytest.approx([0.02, -0.02], abs=1e-6)
        assert bench.drives[0].state() is State.OPERATION_ENABLED
