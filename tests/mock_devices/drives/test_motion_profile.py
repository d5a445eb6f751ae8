"""Profiles: within their limits, continuous, and they arrive."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mock_devices.drives.motion_profile import decelerate_to_rest, move, standstill

POSITION = st.floats(-2e8, 2e8)
SPEED = st.floats(1e5, 1e8)
ACCELERATION = st.floats(1e6, 1e9)


@given(POSITION, st.floats(-5e7, 5e7), POSITION, SPEED, ACCELERATION, ACCELERATION)
def test_a_move_is_continuous_and_rests_at_its_target(x, v, target, speed, acceleration, deceleration):
    profile = move(x, v, target, speed=speed, acceleration=acceleration, deceleration=deceleration)
    times = np.linspace(0.0, profile.duration_s, 400)
    states = np.array([profile.at(t) for t in times])
    fastest = max(speed, abs(v)) * (1 + 1e-9)
    assert np.abs(states[:, 1]).max() <= fastest
    step = times[1] - times[0] if profile.duration_s else 0.0
    assert np.abs(np.diff(states[:, 0])).max() <= fastest * step + 1.0
    steepest = max(acceleration, deceleration)
    assert np.abs(np.diff(states[:, 1])).max() <= steepest * step * (1 + 1e-6) + 1.0
    assert profile.at(profile.duration_s + 1.0) == (target, 0.0, 0.0)
    assert states[0, 0] == pytest.approx(x, abs=1.0)


def test_a_long_move_is_a_trapezoid():
    profile = move(0.0, 0.0, 1e8, speed=5e7, acceleration=2e8, deceleration=2e8)
    assert profile.duration_s == pytest.approx(1e8 / 5e7 + 5e7 / 2e8)
    assert profile.at(1.0)[1] == pytest.approx(5e7)


def test_a_short_move_is_a_triangle():
    profile = move(0.0, 0.0, -1e6, speed=5e7, acceleration=2e8, deceleration=1e8)
    peak = np.sqrt(2 * 2e8 * 1e8 * 1e6 / 3e8)
    assert profile.duration_s == pytest.approx(peak / 2e8 + peak / 1e8)
    assert profile.at(peak / 2e8)[1] == pytest.approx(-peak)


@given(POSITION, st.floats(-5e7, 5e7), ACCELERATION)
def test_a_stop_takes_the_shortest_way(x, v, deceleration):
    profile = decelerate_to_rest(x, v, deceleration=deceleration)
    assert profile.duration_s == pytest.approx(abs(v) / deceleration)
    assert abs(profile.target - x) == pytest.approx(v * v / (2 * deceleration), rel=1e-6, abs=1e-6)


def test_the_lag_follows_its_differential_equation_and_is_gone_after_a_tenth_of_a_second():
    profile = move(0.0, 0.0, 3e7, speed=5e7, acceleration=2e8, deceleration=1e8)
    times = np.linspace(0.0, profile.duration_s + 0.2, 200_001)
    velocity = np.array([profile.at(t)[1] for t in times])
    following_error = np.array([profile.following_error(t) for t in times])
    step, integrated = times[1] - times[0], [0.0]
    for v in 0.5 * (velocity[:-1] + velocity[1:]):
        integrated.append(integrated[-1] + step * (0.05 * v - integrated[-1] / 0.010))
    assert np.abs(following_error - integrated).max() < 2e-3 * np.abs(following_error).max()
    assert abs(profile.following_error(profile.duration_s + 0.12)) < 0.05  # increments


def test_resting_is_a_profile_of_no_duration():
    assert standstill(5.0).at(0.0) == (5.0, 0.0, 0.0)
    assert standstill(5.0).following_error(10.0) == 0.0
