"""Published effects outside the catalogue: what their descriptions say, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import EffectError, parse
from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along


def test_one_broken_tooth_is_felt_once_a_turn():
    one = Alone("damaged_tooth", 1e-5)
    q = 0.5 + 5e-4 * np.arange(2000)
    dropped = -one.deviation(t_s=np.zeros(len(q)), q=along(q)).travel_m[:, 0]
    assert dropped.max() == pytest.approx(1e-5, rel=0.01)
    assert np.mean(dropped > 0.0) == pytest.approx(2.0 * 0.010 / 0.16, abs=0.02)
    assert np.mean(dropped) == pytest.approx(1e-5 * 0.010 / 0.16, rel=0.1)  # cos^2 over twice its half width
    assert dropped[:320] == pytest.approx(dropped[320:640], abs=1e-12)  # a turn on


def test_a_dry_cable_pulls_as_dahl_says():
    one = Alone("dry_cable_drag", 100.0)
    one.move(0, HOME_M + 0.12)
    first = -(1.0 - math.exp(-1.0))
    assert one.deviation().loads[0][1][0].real == pytest.approx(100.0 * first)
    one.move(1, HOME_M - 0.2)  # the other drive does not move it
    assert one.deviation().loads[0][1][0].real == pytest.approx(100.0 * first)
    one.move(0, HOME_M + 0.06)
    back = 1.0 + (first - 1.0) * math.exp(-0.5)
    assert one.deviation().loads[0][1][0].real == pytest.approx(100.0 * back)
    half_way = one.deviation(q=[[HOME_M + 0.09, HOME_M - 0.2]]).loads[0][1][0].real
    assert half_way == pytest.approx(100.0 * (1.0 + (first - 1.0) * math.exp(-0.25)))


def test_only_a_hard_stop_throws_the_clamp_over():
    one = Alone("snapping_clamp", 1e-5, place=FILE.struts[0].name)

    def place():
        return float(one.deviation().platform_joint_m[0, 0].imag)

    one.move(0, HOME_M + 0.3, speed=0.1)
    assert place() == 0.0
    one.move(0, HOME_M + 0.1, speed=0.5)
    assert place() == pytest.approx(-1e-5)
    for target in (0.3, 0.35):
        one.move(0, HOME_M + target, speed=0.1)
        assert place() == pytest.approx(-1e-5)
    one.move(0, HOME_M + 0.4, speed=0.5)
    assert place() == pytest.approx(1e-5)


def test_a_hunting_drive_stands_between_its_jumps():
    one = Alone("hunting", 1.9e-5)
    one.move(0, HOME_M + 0.1, rest_s=0.0)
    arrived_s = one.t_s
    after = [one.travel_m(t_s=arrived_s + dwell) for dwell in (0.5, 3.6, 3.8, 7.5, 20.0)]
    assert after == pytest.approx([-1e-5, -1e-5, 1.3e-5, -1.6e-5, 1.9e-5])


def test_a_published_effect_can_be_asked_for_by_name():
    assert parse("hunting=2e-5,place=right", FILE).place == "right"
    with pytest.raises(EffectError, match="is 'damaged_tooth' meant"):
        parse("damaged_toth=1", FILE)
