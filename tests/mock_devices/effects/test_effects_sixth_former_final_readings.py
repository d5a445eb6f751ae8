"""Sixth former final forms of station, air and reflectors against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import HOME_M, Alone, Temperatures, sight_of


def test_feet_of_a_station_follow_the_air_once_their_friction_is_overcome():
    swing = Temperatures(lambda t: 21.0 + np.sin(np.maximum(t - 60.0, 0.0) / 900.0))
    one = Alone("tracker_drift", 1e-4, variant="dragged_feet", start_s=60.0, temperatures=swing)
    holds_k, weights = one.effect.holds_k, one.effect.weights
    assert 0.1 <= holds_k <= 0.4
    assert Alone("tracker_drift", 1e-4, variant="dragged_feet", seed=2).effect.holds_k != holds_k
    points = np.array([[[0.2, 3.0, 0.1], [-0.5, 2.8, 0.4]]])
    turns = np.array([0.02, 0.3, 1.0, 1.5, 1.7, 2.5, 4.0, 5.0, 6.5])  # of the air, in radians of its sine
    followed = []
    for turn in turns:
        seen = sight_of(points)
        before = seen.distance_m.copy(), seen.hz_rad.copy()
        one.effect.apply_to_sight(one.motion_states(60.0 + 900.0 * turn), seen)
        feet = 0.0  # they are pulled along, always by as little as friction allows
        for warmer in np.sin(np.linspace(0.0, turn, 4000)):
            if abs(warmer - feet) > holds_k:
                feet = warmer - math.copysign(holds_k, warmer - feet)
        turn_rad, shift = (1e-4 / math.sqrt(2.0) * 3.0 * feet * weights[part] for part in (slice(0, 3), slice(3, 6)))
        moved = points + np.cross(turn_rad / 3.2, points) + shift
        expected_m = np.linalg.norm(moved, axis=-1) - np.linalg.norm(points, axis=-1)
        assert seen.distance_m - before[0] == pytest.approx(expected_m, rel=2e-2, abs=1e-7)
        expected_rad = np.arctan2(moved[..., 0], moved[..., 1]) - np.arctan2(points[..., 0], points[..., 1])
        assert seen.hz_rad - before[1] == pytest.approx(expected_rad, rel=2e-2, abs=1e-7)
        followed.append(feet)
    assert followed[0] == 0.0
    assert followed[4] == pytest.approx(1.0 - holds_k, abs=0.01)  # stays where it is as the air turns
    assert min(followed) == pytest.approx(holds_k - 1.0, abs=0.06)


def test_rolls_of_air_bend_lines_this_way_and_that():
    one = Alone("refraction", 10.0, variant="convection_cells", start_s=300.0)
    rolls_m, wanders_s = one.effect.rolls_m, one.effect.wanders_s
    assert 0.15 <= rolls_m <= 0.3
    assert 2500.0 <= wanders_s <= 6000.0
    assert Alone("refraction", 10.0, variant="convection_cells", seed=2).effect.rolls_m != rolls_m
    across = np.linspace(0.0, 2.0 * rolls_m, 48, endpoint=False)  # twice as wide there as halfway
    points = np.stack([across, np.full(48, 3.0), np.tile([0.0, 0.4], 24)], axis=1)[None]
    phases = []
    for t_s in (300.0, 300.0 + 0.25 * wanders_s, 300.0 + wanders_s):
        seen = sight_of(points)
        hz, v, distance = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
        one.effect.apply_to_sight(one.motion_states(t_s), seen)
        assert np.array_equal(seen.v_rad, v)
        assert np.array_equal(seen.distance_m, distance)
        bent = ((seen.hz_rad - hz) / distance)[0]
        wave = np.fft.rfft(bent) / 24.0
        assert abs(wave[1]) == pytest.approx(0.5 * 0.93e-6 * 10.0)
        assert np.abs(np.delete(wave, 1)).max() < 1e-12
        phases.append(np.angle(wave[1]))
    assert math.remainder(phases[1] - phases[0] - 0.5 * math.pi, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)
    assert math.remainder(phases[2] - phases[0], 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)


def test_a_reflector_beside_its_seat_creeps_home_as_drives_shake_it():
    one = Alone("smr_reseat", 3e-5, place="P2", variant="creeps_home", onset_s=100.0)
    home_m = one.effect.home_m
    assert 12.0 <= home_m <= 40.0
    assert Alone("smr_reseat", 3e-5, variant="creeps_home", seed=2).effect.home_m != home_m
    one.move(0, 1.5)  # too early
    assert not np.any(one.deviation(t_s=99.0).smr_m)
    one.t_s = 200.0
    put = one.deviation().smr_m[0, 1]
    assert np.hypot(*put[:2]) == pytest.approx(3e-5)
    left = 1.0
    for k in range(80):
        to_m = HOME_M + 0.3 * (1 - 2 * (k // 2 % 2))
        for _ in range(100):  # every part of the way takes a share
            left -= left * abs(to_m - one.q[k % 2]) / 100.0 / home_m
        one.move(k % 2, to_m, speed=(0.5, 0.1)[k % 3 % 2], rest_s=5.0)
        moved = one.deviation().smr_m[0]
        assert moved[1] == pytest.approx(left * put, rel=2e-2, abs=1e-12)
        assert not np.any(np.delete(moved, 1, axis=0))
        assert np.array_equal(one.deviation(t_s=one.t_s + 60.0).smr_m[0], moved)  # at rest it stays
    assert left < 0.4
