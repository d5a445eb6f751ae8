"""Backlash and windup: what is left of the way that a drive came."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from tests.mock_devices.effects_bench import HOME_M, Alone

WIDTH_M = 2.0e-5


def test_a_reversal_shows_the_whole_play():
    one = Alone("backlash", WIDTH_M)
    one.move(0, HOME_M + 0.1)
    up = one.travel_m()
    one.move(0, HOME_M + 0.05)
    assert up - one.travel_m() == pytest.approx(-WIDTH_M, abs=1e-15)
    assert one.deviation().travel_m[0, 1] == 0.0


def test_within_the_play_the_slider_stands_still():
    one = Alone("backlash", WIDTH_M)
    one.move(0, HOME_M + 0.1)
    before = one.q[0] + one.travel_m()
    for back_m in (3e-6, 1.1e-5, 1.9e-5):
        one.move(0, HOME_M + 0.1 - back_m)
        assert one.q[0] + one.travel_m() == pytest.approx(before, abs=1e-15)
    one.move(0, HOME_M + 0.1 - 3.0e-5)
    assert one.q[0] + one.travel_m() == pytest.approx(before - 1.0e-5, abs=1e-15)


@given(st.lists(st.floats(-1e-4, 1e-4), min_size=1, max_size=12))
def test_play_is_what_a_block_between_two_stops_does(steps):
    one = Alone("backlash", WIDTH_M)
    block = motor = HOME_M
    for step in steps:
        motor += step
        one.move(0, motor)
        block = min(max(block, motor - 0.5 * WIDTH_M), motor + 0.5 * WIDTH_M)  # pushed by whichever stop reaches it
        assert one.q[0] + one.travel_m() == pytest.approx(block, abs=1e-12)


def test_play_under_load_and_after_a_while_is_smaller():
    loaded, waiting = Alone("backlash", WIDTH_M, variant="load_width"), Alone("backlash", WIDTH_M, variant="closing")
    for one in (loaded, waiting):
        one.move(0, HOME_M + 0.1)
    assert loaded.travel_m(payload_kg=400.0) == pytest.approx(0.4 * loaded.travel_m())
    late = waiting.travel_m(t_s=waiting.t_s + 60.0)
    assert 0.3 < late / waiting.travel_m(t_s=waiting.history.legs(0)[-1].end_s) < 0.4


def test_windup_goes_with_the_torque():
    size, friction_n = 2.0e-8, 300.0
    one = Alone("friction_windup", size, friction_n=friction_n)
    one.move(0, HOME_M + 0.1)
    up, force = one.travel_m(), one.deviation().force_n[0, 0]
    assert force == pytest.approx(friction_n)
    loaded = one.travel_m(payload_kg=400.0)
    assert up - loaded == pytest.approx(size * 200.0 * 9.80665)  # each of the two drives carries half
    one.move(0, HOME_M)
    assert one.travel_m() - up == pytest.approx(2.0 * size * friction_n)
    assert one.deviation().force_n[0, 0] == pytest.approx(-friction_n)


def test_windup_saturates_when_it_hardens():
    soft, hard = (Alone("friction_windup", 1e-8, variant=v, friction_n=50.0) for v in ("coulomb", "hardening"))
    loads = (0.0, 200.0, 400.0)
    linear = np.diff([soft.travel_m(payload_kg=m) for m in loads])
    bent = np.diff([hard.travel_m(payload_kg=m) for m in loads])
    assert linear[0] == pytest.approx(linear[1])
    assert abs(bent[1]) < 0.8 * abs(bent[0])


def test_friction_after_a_fast_approach_is_smaller_in_the_stribeck_variant():
    forces = []
    for speed in (0.05, 0.5):
        one = Alone("friction_windup", 1e-8, variant="stribeck")
        one.move(0, HOME_M + 0.1, speed=speed)
        forces.append(one.deviation().force_n[0, 0])
    assert forces[1] < 0.6 * forces[0]


def test_settling_decays_from_the_side_it_came_from():
    one = Alone("servo_settling", 4e-5, tau_s=3.0)
    one.move(0, HOME_M - 0.2, speed=0.25)
    arrived = one.history.legs(0)[-1].end_s
    for t in (0.0, 1.5, 6.0):
        assert one.travel_m(t_s=arrived + t) == pytest.approx(2e-5 * np.exp(-t / 3.0))


def test_the_other_axis_pushes_in_proportion():
    one = Alone("axis_coupling", 1e-4, place="right")
    first = one.travel_m(drive=1)
    one.move(0, HOME_M + 0.2)
    assert one.travel_m(drive=1) - first == pytest.approx(1e-4 * 0.2)
    assert one.travel_m(drive=0) == 0.0
