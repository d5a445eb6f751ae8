"""Seventh former final forms of station, air and reflectors against publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import Alone, Temperatures, drawn, sight_of

SPOTS = np.array([[[0.2, 3.0, 0.1], [-0.5, 2.8, 0.4]]])


def changed(one, t_s, points=SPOTS):
    """What one effect changes of both angles and the range (3, smrs)."""
    seen = sight_of(points)
    before = [x.copy() for x in (seen.hz_rad, seen.v_rad, seen.distance_m)]
    one.effect.apply_to_sight(one.motion_states(t_s), seen)
    return np.array([now - then for now, then in zip((seen.hz_rad, seen.v_rad, seen.distance_m), before, strict=True)])[
        :, 0
    ]


def test_a_level_swings_up_until_its_limits_hold_it():
    level_s = drawn("tracker_drift", "hunting_level", "level_s", low=300.0, high=900.0)
    grows_s = drawn("tracker_drift", "hunting_level", "grows_s", low=400.0, high=1200.0)
    one = Alone("tracker_drift", 1e-4, variant="hunting_level", start_s=60.0)
    weights = one.effect.weights
    swing, now_s, step, swings = 0.05, 0.0, 0.05, []
    for k in range(12):
        after_s = (k + 0.25 + 0.5 * (k % 2)) * level_s  # at one end of a swing or at the other
        while now_s < after_s - 0.5 * step:
            swing, now_s = swing + step / grows_s * swing * (1.0 - swing**2), now_s + step
        side = 1.0 if k % 2 == 0 else -1.0
        turn, shift = (1e-4 / math.sqrt(2.0) * swing * side * weights[part] for part in (slice(0, 3), slice(3, 6)))
        moved = SPOTS + np.cross(turn / 3.2, SPOTS) + shift
        expected = [
            np.arctan2(moved[..., 0], moved[..., 1]) - np.arctan2(SPOTS[..., 0], SPOTS[..., 1]),
            np.linalg.norm(moved, axis=-1) - np.linalg.norm(SPOTS, axis=-1),
        ]
        hz, _, distance = changed(one, 60.0 + after_s)
        assert hz == pytest.approx(expected[0][0], rel=1e-2, abs=1e-9)
        assert distance == pytest.approx(expected[1][0], rel=1e-2, abs=1e-9)
        swings.append(swing)
    assert swings[0] < 0.15
    assert swings[-1] > 0.9
    assert changed(one, 60.0) == pytest.approx(np.zeros((3, 2)), abs=1e-18)


def test_a_layer_swings_up_on_one_side_and_down_on_the_other():
    tilts_s = drawn("refraction", "tilting_layer", "tilts_s", low=150.0, high=600.0)
    one = Alone("refraction", 10.0, variant="tilting_layer", start_s=300.0)
    points = np.array([[[x, 3.0, h] for x in (-0.6, 0.0, 0.6) for h in (0.0, 0.5)]])
    nodes = (np.arange(4000) + 0.5) / 4000.0
    courses = []
    for k in range(8):
        t_s = 300.0 + k / 8.0 * tilts_s
        hz, v, distance = changed(one, t_s, points)
        assert not np.any(hz)
        assert not np.any(distance)
        slope = 0.8 * math.sin(2.0 * math.pi * k / 8.0 + one.effect.tilts_at)
        for (x, level, h), bent in zip(points[0], v, strict=True):
            over = nodes * h - nodes * x * slope - 0.25  # of every part of the line above the layer's middle there
            gradient = float(np.mean(2.0 * (1.0 - nodes) / np.cosh(over / 0.2) ** 2))
            range_m = math.sqrt(x * x + level * level + h * h)
            curved = 0.5 * -0.93e-6 * 10.0 * range_m * gradient * math.hypot(x, level) / range_m
            assert bent == pytest.approx(curved, rel=1e-3)
        courses.append(v)
    courses = np.array(courses)
    assert courses[:4] == pytest.approx(
        courses[4:, [4, 5, 2, 3, 0, 1]], rel=1e-9
    )  # the other way round half a swing on
    assert np.ptp(courses[:, 1]) > 1e-6
    assert np.ptp(courses[:, 2]) < 1e-12  # right before the station it does not go up or down


def test_a_disc_clicks_to_one_side_as_it_is_warmed_and_to_the_other_as_it_cools():
    clicks_k = drawn("smr_reseat", "clicking_disc", "clicks_k", low=0.02, high=0.1)
    back_k = drawn("smr_reseat", "clicking_disc", "back_k", low=-0.1, high=-0.02)
    swing = Temperatures(lambda t: 21.0 + np.maximum(t - 160.0, 0.0) ** 0.5 / 300.0 * np.sin((t - 160.0) / 600.0))
    one = Alone(
        "smr_reseat", 3e-5, place="P2", variant="clicking_disc", onset_s=100.0, start_s=60.0, temperatures=swing
    )
    assert not np.any(one.deviation(t_s=159.0).smr_m)
    side, seen, places = 0.0, [], {}
    for after_s in np.arange(15.0, 9000.0, 30.0).tolist():  # half a step of its clock later than it looks
        warmer_k = math.sqrt(after_s - 15.0) / 300.0 * math.sin((after_s - 15.0) / 600.0)
        if warmer_k > clicks_k or warmer_k < back_k:
            side = math.copysign(1.0, warmer_k)
        moved = one.deviation(t_s=160.0 + after_s).smr_m[0]
        assert not np.any(np.delete(moved, 1, axis=0))
        assert np.linalg.norm(moved[1]) == pytest.approx(3e-5 * abs(side))
        assert moved[1] == pytest.approx(places.setdefault(side, moved[1].copy()), abs=1e-18)
        seen.append(side)
    assert places[1.0] == pytest.approx(-places[-1.0])
    assert seen[0] == 0.0
    assert sum(np.diff(seen) != 0.0) >= 4
