"""Errors along the travel: periods, amplitudes, straightness; settling of a foot."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along

Q = np.linspace(0.45, 1.6, 4001)


def travel(one, **kinds):
    q = along(Q)
    return one.deviation(t_s=np.full(len(q), 10.0), q=q, **kinds).travel_m[:, 0]


def strongest_period(values):
    spectrum = np.abs(np.fft.rfft(values - values.mean()))
    return (Q[-1] - Q[0]) * len(Q) / (len(Q) - 1) / spectrum.argmax()


@settings(max_examples=25)
@given(st.floats(5e-3, 4e-2))
def test_the_screws_error_has_its_period_and_amplitude(period_m):
    values = travel(Alone("screw_periodic_error", 8e-6, period_m=period_m))
    assert strongest_period(values) == pytest.approx(period_m, rel=0.04)
    assert np.abs(values).max() == pytest.approx(8e-6, rel=1e-2)


def test_interpolation_repeats_twice_a_period_of_the_signals():
    one = Alone("encoder_interpolation", 1e-6, pitch_m=2e-3)
    q = along(np.array([1.0, 1.0 + 1e-3, 1.0 + 0.5e-3]))
    same, half, quarter = one.deviation(t_s=np.zeros(3), q=q).travel_m[:, 0]
    assert half == pytest.approx(same)
    assert quarter == pytest.approx(-same)
    offset = Alone("encoder_interpolation", 1e-6, variant="offset", pitch_m=2e-3)
    same, half, _ = offset.deviation(t_s=np.zeros(3), q=q).travel_m[:, 0]
    assert half == pytest.approx(-same)


@pytest.mark.parametrize("variant", ["parabola", "cubic", "irregular", "two_pieces"])
def test_cumulative_error_is_not_only_the_drives_scale(variant):
    values = travel(Alone("screw_cumulative_error", 1e-5, variant=variant))
    line = np.polynomial.Polynomial.fit(Q, values, 1)(Q)
    assert np.std(values - line) > 0.1 * 1e-5
    assert np.abs(values).max() < 5e-5


def test_the_rails_of_a_guide_meet_in_one_step():
    one = Alone("guide_straightness", 1e-5, variant="rail_joint")
    q = along(Q)
    values = one.deviation(t_s=np.zeros(len(q)), q=q).sideways_m[:, 0]
    assert values[0] == pytest.approx(-1e-5, rel=0.02)
    assert values[-1] == pytest.approx(1e-5, rel=0.02)
    assert np.all(np.diff(values) >= 0.0)


def test_a_guide_that_is_not_straight_neither_lifts_nor_turns_the_slider():
    d = Alone("guide_straightness", 1e-5).deviation()
    assert [bool(np.any(x)) for x in (d.travel_m, d.sideways_m, d.yaw_rad)] == [False, True, False]
    d = Alone("guide_angular", 1e-5).deviation()
    assert [bool(np.any(x)) for x in (d.travel_m, d.sideways_m, d.yaw_rad)] == [False, False, True]


@pytest.mark.parametrize("variant", ["exponential", "step", "logarithmic", "creep", "stick_slip"])
def test_a_foot_settles_after_its_onset_and_never_comes_back(variant):
    one = Alone("foundation_settling", 2e-5, variant=variant, onset_s=1000.0, tau_s=900.0, tilt_per_m=0.3)
    t = np.linspace(0.0, 1000.0 + 4.0 * 900.0, 300)
    sunk = -one.deviation(t_s=t).travel_m[:, 0]
    assert np.all(sunk[t < 1000.0] == 0.0)
    assert np.all(np.diff(sunk) >= -1e-18)
    assert 1.5e-5 < sunk[-1] < 2.5e-5


def test_a_column_leans_as_it_sinks():
    one = Alone("foundation_settling", 2e-5, variant="step", onset_s=0.0, tilt_per_m=0.5)
    d = one.deviation(t_s=5.0)
    lean = 0.5 * 2e-5
    assert d.yaw_rad[0, 0] == pytest.approx(lean)
    assert d.sideways_m[0, 0] == pytest.approx(lean * (HOME_M + FILE.struts[0].base_joint.imag + 1.2))
