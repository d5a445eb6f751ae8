"""Fourth former final forms of station, air and reflectors against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import HOME_M, Alone, sight_of


def test_a_building_sways_in_two_waves_of_unrelated_periods():
    one = Alone("tracker_drift", 1e-4, variant="swaying_building", start_s=200.0)
    assert 600.0 <= one.effect.sways_s[0] <= 1300.0
    assert 1800.0 <= one.effect.sways_s[1] <= 3300.0
    assert np.linalg.norm(one.effect.sways, axis=1) == pytest.approx(np.full(2, math.sqrt(3.0)))
    other = Alone("tracker_drift", 1e-4, variant="swaying_building", seed=2).effect
    assert not np.any(other.sways_s == one.effect.sways_s)
    target = np.array([0.2, 3.0, 0.1])
    t = 200.0 + np.arange(0.0, 7200.0, 60.0)
    off = one.distance_off_m(target, t)
    turns = 2.0 * np.pi * (t - 200.0)[:, None] / one.effect.sways_s
    columns = np.column_stack([np.sin(turns), np.cos(turns)])
    found, *_ = np.linalg.lstsq(columns, off, rcond=None)
    assert columns @ found == pytest.approx(off, abs=1e-15)
    ahead = target / np.linalg.norm(target)  # a rotation about the station changes no range
    assert found[:2] == pytest.approx(1e-4 / math.sqrt(2.0) * one.effect.sways[:, 3:] @ ahead)
    assert found[2:] == pytest.approx(np.zeros(2), abs=1e-15)
    assert np.abs(found[:2]).min() > 1e-7


def test_lines_bend_around_puffs_of_warm_air_that_rise_across_them():
    one = Alone("refraction", 10.0, variant="warm_puffs", start_s=300.0)
    assert np.diff(one.effect.puffs_s).mean() == pytest.approx(60.0, rel=0.25)
    assert np.abs(one.effect.puffs_m).max() <= 0.35
    assert Alone("refraction", 10.0, variant="warm_puffs", seed=2).effect.puffs_s[0] != one.effect.puffs_s[0]
    points = np.array([[[-0.7, 3.0, 0.0], [0.1, 3.0, 0.0], [0.7, 3.0, -1.0], [0.36, 2.0, 0.5]]])

    def warmth(across_m, up_m, t_s):
        """Temperature of all puffs where a line is halfway; the steepest place of one has 10 K/m."""
        passes_s = 300.0 + one.effect.puffs_s + up_m / 0.1
        bells = np.exp(-(((across_m - one.effect.puffs_m) / 0.15) ** 2) - ((t_s - passes_s) / 20.0) ** 2)
        return 10.0 * 0.15 * math.sqrt(0.5 * math.e) * float(bells.sum())

    bent = []
    for t_s in 300.0 + one.effect.puffs_s[:6]:
        seen = sight_of(points)
        hz, v, distance = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
        one.effect.apply_to_sight(one.motion_states(t_s), seen)
        assert np.array_equal(seen.v_rad, v)
        assert np.array_equal(seen.distance_m, distance)
        for k, (x, _, z) in enumerate(points[0].tolist()):
            step = 1e-4
            gradient = (warmth(0.5 * x + step, 0.5 * z, t_s) - warmth(0.5 * x - step, 0.5 * z, t_s)) / (2.0 * step)
            # Light is concave towards what is colder, so that all seems to lie towards what is warmer.
            expected = 0.5 * 0.93e-6 * gradient * distance[0, k]
            assert (seen.hz_rad - hz)[0, k] == pytest.approx(expected, rel=1e-5, abs=1e-13)
            bent.append(expected)
    assert np.abs(bent).max() > 2e-6


def test_a_reflector_sags_in_its_grease_while_all_drives_rest():
    one = Alone("smr_reseat", 3e-5, place="P2", variant="sagging_grease", onset_s=100.0)
    grease_s = one.effect.grease_s
    assert 4.0 <= grease_s <= 15.0
    assert Alone("smr_reseat", 3e-5, variant="sagging_grease", seed=2).effect.grease_s != grease_s
    one.move(0, 1.3, rest_s=30.0)  # too early
    assert not np.any(one.deviation().smr_m)
    one.t_s = 200.0
    for drive, to_m in ((0, 1.0), (1, 1.5), (0, 1.2)):
        one.move(drive, to_m, speed=0.1, rest_s=0.0)
        sagged, step, now_s = 0.0, 1e-3, 0.0
        for rest_s in (0.0, 2.0, 9.0, 40.0):
            while now_s < rest_s - 0.5 * step:  # Bingham: flow goes with what the grease does not bear yet
                sagged, now_s = sagged + step / grease_s * (1.0 - sagged), now_s + step
            moved = one.deviation(t_s=one.t_s + rest_s).smr_m[0]
            assert moved[1, :2] == pytest.approx(3e-5 * sagged * one.effect.shifts[0], abs=3e-9)
            assert not np.any(np.delete(moved, 1, axis=0))
        assert np.hypot(*moved[1, :2]) > 2.7e-5
        one.t_s += 50.0
    assert not np.any(one.deviation(t_s=one.t_s - 51.0, q=[[1.1, HOME_M]]).smr_m)  # under way
