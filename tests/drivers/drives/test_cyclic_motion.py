"""Cyclic synchronous position mode: our drivers lead the mock drives from SYNC to SYNC, with and without faults."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.drives.cia402 import PROFILE_POSITION, State
from drivers.drives.drive_setup import interpolation_period
from drivers.errors import DriveFault, NoAnswer
from tests.drivers.drive_bench import Bench, Open

PERIOD_S = 0.02
PATH = [[0.01 * (1.0 - math.cos(0.1 * k)), -0.001 * k] for k in range(60)]
SYNC, RPDO3 = 0x080, (0x301, 0x302)


SPEED_M_PER_S = 0.1


def led(opened: Open) -> Bench:
    """A bench whose drives are enabled in cyclic mode."""
    bench = opened()
    bench.group.set_cyclic_position(PERIOD_S)
    bench.group.enable()
    return bench


def places_m(bench: Bench) -> list[float]:
    return [server.encoder_m(bench.clock.now_s()) for server in bench.servers]


def recover(bench: Bench) -> None:
    """What an operator does: back to profile position mode, and move."""
    bench.group.clear_stop()
    bench.group.disable()
    bench.group.fault_reset()
    for drive in bench.drives:
        drive.set_mode(PROFILE_POSITION)
    bench.group.enable()
    bench.group.move_to([0.0, 0.0], 0.1)


def test_along_a_path_and_back_to_profile_position(opened: Open) -> None:
    bench = led(opened)
    start_s = bench.clock.now_s()
    samples = bench.group.follow(PATH, SPEED_M_PER_S)
    assert bench.clock.now_s() - start_s == pytest.approx(PERIOD_S * len(PATH), abs=0.5 * PERIOD_S)
    assert [s.demand_m for s in samples] == pytest.approx(PATH[-1], abs=2e-6)
    bench.clock.sleep_s(60.0)  # at the end of a path no SYNC is missed
    assert [s.position_m for s in bench.group.sample()] == pytest.approx(PATH[-1], abs=1e-7)
    assert not any(drive.emergencies for drive in bench.drives)
    recover(bench)


def test_what_cannot_be_followed_is_refused_before_anything_moves(opened: Open) -> None:
    bench = led(opened)
    for path, complaint in (
        ([[0.01, 0.0]], "begins 10000 um"),
        ([[0.0]], "rows of 2"),
        ([], "rows of 2"),
        ([[0.0, math.nan]], "impossible position"),
        ([[0.0, 0.0], [0.001, 0.6]], r"q2: row 2 of the path, 0.600000 m, is outside its software limits"),
        ([[0.0, 0.0], [0.001, 0.001], [0.001, 0.0031]], r"q2: row 3 of the path is a step of 2.100 mm, .* 2.000 mm"),
    ):
        with pytest.raises(ValueError, match=complaint):
            bench.group.follow(path, SPEED_M_PER_S)
    with pytest.raises(ValueError, match="q1: it is in operation enabled; this can only be set without power"):
        bench.group.set_cyclic_position(PERIOD_S)
    with pytest.raises(ValueError, match="cannot be expressed in object 0x60C2"):
        bench.group.set_cyclic_position(0.0123456)
    with pytest.raises(ValueError, match="q1: mode of operation 1 is required"):
        bench.group.move_to([0.0, 0.0], 0.1)
    bench.group.disable()
    bench.drives[1].set_mode(PROFILE_POSITION)
    bench.group.enable()
    with pytest.raises(ValueError, match="q2: mode of operation 8 is required"):
        bench.group.follow([[0.0, 0.0]], SPEED_M_PER_S)
    bench.group.disable()
    bench.drives[1].set_cyclic_position(2.0 * PERIOD_S)
    bench.group.enable()
    with pytest.raises(ValueError, match="different SYNC periods"):
        bench.group.follow([[0.0, 0.0]], SPEED_M_PER_S)
    bench.group.disable()
    bench.drives[1].profile = replace(bench.drives[1].profile, cyclic_position=False)
    with pytest.raises(ValueError, match="q2: a 'PKM mock drive' has no cyclic synchronous position mode"):
        bench.group.set_cyclic_position(2.0 * PERIOD_S)
    assert bench.drives[0].sync_period_s == PERIOD_S
    assert bench.group.stop_reason is None
    assert places_m(bench) == [0.0, 0.0]


def test_steps_as_long_as_the_velocity_limit_permits_are_followed(opened: Open) -> None:
    bench = led(opened)
    steps_m = [0.0, *([SPEED_M_PER_S * PERIOD_S] * 5)]
    path = [[place, -place] for place in itertools.accumulate(steps_m)]
    samples = bench.group.follow(path, SPEED_M_PER_S)
    assert [s.demand_m for s in samples] == pytest.approx([0.01, -0.01], abs=2e-6)


def test_drives_whose_clock_is_slower_than_the_master_s_arrive(opened: Open) -> None:
    bench = led(opened)
    for server in bench.servers:
        server.axis.cyclic.units = round(1.1 * server.axis.cyclic.units)
    path = [[place, -place] for place in itertools.accumulate([0.0, *([SPEED_M_PER_S * PERIOD_S] * 5)])]
    samples = bench.group.follow(path, SPEED_M_PER_S)
    assert [s.demand_m for s in samples] == pytest.approx([0.01, -0.01], abs=2e-6)


def test_a_sync_has_one_moment_however_late_a_drive_s_thread_sees_it(opened: Open) -> None:
    bench = led(opened)
    for drive in bench.drives:
        drive.send_target(0.001)
    bench.clock.sleep_s(PERIOD_S)
    for server in bench.servers:
        server._on_sync(12.5)  # the frame's time stamp
        bench.clock.sleep_s(0.25 * PERIOD_S)
    first_m, second_m = places_m(bench)
    assert first_m == pytest.approx(0.0005, rel=0.05)  # less a following error
    assert second_m == first_m


def test_a_target_of_before_a_stop_moves_nothing_after_it(opened: Open) -> None:
    bench = led(opened)
    bench.group.follow([[0.0, 0.0]], SPEED_M_PER_S)
    for drive in bench.drives:
        drive.send_target(0.002)
    bench.line.send_sync()
    bench.clock.sleep_s(0.25 * PERIOD_S)
    bench.group.stop_all("on the way")
    bench.clock.sleep_s(0.1)
    stands_m = places_m(bench)
    assert 0.0005 < stands_m[0] < 0.0018
    bench.group.clear_stop()
    bench.group.enable()
    for _ in range(3):
        bench.group.sample()
        bench.clock.sleep_s(PERIOD_S)
    assert places_m(bench) == pytest.approx(stands_m, abs=2e-8)


def test_the_target_of_a_move_before_is_none_of_cyclic_mode(opened: Open) -> None:
    bench = opened()
    bench.group.enable()
    bench.group.move_to([0.01, -0.01], 0.1)
    for drive in bench.drives:
        drive.write_target(0.02)
    bench.group.disable()
    bench.group.set_cyclic_position(PERIOD_S)
    bench.group.enable()
    bench.group.sample()
    bench.clock.sleep_s(1.0)
    assert places_m(bench) == pytest.approx([0.01, -0.01], abs=2e-8)


def test_a_drive_that_hears_no_targets_stops_the_others(opened: Open) -> None:
    for number in (1, 10, 30):
        bench = led(opened)
        count = itertools.count(1)

        def loses(frame: can.Message, count: itertools.count[int] = count, number: int = number) -> bool:
            return frame.arbitration_id == RPDO3[1] and next(count) >= number

        bench.bus.loses = loses
        with pytest.raises(DriveFault, match=r"^q2 .*is not on the path"):
            bench.group.follow(PATH, SPEED_M_PER_S)
        bench.clock.sleep_s(0.1)
        assert places_m(bench)[0] == pytest.approx(PATH[number][0], abs=0.003)
        bench.bus.loses = lambda _frame: False
        recover(bench)


def test_a_drive_that_says_that_it_takes_no_targets_stops_the_others(opened: Open) -> None:
    bench = led(opened)
    bench.servers[1].axis.limits.low_inc = -1_000_000  # 10 rows
    with pytest.raises(DriveFault, match=r"^q2 .*does not follow its targets"):
        bench.group.follow(PATH, SPEED_M_PER_S)
    bench.clock.sleep_s(0.1)
    assert places_m(bench) == pytest.approx(PATH[10], abs=0.003)


def test_samples_from_elsewhere_do_not_disturb_a_path(opened: Open) -> None:
    bench = led(opened)
    taken: list[list[float]] = []

    def look() -> None:
        taken.append([sample.demand_m for sample in bench.group.sample()])
        bench.clock.call_at(bench.clock.now_s() + 0.3 * PERIOD_S, look)

    bench.bus.sent.clear()
    bench.clock.call_at(bench.clock.now_s() + 0.3 * PERIOD_S, look)
    bench.group.follow(PATH, SPEED_M_PER_S)
    assert sum(frame.arbitration_id == SYNC for frame in bench.bus.sent) == len(PATH) + 2
    assert len(taken) > 2 * len(PATH)
    assert {tuple(round(x, 5) for x in row) for row in taken} <= {tuple(round(x, 5) for x in row) for row in PATH}


def test_a_path_that_comes_back_to_where_it_began_is_followed_to_its_end(opened: Open) -> None:
    bench = led(opened)
    home = [0.0, 0.0]
    bench.group.follow([home, [0.001, 0.0], [0.002, 0.001], [0.001, 0.0], home], SPEED_M_PER_S)
    bench.clock.sleep_s(0.1)
    assert max(profile.target for _, profile, _ in bench.servers[0].axis.motion.trail) == 200_000
    assert bench.servers[0].encoder_m(bench.clock.now_s()) == pytest.approx(0.0, abs=1e-6)


def test_frames_of_a_path(opened: Open) -> None:
    bench = opened()

    def frames() -> list[str]:
        told = [f for f in bench.bus.sent if f.arbitration_id != 0x77F]
        bench.bus.sent.clear()
        return [f"{f.arbitration_id:03X} {bytes(f.data).hex().upper()}".strip() for f in told]

    frames()
    bench.drives[0].set_cyclic_position(PERIOD_S)
    setting = frames()
    period = ["2FC2600114000000", "40C2600100000000", "2FC26002FD000000", "40C2600200000000"]  # 20 times 10^-3 s
    assert setting[:5] == ["601 4041600000000000", *(f"601 {data}" for data in period)]
    assert setting[-3:] == ["000 0101", "601 2F60600008000000", "601 4061600000000000"]
    bench.drives[0].enable()
    assert frames()[-7:] == [
        "201 0700",
        "601 4041600000000000",
        "601 4064600000000000",  # its target is where it stands
        "601 237A600000000000",
        "601 407A600000000000",
        "201 0F00",
        "601 4041600000000000",
    ]
    bench.drives[1].set_cyclic_position(PERIOD_S)
    bench.group.enable()
    frames()
    bench.group.follow([[0.0, 0.0], [1e-4, -1e-4]], SPEED_M_PER_S)
    assert frames() == [
        "080",
        *("301 00000000", "302 00000000", "080"),
        *("301 10270000", "302 F0D8FFFF", "080"),
        *("301 10270000", "302 F0D8FFFF", "080"),
    ]


@pytest.mark.parametrize("cob_id", [*RPDO3, SYNC, 0x181, 0x282])
def test_one_lost_frame_does_not_end_it(opened: Open, cob_id: int) -> None:
    for number in (1, 5, len(PATH), len(PATH) + 1):
        bench = led(opened)
        count = itertools.count(1)

        def loses(frame: can.Message, count: itertools.count[int] = count, number: int = number) -> bool:
            return frame.arbitration_id == cob_id and next(count) == number

        bench.bus.loses = bench.bus.misses = loses
        start_s = bench.clock.now_s()
        samples = bench.group.follow(PATH, SPEED_M_PER_S)
        assert [s.demand_m for s in samples] == pytest.approx(PATH[-1], abs=2e-6)
        assert not any(drive.emergencies for drive in bench.drives)
        extra = (bench.clock.now_s() - start_s) / PERIOD_S - len(PATH)
        if number == 5:  # where SYNC or an answer is lost it is silent for a period, then SYNC is sent again
            assert extra == pytest.approx(float(cob_id not in RPDO3), abs=0.6)
        assert extra < 1.6


def test_two_lost_syncs_are_too_many(opened: Open) -> None:
    bench = led(opened)
    count = itertools.count(1)
    bench.bus.loses = lambda frame: frame.arbitration_id == SYNC and next(count) in (10, 11, 12)
    with pytest.raises((NoAnswer, DriveFault)):
        bench.group.follow(PATH, SPEED_M_PER_S)
    assert bench.group.stop_reason is not None
    bench.clock.sleep_s(0.2)
    assert not any(server.is_moving(bench.clock.now_s()) for server in bench.servers)


def test_drives_that_hear_no_sync_stop_by_themselves(opened: Open) -> None:
    bench = led(opened)
    bench.group.follow(PATH[:2], SPEED_M_PER_S)
    for drive in bench.drives:
        drive.send_target(0.002)
    bench.line.send_sync()
    bench.clock.sleep_s(2.9 * PERIOD_S)
    assert not any(drive.emergencies for drive in bench.drives)
    bench.clock.sleep_s(0.2 * PERIOD_S)
    assert [str(drive.messages.last_emergency()) for drive in bench.drives] == ["EMCY 0x8700 (no SYNC)"] * 2
    bench.clock.sleep_s(0.1)
    assert [drive.state() for drive in bench.drives] == [State.FAULT] * 2
    with pytest.raises(DriveFault, match="0x8700"):
        bench.group.follow(PATH, SPEED_M_PER_S)
    recover(bench)


def test_a_jump_in_the_path_stops_all(opened: Open) -> None:
    bench = led(opened)
    jump = [*PATH[:10], [PATH[9][0] + 0.1, PATH[9][1]], *PATH[11:]]
    with pytest.raises(DriveFault, match=r"q1 .*0x8611 .following error"):
        bench.group.follow(jump, 10.0)
    assert bench.group.stop_reason is not None
    bench.clock.sleep_s(0.2)
    stands_m = [server.encoder_m(bench.clock.now_s()) for server in bench.servers]
    assert stands_m == pytest.approx(PATH[9], abs=2e-3)
    recover(bench)


def test_a_fault_of_one_stops_the_other(opened: Open) -> None:
    bench = led(opened)
    bench.clock.call_at(bench.clock.now_s() + 0.2, bench.servers[0].inject_fault)
    with pytest.raises(DriveFault, match=r"^q1 .*0x2310"):
        bench.group.follow(PATH, SPEED_M_PER_S)
    assert not bench.servers[1].is_moving(bench.clock.now_s() + 0.1)
    recover(bench)


@given(units=st.integers(1, 255), exponent=st.integers(-6, 0))
def test_every_period_that_the_object_holds_comes_back(units: int, exponent: int) -> None:
    told = interpolation_period(units * 10.0**exponent)
    assert told[0] * 10.0 ** told[1] == pytest.approx(units * 10.0**exponent, rel=1e-12)


@given(units=st.integers(1, 255), exponent=st.integers(-6, 0), off=st.floats(1e-8, 1e-4), sign=st.sampled_from([-1, 1]))
def test_a_period_that_is_nearly_one_is_refused(units: int, exponent: int, off: float, sign: int) -> None:
    with pytest.raises(ValueError, match="cannot be expressed in object 0x60C2"):
        interpolation_period(units * 10.0**exponent * (1.0 + sign * off))


@given(period_s=st.floats(max_value=9.9e-7) | st.floats(min_value=255.1) | st.just(math.nan))
def test_a_period_that_is_too_short_or_too_long_is_refused(period_s: float) -> None:
    with pytest.raises(ValueError, match="cannot be expressed in object 0x60C2"):
        interpolation_period(period_s)
