"""Further forms of station, air and reflectors against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import HOME_M, Alone, sight_of


def test_every_motion_shakes_the_station_a_little_further():
    one = Alone("tracker_drift", 1e-4, variant="shaken_stand")
    target = np.array([0.2, 3.0, 0.1])

    def off():
        points = target[None, None]
        seen = sight_of(points)
        before = seen.distance_m.copy()
        one.effect.apply_to_sight(one.motion_states(), seen)
        return float((seen.distance_m - before)[0, 0])

    assert off() == 0.0
    one.move(0, 1.3, speed=0.5)
    first = off()
    assert first != 0.0
    one.move(1, 0.9, speed=0.25)
    assert off() == pytest.approx(1.25 * first)
    one.move(1, 0.9, speed=0.5)  # no motion
    one.t_s += 5000.0
    assert off() == pytest.approx(1.25 * first)
    for k in range(10):
        one.move(0, 1.0 if k % 2 == 0 else 1.01, speed=0.5)  # energy, not distance
    assert off() == pytest.approx(11.25 * first)
    along_line = one.effect.weights[3:] @ target / np.linalg.norm(target)
    assert first == pytest.approx(1e-4 / math.sqrt(2.0) * 0.25 / 40.0 * along_line)


def test_a_front_of_warm_air_sinks_through_the_lines_of_sight():
    gradient = 10.0
    one = Alone("refraction", gradient, variant="filling_box")
    fills_s = one.effect.fills_s
    assert 600.0 <= fills_s <= 2500.0
    heights = np.array([-0.4, 0.0, 0.4])
    points = np.stack([np.zeros(3), np.full(3, 3.0), heights], axis=1)[None]
    for t in (0.0, 1000.0, 3000.0, 20000.0):
        seen = sight_of(points)
        level, distance = seen.v_rad.copy(), seen.distance_m.copy()
        one.effect.apply_to_sight(one.motion_states(t), seen)
        front = -1.5 + 4.0 * (1.0 + t / fills_s) ** -1.5
        s = (np.arange(4000) + 0.5) / 4000.0
        h = np.outer(s, heights)
        slope = 1.0 / np.cosh((h - front) / 0.25) ** 2 + 0.15 * (1.0 + np.tanh((h - front) / 0.25))
        mean = np.mean(2.0 * (1.0 - s)[:, None] * slope, axis=0)  # what bends near the station counts most
        expected = -0.5 * 0.93e-6 * gradient * mean * distance[0] * np.sin(level[0])
        assert (seen.v_rad - level)[0] == pytest.approx(expected, rel=2e-3, abs=1e-12)
        assert np.array_equal(seen.distance_m, distance)
    # As the volume below the front is drawn into the plume, it empties ever more slowly.
    z = [(1.0 + t) ** -1.5 for t in (0.0, 1e-4, 1.0, 1.0 + 1e-4)]
    rates = np.array([z[1] - z[0], z[3] - z[2]]) / 1e-4
    assert rates / np.array([1.0, z[2] ** (5.0 / 3.0)]) == pytest.approx([-1.5, -1.5], rel=1e-3)


def test_a_holder_slides_at_stops_that_are_too_hard_for_its_magnet():
    one = Alone("smr_reseat", 3e-5, place="P2", variant="sliding_holder", onset_s=40.0)

    def shift():
        moved = one.deviation().smr_m[0]
        assert not np.any(np.delete(moved, 1, axis=0))
        return moved[1, :2]

    one.move(0, HOME_M + 0.4, speed=0.5)
    assert not np.any(shift())  # before the onset
    one.t_s = 50.0
    one.move(0, HOME_M, speed=0.2)
    assert not np.any(shift())  # the magnet holds
    one.move(0, HOME_M + 0.1, speed=0.4)
    once = shift()
    assert np.linalg.norm(once) == pytest.approx(3e-5 * 3.0 / 300.0)
    one.move(1, HOME_M - 0.3, speed=0.4)  # down its face at any stop
    assert shift() == pytest.approx(2.0 * once)
    one.t_s += 5000.0
    assert shift() == pytest.approx(2.0 * once)
