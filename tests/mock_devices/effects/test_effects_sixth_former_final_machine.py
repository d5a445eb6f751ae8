"""Sixth former final forms of structure, parts' temperatures and stated values: equations solved here step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Site
from mock_devices.effects.catalogue import make
from mock_devices.known_tables import KnownTable
from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, Temperatures, drawn

ALPHA = 11.5e-6
LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)


def test_a_strut_is_heated_as_it_is_taken_past_a_magnet():
    tau = 700.0
    magnet_m = drawn(
        "link_thermal_growth", "eddy_magnet", "magnet_m", low=MIDDLE_M - 0.5 * HALF_M, high=MIDDLE_M + 0.5 * HALF_M
    )
    one = Alone("link_thermal_growth", 2.0, variant="eddy_magnet", tau_s=tau, place="right_lower")
    one.t_s = 500.0
    warm, at_s, seen = 0.0, 0.0, []
    ends = (magnet_m - 0.05, magnet_m + 0.3, LOW_M, magnet_m - 0.2, HIGH_M, magnet_m)
    for k in range(30):
        to_m, speed, from_m, begins_s = ends[k % 6], (0.5, 0.1, 0.25)[k % 3], one.q[1], one.t_s
        one.move(1, to_m, speed=speed, rest_s=11.0 + k)
        one.move(0, HOME_M + 0.4 * (k % 2), speed=1e4, rest_s=0.0)  # another strut's
        near_m = sum(abs(m - magnet_m) < 0.075 for m in np.linspace(from_m, to_m, 20001)) / 20000.0 * abs(to_m - from_m)
        middle_s = begins_s + 0.5 * abs(to_m - from_m) / speed
        lasts_s = near_m / speed  # of the square of the speed; over all the travel that is 0.15 m of its 1.38 m
        warm = warm * math.exp(-(middle_s - at_s) / tau) + lasts_s * speed**2 * (1.38 / 0.15) / (0.5 * 0.01 * tau)
        at_s = middle_s
        d = one.deviation()
        expected = ALPHA * 2.0 * 1.5 * warm * math.exp(-(one.t_s - at_s) / tau)
        assert d.length_m[0, 3] == pytest.approx(expected, rel=2e-3, abs=1e-10)
        assert not np.any(d.length_m[0, :3])
        seen.append(expected)
    assert max(seen) > 1e-5


def test_what_a_carriage_lowers_warms_its_column():
    tau = 800.0
    one = Alone("column_thermal_growth", 2.0, variant="braking_resistor", tau_s=tau, place="right")
    one.t_s = 50.0
    warm, at_s = 0.0, 0.0
    for k, to_m in enumerate((1.5, 0.4, 0.9, 0.7, 1.6, 0.5, 1.0) * 4):
        way_m, begins_s, speed = to_m - one.q[1], one.t_s, (0.5, 0.1)[k % 2]
        one.move(1, to_m, speed=speed, rest_s=7.0 * k)
        one.move(0, 2.2 - to_m, speed=1e4, rest_s=0.0)  # the other one's
        middle_s = begins_s + 0.5 * abs(way_m) / speed
        down_m = abs(way_m) if way_m < 0.0 else 0.0
        warm, at_s = warm * math.exp(-(middle_s - at_s) / tau) + down_m / (0.5 * 0.01 * tau), middle_s
        now = warm * math.exp(-(one.t_s - at_s) / tau)
        height_m = to_m + FILE.struts[2].base_joint.imag + 1.2  # from the foot
        d = one.deviation()
        assert d.travel_m[0] == pytest.approx([0.0, ALPHA * 2.0 * now * height_m], abs=1e-13)
        assert not np.any(d.sideways_m)
    assert now > 0.3


def test_a_clamp_grips_some_seconds_after_a_stop():
    grips_s = drawn("column_compliance", "clamped_at_rest", "grips_s", low=3.0, high=10.0)
    one = Alone("column_compliance", 1e-8, variant="clamped_at_rest", place="right")
    one.t_s = 100.0
    for to_m in (1.3, 0.8):
        one.move(1, to_m, rest_s=0.0)
        stops_s = one.t_s
        one.move(0, to_m, speed=1e4, rest_s=30.0)  # the other one's does not release it
        for after_s, share in ((0.0, 1.0), (grips_s - 0.01, 1.0), (grips_s + 0.01, 0.2), (29.0, 0.2)):
            soft = one.deviation(t_s=stops_s + after_s).carriage_compliance[0]
            assert soft[1, 1] == pytest.approx(1e-8 * share)
            assert not np.any(soft[0])
            assert not np.any(soft[1, [0, 2]])


def test_a_truss_snaps_through_high_up_and_back_low_down():
    low_m, high_m = Alone("link_stiffness", 0.7, variant="snapped_truss").effect.snaps_m
    assert Alone("link_stiffness", 0.7, variant="snapped_truss", seed=2).effect.snaps_m != (low_m, high_m)
    assert 0.1 * HALF_M <= MIDDLE_M - low_m <= 0.4 * HALF_M
    assert 0.1 * HALF_M <= high_m - MIDDLE_M <= 0.4 * HALF_M
    one = Alone("link_stiffness", 0.7, variant="snapped_truss", place="left_lower")
    soft, seen = False, []
    for to_m in (high_m - 0.01, MIDDLE_M, high_m + 0.01, HIGH_M, MIDDLE_M, low_m + 0.01, low_m - 0.01, high_m - 0.02):
        one.move(0, to_m)
        one.move(1, 2.2 - to_m)  # another strut's
        soft = to_m > high_m or (soft and to_m > low_m)
        ln = one.deviation().ln_stiffness[0]
        assert ln[1] == pytest.approx(-0.7 if soft else 0.0)
        assert not np.any(np.delete(ln, 1))
        seen.append(soft)
    assert seen == [False, False, True, True, True, True, False, False]


def test_a_ratchet_takes_play_up_and_it_begins_anew():
    takes_up_m = drawn("joint_clearance", "ratcheted_bush", "takes_up_m", low=10.0, high=25.0)
    one = Alone("joint_clearance", 2e-5, variant="ratcheted_bush", place="left_lower")
    play, shares = one.effect.worn, []
    for k in range(120):
        to_m = HOME_M + 0.3 * (1 - 2 * (k % 2))
        play += abs(to_m - one.q[0]) / takes_up_m
        if play >= 1.0:
            play -= 1.0
        one.move(0, to_m)
        one.move(1, 2.2 - to_m, rest_s=0.0)  # another strut's
        (law,) = one.deviation().laws[1]
        forces = [float(law(np.array([e]), np.array([1e8]))[0][0]) for e in (-6e-5, 6e-5)]
        assert 6e-5 - np.abs(forces) / 1e8 == pytest.approx(np.full(2, 2e-5 * play), abs=2e-8)
        shares.append(play)
    assert sum(np.diff(shares) < 0.0) >= 2
    assert max(shares) > 0.9
    assert list(one.deviation().laws) == [1]


def test_relieved_ground_rises_first_and_sinks_in_the_end():
    tau = 1000.0
    early = drawn("foundation_settling", "rebounding_ground", "early", low=0.08, high=0.25)
    one = Alone(
        "foundation_settling", 1e-4, variant="rebounding_ground", onset_s=200.0, tau_s=tau, tilt_per_m=0.2, start_s=30.0
    )
    narrow, wide, step, now_s, seen = 0.0, 0.0, 0.05, 0.0, []
    for after_s in np.arange(20.0, 7000.0, 241.0).tolist():
        while now_s < after_s - 0.5 * step:
            wide += step / tau * (1.0 - wide)  # nears one
            narrow += step * ((1.0 - wide) / (early * tau) * (1.0 - early) - narrow / (early * tau))
            now_s += step
        sunk = wide - 2.5 * narrow
        d = one.deviation(t_s=230.0 + after_s)
        assert d.travel_m[0] == pytest.approx([-1e-4 * sunk, 0.0], rel=5e-3, abs=2e-8)
        assert d.yaw_rad[0, 0] == pytest.approx(-0.2 * d.travel_m[0, 0])
        seen.append(sunk)
    assert min(seen) < -0.5
    assert seen[-1] > 0.95
    assert not np.any(one.deviation(t_s=229.0).travel_m)


def test_screws_of_graded_steel_grow_with_the_square_of_the_place():
    one = Alone("expansion_coefficient", 5e-6, variant="graded_screw")
    for celsius in (18.5, 20.0, 22.0):
        one.temperatures = Temperatures(lambda t, celsius=celsius: np.full_like(t, celsius))
        for q in ((LOW_M, HIGH_M), (0.8, 1.3)):
            expected = []
            for at_m in q:  # every part of the screw by its own coefficient
                parts = LOW_M + (np.arange(2000) + 0.5) / 2000.0 * (at_m - LOW_M)
                of_part = 5e-6 * (parts - LOW_M) / (HIGH_M - LOW_M)
                expected.append(float(of_part.sum()) * (at_m - LOW_M) / 2000.0 * (celsius - 20.0))
            d = one.deviation(q=[q])
            assert d.travel_m[0] == pytest.approx(expected, abs=1e-12)
            assert not np.any(d.length_m)
            assert not np.any(d.base_joint_m)
            assert not np.any(d.sideways_m)
    assert d.travel_m[0, 1] > 1e-6


def test_clamps_are_left_on_the_platform_at_every_exchange():
    one = Alone("payload", 12.0, variant="forgotten_bolts")
    left = []
    for exchanges in range(20):
        for payload_kg in (0.0, 400.0):
            d = one.deviation(exchanges=float(exchanges), payload_kg=payload_kg)
            assert d.force_n[0] == pytest.approx(np.full(2, 0.5 * 9.80665 * d.payload_mass_kg[0]))
            assert not np.any(d.payload_shift_m)
        left.append(float(d.payload_mass_kg[0]))
    assert left[0] == 0.0
    each = np.diff(left) / 3.0
    assert np.all((each >= 0.3) & (each <= 1.7))
    assert len(set(np.round(each, 9))) == 19
    after_four = [
        float(Alone("payload", 12.0, variant="forgotten_bolts", seed=k).deviation(exchanges=4.0).payload_mass_kg[0])
        for k in range(300)
    ]
    assert np.mean(after_four) == pytest.approx(12.0, rel=0.04)


def test_entries_are_rounded_to_coarse_steps():
    drawn("tables_left_on", "rounded_entries", "coarse", low=0.4, high=0.9)
    nodes, rows = (0.4, 1.0, 1.6), ((1e-5, 3e-5), (4e-5, 0.0), (-2e-5, 2e-5))
    left = KnownTable(1, "left", nodes, rows, "right", (0.5, 1.5))
    right = KnownTable(1, "right", nodes, ((-3e-5,), (0.0,), (6e-5,)))
    one = Alone("tables_left_on", 0.5, variant="rounded_entries")
    one.effect = make(
        EffectChoice("tables_left_on", 0.5, variant="rounded_entries"), Site(FILE, STATION_M, 0.0, (left, right)), 1
    )
    assert 0.4 <= one.effect.coarse <= 0.9
    step_m = one.effect.coarse * 6e-5

    def stored(entry_m):
        return min((k * step_m for k in range(-9, 10)), key=lambda whole_m: abs(whole_m - entry_m))

    d = one.deviation(t_s=np.zeros(3), q=[[0.4, 0.4], [1.0, 1.6], [0.7, 1.0]])
    middle = 0.25 * (stored(1e-5) + stored(3e-5) + stored(4e-5) + stored(0.0))
    on_left = [stored(1e-5), stored(0.0), middle]
    on_right = [stored(-3e-5), stored(6e-5), 0.0]
    assert stored(1e-5) == 0.0  # small ones are gone
    assert stored(6e-5) > 2e-5
    assert d.travel_m == pytest.approx(0.5 * np.stack([on_left, on_right], axis=1), abs=1e-18)
