"""Faces of a station, a bellows, a cam, a gear: what their descriptions say, at points worked out by hand."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest

from mock_devices.effects import OUTSIDE, OUTSIDE_FINAL, SPECS
from tests.mock_devices.effects_bench import (
    HOME_M,
    Alone,
    Temperatures,
    assert_drawn_by_seed,
    assert_machine_in_space_has,
    sight_of,
)

NAMES = ("two_faces", "aneroid_bellows", "neighbours_cam", "rounded_ratio")
DRAWN = {"two_faces": "axis", "aneroid_bellows": "slack_hpa", "neighbours_cam": "cam_m"}


class Weather(Temperatures):
    """A pressure that rises and falls."""

    def pressure_series_hpa(self, t_s):
        return 990.0 + 0.3 * np.sin(np.asarray(t_s, dtype=float) / 1500.0)


def test_they_are_ordinary_ones():
    assert set(NAMES) <= set(OUTSIDE)
    assert not set(NAMES) & set(OUTSIDE_FINAL)
    assert {SPECS[name].final for name in NAMES} == {"cubic"}


def test_both_faces_of_a_station_err_to_opposite_sides():
    one = Alone("two_faces", 4e-5)
    axis = one.effect.axis
    assert 1.0 <= abs(axis) <= 3.0
    assert {math.copysign(1.0, Alone("two_faces", 4e-5, seed=k).effect.axis) for k in range(12)} == {-1.0, 1.0}
    points = np.array([[[0.4, 3.1, 0.0], [-0.5, 2.8, 0.6], [0.1, 3.0, -0.9]]])
    faces = []
    for exchanges in range(4):
        seen = sight_of(points)
        hz, v, before = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
        one.effect.apply_to_sight(one.motion_states(500.0, exchanges=exchanges), seen)
        assert np.array_equal(seen.v_rad, v)
        assert np.array_equal(seen.distance_m, before)
        faces.append((seen.hz_rad - hz)[0])
    for (x, y, h), off in zip(points[0].tolist(), faces[0].tolist(), strict=True):
        level, range_m = math.hypot(x, y), math.sqrt(x * x + y * y + h * h)
        # A beam that points aside by an angle, and an axis that leans: as far aside as either has it, over the level.
        aside_m = 4e-5 * range_m + 4e-5 * axis * h
        assert off == pytest.approx(aside_m / level, rel=1e-9)
    assert faces[1] == pytest.approx(-faces[0])
    assert faces[2] == pytest.approx(faces[0])
    assert faces[3] == pytest.approx(faces[1])


def test_a_closed_bellows_pulls_by_the_pressure_of_the_air():
    assert {Alone("aneroid_bellows", 300.0, seed=seed).effect.side for seed in range(12)} == {-1.0, 1.0}
    one = Alone("aneroid_bellows", 300.0, start_s=400.0, temperatures=Weather())
    side, slack_hpa = one.effect.side, one.effect.slack_hpa
    assert abs(slack_hpa) <= 0.05
    pulls = []
    for t_s in (400.0, 1900.0, 4000.0, 7000.0):
        change_hpa = 0.3 * (math.sin(t_s / 1500.0) - math.sin(400.0 / 1500.0))
        for at_m in (HOME_M, 0.7):
            ((points, forces),) = one.deviation(t_s=t_s, q=[[at_m, 1.2]]).loads
            assert points[0] == 0.1 - 0.2j
            assert forces[0] == pytest.approx(300.0 * side * (change_hpa - slack_hpa) / 0.1)
        pulls.append(forces[0].real * side)
    assert min(pulls) < -100.0 < 100.0 < max(pulls)


def test_a_cam_that_the_next_drive_turns_lifts_a_strut_in_waves():
    one = Alone("neighbours_cam", 3e-5, place="right_lower")
    cam_m = one.effect.cam_m
    assert 0.12 <= cam_m <= 0.3
    at = HOME_M + cam_m * np.arange(64) / 64.0
    d = one.deviation(t_s=np.zeros(64), q=np.stack([at, np.full(64, 0.8)], axis=1))
    whole = np.fft.fft(d.length_m[:, 3]) / 64.0
    assert 2.0 * abs(whole[1]) == pytest.approx(3e-5)
    assert np.abs(np.delete(whole, [1, 63])).max() < 1e-15  # a circle off its axis: one wave a turn
    assert not np.any(d.length_m[:, :3])
    assert not np.any(d.travel_m)
    own = one.deviation(t_s=np.zeros(64), q=np.stack([np.full(64, 0.8), at], axis=1)).length_m[:, 3]
    assert np.ptp(own) == 0.0


def test_what_an_electronic_gear_cannot_have_of_a_ratio_is_left_and_adds_up():
    teeth = {Alone("rounded_ratio", 3e-5, seed=k).effect.teeth for k in range(60)}
    assert teeth == set(range(3, 13))
    one = Alone("rounded_ratio", 3e-5, place="right")
    count, left, seen = one.effect.teeth, 0.0, []
    for k in range(60):
        own_m = (0.2, -0.13, 0.01, -0.2, 0.13, -0.01)[k % 6]
        lead_m = (0.311, 0.103, 0.01, -0.313, -0.117, 0.0)[k % 6]
        begins_s = one.t_s
        for drive, way_m in ((0, lead_m), (1, own_m)):
            if way_m:
                one.history.add(drive, begins_s, begins_s + 2.0, one.q[drive] + way_m, 0.2)
                one.q[drive] += way_m
        one.t_s = begins_s + 5.0
        if lead_m:
            nearest = min((Fraction(n, count) for n in range(-20, 21)), key=lambda r: abs(float(r) * lead_m - own_m))
            left += (float(nearest) * lead_m - own_m) / (0.5 / (2.0 * count))  # over the most when that way is 0.5 m
        d = one.deviation()
        assert d.travel_m[0] == pytest.approx([0.0, 3e-5 * left], abs=1e-12)
        seen.append(left)
    assert np.ptp(seen) > 0.3
    one.move(0, one.q[0] + 0.2)  # alone, and so not geared
    one.move(1, one.q[1] + 0.1)
    assert one.travel_m(drive=1) == pytest.approx(3e-5 * left, abs=1e-12)
    assert one.travel_m(drive=1, t_s=-1.0, q=[[HOME_M, HOME_M]]) == 0.0


@pytest.mark.parametrize("name", ["stewart6", "delta6"])
@pytest.mark.parametrize("effect", NAMES)
def test_machines_in_space_have_them(name, effect):
    assert_machine_in_space_has(effect, name, has=True)


@pytest.mark.parametrize("name", DRAWN)  # what a gear draws is whole and may be the same by chance
def test_the_same_seed_makes_the_same_of_them(name):
    assert_drawn_by_seed(name, DRAWN[name])
