"""Homing of drives that have lost their reference: our driver and the mock drives, frame by frame and under faults."""

from __future__ import annotations

import contextlib
import itertools
from dataclasses import replace

import can
import pytest

from drivers.drives.cia402 import State
from drivers.drives.drive_profile import load_profile
from drivers.drives.homing import HomingParameters
from drivers.drives.servo_drive import DriveExpectation, ServoDrive
from drivers.errors import DeviceError, DriveFault, MotionTimeout, NotReferenced, SdoRefused, Stopped
from mock_devices.faults import Fault, FaultPlan
from tests.drivers.drive_bench import Bench, Open

UP = HomingParameters(34, 0.25, speed_m_per_s=0.004)
QUICKLY = replace(UP, speed_m_per_s=0.02)
HERE = HomingParameters(37, 0.125)


def positions_m(bench: Bench) -> list[float]:
    return [sample.position_m for sample in bench.group.sample()]


def places_m(bench: Bench) -> list[float]:
    return [server.encoder_m(bench.clock.now_s()) for server in bench.servers]


def test_unreferenced_drives_are_refused_until_they_are_homed(opened: Open) -> None:
    bench = opened(absolute=False)
    for refused in (
        bench.drives[0].connect,
        bench.group.enable,
        lambda: bench.group.move_to([0.1, 0.1], 0.1),
        lambda: bench.group.follow([[0.0, 0.0]], 0.1),
    ):
        with pytest.raises(NotReferenced, match="home the drive"):
            refused()
    assert places_m(bench) == pytest.approx([0.003, 0.003])
    bench.group.home([UP, HERE])
    assert places_m(bench) == pytest.approx([0.010, 0.003], abs=1e-8)
    assert positions_m(bench) == pytest.approx([0.25, 0.125], abs=1e-8)
    assert [drive.target_m for drive in bench.drives] == pytest.approx([0.25, 0.125], abs=1e-8)
    assert all(drive.state() is State.SWITCH_ON_DISABLED for drive in bench.drives)
    bench.group.enable()
    bench.group.move_to([0.26, 0.115], 0.1)
    assert places_m(bench) == pytest.approx([0.020, -0.007], abs=1e-6)
    bench.group.disable()
    bench.drives[0].connect()


def test_the_others_stand_while_one_is_homed(opened: Open) -> None:
    bench = opened(absolute=False)
    powered: list[tuple[bool, ...]] = []

    def look() -> None:
        powered.append(tuple(server.axis.powered for server in bench.servers))
        bench.clock.call_at(bench.clock.now_s() + 0.1, look)

    look()
    bench.group.home([UP, UP])
    assert {(True, False), (False, True)} <= set(powered)
    assert (True, True) not in powered


# Host to drive 1, homing where it stands: SDO (0x601), controlwords (0x201). Statusword 0x6041, mode 0x6060 and 0x6061.
GOLDEN = """
601 2F98600025000000
601 4098600000000000
601 237C600020BCBE00
601 407C600000000000
601 23996001400D0300
601 4099600100000000
601 23996002400D0300
601 4099600200000000
601 239A600080969800
601 409A600000000000
601 2F60600006000000
601 4061600000000000
601 4041600000000000
201 0600
601 4041600000000000
201 0700
601 4041600000000000
201 0F00
601 4041600000000000
601 4041600000000000
201 1F00
601 4041600000000000
201 1F00
601 4041600000000000
201 1F00
601 4041600000000000
601 4041600000000000
201 0000
601 4041600000000000
601 2F60600001000000
601 4061600000000000
601 4064600000000000
601 407A600000000000
601 4003210100000000
601 4003210100000000
"""


def test_frames_of_homing(opened: Open) -> None:
    bench = opened(absolute=False)
    bench.bus.sent.clear()
    bench.group.home([HERE, None])
    frames = [f"{f.arbitration_id:X} {bytes(f.data).hex().upper()}" for f in bench.bus.sent]
    first = frames.index("601 2F98600025000000")
    mine = [frame for frame in frames[first:] if frame.startswith(("601", "201"))]
    assert mine == GOLDEN.split("\n")[1:-1]


@pytest.mark.parametrize("cob_id", [0x201, 0x601, 0x581])
def test_a_lost_frame_does_not_end_it_or_make_it_wrong(opened: Open, cob_id: int) -> None:
    for number in range(1, 9):
        bench = opened(absolute=False)
        count = itertools.count(1)

        def loses(frame: can.Message, count: itertools.count[int] = count, number: int = number) -> bool:
            return frame.arbitration_id == cob_id and next(count) == number

        bench.bus.loses = bench.bus.misses = loses
        bench.group.home([UP, None])
        assert places_m(bench)[0] == pytest.approx(0.010, abs=1e-8)
        assert positions_m(bench)[0] == pytest.approx(0.25, abs=1e-8)


STATUSWORD_ANSWER = bytes.fromhex("4B416000")


