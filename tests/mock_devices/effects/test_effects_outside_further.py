"""Cables, threads, beams and platforms outside the catalogue: what descriptions say, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.recordings.design import nominal_drives
from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, sight_of


def test_a_cable_that_is_too_short_pulls_only_where_it_is_taut():
    one = Alone("short_tether", 300.0)
    holder, tied = complex(-1.2 + 0.25, 0.3 + 0.3), -0.1 + 0.2j
    places = [complex(x, y) for x in (-0.35, 0.0, 0.35) for y in (-0.3, 0.0, 0.3)]
    q = [nominal_drives(FILE, place) for place in places]
    d = one.deviation(t_s=np.zeros(9), q=q)
    ((point, force),) = d.loads
    way = holder - np.array(places) - tied
    longest = abs(holder - (0.35 - 0.3j) - tied)
    expected = 300.0 * np.maximum(np.abs(way) / longest - 0.8, 0.0) / 0.2 * way / np.abs(way)
    assert point == pytest.approx(np.full(9, tied))
    assert force == pytest.approx(expected, abs=1e-6)
    assert np.abs(force).max() == pytest.approx(300.0)
    assert np.sum(np.abs(force) == 0.0) >= 3
    before = force
    one.move(0, 1.3)
    assert np.array_equal(one.deviation(t_s=np.full(9, one.t_s), q=q).loads[0][1], before)  # no side, no time


def test_a_thread_creeps_with_every_wide_swing_and_with_no_small_one():
    one = Alone("creeping_thread", 5e-5, place="right_lower")
    assert not np.any(one.deviation().length_m)
    for k in range(20):
        one.move(1, HOME_M + (0.3 if k % 2 == 0 else 0.0), speed=0.1 + 0.02 * k)
        one.move(1, one.q[1] + 0.01)  # sticks
        one.move(1, HOME_M + (0.3 if k % 2 == 0 else 0.0))
        one.move(0, HOME_M + (0.3 if k % 2 == 0 else 0.0))  # another strut's
    grown = one.deviation().length_m[0]
    assert grown[3] == pytest.approx(5e-5 * 20 / 100.0)
    assert not np.any(grown[:3])
    one.t_s += 5000.0
    assert np.array_equal(one.deviation().length_m[0], grown)


def test_a_wire_before_the_station_pushes_the_beam_s_middle_away():
    one = Alone("clipped_beam", 2e-5)
    wire = one.effect.wire_rad
    assert -0.06 <= wire <= 0.06
    assert Alone("clipped_beam", 2e-5, seed=2).effect.wire_rad != wire
    at = wire + 0.015 * np.array([-6.0, -1.0, 0.0, 1.0, 2.0])
    points = np.stack([3.0 * np.sin(at), 3.0 * np.cos(at), np.full(5, 0.2)], axis=1)[None]
    seen = sight_of(points)
    hz, v, distance = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
    one.effect.apply_to_sight(one.motion_states(0.0), seen)
    off = (seen.hz_rad - hz)[0]
    assert off == pytest.approx(2e-5 * np.array([0.0, -1.0, 0.0, 1.0, 2.0 * math.exp(-1.5)]), abs=1e-11)
    assert np.array_equal(seen.v_rad, v)
    assert np.array_equal(seen.distance_m, distance)


def test_a_platform_sags_as_a_beam_between_its_joints():
    one = Alone("sagging_platform", 4e-5)
    own, d = one.deviation(), one.deviation(payload_kg=125.0)  # half of 150 kg and 400 kg
    assert own.smr_m == pytest.approx(d.smr_m * 150.0 / 275.0)
    names = [smr.name for smr in FILE.smrs]
    # E I w'' = M of a force F in the middle of 2 a, integrated twice in small steps from the middle outwards.
    a, n = 0.2, 20000
    x = (np.arange(n) + 0.5) * a / n
    slope = np.cumsum(a - x)
    sag = np.cumsum(slope[::-1])[::-1] / np.sum(slope)  # over that in the middle
    lean = slope[-1] / np.sum(slope) / (a / n)
    middle, end = d.smr_m[0, names.index("P3")], d.smr_m[0, names.index("P2")]
    assert middle == pytest.approx([0.0, -2e-5, 0.0], abs=1e-12)
    assert end[1] == pytest.approx(0.0, abs=1e-12)
    assert end[0] == pytest.approx(0.0, abs=1e-12)  # P2 lies in the neutral line
    joints = d.platform_joint_m[0]
    assert joints.imag == pytest.approx(np.zeros(4), abs=1e-12)
    turned = 2e-5 * lean
    assert joints.real == pytest.approx(turned * np.array([0.245, -0.005, -0.245, 0.005]), rel=1e-3)
    assert sag[n // 2] == pytest.approx(1.0 - 1.5 * 0.25 + 0.5 * 0.125, rel=1e-3)


def test_both_columns_lean_outwards_with_the_root_of_time():
    one = Alone("damp_granite", 1e-5)
    spilt_s = one.effect.moments_s[0]
    t = spilt_s + np.array([-10.0, 0.0, 900.0, 3600.0, 14400.0])
    d = one.deviation(t_s=t, q=np.full((5, 2), HOME_M))
    assert d.yaw_rad[:, 0] == pytest.approx([0.0, 0.0, 0.5e-5, 1e-5, 2e-5], abs=1e-15)
    assert d.yaw_rad[:, 1] == pytest.approx(-d.yaw_rad[:, 0])
    height = HOME_M + 0.125 + 1.2
    tops = d.sideways_m * np.array([slider.axis * 1j for slider in FILE.sliders]).real  # along x
    assert tops[3] == pytest.approx([-1e-5 * height, 1e-5 * height])
    assert not np.any(d.travel_m)
