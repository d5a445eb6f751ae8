"""Effects that only a final scoring uses: what their descriptions say, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import OUTSIDE, OUTSIDE_FINAL, SPECS, draw
from tests.mock_devices.effects_bench import (
    FILE,
    HOME_M,
    Alone,
    Temperatures,
    assert_drawn_by_seed,
    assert_machine_in_space_has,
    sight_of,
)

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M = 0.5 * (LOW_M + HIGH_M)
NAMES = ("play_of_tangent_screw", "retied_rope", "sealed_tube", "product_of_ways")
DRAWN = {"play_of_tangent_screw": "play_m", "sealed_tube": "sealed_hpa", "product_of_ways": "felt_m"}


class Weather(Temperatures):
    """A pressure that rises and falls."""

    def pressure_series_hpa(self, t_s):
        return 990.0 + 0.3 * np.sin(np.asarray(t_s, dtype=float) / 1500.0)


def test_a_final_scoring_draws_what_the_descriptions_say():
    assert set(OUTSIDE_FINAL) == set(NAMES)
    assert not set(OUTSIDE_FINAL) & set(OUTSIDE)
    rng = np.random.default_rng(1)
    assert {draw(name, FILE, rng, final=True).variant for name in OUTSIDE_FINAL} == {"plain"}
    assert all(len(SPECS[name].variants) == 4 for name in OUTSIDE_FINAL)


def test_a_tangent_screw_lags_behind_the_platform_by_its_play():
    one = Alone("play_of_tangent_screw", 4e-5)
    play_m = one.effect.play_m
    assert 0.01 <= play_m <= 0.06
    points = np.array([[[0.4, 3.1, 0.0], [-0.5, 2.8, 0.6], [0.1, 3.0, -0.9]]])
    screws, seen_all = [MIDDLE_M, MIDDLE_M], []
    for k in range(60):
        drive = k % 2
        one.move(drive, one.q[drive] + (0.3, -0.25, -0.4 * play_m, 0.005, -0.2, 0.15, -1.1 * play_m)[k % 7])
        for a, at_m in enumerate(one.q):  # each is pushed on by the flank that it has come to
            if at_m - screws[a] > play_m:
                screws[a] = at_m - play_m
            elif screws[a] - at_m > play_m:
                screws[a] = at_m + play_m
        seen = sight_of(points)
        hz, v, before = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
        one.effect.apply_to_sight(one.motion_states(), seen)
        lags = [(at_m - screw) / play_m for at_m, screw in zip(one.q, screws, strict=True)]
        assert (seen.hz_rad - hz)[0] == pytest.approx(np.full(3, 4e-5 * 0.5 * (lags[0] - lags[1])), abs=1e-15)
        assert np.array_equal(seen.v_rad, v)
        assert np.array_equal(seen.distance_m, before)
        seen_all.append(lags[0] - lags[1])
    assert min(seen_all) < -1.5 < 1.5 < max(seen_all)
    assert sum(0.1 < abs(x) < 1.9 for x in seen_all) > 10  # a short way back takes a part only


def test_a_rope_pulls_to_another_side_after_each_exchange():
    one = Alone("retied_rope", 300.0)
    assert not np.array_equal(one.effect.pulls, Alone("retied_rope", 300.0, seed=2).effect.pulls)
    pulls = []
    for exchanges in range(64):
        d = [
            one.deviation(t_s=t_s, q=[[at_m, 1.2]], exchanges=exchanges).loads for t_s, at_m in ((5.0, 0.7), (9e3, 1.3))
        ]
        for ((points, forces),) in d:
            assert points[0] == -0.1 - 0.2j
            assert forces[0].imag == 0.0
            assert forces[0] == d[0][0][1][0]
        pulls.append(forces[0].real)
    assert 90.0 <= np.abs(pulls).min() < 120.0
    assert 270.0 < np.abs(pulls).max() <= 300.0
    assert 16 < sum(pull > 0.0 for pull in pulls) < 48
    assert len(set(pulls)) == 64


def test_the_pressure_of_the_air_shortens_a_sealed_tube():
    one = Alone("sealed_tube", 3e-5, place="right_lower", start_s=400.0, temperatures=Weather())
    sealed_hpa = one.effect.sealed_hpa
    assert abs(sealed_hpa) <= 0.05
    lengths = []
    for t_s in (400.0, 1900.0, 4000.0, 7000.0):
        outside_hpa = 990.0 + 0.3 * math.sin(t_s / 1500.0)
        inside_hpa = 990.0 + 0.3 * math.sin(400.0 / 1500.0) + sealed_hpa
        d = one.deviation(t_s=t_s, q=[[HOME_M, 0.8]], payload_kg=200.0)
        assert d.length_m[0, 3] == pytest.approx(-3e-5 * (outside_hpa - inside_hpa) / 0.1, rel=1e-6)
        assert not np.any(d.length_m[0, :3])
        assert not np.any(d.travel_m)
        lengths.append(d.length_m[0, 3])
    assert min(lengths) < -3e-5 < 3e-5 < max(lengths)


def test_a_disc_and_a_wheel_multiply_the_last_long_ways_of_both_drives():
    one = Alone("product_of_ways", 3e-5, place="right")
    felt_m = one.effect.felt_m
    assert 0.03 <= felt_m <= 0.12
    last, stands = [0.0, 0.0], []
    for k in range(40):
        drive = (0, 1, 1, 0, 1)[k % 5]
        way_m = (0.31, -0.2, felt_m - 1e-4, -0.35, 0.01, felt_m + 1e-4, -0.13)[k % 7]
        assert one.travel_m(drive=1) == pytest.approx(3e-5 * last[0] * last[1] / 0.09, abs=1e-15)
        one.move(drive, one.q[drive] + way_m, rest_s=(1.0, 40.0)[k % 2])
        last[drive] = way_m if abs(way_m) > felt_m else last[drive]
        d = one.deviation(t_s=one.t_s + 3.0, payload_kg=100.0)
        assert d.travel_m[0] == pytest.approx([0.0, 3e-5 * last[0] * last[1] / 0.09], abs=1e-12)
        stands.append(last[0] * last[1])
    assert min(stands) < -0.03 < 0.03 < max(stands)
    assert one.travel_m(drive=1, t_s=-1.0, q=[[HOME_M, HOME_M]]) == 0.0


@pytest.mark.parametrize("name", ["stewart6", "delta6"])
@pytest.mark.parametrize("effect", NAMES)
def test_machines_in_space_have_them(name, effect):
    assert_machine_in_space_has(effect, name, has=True)


@pytest.mark.parametrize("name", DRAWN)  # a rope draws many pulls
def test_the_same_seed_makes_the_same_of_them(name):
    assert_drawn_by_seed(name, DRAWN[name])