def strike(bench: Bench, guilty: int, number: int, where: str) -> list[int]:
    """Has a drive fail at the n-th answer or command, its EMCY overtaking that; the list is filled when it did."""
    count, struck = itertools.count(1), []

    def fail(counts: bool) -> bool:
        if counts and not struck and next(count) == number:
            struck.append(number)
            bench.servers[guilty].inject_fault()
            return True
        return False

    def answers(frame: can.Message) -> bool:
        return fail(frame.arbitration_id == 0x581 and bytes(frame.data[:4]) == STATUSWORD_ANSWER)

    def commands(frame: can.Message) -> bool:
        fail(frame.arbitration_id == 0x201)
        return False

    if where == "answer":
        bench.bus.overtaken = answers
    else:
        bench.bus.loses = commands
    return struck


@pytest.mark.parametrize("guilty", [0, 1])
@pytest.mark.parametrize("where", ["answer", "command"])
def test_a_fault_of_any_drive_at_any_time_stops_all_for_good(opened: Open, guilty: int, where: str) -> None:
    for number in itertools.count(1):
        bench = opened(absolute=False)
        struck = strike(bench, guilty, number, where)
        with contextlib.suppress(DriveFault):
            bench.group.home([QUICKLY, None])
        if not struck:
            assert bench.drives[0].reference.is_valid
            assert number > 4
            return
        reason = str(bench.group.stop_reason)
        assert reason.startswith(f"q{guilty + 1} ")
        assert "0x2310" in reason
        bench.clock.sleep_s(0.2)
        assert bench.drives[0].state() is not State.OPERATION_ENABLED
        assert bench.servers[0].axis.homing.referenced or not bench.drives[0].reference.is_valid
        stands_m = places_m(bench)
        bench.clock.sleep_s(5.0)
        assert places_m(bench) == pytest.approx(stands_m, abs=1e-7)


def test_the_guilty_drive_is_named_and_homing_may_be_repeated(opened: Open) -> None:
    for guilty in (0, 1):
        bench = opened(absolute=False)
        bench.clock.call_at(bench.clock.now_s() + 0.5, bench.servers[guilty].inject_fault)
        with pytest.raises(DriveFault, match=rf"^q{guilty + 1} .*0x2310"):
            bench.group.home([UP, None])
        assert not bench.drives[0].reference.is_valid
        with pytest.raises(Stopped, match=rf"q{guilty + 1} .*0x2310"):
            bench.group.enable()
        bench.group.clear_stop()
        with pytest.raises(NotReferenced):
            bench.group.enable()
        bench.group.fault_reset()
        bench.group.home([UP, UP])
        assert positions_m(bench) == pytest.approx([0.25, 0.25], abs=1e-8)


def test_a_fault_whose_message_is_lost_is_seen_in_the_other_drives_state(opened: Open) -> None:
    bench = opened(absolute=False)
    bench.bus.misses = lambda frame: frame.arbitration_id == 0x082
    bench.clock.call_at(bench.clock.now_s() + 0.5, bench.servers[1].inject_fault)
    with pytest.raises(DriveFault, match=r"^q2 .*in fault"):
        bench.group.home([UP, None])


def test_what_the_homing_before_has_left_does_not_pass_for_a_new_one(opened: Open) -> None:
    bench = opened(absolute=False)
    bench.group.home([UP, None])
    bench.bus.loses = lambda frame: frame.arbitration_id == 0x201 and frame.data[0] == 0x1F
    with pytest.raises(MotionTimeout, match="not homed"):
        bench.group.home([replace(UP, limit_s=2.0), None])
    bench.bus.loses = lambda _frame: False
    bench.group.clear_stop()
    bench.group.home([UP, None])
    assert places_m(bench)[0] == pytest.approx(0.020, abs=1e-8)
    for _ in range(2):
        bench.group.home([HERE, None])
        assert positions_m(bench)[0] == pytest.approx(0.125, abs=1e-8)


@pytest.mark.parametrize("name", ["sdo-abort", "drive-reboot"])
def test_a_fault_at_any_frame_ends_right_or_leaves_no_reference(opened: Open, name: str) -> None:
    for number in itertools.count(1):
        plan = FaultPlan()
        bench = opened(plan, absolute=False)
        plan.arm([Fault(name, number)])
        with contextlib.suppress(DeviceError):
            bench.group.home([UP, None])
        struck = bool(plan.struck)
        plan.clear()
        bench.clock.sleep_s(1.0)
        server, drive = bench.servers[0], bench.drives[0]
        assert not server.is_moving(bench.clock.now_s())
        if drive.reference.is_valid:
            assert places_m(bench)[0] == pytest.approx(0.010, abs=1e-8)
            assert server.axis.actual_inc() == pytest.approx(25_000_000, abs=1.0)
        if not struck:
            assert drive.reference.is_valid
            return
        bench.group.clear_stop()
        drive.connect(unreferenced=True)
        bench.group.fault_reset()
        bench.group.home([HERE, None])
        assert positions_m(bench)[0] == pytest.approx(0.125, abs=1e-8)


