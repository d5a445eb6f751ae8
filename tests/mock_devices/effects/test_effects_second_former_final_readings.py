"""Second former final forms of station, air and reflectors against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import HOME_M, Alone, sight_of


def test_a_fan_is_switched_between_two_temperatures():
    one = Alone("tracker_drift", 1e-4, variant="thermostat", start_s=200.0)
    cycle_s, runs = one.effect.cycle_s, one.effect.runs
    assert 600.0 <= cycle_s <= 1500.0
    assert 0.3 <= runs <= 0.6
    target = np.array([0.2, 3.0, 0.1])
    along_line = one.effect.weights[3:] @ target / np.linalg.norm(target)
    assert abs(along_line) > 1e-3
    # Warmth nears one level without the fan and another one with it; it is switched at 0 and 1.
    warms_s, cools_s = (1.0 - runs) * cycle_s, runs * cycle_s
    most = 1.0 - math.exp(-2.0)
    levels = {False: 1.0 / most, True: 1.0 - 1.0 / most}
    warm, fan, step, now_s, seen, switches = 0.0, False, 0.05, 0.0, [], []
    times = np.array([0.3, 0.9, 1.3, 1.95, 2.4, 3.1]) * cycle_s
    for until_s in times.tolist():
        while now_s < until_s:
            warm += step / (0.5 * (cools_s if fan else warms_s)) * (levels[fan] - warm)
            now_s += step
            if (warm >= 1.0) != fan and (warm >= 1.0 or warm <= 0.0):
                fan = not fan
                switches.append(now_s)
        seen.append(warm)
    off = one.distance_off_m(target, 200.0 + times)
    assert off == pytest.approx(1e-4 / math.sqrt(2.0) * along_line * np.array(seen), abs=2e-7)
    assert switches[1] == pytest.approx(cycle_s, rel=0.01)


def test_motions_mix_the_layers_and_rest_forms_them_anew():
    one = Alone("refraction", 10.0, variant="stirred")
    forms_s = one.effect.forms_s
    assert 500.0 <= forms_s <= 1500.0
    points = np.array([[[-0.5, 3.0, -0.4], [0.4, 2.0, 0.3]]])

    def bends(t_s):
        seen = sight_of(points)
        hz, v, distance = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
        one.effect.apply_to_sight(one.motion_states(t_s), seen)
        assert np.array_equal(seen.hz_rad, hz)
        assert np.array_equal(seen.distance_m, distance)
        left = (seen.v_rad - v)[0] / (-0.5 * 0.93e-6 * 10.0 * distance[0] * np.sin(v[0]))
        assert left[0] == pytest.approx(left[1])
        return float(left[0])

    assert bends(100.0) == pytest.approx(1.0)
    for k in range(30):
        one.move(0, HOME_M + 0.5 * (1 - k % 2), speed=100.0, rest_s=0.0)
    mixed = bends(one.t_s)
    assert mixed == pytest.approx(0.5 + 0.5 * math.exp(-15.0 / 15.0), rel=1e-3)  # half of it by either drive
    assert 1.0 - bends(one.t_s + forms_s) == pytest.approx((1.0 - mixed) / math.e, rel=1e-3)
    one.move(1, 1.6, speed=100.0, rest_s=0.0)
    assert bends(one.t_s) == pytest.approx(0.5 * math.exp(-1.0) + 0.5 * math.exp(-0.5 / 15.0), rel=2e-3)


def test_hard_stops_throw_a_ball_to_either_side_of_its_seat():
    one = Alone("smr_reseat", 3e-5, place="P2", variant="thrown_ball", onset_s=100.0)
    one.move(0, 1.3, speed=0.5)  # too early
    assert not np.any(one.deviation().smr_m)
    one.t_s = 200.0
    side = one.effect.shifts[0]
    now = 0.0
    for to_m, speed, drive, thrown in (
        (1.0, 0.5, 0, -1.0), (1.2, 0.1, 0, -1.0), (1.4, 0.5, 1, -1.0), (1.3, 0.25, 0, 1.0), (0.9, 0.15, 0, 1.0),
        (0.8, 0.5, 0, -1.0),
    ):  # fmt: skip
        underway = one.t_s + 0.5 * abs(to_m - one.q[drive]) / speed
        one.move(drive, to_m, speed=speed, rest_s=0.0)
        assert one.deviation(t_s=underway).smr_m[0, 1, :2] == pytest.approx(0.5 * 3e-5 * now * side)
        now = thrown
        moved = one.deviation().smr_m[0]
        assert moved[1, :2] == pytest.approx(0.5 * 3e-5 * now * side)
        assert not np.any(np.delete(moved, 1, axis=0))
        one.t_s += 5.0
    assert np.linalg.norm(side) == pytest.approx(1.0)
