"""Former final forms of station, air and reflectors against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import HOME_M, Alone, Temperatures, sight_of


def test_the_legs_of_a_stand_settle_with_the_logarithm_of_time():
    one = Alone("tracker_drift", 1e-4, variant="settling_legs", start_s=200.0)
    target = np.array([0.2, 3.0, 0.1])
    t = np.array([0.0, 60.0, 180.0, 3600.0, 60.0 * (61.0**2 - 1.0)])
    off = one.distance_off_m(target, 200.0 + t)
    along_line = one.effect.weights[3:] @ target / np.linalg.norm(target)
    steps = np.array([0.0, math.log(2.0), math.log(4.0), math.log(61.0), 2.0 * math.log(61.0)]) / math.log(61.0)
    assert off == pytest.approx(1e-4 / math.sqrt(2.0) * along_line * steps)
    assert abs(along_line) > 1e-3


def test_light_bends_towards_the_walls_while_they_are_colder():
    air = Temperatures(lambda t: np.where(t < 300.0, 20.0, 22.0))
    one = Alone("refraction", 10.0, variant="cold_walls", temperatures=air)
    walls_s = one.effect.walls_s
    assert 3000.0 <= walls_s <= 8000.0
    points = np.array([[[-0.5, 3.0, -0.4], [0.4, 2.0, 0.3]]])
    for t in (200.0, 600.0, 4000.0):
        seen = sight_of(points)
        hz, v, distance = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
        one.effect.apply_to_sight(one.motion_states(t), seen)
        colder_k = 2.0 * math.exp(-(t - 300.0) / walls_s) if t > 300.0 else 0.0
        gradient = 10.0 * colder_k / 1.5
        expected = 0.5 * 0.93e-6 * gradient * distance[0]  # half the curvature times the way
        assert (seen.hz_rad - hz)[0] == pytest.approx(expected, rel=0.01, abs=1e-12)
        assert np.array_equal(seen.v_rad, v)
        assert np.array_equal(seen.distance_m, distance)


def test_a_nest_moves_its_reflector_with_the_temperature_since_it_was_put_back():
    warmer = Temperatures(lambda t: 20.0 + t / 1000.0)
    one = Alone("smr_reseat", 3e-5, place="P2", variant="warm_nest", onset_s=1000.0, temperatures=warmer)
    t = np.array([0.0, 1000.0, 1250.0, 1500.0, 3000.0])
    moved = one.deviation(t_s=t, q=np.full((5, 2), HOME_M)).smr_m
    assert not np.any(np.delete(moved, 1, axis=1))
    assert not np.any(moved[:2])
    assert np.linalg.norm(moved[:, 1], axis=1) == pytest.approx(3e-5 * np.array([0.0, 0.0, 0.5, 1.0, 4.0]))
    assert moved[4, 1] == pytest.approx(4.0 * moved[3, 1])
    one.temperatures = Temperatures(lambda t: 22.0 - t / 1000.0)
    assert one.deviation(t_s=1500.0).smr_m[0, 1] == pytest.approx(-moved[3, 1])
