"""Effects outside the catalogue in bearings, hoses, joints and chains: what their descriptions say, point by point."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import OUTSIDE, SPECS, EffectChoice, EffectError, draw
from mock_devices.effects.in_space import OF_SLIDERS, TURNING, check_in_space
from mock_devices.spatial_file import read_spatial_machine
from tests.mock_devices.effects_bench import FILE, HOME_M, MACHINE, Alone, Temperatures, along, sight_of

NAMES = ("bearing_wobble", "stiff_hose", "floating_ball", "chain_on_carriage")


def test_an_ordinary_scoring_draws_their_usual_shapes():
    assert set(NAMES) <= set(OUTSIDE)
    rng = np.random.default_rng(1)
    drawn = {draw(name, FILE, rng, final=False).variant for name in NAMES for _ in range(30)}
    assert drawn == {"plain", "saturating", "with_payload"}
    assert {draw(name, FILE, rng, final=True).variant for name in NAMES} == {"cubic"}


def test_an_axis_wobbles_with_its_balls():
    one = Alone("bearing_wobble", 2e-5)
    balls = one.effect.waves / 0.42
    assert balls == pytest.approx(round(balls))
    assert 12 <= round(balls) <= 20
    others = {round(Alone("bearing_wobble", 2e-5, seed=k).effect.waves / 0.42) for k in range(60)}
    assert others == set(range(12, 21))
    across = np.linspace(-0.4, 0.4, 41)
    points = np.stack([3.0 * np.sin(across), 3.0 * np.cos(across), np.full(41, 0.6)], axis=1)
    seen = sight_of(points[None])
    hz, v, distance = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
    one.effect.apply_to_sight(one.motion_states(0.0), seen)
    assert np.array_equal(seen.distance_m, distance)
    for k in range(41):  # what a small turn of the station's frame does to each point
        ball = one.effect.waves * hz[0, k] + one.effect.phase
        ahead = np.array([math.sin(across[k]), math.cos(across[k]), 0.0])
        aside = np.array([math.cos(across[k]), -math.sin(across[k]), 0.0])
        turn = 2e-5 * (math.sin(ball) * ahead - math.cos(ball) * aside)
        x, y, z = points[k] + np.cross(turn, points[k])
        assert (seen.hz_rad - hz)[0, k] == pytest.approx(math.atan2(x, y) - hz[0, k], abs=1e-9)
        assert (seen.v_rad - v)[0, k] == pytest.approx(math.atan2(math.hypot(x, y), z) - v[0, k], abs=1e-9)
    assert np.ptp(seen.v_rad - v) > 1e-5


def test_a_hose_draws_back_to_the_middle_and_more_when_it_is_cold():
    air = Temperatures(lambda t: 20.0 - t / 100.0)
    one = Alone("stiff_hose", 300.0, temperatures=air)
    t = np.array([-300.0, 0.0, 300.0])
    q = along(np.full(3, HOME_M + 0.45))  # half of the way from one side of the machine to the other
    ((point, force),) = one.deviation(t_s=t, q=q).loads
    assert point == pytest.approx(np.full(3, 0.1 + 0.2j))
    assert not np.any(force.imag)
    assert force.real == pytest.approx([-150.0 * math.exp(-0.5), -150.0, -150.0 * math.exp(0.5)])
    other = one.deviation(t_s=t, q=along(np.full(3, HOME_M + 0.45), drive=1)).loads[0][1]
    assert other == pytest.approx(-force)
    one.move(0, 1.3)
    assert one.deviation(t_s=t, q=q).loads[0][1] == pytest.approx(force)  # no side


def test_a_joint_floats_up_with_speed_and_sinks_at_rest():
    one = Alone("floating_ball", 3e-5, place="right_lower")
    thins_s = one.effect.thins_s
    assert 6.0 <= thins_s <= 20.0
    assert not np.any(one.deviation(t_s=50.0).length_m)
    for to_m, speed in ((1.3, 0.5), (1.1, 0.125)):
        one.move(1, to_m, speed=speed, rest_s=0.0)
        for wait_s, thinner in ((0.0, 1.0), (thins_s, 2.0), (8.0 * thins_s, 9.0)):
            d = one.deviation(t_s=one.t_s + wait_s)
            film = 3e-5 * (2.0 ** (-2.0 * 0.7) if speed < 0.5 else 1.0) / math.sqrt(thinner)
            assert d.length_m[0] == pytest.approx([0.0, 0.0, 0.0, film], abs=1e-15)
        one.t_s += 200.0
    before = one.deviation().length_m
    one.move(0, 1.5, rest_s=0.0)  # another strut's
    assert one.deviation().length_m[0, 3] < before[0, 3]


def test_a_chain_turns_its_carriage_by_its_height_and_its_drag():
    one = Alone("chain_on_carriage", 1e-4, place="right")
    low, high = FILE.sliders[1].travel_m
    at = low + (high - low) * np.array([0.0, 0.5, 1.0])
    for to_m, side in ((HOME_M, 0.0), (1.3, 1.0), (1.2, -1.0)):
        if side:
            one.move(1, to_m)
        d = one.deviation(t_s=np.full(3, one.t_s), q=along(at, drive=1))
        assert d.yaw_rad[:, 1] == pytest.approx(1e-4 * (np.array([0.0, 0.15, 0.6]) + 0.4 * side))
        assert not np.any(d.yaw_rad[:, 0])
        assert not np.any(d.sideways_m)


@pytest.mark.parametrize("name", ["stewart6", "delta6"])
def test_machines_in_space_have_them_where_they_have_the_parts(name):
    file = read_spatial_machine(MACHINE.with_name(f"{name}.toml"))
    for effect in NAMES:
        choice = EffectChoice(effect, SPECS[effect].size.typical)
        if effect in OF_SLIDERS and name == "stewart6":
            assert effect in TURNING
            with pytest.raises(EffectError, match="no sliders, which alone have guides"):
                check_in_space(choice, file)
        else:
            check_in_space(choice, file)


@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_makes_the_same_of_them(name):
    size, ends = SPECS[name].size.middle, []
    for seed in (3, 3, 4):
        one = Alone(name, size, seed=seed)
        one.move(0, 1.3, rest_s=2.0)
        d, seen = one.deviation(payload_kg=200.0), sight_of(np.array([[[0.3, 3.0, 0.4], [-0.2, 3.1, -0.3]]]))
        one.effect.apply_to_sight(one.motion_states(), seen)
        force = sum((force for _, force in d.loads), np.zeros(1))
        ends.append(np.concatenate([d.length_m[0], d.yaw_rad[0], force.real, seen.v_rad[0]]))
    assert np.array_equal(ends[0], ends[1])
    assert np.array_equal(ends[0], ends[2]) == (name in {"stiff_hose", "chain_on_carriage"})  # which draw nothing
