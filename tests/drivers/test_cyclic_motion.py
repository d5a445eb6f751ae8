"""Cyclic synchronous position mode: our drivers lead the mock drives from SYNC to SYNC, with and without faults."""

from __future__ import annotations

import contextlib
import itertools
import math

import can
import pytest
from drive_bench import Bench, Open
from hypothesis import given
from hypothesis import strategies as st

from drivers.cia402 import CYCLIC_POSITION, PROFILE_POSITION, State
from drivers.drive_setup import interpolation_period
from drivers.errors import DriveFault

PERIOD_S = 0.02
PATH = [[0.01 * (1.0 - math.cos(0.1 * k)), -0.001 * k] for k in range(60)]
SYNC, RPDO3 = 0x080, (0x301, 0x302)


def led(opened: Open) -> Bench:
    """A bench whose drives are enabled in cyclic mode."""
    bench = opened()
    for drive in bench.drives:
        drive.set_mode(CYCLIC_POSITION)
    bench.group.enable()
    return bench


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
    samples = bench.group.follow(PATH, PERIOD_S)
    assert bench.clock.now_s() - start_s == pytest.approx(PERIOD_S * len(PATH), abs=0.5 * PERIOD_S)
    assert [s.demand_m for s in samples] == pytest.approx(PATH[-1], abs=2e-6)
    bench.clock.sleep_s(60.0)  # at the end of a path no SYNC is missed
    assert [s.position_m for s in bench.group.sample()] == pytest.approx(PATH[-1], abs=1e-7)
    assert not any(drive.emergencies for drive in bench.drives)
    recover(bench)


def test_what_cannot_be_followed_is_refused_before_anything_moves(opened: Open) -> None:
    bench = led(opened)
    for path, period_s, complaint in (
        ([[0.01, 0.0]], PERIOD_S, "begins 10000 um"),
        ([[0.0]], PERIOD_S, "rows of 2"),
        ([], PERIOD_S, "rows of 2"),
        ([[0.0, math.nan]], PERIOD_S, "no such position"),
        ([[0.0, 0.0]], 0.0123456, "cannot be told"),
    ):
        with pytest.raises(ValueError, match=complaint):
            bench.group.follow(path, period_s)
    with pytest.raises(ValueError, match="q1: mode of operation 1 is needed"):
        bench.group.move_to([0.0, 0.0], 0.1)
    bench.group.disable()
    bench.drives[1].set_mode(PROFILE_POSITION)
    bench.group.enable()
    with pytest.raises(ValueError, match="q2: mode of operation 8 is needed"):
        bench.group.follow([[0.0, 0.0]], PERIOD_S)
    assert bench.group.stop_reason is None


def test_a_path_that_comes_back_to_where_it_began_is_followed_to_its_end(opened: Open) -> None:
    bench = led(opened)
    home = [0.0, 0.0]
    bench.group.follow([home, [0.001, 0.0], [0.002, 0.001], [0.001, 0.0], home], PERIOD_S)
    bench.clock.sleep_s(0.1)
    assert max(profile.target for _, profile, _ in bench.servers[0].axis.motion.trail) == 200_000
    assert bench.servers[0].encoder_m(bench.clock.now_s()) == pytest.approx(0.0, abs=1e-6)


def test_frames_of_a_path(opened: Open) -> None:
    bench = led(opened)
    bench.bus.sent.clear()
    bench.group.follow([[0.0, 0.0], [1e-4, -1e-4]], PERIOD_S)
    frames = [
        f"{f.arbitration_id:03X} {bytes(f.data).hex().upper()}".strip()
        for f in bench.bus.sent
        if f.arbitration_id != 0x77F
    ]
    period = ["2FC26002FD000000", "40C2600200000000", "2FC2600114000000", "40C2600100000000"]  # 20 times 10^-3 s
    assert frames == [
        *(f"601 {data}" for data in period),
        *(f"602 {data}" for data in period),
        "080",
        *("301 00000000", "302 00000000", "080"),
        *("301 10270000", "302 F0D8FFFF", "080"),
        *("301 10270000", "302 F0D8FFFF", "080"),
    ]


@pytest.mark.parametrize("cob_id", [*RPDO3, SYNC])
def test_one_lost_frame_does_not_end_it(opened: Open, cob_id: int) -> None:
    for number in (1, 5, len(PATH), len(PATH) + 1):
        bench = led(opened)
        count = itertools.count(1)

        def loses(frame: can.Message, count: itertools.count[int] = count, number: int = number) -> bool:
            return frame.arbitration_id == cob_id and next(count) == number

        bench.bus.loses = loses
        samples = bench.group.follow(PATH, PERIOD_S)
        assert [s.demand_m for s in samples] == pytest.approx(PATH[-1], abs=2e-6)


def test_drives_that_hear_no_sync_stop_by_themselves(opened: Open) -> None:
    bench = led(opened)
    bench.group.follow(PATH[:2], PERIOD_S)
    for drive in bench.drives:
        drive.send_target(0.002)
    bench.line.send_sync()
    bench.clock.sleep_s(2.9 * PERIOD_S)
    assert not any(drive.emergencies for drive in bench.drives)
    bench.clock.sleep_s(0.2 * PERIOD_S)
    assert [str(drive.last_emergency()) for drive in bench.drives] == ["EMCY 0x8700 (no SYNC)"] * 2
    bench.clock.sleep_s(0.1)
    assert [drive.state() for drive in bench.drives] == [State.FAULT] * 2
    with pytest.raises(DriveFault, match="0x8700"):
        bench.group.follow(PATH, PERIOD_S)
    recover(bench)


def test_a_jump_in_the_path_stops_all(opened: Open) -> None:
    bench = led(opened)
    jump = [*PATH[:10], [PATH[9][0] + 0.1, PATH[9][1]], *PATH[11:]]
    with pytest.raises(DriveFault, match=r"q1 .*0x8611 .following error"):
        bench.group.follow(jump, PERIOD_S)
    assert bench.group.stop_reason is not None
    bench.clock.sleep_s(0.2)
    stands_m = [server.encoder_m(bench.clock.now_s()) for server in bench.servers]
    assert stands_m == pytest.approx(PATH[9], abs=2e-3)
    recover(bench)


def test_a_fault_of_one_stops_the_other(opened: Open) -> None:
    bench = led(opened)
    bench.clock.call_at(bench.clock.now_s() + 0.2, bench.servers[0].inject_fault)
    with pytest.raises(DriveFault, match="0x2310"):
        bench.group.follow(PATH, PERIOD_S)
    assert not bench.servers[1].is_moving(bench.clock.now_s() + 0.1)
    recover(bench)


@given(units=st.integers(1, 255), exponent=st.integers(-6, 0))
def test_every_period_that_the_object_holds_comes_back(units: int, exponent: int) -> None:
    told = interpolation_period(units * 10.0**exponent)
    assert told[0] * 10.0 ** told[1] == pytest.approx(units * 10.0**exponent, rel=1e-12)


@given(period_s=st.floats())
def test_any_other_period_is_refused(period_s: float) -> None:
    with contextlib.suppress(ValueError):
        units, exponent = interpolation_period(period_s)
        assert units * 10.0**exponent == pytest.approx(period_s, rel=1e-8)
