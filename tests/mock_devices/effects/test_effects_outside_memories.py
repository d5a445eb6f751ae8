"""Effects outside the catalogue that flip, relax or are left to chance: their descriptions, worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import OUTSIDE, SPECS, EffectChoice
from mock_devices.effects.in_space import check_in_space
from mock_devices.recordings.design import nominal_drives
from mock_devices.spatial_file import read_spatial_machine
from tests.mock_devices.effects_bench import FILE, HOME_M, MACHINE, Alone

LOW_M, HIGH_M = FILE.sliders[0].travel_m
NAMES = ("maxwell_strap", "flipping_fork", "chance_of_balls")


def test_a_strap_pulls_back_after_every_sideways_motion_and_relaxes():
    one = Alone("maxwell_strap", 600.0)
    relaxes_s = one.effect.relaxes_s
    assert 40.0 <= relaxes_s <= 150.0
    start = nominal_drives(FILE, 0.2 - 0.1j)
    for drive, at_m in enumerate(start):
        one.move(drive, at_m, speed=1e4, rest_s=0.0)
    one.t_s += 5000.0  # it has forgotten how it came here
    assert np.abs(one.deviation().loads[0][1]) == pytest.approx([0.0], abs=1e-6)
    pull, step = 0.0, 0.01
    for drive, to_m, rest_s in ((0, start[0] + 0.2, 30.0), (1, start[1] - 0.4, 60.0), (0, start[0], 200.0)):
        pull += 600.0 / 0.3 * 0.5 * (to_m - one.q[drive]) * (1.0 if drive == 0 else -1.0)
        one.move(drive, to_m, speed=1e4, rest_s=0.0)  # at once
        for _ in range(round(rest_s / step)):
            pull -= pull * step / relaxes_s
        one.t_s += rest_s
        ((point, force),) = one.deviation().loads
        assert point == pytest.approx([-0.1 + 0.2j])
        assert force == pytest.approx([pull], rel=1e-3)
    to_the_right = nominal_drives(FILE, 0.25 - 0.1j)
    right = Alone("maxwell_strap", 600.0)
    for drive, at_m in enumerate(start):
        right.move(drive, at_m, speed=1e4)
    right.t_s += 5000.0
    for drive, at_m in enumerate(to_the_right):
        right.move(drive, at_m, speed=1e4, rest_s=0.0)
    assert right.deviation().loads[0][1].real < -1.0  # back to the left


def test_a_fork_flips_over_at_two_places():
    one = Alone("flipping_fork", 3e-5, place="right_lower")
    low_m, high_m = one.effect.flips_m
    middle_m, half_m = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
    assert 0.15 * half_m <= middle_m - low_m <= 0.4 * half_m
    assert 0.15 * half_m <= high_m - middle_m <= 0.4 * half_m
    side = -1.0
    for to_m in (
        high_m - 0.01,
        high_m + 0.01,
        middle_m,
        low_m + 0.01,
        low_m - 0.01,
        high_m - 0.02,
        HIGH_M,
        low_m + 0.02,
    ):
        one.move(0, 2.2 - to_m)  # another strut's
        one.move(1, to_m, rest_s=3.0)
        side = 1.0 if to_m > high_m else -1.0 if to_m < low_m else side
        expected = np.zeros(4)
        expected[3] = 3e-5 * (0.7 * side + 0.3 * (to_m - middle_m) / half_m)
        d = one.deviation()
        assert d.length_m[0] == pytest.approx(expected, abs=1e-18)
        assert not np.any(d.travel_m)
    assert side == 1.0


def test_every_stop_is_another_one_and_stays_until_the_next():
    one = Alone("chance_of_balls", 3e-5, place="right")
    ends = []
    for k in range(600):
        one.move(1, HOME_M + 0.1 * (k % 2), rest_s=5.0)
        stood = one.travel_m(drive=1)
        one.move(0, HOME_M + 0.2 * (k % 2), rest_s=20.0)  # the other one's motion moves nothing
        assert one.travel_m(drive=1) == stood
        assert one.travel_m(drive=0) == 0.0
        ends.append(stood)
    assert np.abs(ends).max() <= 3e-5
    assert len(set(ends)) == 600
    assert np.mean(ends) == pytest.approx(0.0, abs=2.5e-6)
    assert np.std(ends) == pytest.approx(3e-5 / math.sqrt(3.0), rel=0.06)
    assert abs(np.corrcoef(ends[:-1], ends[1:])[0, 1]) < 0.1


def test_they_are_ordinary_ones_with_a_cubic_final_variant():
    assert set(NAMES) <= set(OUTSIDE)
    assert {SPECS[name].final for name in NAMES} == {"cubic"}


@pytest.mark.parametrize("name", ["stewart6", "delta6"])
@pytest.mark.parametrize("effect", NAMES)
def test_machines_in_space_have_them(name, effect):
    file = read_spatial_machine(MACHINE.with_name(f"{name}.toml"))
    check_in_space(EffectChoice(effect, SPECS[effect].size.typical), file)


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_makes_the_same_of_them(name):
    size, ends = SPECS[name].size.middle, []
    for seed in (3, 3, 4):
        one = Alone(name, size, seed=seed)
        one.move(0, 0.5, rest_s=9.0)
        d = one.deviation(payload_kg=200.0)
        force = sum((force for _, force in d.loads), np.zeros(1))
        ends.append(np.concatenate([d.length_m[0], d.travel_m[0], force.real]))
        if name == "flipping_fork":
            ends[-1] = np.array(one.effect.flips_m)
    assert np.array_equal(ends[0], ends[1])
    assert not np.array_equal(ends[0], ends[2])
