"""Final forms of station, air and reflectors against their publications, at points worked out by hand."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from tests.mock_devices.effects_bench import Alone, sight_of

SPOTS = np.array([[[0.2, 3.0, 0.1], [-0.5, 2.8, 0.4]]])


def changed(one, t_s, points=SPOTS, **kinds):
    """What one effect changes of both angles and the range (3, smrs)."""
    seen = sight_of(points)
    before = [x.copy() for x in (seen.hz_rad, seen.v_rad, seen.distance_m)]
    one.effect.apply_to_sight(one.motion_states(t_s, **kinds), seen)
    return np.array([now - then for now, then in zip((seen.hz_rad, seen.v_rad, seen.distance_m), before, strict=True)])[
        :, 0
    ]


def test_payloads_beside_the_station_let_it_lean_by_what_is_not_on_the_platform():
    one = Alone("tracker_drift", 1e-4, variant="stored_payloads", start_s=60.0)
    weights = one.effect.weights
    assert not np.array_equal(weights, Alone("tracker_drift", 1e-4, variant="stored_payloads", seed=2).effect.weights)
    assert np.linalg.norm(weights) == pytest.approx(math.sqrt(3.0))
    for payload_kg in (0.0, 100.0, 400.0):
        stored = (400.0 - payload_kg) / 400.0
        turn, shift = (1e-4 / math.sqrt(2.0) * stored * weights[part] for part in (slice(0, 3), slice(3, 6)))
        moved = SPOTS + np.cross(turn / 3.2, SPOTS) + shift
        for t_s in (60.0, 7000.0):
            hz, _, distance = changed(one, t_s, payload_kg=payload_kg)
            expected_hz = np.arctan2(moved[..., 0], moved[..., 1]) - np.arctan2(SPOTS[..., 0], SPOTS[..., 1])
            expected_m = np.linalg.norm(moved, axis=-1) - np.linalg.norm(SPOTS, axis=-1)
            assert hz == pytest.approx(expected_hz[0], rel=1e-3, abs=2e-9)
            assert distance == pytest.approx(expected_m[0], rel=1e-3, abs=2e-9)


def warmth(x, z):
    """Of a tube of air, over that in its middle."""
    return np.exp(-(x**2 + z**2) / 0.18**2)


def test_light_bends_outwards_beside_a_tube_of_warm_air():
    one = Alone("refraction", 10.0, variant="gas_lens")
    middle = one.effect.tube_m
    others = np.array([Alone("refraction", 10.0, variant="gas_lens", seed=k).effect.tube_m for k in range(20)])
    assert np.all(np.abs(others[:, 0]) <= 0.25)
    assert np.all((others[:, 1] >= -0.2) & (others[:, 1] <= 0.3))
    assert len(set(others[:, 0])) == 20
    offsets = np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1], [-0.127, 0.0], [-0.1, -0.2], [0.3, 0.25]])
    points = np.array([[[2.0 * (middle[0] + x), 3.0, 2.0 * (middle[1] + z)] for x, z in offsets]])
    hz, v, distance = changed(one, 500.0, points)
    assert not np.any(distance)
    range_m = np.linalg.norm(points[0], axis=1)
    # The tube's warmth is a bell; the refractive index grows as the air cools, and light bends to where it is larger.
    steepest = max(-np.gradient(warmth(np.linspace(0.0, 0.5, 5001), 0.0), 1e-4))
    step = 1e-6
    for k, (x, z) in enumerate(offsets.tolist()):
        across = (warmth(x + step, z) - warmth(x - step, z)) / (2.0 * step) / steepest * 10.0
        up = (warmth(x, z + step) - warmth(x, z - step)) / (2.0 * step) / steepest * 10.0
        curves = -0.93e-6 * np.array([across, up])  # towards positive x and upwards
        leaves = (
            -0.5 * curves * range_m[k]
        )  # a chord's end: it seems to lie on the side from which the light bends away
        assert hz[k] == pytest.approx(leaves[0], abs=1e-9)
        assert v[k] == pytest.approx(-leaves[1] * math.hypot(*points[0, k, :2]) / range_m[k], abs=1e-9)
    assert hz[1] < 0.0 < hz[3]  # a lens that spreads: what is seen beside its middle seems nearer to that
    assert np.abs(hz).max() == pytest.approx(0.5 * 0.93e-6 * 10.0 * range_m[3], rel=1e-3)
    assert np.array_equal(changed(one, 5000.0, points, payload_kg=300.0), [hz, v, distance])


def test_a_reflector_beside_its_stem_is_turned_on_at_each_exchange():
    one = Alone("smr_reseat", 3e-5, place="P2", variant="turned_on", onset_s=100.0, start_s=60.0)
    turned = one.effect.turned_rad
    others = [Alone("smr_reseat", 3e-5, variant="turned_on", seed=k).effect.turned_rad for k in range(16)]
    assert {math.copysign(1.0, x) for x in others} == {-1.0, 1.0}
    assert 0.5 <= min(np.abs(others)) < max(np.abs(others)) <= 2.6
    assert not np.any(one.deviation(t_s=159.0, exchanges=3).smr_m)
    moved = []
    for exchanges in range(8):
        d = one.deviation(t_s=161.0 + 50.0 * exchanges, exchanges=exchanges).smr_m[0]
        assert not np.any(np.delete(d, 1, axis=0))
        assert d[1, 2] == 0.0
        moved.append(d[1, :2])
    turn = np.array([[math.cos(turned), -math.sin(turned)], [math.sin(turned), math.cos(turned)]])
    for before, after in pairwise(moved):
        assert after == pytest.approx(turn @ before, abs=1e-17)
        assert np.linalg.norm(after) == pytest.approx(3e-5)