def test_a_stop_by_somebody_else_ends_it(opened: Open) -> None:
    bench = opened(absolute=False)
    bench.clock.call_at(bench.clock.now_s() + 0.5, lambda: bench.group.stop_all("interlock open"))
    with pytest.raises(Stopped, match="interlock open"):
        bench.group.home([UP, None])
    assert not bench.servers[0].is_moving(bench.clock.now_s() + 0.1)


def test_a_home_that_is_not_found_in_time(opened: Open) -> None:
    bench = opened(absolute=False)
    with pytest.raises(MotionTimeout, match=r"not homed in 0.5 s"):
        bench.group.home([HomingParameters(34, 0.25, speed_m_per_s=0.001, limit_s=0.5), None])
    assert bench.group.stop_reason is not None
    assert not bench.drives[0].reference.is_valid


def test_however_fast_rig_time_runs_the_drive_gets_its_chance_to_answer(opened: Open) -> None:
    bench = opened(absolute=False)
    count = itertools.count()
    bench.bus.loses = lambda frame: frame.arbitration_id == 0x201 and frame.data[0] == 0x1F and next(count) < 2
    bench.group.home([replace(HERE, limit_s=1e-6), None])
    assert bench.drives[0].reference.is_valid


def another_connects(bench: Bench, **expected: tuple[float, float]) -> None:
    """What another program does that knows nothing of what was before."""
    drive = ServoDrive(bench.line, 1, "q1", bench.clock, DriveExpectation(**expected), partner_node_id=2)
    try:
        drive.connect()
    finally:
        drive.close()


def test_a_home_offset_of_the_other_sign_leaves_no_reference(opened: Open) -> None:
    bench = opened(absolute=False)
    bench.drives[0].profile = replace(bench.drives[0].profile, home_offset_sign=-1)
    with pytest.raises(DriveFault, match=r"stands at -0.250000 m, not at 0.250000 m; check home offset and its sign"):
        bench.group.home([UP, None])
    assert not bench.drives[0].reference.is_valid
    with pytest.raises(NotReferenced):
        another_connects(bench)


def test_where_nothing_takes_the_wrong_reference_away_it_is_told_and_not_believed(opened: Open) -> None:
    bench = opened(absolute=False)
    bench.drives[0].profile = replace(bench.drives[0].profile, home_offset_sign=-1)
    with pytest.raises(DriveFault, match=r"still reports that it is referenced; .*pkm-rig home"):
        bench.group.home([HERE, None])
    bench.group.clear_stop()
    for refused in (bench.drives[0].connect, bench.group.enable):
        with pytest.raises(NotReferenced, match="did not complete successfully"):
            refused()
    with pytest.raises(NotReferenced, match=r"it is at -0.125000 m, outside its travel of 0.000000 m to 0.500000 m"):
        another_connects(bench, travel_m=(0.0, 1.0))


def test_a_reference_that_is_lost_later_is_asked_for_before_power(opened: Open) -> None:
    bench = opened(absolute=False)
    bench.group.home([UP, HERE])
    bench.servers[1].axis.homing.referenced = False
    with pytest.raises(NotReferenced, match=r"^q2 .*pkm-rig home --rig"):
        bench.group.enable()
    assert not any(server.axis.powered for server in bench.servers)
    bench.group.home([None, HERE])
    bench.group.enable()
    bench.servers[1].inject_fault()
    bench.servers[1].axis.homing.referenced = False
    bench.clock.sleep_s(0.5)
    bench.group.fault_reset()
    with pytest.raises(NotReferenced, match=r"^q2 "):
        bench.group.move_to([0.25, 0.125], 0.1)


def test_what_one_drive_cannot_take_is_refused_before_anything_is_written(opened: Open) -> None:
    bench = opened(absolute=False)
    bench.bus.sent.clear()
    with pytest.raises(ValueError, match=r"q2: impossible position"):
        bench.group.home([UP, HomingParameters(34, 1120.0)])
    with pytest.raises(ValueError, match=r"q2: 0x609A:00 homing acceleration"):
        bench.group.home([UP, replace(UP, acceleration_m_per_s2=1e3)])
    bench.drives[1].profile = load_profile("plain-402")
    with pytest.raises(ValueError, match="q2: its profile does not say"):
        bench.group.home([UP, UP])
    bench.drives[1].profile = replace(load_profile("pkm-mock"), homing=False)
    with pytest.raises(ValueError, match="q2: a 'PKM mock drive' cannot be homed"):
        bench.group.home([UP, UP])
    assert not bench.bus.sent


def test_a_method_that_the_drive_does_not_know(opened: Open) -> None:
    bench = opened(absolute=False)
    with pytest.raises(SdoRefused, match="homing method"):
        bench.group.home([HomingParameters(17, 0.0), None])
    assert places_m(bench) == pytest.approx([0.003, 0.003])


def test_what_cannot_be_is_refused_at_once() -> None:
    for wrong in ({"method": 300}, {"speed_m_per_s": 0.0}, {"limit_s": float("nan")}, {"tolerance_m": -1.0}):
        with pytest.raises(ValueError, match="homing"):
            HomingParameters(**{"method": 37, "position_m": 0.0, **wrong})  # type: ignore[arg-type]
