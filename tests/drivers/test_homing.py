"""Homing of drives that have lost their reference: our driver and the mock drives, frame by frame and under faults."""

from __future__ import annotations

import contextlib
import itertools
from dataclasses import replace

import can
import pytest
from drive_bench import Bench, Open

from drivers.cia402 import State
from drivers.errors import DeviceError, DriveFault, MotionTimeout, NotReferenced, SdoRefused, Stopped
from drivers.homing import Homing
from mock_devices.faults import Fault, FaultPlan

UP = Homing(34, 0.25, speed_m_per_s=0.004)
HERE = Homing(37, 0.125)


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
        lambda: bench.group.follow([[0.0, 0.0]], 0.02),
    ):
        with pytest.raises(NotReferenced, match="home the drive"):
            refused()
    assert places_m(bench) == pytest.approx([0.003, 0.003])
    bench.group.home([UP, HERE])
    assert places_m(bench) == pytest.approx([0.010, 0.003], abs=1e-8)
    assert positions_m(bench) == pytest.approx([0.25, 0.125], abs=1e-8)
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
201 1F00
601 4041600000000000
201 1F00
601 4041600000000000
201 1F00
601 4041600000000000
201 0F00
601 2F60600001000000
601 4061600000000000
601 4041600000000000
201 0000
601 4041600000000000
601 4064600000000000
601 407A600000000000
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

        bench.bus.loses = loses
        bench.group.home([UP, None])
        assert places_m(bench)[0] == pytest.approx(0.010, abs=1e-8)
        assert positions_m(bench)[0] == pytest.approx(0.25, abs=1e-8)


def test_a_fault_of_any_drive_ends_it_and_leaves_no_reference(opened: Open) -> None:
    for guilty in (0, 1):
        bench = opened(absolute=False)
        bench.clock.call_at(bench.clock.now_s() + 0.5, bench.servers[guilty].inject_fault)
        with pytest.raises((DriveFault, Stopped), match=r"0x2310|quick stop"):
            bench.group.home([UP, None])
        assert bench.group.stop_reason is not None
        stands_m = places_m(bench)
        bench.clock.sleep_s(5.0)
        assert places_m(bench) == pytest.approx(stands_m, abs=1e-4)
        assert not bench.drives[0].referenced
        with pytest.raises((NotReferenced, Stopped)):
            bench.group.enable()
        bench.group.clear_stop()
        bench.group.fault_reset()
        bench.group.home([UP, UP])
        assert positions_m(bench) == pytest.approx([0.25, 0.25], abs=1e-8)


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
        if drive.referenced:
            assert places_m(bench)[0] == pytest.approx(0.010, abs=1e-8)
            assert server.axis.actual_inc() == pytest.approx(25_000_000, abs=1.0)
        if not struck:
            assert drive.referenced
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
        bench.group.home([Homing(34, 0.25, speed_m_per_s=0.001, limit_s=0.5), None])
    assert bench.group.stop_reason is not None
    assert not bench.drives[0].referenced


def test_a_home_offset_of_the_other_sign_is_noticed(opened: Open) -> None:
    bench = opened(absolute=False)
    bench.drives[0].profile = replace(bench.drives[0].profile, home_offset_sign=-1)
    with pytest.raises(DriveFault, match=r"stands at -0.250000 m, not at 0.250000 m"):
        bench.group.home([UP, None])
    assert not bench.drives[0].referenced


def test_a_method_that_the_drive_does_not_know(opened: Open) -> None:
    bench = opened(absolute=False)
    with pytest.raises(SdoRefused, match="homing method"):
        bench.group.home([Homing(17, 0.0), None])
    assert places_m(bench) == pytest.approx([0.003, 0.003])


def test_what_cannot_be_is_refused_at_once() -> None:
    for wrong in ({"method": 300}, {"speed_m_per_s": 0.0}, {"limit_s": float("nan")}, {"tolerance_m": -1.0}):
        with pytest.raises(ValueError, match="homing"):
            Homing(**{"method": 37, "position_m": 0.0, **wrong})  # type: ignore[arg-type]
