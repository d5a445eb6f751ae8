"""A magnet, a swinging weight and rounded ways: what their descriptions say, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import OUTSIDE, OUTSIDE_FINAL, SPECS
from mock_devices.recordings.design import nominal_drives
from tests.mock_devices.effects_bench import (
    FILE,
    HOME_M,
    Alone,
    assert_drawn_by_seed,
    assert_machine_in_space_has,
)

(LEFT_M, RIGHT_M), (BOTTOM_M, TOP_M) = FILE.workspace_m
NAMES = ("near_magnet", "rung_by_other", "rounded_ways")
DRAWN = {"near_magnet": "behind_m", "rung_by_other": "swings_s", "rounded_ways": "step_m"}


def test_they_are_ordinary_ones():
    assert set(NAMES) <= set(OUTSIDE)
    assert not set(NAMES) & set(OUTSIDE_FINAL)
    assert {SPECS[name].final for name in NAMES} == {"cubic"}


def test_a_magnet_pulls_the_platform_towards_one_point():
    one = Alone("near_magnet", 500.0)
    behind_m = one.effect.behind_m
    assert 0.08 <= behind_m <= 0.16
    tool = one.effect.pole + FILE.tool_point
    assert abs(tool.real - 0.5 * (LEFT_M + RIGHT_M)) <= 0.2 * (RIGHT_M - LEFT_M)
    assert abs(tool.imag - 0.5 * (BOTTOM_M + TOP_M)) <= 0.2 * (TOP_M - BOTTOM_M)
    away = [0.0, 0.02, -0.05j, behind_m / math.sqrt(2.0) * 1j, 0.1 + 0.1j, -0.25, 0.3j - 0.2]
    q = np.array([nominal_drives(FILE, tool + step) for step in away])
    ((points, forces),) = one.deviation(t_s=np.zeros(len(away)), q=q).loads
    assert np.all(points == 0.1 + 0.05j)
    hardest_m = behind_m / math.sqrt(2.0)
    hardest = hardest_m / (hardest_m**2 + behind_m**2) ** 1.5
    for step, force in zip(away, forces.tolist(), strict=True):
        to_pole_m = math.hypot(abs(step), behind_m)
        share_in_plane = abs(step) / to_pole_m
        expected = (
            500.0 / hardest * share_in_plane / to_pole_m**2
        )  # one over the square, and what of it is in the plane
        toward = -step / abs(step) if step else 0.0
        assert force == pytest.approx(expected * toward, abs=1e-6)
    assert abs(forces[3]) == pytest.approx(500.0)


def test_stops_of_the_other_drive_make_a_weight_in_a_strut_swing():
    one = Alone("rung_by_other", 3e-5, place="right_lower")
    swings_s, calms_s = one.effect.swings_s, one.effect.calms_s
    assert 4.0 <= swings_s <= 9.0
    assert 8.0 <= calms_s <= 20.0
    assert not np.any(one.deviation().length_m)
    rate, step = 2.0 * math.pi / swings_s, 1e-3
    for side, speed in ((1.0, 0.5), (-1.0, 0.1), (1.0, 0.25)):
        one.move(0, HOME_M + 0.2 * side, speed=speed, rest_s=0.0)
        stops_s = one.t_s
        one.move(1, HOME_M + 0.1 * side, speed=1e4, rest_s=0.0)  # its own drive does nothing
        swing, at_s = complex(3e-5 * side * speed / 0.5), 0.0
        for asked_s in (0.5, 3.0, 9.0, 21.0):
            while at_s < asked_s - 0.5 * step:  # it turns and shrinks little by little
                swing, at_s = (
                    swing * (1.0 + step * (1j * rate - 1.0 / calms_s) + 0.5 * (1j * rate * step) ** 2),
                    (at_s + step),
                )
            expected = np.zeros(4)
            expected[3] = swing.real
            d = one.deviation(t_s=stops_s + asked_s)
            assert d.length_m[0] == pytest.approx(expected, abs=2e-8)
            assert not np.any(d.travel_m)
        one.t_s = stops_s + 30.0


def test_what_ways_have_beyond_whole_steps_is_lost_and_adds_up():
    one = Alone("rounded_ways", 3e-5, place="right")
    step_m, lost = one.effect.step_m, 0.0
    assert 0.013 <= step_m <= 0.037
    for k in range(60):
        way_m = (2.25, -1.75, 0.5, 3.9, -3.1, -0.3)[k % 6] * step_m
        whole = int(abs(way_m) / step_m)
        lost += math.copysign(abs(way_m) / step_m - whole, way_m)
        one.move(1, one.q[1] + way_m, rest_s=2.0)
        one.move(0, HOME_M + 0.123 * (k % 2))  # the other one's loses nothing here
        assert one.travel_m(drive=1) == pytest.approx(-3e-5 * lost, abs=1e-13)
        assert one.travel_m(drive=0) == 0.0
    assert lost == pytest.approx(5.0)  # half an increment in every six ways
    assert one.travel_m(drive=1, t_s=0.0, q=[[HOME_M, HOME_M]]) == 0.0


@pytest.mark.parametrize("name", ["stewart6", "delta6"])
@pytest.mark.parametrize("effect", NAMES)
def test_machines_in_space_have_them_but_the_magnet(name, effect):
    assert_machine_in_space_has(effect, name, has=effect != "near_magnet")


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_makes_the_same_of_them(name):
    assert_drawn_by_seed(name, DRAWN[name])
