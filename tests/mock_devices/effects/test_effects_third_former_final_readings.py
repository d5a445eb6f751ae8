"""Third former final forms of station, air and reflectors against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import HOME_M, Alone, sight_of


def test_motors_that_follow_the_machine_warm_the_station():
    one = Alone("tracker_drift", 1e-4, variant="tracking_heat", start_s=200.0)
    target = np.array([0.2, 3.0, 0.1])
    along_line = one.effect.weights[3:] @ target / np.linalg.norm(target)
    assert abs(along_line) > 1e-3

    def warmth(t_s):
        q = np.array([one.q])
        points = target[None, None]
        seen = sight_of(points)
        before = seen.distance_m.copy()
        one.effect.apply_to_sight(one.motion_states(t_s, q=q), seen)
        return float((seen.distance_m - before)[0, 0]) / (1e-4 / math.sqrt(2.0) * along_line)

    assert warmth(900.0) == 0.0
    heat, at_s = 0.0, 0.0
    one.t_s = 1000.0
    for drive, to_m, speed, rest_s in ((0, 1.5, 0.5, 30.0), (1, 0.8, 0.1, 300.0), (0, 0.9, 0.25, 0.0)):
        way_m = abs(to_m - one.q[drive])
        middle_s = one.t_s + 0.5 * way_m / speed
        heat, at_s = heat * math.exp(-(middle_s - at_s) / 900.0) + way_m / (0.04 * 900.0), middle_s
        one.move(drive, to_m, speed=speed, rest_s=rest_s)
        assert warmth(one.t_s) == pytest.approx(heat * math.exp(-(one.t_s - at_s) / 900.0))
    assert warmth(one.t_s + 900.0) == pytest.approx(warmth(one.t_s) / math.e)


def test_the_air_over_a_sunny_patch_bends_lines_upwards():
    one = Alone("refraction", 10.0, variant="sun_patch", start_s=300.0)
    crosses_s, wanders = one.effect.crosses_s, one.effect.wanders
    assert 3500.0 <= crosses_s <= 7000.0
    sides = {Alone("refraction", 10.0, variant="sun_patch", seed=k).effect.wanders for k in range(12)}
    assert sides == {-1.0, 1.0}
    points = np.array([[[-0.7, 3.0, 0.0], [0.0, 3.0, 0.0], [0.7, 3.0, 0.0], [0.36, 2.0, 0.5], [0.0, 3.0, -1.0]]])
    for share, at_m in ((0.0, -0.35), (0.5, 0.0), (1.0, 0.35)):
        seen = sight_of(points)
        hz, v, distance = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
        one.effect.apply_to_sight(one.motion_states(300.0 + share * crosses_s), seen)
        assert np.array_equal(seen.hz_rad, hz)
        assert np.array_equal(seen.distance_m, distance)
        for k, (x, _, z) in enumerate(points[0].tolist()):  # the line is halfway at half of each coordinate
            gradient = -10.0 * math.exp(-(((0.5 * x - wanders * at_m) / 0.18) ** 2)) * math.exp(-0.5 * z / 0.5)
            # Cooler above: light curves upwards, comes from below, and what is seen lies lower: v is larger.
            expected = -0.5 * 0.93e-6 * gradient * distance[0, k] * math.sin(v[0, k])
            assert (seen.v_rad - v)[0, k] == pytest.approx(expected, rel=1e-9, abs=1e-15)
    assert (seen.v_rad - v).max() > 1e-6


def test_a_reflector_on_a_stem_swings_after_every_stop():
    one = Alone("smr_reseat", 3e-5, place="P2", variant="ringing_stem", onset_s=100.0)
    stem_s, calms_s = one.effect.stem_s, one.effect.calms_s
    assert 3.0 <= stem_s <= 6.0
    assert 10.0 <= calms_s <= 20.0
    assert Alone("smr_reseat", 3e-5, variant="ringing_stem", seed=2).effect.stem_s != stem_s
    one.move(0, 1.3, speed=0.5)  # too early
    assert not np.any(one.deviation().smr_m)
    one.t_s = 200.0
    one.move(0, 1.0, speed=0.2, rest_s=0.0)
    ends_s = one.t_s
    assert not np.any(one.deviation(t_s=ends_s - 0.5, q=[[1.1, HOME_M]]).smr_m[0])  # under way
    # x'' + 2 x' / calms + (w^2 + 1 / calms^2) x = 0 from where the motion has left it, by a step of Newmark's kind.
    rate = 2.0 * math.pi / stem_s
    swing, speed, step, now_s = -2.0, 2.0 / calms_s, 1e-4, 0.0
    for wait_s in (0.0, 0.5 * stem_s, 7.0, 20.0):
        while now_s < wait_s:
            speed += step * (-2.0 / calms_s * speed - (rate**2 + calms_s**-2) * swing)
            swing, now_s = swing + step * speed, now_s + step
        moved = one.deviation(t_s=ends_s + wait_s).smr_m[0]
        assert moved[1, :2] == pytest.approx(3e-5 * swing * one.effect.shifts[0], abs=3e-8)
        assert not np.any(np.delete(moved, 1, axis=0))
    one.t_s = ends_s + 20.0
    one.move(1, HOME_M + 0.2, speed=0.1, rest_s=0.0)  # the other drive's stop adds to what is left
    left = -2.0 * math.exp(-22.0 / calms_s) * math.cos(rate * 22.0)
    assert one.deviation().smr_m[0, 1, :2] == pytest.approx(3e-5 * (1.0 + left) * one.effect.shifts[0], abs=1e-12)
