"""Growth is alpha l dT, with the time constant that was asked for; screws are heated by their own motion."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, Temperatures

ALPHA, TAU_S = 11.5e-6, 1500.0


@given(st.floats(0.1, 8.0), st.floats(300.0, 6000.0), st.floats(0.0, 20000.0))
def test_a_warming_strut_grows_by_alpha_l_dt(rise_k, tau_s, t_s):
    one = Alone("link_thermal_growth", rise_k, place="right_upper", tau_s=tau_s)
    length = one.deviation(t_s=t_s).length_m[0]
    assert length[2] == pytest.approx(ALPHA * 1.5 * rise_k * (1.0 - np.exp(-t_s / tau_s)), abs=1e-12)
    assert np.all(length[[0, 1, 3]] == 0.0)


def test_a_pulse_is_highest_after_one_time_constant():
    one = Alone("link_thermal_growth", 2.0, variant="pulse", tau_s=TAU_S)
    t = np.linspace(1.0, 8000.0, 400)
    grown = one.deviation(t_s=t).length_m[:, 0]
    assert t[grown.argmax()] == pytest.approx(TAU_S, abs=40.0)
    assert grown.max() == pytest.approx(ALPHA * 1.5 * 2.0, rel=1e-3)


def test_a_part_that_lags_is_late_by_the_swing_that_it_missed():
    ramp = Temperatures(lambda t: 20.0 + 2.0 * t / 3600.0)
    one = Alone("link_thermal_growth", 1.0, variant="lagging", temperatures=ramp, tau_s=TAU_S)
    late = one.deviation(t_s=15000.0).length_m[0, 0]
    behind_k = 2.0 / 3600.0 * TAU_S  # a first-order part is behind a ramp by rate times time constant
    assert late == pytest.approx(-ALPHA * 1.5 * behind_k, rel=0.02)


def test_a_column_grows_from_its_foot_and_bends_with_the_square_of_its_height():
    grown = Alone("column_thermal_growth", 1.0, tau_s=300.0)
    heights = {}
    for q in (0.8, 1.4):
        heights[q] = float(grown.deviation(t_s=1e5, q=[[q, q]]).travel_m[0, 0])
    assert heights[1.4] - heights[0.8] == pytest.approx(ALPHA * 0.6)
    assert heights[0.8] == pytest.approx(ALPHA * (0.8 + 0.125 + 1.2))
    bent = Alone("column_thermal_growth", 1.0, variant="bending", tau_s=300.0)
    d = [bent.deviation(t_s=1e5, q=[[q, q]]) for q in (1.0, 1.0 + 1e-6)]
    slope = (d[1].sideways_m[0, 0] - d[0].sideways_m[0, 0]) / 1e-6
    assert slope == pytest.approx(d[0].yaw_rad[0, 0], rel=1e-4)  # the rail's direction is the slope of its line


def test_the_screw_follows_the_heat_balance_of_its_motion():
    rise_k, tau_s = 3.0, 1200.0
    one = Alone("screw_thermal_growth", rise_k, tau_s=tau_s)
    warm_k, dt = 0.0, 0.05
    for k in range(60):
        goal = HOME_M + (0.3 if k % 2 else -0.3)
        way = abs(goal - one.q[0])
        one.move(0, goal, speed=0.2, rest_s=20.0)
        moving = way / 0.2
        for i in range(round((moving + 20.0) / dt)):  # Euler: heat by speed, loss by temperature
            speed = 0.2 if i * dt < moving - 1e-9 else 0.0
            warm_k += dt / tau_s * (rise_k * speed / 0.01 - warm_k)
    low = FILE.sliders[0].travel_m[0]
    assert one.travel_m() == pytest.approx(10.5e-6 * warm_k * (one.q[0] - low), rel=0.01)
    assert warm_k > 0.5


def test_a_screw_that_stands_cools():
    one = Alone("screw_thermal_growth", 3.0, tau_s=1000.0)
    one.move(0, HOME_M + 0.3)
    first = one.travel_m(t_s=one.t_s)
    assert one.travel_m(t_s=one.t_s + 1000.0) == pytest.approx(first / np.e)
