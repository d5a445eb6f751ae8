"""Effects outside the catalogue that count motions or remember rests: their descriptions, worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import OUTSIDE, OUTSIDE_FINAL, SPECS, EffectChoice
from mock_devices.effects.in_space import check_in_space
from mock_devices.spatial_file import read_spatial_machine
from tests.mock_devices.effects_bench import FILE, HOME_M, MACHINE, Alone, assert_drawn_by_seed, sight_of

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
NAMES = ("lost_fringes", "tacky_film", "stepping_collar", "every_other_stop")
SPOTS = np.array([[[0.3, 3.0, 0.4], [-0.2, 3.1, -0.3]]])


def test_they_are_ordinary_ones_with_a_cubic_final_variant():
    assert set(NAMES) <= set(OUTSIDE)
    assert not set(NAMES) & set(OUTSIDE_FINAL)
    assert {SPECS[name].final for name in NAMES} == {"cubic"}


def short_m(one, t_s=None):
    """By how much a station reads both spots short (smrs,), its angles as they are."""
    seen = sight_of(SPOTS)
    hz, v, distance = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
    one.effect.apply_to_sight(one.motion_states(t_s), seen)
    assert np.array_equal(seen.hz_rad, hz)
    assert np.array_equal(seen.v_rad, v)
    return (distance - seen.distance_m)[0]


def test_every_fast_motion_loses_fringes_until_the_station_is_homed():
    one = Alone("lost_fringes", 6e-5, start_s=150.0)
    homes_s = one.effect.homes_s
    assert 900.0 <= homes_s <= 1800.0
    assert Alone("lost_fringes", 6e-5, seed=2).effect.homes_s != homes_s
    fast_s, asked = [], []
    for k in range(120):
        drive, speed = k % 2, (0.1, 0.19, 0.25, 0.5)[k % 4]
        if speed > 0.2:
            fast_s.append(one.t_s)
        one.move(drive, HOME_M + 0.2 * (1 - 2 * (k // 2 % 2)), speed=speed, rest_s=37.0)
        asked.append(one.t_s)
        homed_s = 150.0 + (one.t_s - 150.0) // homes_s * homes_s
        lost = sum(homed_s <= s for s in fast_s)
        assert short_m(one) == pytest.approx(np.full(2, 6e-5 * lost / 30.0), abs=1e-15)
    assert one.t_s - 150.0 > 2.2 * homes_s
    middle_s = asked[60]  # a moment that is long past, and many at once
    homed_s = 150.0 + (middle_s - 150.0) // homes_s * homes_s
    lost = sum(homed_s <= s < middle_s for s in fast_s)
    assert short_m(one, middle_s - 1e-6) == pytest.approx(np.full(2, 6e-5 * lost / 30.0), abs=1e-15)


def test_a_tacky_film_pulls_back_to_where_the_platform_has_rested():
    one = Alone("tacky_film", 600.0)
    forms_s = one.effect.forms_s
    assert 3.0 <= forms_s <= 12.0
    assert Alone("tacky_film", 600.0, seed=2).effect.forms_s != forms_s
    rested = [(MIDDLE_M, 0.0), (MIDDLE_M, 0.0)]
    forces = []
    ways = ((0, 1.2, 40.0), (1, 1.05, 6.0), (0, 1.1, 1.0), (1, 0.95, 30.0), (0, 1.6, 9.0), (1, 1.0, 0.0))
    for drive, to_m, rest_s in ways:
        last = one.history.legs(drive)[-1]
        if one.t_s - last.end_s >= 2.0:
            rested[drive] = (last.to_m, one.t_s - last.end_s)
        one.move(drive, to_m, speed=0.5, rest_s=rest_s)
        from_there_m = 0.5 * ((one.q[0] - rested[0][0]) - (one.q[1] - rested[1][0]))
        formed = 1.0 - math.exp(-min(rested[0][1], rested[1][1]) / forms_s)
        stretched = from_there_m / 0.12
        expected = -600.0 * formed * stretched * math.exp(0.5 * (1.0 - stretched**2))
        ((point, force),) = one.deviation().loads
        assert point == pytest.approx([-0.1 + 0.2j])
        assert force == pytest.approx([expected], abs=1e-9)
        forces.append(expected)
    assert max(np.abs(forces)) > 300.0
    assert forces[0] == 0.0


def test_the_film_pulls_hardest_some_centimetres_away_and_no_more_far_away():
    one = Alone("tacky_film", 600.0)
    one.t_s = 1000.0
    one.move(0, HOME_M + 0.001, speed=1e4, rest_s=0.0)
    one.move(1, HOME_M + 0.001, speed=1e4, rest_s=0.0)
    away = np.linspace(-0.6, 0.6, 241)
    q = np.stack([HOME_M + away, HOME_M - away], axis=1)
    force = one.deviation(t_s=np.full(241, one.t_s), q=q).loads[0][1].real
    assert np.all(force * away <= 0.0)
    assert np.abs(force).max() == pytest.approx(600.0, rel=1e-3)
    assert abs(away[np.argmax(np.abs(force))]) == pytest.approx(0.12, abs=0.003)
    assert abs(force[0]) < 0.1


def test_a_collar_steps_on_with_every_motion_and_falls_back():
    one = Alone("stepping_collar", 3e-5, place="right_lower")
    teeth = one.effect.teeth
    assert 6 <= teeth <= 12
    assert len({Alone("stepping_collar", 3e-5, seed=k).effect.teeth for k in range(20)}) > 4
    for k in range(1, 3 * teeth):
        one.move(1, HOME_M + (0.1, 0.2, 0.001)[k % 3], rest_s=2.0)
        one.move(0, HOME_M + 0.1 * (k % 2))  # another strut's
        one.move(1, one.q[1], rest_s=1.0)  # no motion
        expected = np.zeros(4)
        expected[3] = 3e-5 * (k % teeth) / (teeth - 1)
        d = one.deviation()
        assert d.length_m[0] == pytest.approx(expected, abs=1e-18)
        assert not np.any(d.travel_m)


def test_every_other_stop_after_long_motions_differs():
    one = Alone("every_other_stop", 3e-5, place="right")
    trigger_m, side = one.effect.trigger_m, one.effect.first
    assert 0.03 <= trigger_m <= 0.1
    assert abs(side) == 1.0
    assert Alone("every_other_stop", 3e-5, seed=2).effect.trigger_m != trigger_m
    for k in range(40):
        way_m = (1.01, -0.99, 2.5, -2.6)[k % 4] * trigger_m
        one.move(1, one.q[1] + way_m, rest_s=3.0)
        one.move(0, HOME_M + 0.3 * (k % 2))  # the other one's changes nothing
        side = -side if abs(way_m) > trigger_m else side
        leans = 0.75 + 0.25 * (one.q[1] - MIDDLE_M) / HALF_M
        assert one.travel_m(drive=1) == pytest.approx(3e-5 * side * leans)
        assert one.travel_m(drive=0) == 0.0


@pytest.mark.parametrize("name", ["stewart6", "delta6"])
@pytest.mark.parametrize("effect", NAMES)
def test_machines_in_space_have_them(name, effect):
    file = read_spatial_machine(MACHINE.with_name(f"{name}.toml"))
    check_in_space(EffectChoice(effect, SPECS[effect].size.typical), file)


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_makes_the_same_of_them(name):
    drawn = {"lost_fringes": "homes_s", "tacky_film": "forms_s", "stepping_collar": "teeth",
             "every_other_stop": "trigger_m"}[name]  # fmt: skip
    assert_drawn_by_seed(name, drawn)
