"""A floor that mirrors, a hook, a stay, switched gains: what their descriptions say, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import OUTSIDE, OUTSIDE_FINAL, SPECS
from tests.mock_devices.effects_bench import (
    FILE,
    STATION_M,
    Alone,
    assert_drawn_by_seed,
    assert_machine_in_space_has,
    sight_of,
)

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
NAMES = ("mirrored_floor", "catching_hook", "stay_cable", "scheduled_gain")
DRAWN = {"mirrored_floor": "wave_m", "catching_hook": "catches_m", "stay_cable": "taut_m", "scheduled_gain": "aside"}


def test_they_are_ordinary_ones():
    assert set(NAMES) <= set(OUTSIDE)
    assert not set(NAMES) & set(OUTSIDE_FINAL)
    assert {SPECS[name].final for name in NAMES} == {"cubic"}


def test_light_by_way_of_the_floor_makes_ranges_err_in_waves_of_height():
    one = Alone("mirrored_floor", 4e-5)
    wave_m = one.effect.wave_m
    assert 0.08 <= wave_m <= 0.2
    up = np.linspace(-0.8, 0.9, 500)
    points = np.stack([np.full(500, 0.4), np.full(500, 3.1), up], axis=1)
    seen = sight_of(points[None])
    hz, v, before = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
    one.effect.apply_to_sight(one.motion_states(500.0), seen)
    off = (seen.distance_m - before)[0]
    station_m = STATION_M[1] + 1.2  # above the floor
    images = points - np.array([0.0, 0.0, 2.0]) * (station_m + up)[:, None]  # as far below the floor as they are above
    turn = 2.0 * math.pi * (np.linalg.norm(images, axis=1) - np.linalg.norm(points, axis=1)) / wave_m
    columns = np.stack([np.sin(turn), np.cos(turn)], axis=1)
    found, *_ = np.linalg.lstsq(columns, off, rcond=None)
    assert columns @ found == pytest.approx(off, abs=1e-12)
    assert np.hypot(*found) == pytest.approx(4e-5)
    assert np.sum(np.diff(np.sign(off)) != 0.0) >= 8
    assert np.array_equal(seen.hz_rad, hz)
    assert np.array_equal(seen.v_rad, v)


def test_a_hook_catches_high_up_and_lets_go_low_down():
    assert {Alone("catching_hook", 300.0, seed=seed).effect.drive for seed in range(12)} == {0, 1}
    one = Alone("catching_hook", 300.0)
    (low_m, high_m), drive = one.effect.catches_m, one.effect.drive
    assert 0.15 * HALF_M <= MIDDLE_M - low_m <= 0.5 * HALF_M
    assert 0.15 * HALF_M <= high_m - MIDDLE_M <= 0.5 * HALF_M
    caught, seen = False, []
    for to_m in (high_m - 0.01, MIDDLE_M, high_m + 0.01, MIDDLE_M, low_m + 0.01, low_m - 0.01, high_m - 0.01, HIGH_M):
        one.move(drive, to_m)
        one.move(1 - drive, 2.2 - to_m)  # the other one's
        caught = to_m > high_m or (caught and to_m > low_m)
        ((points, forces),) = one.deviation().loads
        assert points[0] == 0.1 - 0.2j
        assert forces[0] == pytest.approx(300.0 * (0.8 + 0.2 * (to_m - MIDDLE_M) / HALF_M) if caught else 0.0)
        seen.append(caught)
    assert seen == [False, False, True, True, True, False, False, True]


def test_a_stay_draws_a_strut_longer_once_the_next_carriage_is_far_above():
    one = Alone("stay_cable", 3e-5, place="right_lower")
    taut_m = one.effect.taut_m
    assert 0.15 * HALF_M <= taut_m <= 0.4 * HALF_M
    above = np.array([-0.6, 0.0, taut_m - 1e-6, taut_m + 0.03, taut_m + 0.3, taut_m + 0.45])
    d = one.deviation(t_s=np.zeros(6), q=np.stack([0.8 + above, np.full(6, 0.8)], axis=1))
    assert d.length_m[:, 3] == pytest.approx(3e-5 * np.array([0.0, 0.0, 0.0, 0.1, 1.0, 1.5]), abs=1e-15)
    assert not np.any(d.length_m[:, :3])
    assert not np.any(d.travel_m)


def test_beyond_a_payload_a_slider_stands_otherwise_by_both_directions():
    one = Alone("scheduled_gain", 3e-5, place="right")
    switches_kg, aside = one.effect.switches_kg, one.effect.aside
    assert 60.0 <= switches_kg <= 300.0
    assert 0.4 <= aside <= 1.0
    stands = {}
    for own in (1.0, -1.0):
        for other in (1.0, -1.0):
            one.move(1, one.q[1] + 0.1 * own, rest_s=20.0)
            one.move(0, one.q[0] + 0.1 * other, rest_s=3.0)
            for payload_kg in (0.0, switches_kg - 0.1):
                assert not np.any(one.deviation(payload_kg=payload_kg).travel_m)
            d = one.deviation(payload_kg=switches_kg + 0.1).travel_m[0]
            assert d[0] == 0.0
            stands[own, other] = d[1]
    lifted, moved_aside = 3e-5, -3e-5 * aside
    assert stands == pytest.approx({(1, 1): lifted, (1, -1): moved_aside, (-1, 1): moved_aside, (-1, -1): lifted})


@pytest.mark.parametrize("name", ["stewart6", "delta6"])
@pytest.mark.parametrize("effect", NAMES)
def test_machines_in_space_have_them_but_the_floor(name, effect):
    assert_machine_in_space_has(effect, name, has=effect != "mirrored_floor")


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_makes_the_same_of_them(name):
    assert_drawn_by_seed(name, DRAWN[name])
