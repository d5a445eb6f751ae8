"""Seventh former final forms of structure, parts' temperatures and stated values: solved here step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Site
from mock_devices.effects.catalogue import make
from mock_devices.known_tables import KnownTable
from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, Temperatures, along, drawn

ALPHA = 11.5e-6
LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)


def test_a_strut_cools_while_the_next_carriage_shades_its_lamp():
    tau = 600.0
    shades_m = drawn(
        "link_thermal_growth", "neighbours_shade", "shades_m", low=MIDDLE_M - 0.3 * HALF_M, high=MIDDLE_M + 0.3 * HALF_M
    )
    one = Alone("link_thermal_growth", 2.0, variant="neighbours_shade", tau_s=tau, place="right_lower")
    warm, light, seen = 0.0, [], []
    for k in range(14):
        to_m = (LOW_M, shades_m - 0.1, HIGH_M, shades_m + 0.1, shades_m + 0.03, MIDDLE_M)[k % 6]
        before_s = one.t_s
        light.append(min(max(0.5 - (to_m - shades_m) / 0.15, 0.0), 1.0))
        one.move(0, to_m, speed=1e4, rest_s=150.0)
        one.move(1, 2.2 - to_m, speed=1e4, rest_s=0.0)  # its own drive shades nothing
        for _ in range(3000):
            warm += (one.t_s - before_s) / 3000.0 / tau * (light[-1] - warm)
        length_m = one.deviation().length_m[0]
        assert length_m[3] == pytest.approx(ALPHA * 2.0 * 1.5 * warm, rel=2e-3, abs=1e-9)
        assert not np.any(length_m[:3])
        seen.append(warm)
    assert {0.0, 1.0} < set(light)
    assert min(np.diff(seen)) < -0.05 < 0.05 < max(np.diff(seen))


def test_a_heater_in_a_column_goes_on_and_off():
    tau = 900.0
    cycle_s = drawn("column_thermal_growth", "cycled_heater", "cycle_s", low=900.0, high=2400.0)
    heats = drawn("column_thermal_growth", "cycled_heater", "heats", low=0.3, high=0.6)
    heater_m = drawn(
        "column_thermal_growth", "cycled_heater", "heater_m", low=MIDDLE_M - 0.5 * HALF_M, high=MIDDLE_M + 0.5 * HALF_M
    )
    one = Alone("column_thermal_growth", 2.0, variant="cycled_heater", tau_s=tau, start_s=40.0)
    places = np.array([LOW_M, heater_m, HIGH_M])
    foot_m = -1.2 - FILE.struts[0].base_joint.imag
    grown = []
    for place in places:  # every part of the column as warm as it is
        along_m = np.linspace(foot_m, place, 20001)
        profile = np.exp(-np.abs(along_m - heater_m) / 0.5)
        grown.append(float(np.sum(0.5 * (profile[1:] + profile[:-1]) * np.diff(along_m))))
    warm, step, now_s, seen = 0.0, 0.5, 0.0, []
    for after_s in np.arange(0.0, 8000.0, 250.0).tolist():
        while now_s < after_s - 0.5 * step:
            on = (now_s + 0.5 * step) % cycle_s < heats * cycle_s
            warm, now_s = warm + step / tau * (on - warm), now_s + step
        d = one.deviation(t_s=np.full(3, 40.0 + after_s), q=along(places))
        assert d.travel_m[:, 0] == pytest.approx(ALPHA * 2.0 * warm * np.array(grown), rel=5e-3, abs=1e-10)
        assert not np.any(d.travel_m[:, 1])
        assert not np.any(d.yaw_rad)
        seen.append(warm)
    assert sum(np.diff(np.sign(np.diff(seen))) != 0.0) >= 4  # up and down


def test_one_ball_more_carries_in_every_other_half_of_their_way():
    balls_m = drawn("column_compliance", "balls_in_turn", "balls_m", low=0.03, high=0.06)
    one = Alone("column_compliance", 1e-8, variant="balls_in_turn", place="right")
    at = HOME_M + balls_m * (np.arange(4000) + 0.5) / 1000.0  # four of them
    soft = one.deviation(t_s=np.zeros(4000), q=along(at, 1)).carriage_compliance
    share = soft[:, 1, 1] / 1e-8
    assert set(np.round(share, 12)) == {0.3, 1.0}
    assert np.mean(share == share.max()) == pytest.approx(0.5, abs=1e-3)
    changes = at[1:][np.diff(share) != 0.0]
    assert np.diff(changes) == pytest.approx(np.full(len(changes) - 1, 0.5 * balls_m), abs=1e-3 * balls_m)
    assert not np.any(soft[:, 0])
    assert not np.any(soft[:, 1, [0, 2]])


def test_a_spring_that_lies_coil_on_coil_is_stiff():
    closes_kg = drawn("link_stiffness", "closed_spring", "closes_kg", low=60.0, high=300.0)
    closed = drawn("link_stiffness", "closed_spring", "closed", low=0.02, high=0.15)
    one = Alone("link_stiffness", 0.7, variant="closed_spring", place="left_lower")
    for payload_kg, soft in ((0.0, 1.0), (closes_kg - 0.1, 1.0), (closes_kg + 0.1, closed), (400.0, closed)):
        ln = one.deviation(payload_kg=payload_kg).ln_stiffness[0]
        # Its compliance and that of the strut add up: the whole ratio while the spring is open.
        assert math.exp(-ln[1]) == pytest.approx(1.0 + soft * (math.exp(0.7) - 1.0))
        assert not np.any(np.delete(ln, 1))


def test_a_fast_motion_leaves_a_film_that_closes_the_play_for_some_seconds():
    film_s = drawn("joint_clearance", "carried_by_film", "film_s", low=5.0, high=15.0)
    one = Alone("joint_clearance", 2e-5, variant="carried_by_film", place="left_lower")
    (law,) = one.deviation().laws[1]
    elongations, stiff = np.array([-6e-5, 6e-5]), np.full(2, 1e8)
    assert 6e-5 - np.abs(law(elongations, stiff)[0]) / 1e8 == pytest.approx(np.full(2, 2e-5), abs=2e-8)
    for to_m, speed in ((1.3, 0.5), (1.0, 0.15), (1.2, 0.02)):
        one.move(0, to_m, speed=speed, rest_s=0.0)
        stops_s = one.t_s
        one.move(1, to_m, speed=1e4, rest_s=0.0)  # another strut's
        for after_s in (0.0, 4.0, 20.0, 90.0):
            closes, step = speed / (speed + 0.15), 1e-2
            for _ in range(round(after_s / step)):
                closes -= step * closes / film_s
            (law,) = one.deviation(t_s=stops_s + after_s).laws[1]
            force = law(elongations, stiff)[0]
            assert 6e-5 - np.abs(force) / 1e8 == pytest.approx(np.full(2, 2e-5 * (1.0 - closes)), abs=6e-8)
        one.t_s = stops_s + 200.0
    assert list(one.deviation().laws) == [1]


def test_a_slope_slides_ever_faster_until_rubble_holds_it():
    one = Alone(
        "foundation_settling", 1e-4, variant="failing_slope", onset_s=200.0, tau_s=1000.0, tilt_per_m=0.2, start_s=30.0
    )
    fails_s = one.effect.fails_s
    assert 400.0 <= fails_s <= 1000.0
    assert Alone("foundation_settling", 1e-4, variant="failing_slope", tau_s=1000.0, seed=2).effect.fails_s != fails_s
    sunk, now_s, steps = 0.0, 0.0, 100000
    step = 0.95 * fails_s / steps
    for k in range(steps):
        now_s = (k + 0.5) * step
        sunk += step / (fails_s - now_s)  # with one over the time that is left
        if k % 20000 == 19999:
            d = one.deviation(t_s=230.0 + now_s + 0.5 * step)
            assert d.travel_m[0] == pytest.approx([-1e-4 * sunk / -math.log(0.05), 0.0], rel=1e-4)
            assert d.yaw_rad[0, 0] == pytest.approx(-0.2 * d.travel_m[0, 0])
    for after_s in (0.96 * fails_s, 5.0 * fails_s):
        assert one.deviation(t_s=230.0 + after_s).travel_m[0, 0] == pytest.approx(-1e-4)
    assert not np.any(one.deviation(t_s=229.0).travel_m)


def test_struts_grow_by_how_fast_they_are_warmed():
    swing = Temperatures(lambda t: np.where(t < 500.0, 21.0, 21.0 + 1.5 * np.sin((t - 500.0) / 900.0)))
    one = Alone("expansion_coefficient", 5e-6, variant="strained_by_rate", temperatures=swing, start_s=10.0)
    lengths_m = np.array([strut.length_m for strut in FILE.struts])
    seen = []
    for t_s in (300.0, 900.0, 1800.0, 2500.0, 3327.0, 5000.0):
        rate = 0.0 if t_s < 500.0 else 1.5 / 900.0 * math.cos((t_s - 60.0 - 500.0) / 900.0)  # within two minutes
        d = one.deviation(t_s=t_s)
        assert d.length_m[0] == pytest.approx(5e-6 * 1800.0 * rate * lengths_m, rel=2e-3, abs=1e-12)
        assert not np.any(d.travel_m)
        seen.append(rate)
    assert seen[0] == 0.0
    assert min(seen) < -1e-3 < 1e-3 < max(seen)
    assert not np.any(one.deviation(t_s=10.0).length_m)


def test_parts_are_stacked_until_a_pallet_is_full():
    every = {Alone("payload", 12.0, variant="stacked_parts", seed=k).effect.every for k in range(40)}
    assert min(every) >= 8
    assert max(every) <= 20
    assert len(every) > 8
    one = Alone("payload", 12.0, variant="stacked_parts")
    parts, until = one.effect.stacked, one.effect.every
    assert 0 <= parts < 6
    seen = set()
    for k in range(260):
        one.move(k % 2, HOME_M + 0.01 * (k % 7))
        until -= 1
        if until == 0:
            parts, until = (parts + 1, one.effect.every) if parts < 5 else (0, one.effect.every)
        for payload_kg in (0.0, 400.0):
            d = one.deviation(payload_kg=payload_kg)
            assert d.payload_mass_kg[0] == pytest.approx(12.0 * parts / 5.0)
            assert d.force_n[0] == pytest.approx(np.full(2, 0.5 * 9.80665 * 12.0 * parts / 5.0))
            assert not np.any(d.payload_shift_m)
        seen.add(parts)
    assert seen == {0, 1, 2, 3, 4, 5}


def test_tables_are_weighted_by_the_speed_of_the_last_motion():
    left = KnownTable(1, "left", (0.4, 1.0, 1.6), ((1e-5,), (4e-5,), (-2e-5,)))
    right = KnownTable(1, "right", (0.4, 1.0, 1.6), ((-3e-5,), (1e-5,), (6e-5,)))
    one = Alone("tables_left_on", 0.5, variant="feed_forward")
    choice = EffectChoice("tables_left_on", 0.5, variant="feed_forward")
    one.effect = make(choice, Site(FILE, STATION_M, 0.0, (left, right)), 1)
    assert not np.any(one.deviation().travel_m)  # no motion so far
    for to_m, speeds in ((1.3, (0.5, 0.1)), (0.7, (0.05, 0.25)), (0.4, (0.25, 0.5))):
        one.move(0, to_m, speed=speeds[0])
        one.move(1, to_m, speed=speeds[1], rest_s=7.0)
        whole = [
            float(np.interp(to_m, table.own_m, np.ravel(table.corrections_m))) * speed / 0.5
            for table, speed in zip((left, right), speeds, strict=True)
        ]
        assert one.deviation().travel_m[0] == pytest.approx(0.5 * np.array(whole), abs=1e-18)
        assert np.any(whole)
