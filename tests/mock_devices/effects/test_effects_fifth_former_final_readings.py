"""Fifth former final forms of station, air and reflectors against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, sight_of


def test_a_station_stands_in_the_hollows_under_both_columns():
    one = Alone("tracker_drift", 1e-4, variant="carriages_weight", start_s=200.0)
    hollows = one.effect.hollows
    assert np.linalg.norm(hollows, axis=1) == pytest.approx(np.full(2, math.sqrt(3.0)))
    assert not np.any(Alone("tracker_drift", 1e-4, variant="carriages_weight", seed=2).effect.hollows == hollows)
    low, high = FILE.sliders[0].travel_m
    points = np.array([[[0.2, 3.0, 0.1], [-0.5, 2.8, 0.4]]])
    for q, payload_kg in (((high, high), 400.0), ((low, high), 0.0), ((high, low), 300.0), ((0.9, 1.2), 150.0)):
        seen = sight_of(points)
        before = seen.distance_m.copy(), seen.hz_rad.copy()
        one.effect.apply_to_sight(one.motion_states(5000.0, q=[q], payload_kg=payload_kg), seen)
        bears = np.array([(high - at) / (high - low) * (150.0 + payload_kg) / 150.0 for at in q])
        turn, shift = (1e-4 / math.sqrt(2.0) * bears @ hollows[:, part] for part in (slice(0, 3), slice(3, 6)))
        moved = points + np.cross(turn / 3.2, points) + shift
        assert seen.distance_m - before[0] == pytest.approx(
            np.linalg.norm(moved, axis=-1) - np.linalg.norm(points, axis=-1), abs=2e-8
        )
        expected_rad = np.arctan2(moved[..., 0], moved[..., 1]) - np.arctan2(points[..., 0], points[..., 1])
        assert seen.hz_rad - before[1] == pytest.approx(expected_rad, abs=1e-8)
    assert np.abs(expected_rad).max() > 5e-7


def test_a_layer_that_heaves_bends_the_lines_in_its_period():
    one = Alone("refraction", 10.0, variant="heaving_layers", start_s=300.0)
    heaves_s, begins = one.effect.heaves_s, one.effect.heaves_at
    assert 100.0 <= heaves_s <= 300.0
    assert Alone("refraction", 10.0, variant="heaving_layers", seed=2).effect.heaves_s != heaves_s
    points = np.array([[[-0.7, 3.0, 0.0], [0.1, 3.0, 0.5], [0.7, 3.0, -0.6]]])
    along = (np.arange(2000) + 0.5) / 2000.0
    bent = []
    for t_s in (300.0, 300.0 + 0.3 * heaves_s, 300.0 + 0.7 * heaves_s, 300.0 + 1.7 * heaves_s):
        seen = sight_of(points)
        hz, v, distance = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
        one.effect.apply_to_sight(one.motion_states(t_s), seen)
        assert np.array_equal(seen.hz_rad, hz)
        assert np.array_equal(seen.distance_m, distance)
        middle_m = 0.25 + 0.25 * math.sin(2.0 * math.pi * (t_s - 300.0) / heaves_s + begins)
        for k, height_m in enumerate(points[0, :, 2].tolist()):
            gradient = 10.0 / np.cosh((height_m * along - middle_m) / 0.2) ** 2
            # A bend nearer the station counts by how much of the line is behind it.
            expected = -0.93e-6 * distance[0, k] * np.mean((1.0 - along) * gradient) * math.sin(v[0, k])
            assert (seen.v_rad - v)[0, k] == pytest.approx(expected, rel=1e-3, abs=1e-9)
        bent.append((seen.v_rad - v)[0])
    assert bent[3] == pytest.approx(bent[2], rel=1e-9)
    assert np.abs(bent[1] - bent[2]).max() > 2e-6


def test_a_reflector_lies_anywhere_in_its_seat_after_each_motion():
    one = Alone("smr_reseat", 3e-5, place="P2", variant="rattling", onset_s=100.0)
    one.move(0, 1.3)  # too early
    assert not np.any(one.deviation(t_s=99.0).smr_m)
    one.t_s = 200.0
    places = []
    for k in range(500):
        one.move(k % 2, HOME_M + 0.1 * (k // 2 % 2 + 1), rest_s=5.0)
        moved = one.deviation().smr_m[0]
        assert not np.any(np.delete(moved, 1, axis=0))
        assert moved[1, 2] == 0.0
        assert np.array_equal(one.deviation(t_s=one.t_s + 30.0).smr_m[0], moved)  # it stays until the next one
        places.append(moved[1, :2])
    at = np.array(places) / 3e-5
    radii = np.hypot(*at.T)
    assert radii.max() <= 1.0
    assert len(np.unique(at[:, 0])) == 500
    assert np.mean(radii**2) == pytest.approx(0.5, abs=0.05)  # even over the seat
    assert at.mean(axis=0) == pytest.approx(np.zeros(2), abs=0.1)
    assert abs(np.corrcoef(at[:-1, 0], at[1:, 0])[0, 1]) < 0.15
    assert np.array_equal(Alone("smr_reseat", 3e-5, variant="rattling").effect.spots, one.effect.spots)
    assert not np.any(Alone("smr_reseat", 3e-5, variant="rattling", seed=2).effect.spots == one.effect.spots)
