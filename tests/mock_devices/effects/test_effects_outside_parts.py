"""Effects outside the catalogue in machine and station: what their descriptions say, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects.base import StationSight
from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)


def test_heads_around_a_circle_leave_the_orders_of_their_number():
    one = Alone("circle_error", 1e-5)
    n = 720
    angle = 2.0 * np.pi * np.arange(n) / n
    seen = StationSight(np.zeros((n, 1, 3)), angle[:, None].copy(), angle[:, None].copy(), np.ones((n, 1)))
    one.effect.apply_to_sight(one.motion_states(np.zeros(n), q=np.full((n, 2), HOME_M)), seen)
    for error in (seen.hz_rad[:, 0] - angle, seen.v_rad[:, 0] - angle):
        orders = np.abs(np.fft.rfft(error)) / (n / 2)
        assert orders[[4, 8, 12, 16]] == pytest.approx([0.25e-5] * 4)
        orders[[4, 8, 12, 16]] = 0.0
        assert orders.max() < 1e-12
    assert np.all(seen.distance_m == 1.0)


def test_a_lobed_ball_lengthens_its_strut_five_times_a_turn():
    one = Alone("lobed_joint", 1e-5, place=FILE.struts[2].name)
    turn = np.array([0.0, 2.0 * np.pi / 15.0, np.pi / 5.0])[:, None] * 0.5  # within what the strut can swing
    swing = np.concatenate([turn[:, 0], -turn[1:, 0]])
    d = one.deviation(t_s=np.zeros(5), q=along(MIDDLE_M + 1.5 * np.sin(swing), drive=1))
    assert d.length_m[:, 2] == pytest.approx(1e-5 * np.cos(5.0 * swing + one.effect.phase))
    assert not np.any(d.length_m[:, [0, 1, 3]])
    # From one lobe to the valley beside it is a tenth of a turn.
    q = MIDDLE_M + 1.5 * np.sin(np.array([-0.1, np.pi / 5.0 - 0.1]))
    there = one.deviation(t_s=np.zeros(2), q=along(q, drive=1)).length_m[:, 2]
    assert there[1] == pytest.approx(-there[0])


def test_a_lining_wears_with_the_way_and_the_pressure():
    one = Alone("guide_wear", 1e-5)
    assert not np.any(one.deviation().sideways_m)
    for k in range(10):
        one.move(0, HOME_M + (0.5 if k % 2 == 0 else 0.0))
    one.move(1, 0.5)  # the other drive's way wears nothing here
    d = one.deviation(t_s=[one.t_s] * 2, q=along([HOME_M, HIGH_M])).sideways_m[:, 0]
    pressed = np.exp(-2.0 * (np.array([HOME_M, HIGH_M]) - MIDDLE_M) ** 2 / HALF_M**2)
    ways = np.array([5.0, 4.5 + HIGH_M - HOME_M - 0.5])  # the last leg came down by half a metre
    assert d == pytest.approx(-1e-5 * ways / 100.0 * pressed)
    assert pressed[1] == pytest.approx(math.exp(-2.0))


def test_a_gas_spring_keeps_pressure_times_a_power_of_its_volume():
    one = Alone("gas_spring", 1000.0)
    at = np.array([LOW_M, MIDDLE_M, HIGH_M])
    (point, force), *others = one.deviation(t_s=np.zeros(3), q=np.stack([at, at], axis=1)).loads
    assert not others
    assert not np.any(point)
    assert not np.any(force.real)
    lifts = force.imag
    middle = 1000.0 / 0.8**1.3  # of the extended spring's volume four fifths are left
    assert lifts + middle == pytest.approx([1000.0 / 0.6**1.3, middle, 1000.0])
    assert lifts[0] > 0.0 > lifts[2]  # pressed together it lifts more
    mixed = one.deviation(q=[[LOW_M, HIGH_M]]).loads[0][1]
    assert mixed[0] == pytest.approx(0.0, abs=1e-9)
