"""Second former final forms of structure, temperatures and stated values: equations solved here step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Site
from mock_devices.effects.catalogue import make
from mock_devices.known_tables import KnownTable
from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, Temperatures, along

ALPHA = 11.5e-6


def test_a_strut_cools_while_it_is_moved_through_the_air():
    tau = 600.0
    one = Alone("link_thermal_growth", 2.0, variant="fanned", tau_s=tau, place="right_lower")
    one.t_s = 300.0
    for to_m, speed, rest_s in ((1.5, 0.02, 40.0), (0.5, 0.5, 30.0), (1.5, 0.05, 0.0)):
        one.move(1, to_m, speed=speed, rest_s=rest_s)
        one.move(0, 1.3 if one.q[0] == HOME_M else HOME_M, rest_s=0.0)  # another strut's
    legs = [leg for leg in one.history.legs(1) if leg.to_m != leg.from_m]
    warm, step, now_s = 0.0, 0.02, 0.0
    seen = {}
    while now_s < 900.0:
        speed = next((leg.speed_m_per_s for leg in legs if leg.start_s <= now_s < leg.end_s), 0.0)
        loses = 1.0 + 5.0 * math.sqrt(speed / 0.5)
        warm, now_s = warm + step / tau * (1.0 - loses * warm), now_s + step
        seen[round(now_s / step)] = warm
    for t in (200.0, legs[0].start_s + 8.0, legs[1].end_s + 10.0, legs[2].end_s, 880.0):
        d = one.deviation(t_s=t)
        found = d.length_m[0] / (ALPHA * 2.0 * 1.5)
        assert found[3] == pytest.approx(seen[round(t / step)], rel=3e-3)
        assert not np.any(found[:3])
    assert seen[round(legs[1].end_s / step)] < seen[round(legs[1].start_s / step)]


def test_a_wet_column_is_cool_until_it_has_dried():
    tau = 1000.0
    one = Alone("column_thermal_growth", 2.0, variant="drying", tau_s=tau)
    begins_s, lasts_s = one.effect.wet_begins_s, one.effect.wet_lasts_s
    assert 300.0 <= begins_s <= 1200.0
    assert 1500.0 <= lasts_s <= 3600.0
    t = begins_s + np.array([-10.0, 0.4 * lasts_s, lasts_s, lasts_s + 200.0, lasts_s + 1500.0, lasts_s + 30.0 * tau])
    d = one.deviation(t_s=t, q=np.full((6, 2), 1.1))
    cool, step, at_s, seen = 0.0, 0.1, begins_s, []
    for until_s in t[1:5].tolist():
        while at_s < until_s:
            wet = math.exp(-max(at_s - begins_s - lasts_s, 0.0) / (0.3 * tau))
            cool, at_s = cool + step / tau * (wet - cool), at_s + step
        seen.append(cool)
    height = 1.1 + 0.125 + 1.2
    assert d.travel_m[:, 0] == pytest.approx(-ALPHA * 2.0 * height * np.array([0.0, *seen, 0.0]), rel=1e-3, abs=1e-12)
    assert not np.any(d.sideways_m)
    assert not np.any(d.travel_m[:, 1])


def test_resin_gives_way_further_in_a_warm_column():
    one = Alone("column_compliance", 1e-8, variant="warm_resin", place="right")
    soft = []
    for kelvin in (-1.0, 0.0, 1.0, 3.0):
        one.temperatures = Temperatures(lambda t, kelvin=kelvin: np.full_like(t, 20.0 + kelvin))
        d = one.deviation(payload_kg=300.0)
        assert not np.any(d.carriage_compliance[0, 0])
        assert not np.any(d.carriage_compliance[0, 1, [0, 2]])
        soft.append(d.carriage_compliance[0, 1, 1] / 1e-8)
    shift = [10.0 ** (8.86 * k / (101.6 + k)) for k in (-1.0, 0.0, 1.0, 3.0)]
    assert soft == pytest.approx(shift)
    assert soft[2] == pytest.approx(1.22, abs=0.01)  # a fifth a kelvin


def test_an_adhesive_turns_from_hard_to_soft():
    one = Alone("link_stiffness", 0.7, variant="warm_adhesive", place="right_upper")
    soft_at_k = one.effect.soft_at_k
    assert -0.5 <= soft_at_k <= 2.0
    more = []
    for kelvin in (-60.0, -3.0, 0.0, 1.5, 60.0):
        one.temperatures = Temperatures(lambda t, kelvin=kelvin: np.full_like(t, 20.0 + soft_at_k + kelvin))
        ln = one.deviation().ln_stiffness[0]
        assert not np.any(np.delete(ln, 2))
        more.append((math.exp(-ln[2]) - 1.0) / (math.exp(0.7) - 1.0))  # of the compliance that the soft one adds
    logistic = [1.0 / (1.0 + math.exp(-2.0 * k / 3.0)) for k in (-3.0, 1.5)]
    assert more == pytest.approx([0.0, logistic[0], 0.5, logistic[1], 1.0], abs=1e-9)


def test_a_pin_wears_its_hole_with_the_way_of_its_drive():
    one = Alone("joint_clearance", 2e-5, variant="wearing_pin", place="left_lower")

    def play_m():
        (law,) = one.deviation().laws[1]
        pulls = np.linspace(0.0, 4e-5, 40001)
        force, slope = law(pulls, np.full(40001, 1e8))
        assert slope[-1] == pytest.approx(1e8, rel=1e-3)
        return 4e-5 - force[-1] / 1e8  # what the strut was longer before it felt anything

    assert play_m() == pytest.approx(0.2e-5, abs=2e-8)
    for k in range(80):
        one.move(0, HOME_M + 0.5 * (1 - k % 2), speed=0.1 + 0.005 * k)
        one.move(1, HOME_M - 0.3 * (1 - k % 2))  # another drive's
    assert play_m() == pytest.approx(2e-5 * (0.1 + 0.9 * 0.5), abs=2e-8)
    for k in range(80):
        one.move(0, HOME_M + 0.5 * (1 - k % 2))
    assert play_m() == pytest.approx(2e-5, abs=2e-8)
    assert list(one.deviation().laws) == [1]


def test_a_foot_sinks_at_every_exchange_and_ever_less():
    one = Alone("foundation_settling", 1e-5, variant="repeated_loads", tilt_per_m=0.2)
    sunk = []
    for exchanges in range(9):
        d = one.deviation(exchanges=float(exchanges), t_s=500.0 * exchanges)
        sunk.append(-d.travel_m[0, 0])
        assert d.yaw_rad[0, 0] == pytest.approx(0.2 * sunk[-1])
        assert not np.any(d.travel_m[:, 1])
    assert sunk[0] == 0.0
    assert sunk[4] == pytest.approx(1e-5)
    powers = np.log(np.array(sunk[2:]) / sunk[1]) / np.log(np.arange(2.0, 9.0))
    assert powers == pytest.approx(np.full(7, 0.4))
    assert np.all(np.diff(sunk, 2) < 0.0)
    assert one.deviation(exchanges=2.0, t_s=9000.0).travel_m[0, 0] == -sunk[2]  # no time, no payload


def test_a_frame_grows_by_jumps():
    swing = Temperatures(lambda t: 21.0 + 0.5 * np.sin(np.maximum(t - 60.0, 0.0) / 900.0))
    one = Alone("expansion_coefficient", 5e-6, variant="jumping_feet", temperatures=swing, start_s=60.0)
    feet_k = one.effect.feet_k
    assert 0.06 <= feet_k <= 0.2
    t = np.arange(60.0, 5000.0, 30.0)
    d = one.deviation(t_s=t, q=np.full((len(t), 2), HOME_M))
    held, strain = 0.0, []
    for warmer_k in (0.5 * np.sin((t - 60.0) / 900.0)).tolist():
        held = warmer_k if abs(warmer_k - held) > feet_k else held
        strain.append(5e-6 * held)
    middle = 0.5 * (FILE.struts[0].base_joint + FILE.struts[1].base_joint)
    assert d.sideways_m[:, 0] == pytest.approx(-np.array(strain) * middle.real, abs=1e-18)  # across, its axis turned
    assert d.base_joint_m[:, 0] == pytest.approx(np.array(strain) * (FILE.struts[0].base_joint - middle), abs=1e-18)
    jumps = np.abs(np.diff(np.array(strain)))
    assert np.all((jumps == 0.0) | (jumps > 5e-6 * feet_k))
    assert np.sum(jumps > 0.0) >= 5
    assert one.deviation(t_s=t[77]).sideways_m[0, 0] == pytest.approx(d.sideways_m[77, 0])  # alone as among others
    assert not np.any(d.length_m)


def test_coolant_stands_on_the_platform_while_its_pump_runs():
    one = Alone("payload", 30.0, variant="coolant_pool", start_s=500.0)
    switched = one.effect.pump_s
    assert np.all(np.diff(switched) >= 400.0)
    assert np.all(np.diff(switched) <= 1200.0)
    t = np.array([0.0, switched[1] - 1.0, *(switched[1:7] + 120.0), switched[7] - 1.0])
    full, step, at_s, seen = 0.0, 0.05, 0.0, []
    for until_s in t.tolist():
        while at_s < until_s:
            runs = np.searchsorted(switched, at_s, side="right") % 2 == 0  # at first it does not
            full += step * ((1.0 - full) / 150.0 if runs else -full / 400.0)
            at_s += step
        seen.append(full)
    for payload_kg in (0.0, 400.0):
        d = one.deviation(t_s=500.0 + t, q=np.full((len(t), 2), HOME_M), payload_kg=payload_kg)
        assert d.payload_mass_kg == pytest.approx(30.0 * np.array(seen), abs=0.02)
        assert d.force_n[:, 1] == pytest.approx(d.payload_mass_kg * 9.80665 / 2.0)
        assert not np.any(d.payload_shift_m)
    assert max(seen) > 0.5
    assert seen[:2] == [0.0, 0.0]


def test_corrections_are_added_slowly_after_a_motion():
    nodes, rows = (0.4, 1.0, 1.6), ((1e-5, 3e-5), (4e-5, 0.0), (-2e-5, 2e-5))
    left = KnownTable(1, "left", nodes, rows, "right", (0.5, 1.5))
    right = KnownTable(1, "right", nodes, ((-3e-5,), (0.0,), (5e-5,)))
    one = Alone("tables_left_on", 0.5, variant="ramped")
    choice = EffectChoice("tables_left_on", 0.5, variant="ramped")
    one.effect = make(choice, Site(FILE, STATION_M, 0.0, (left, right)), 1)
    one.history._effects = (one.effect,)
    ramps_s = one.effect.ramps_s
    assert 5.0 <= ramps_s <= 15.0
    one.move(1, 1.6, speed=0.5, rest_s=10.0 * ramps_s)
    assert one.travel_m(drive=1) == pytest.approx(0.5 * 5e-5, rel=1e-3)
    one.move(1, 1.0, speed=100.0, rest_s=0.0)  # at once
    off = [one.travel_m(drive=1, t_s=one.t_s + wait_s) for wait_s in (0.0, ramps_s, 10.0 * ramps_s)]
    assert off == pytest.approx(0.5 * 5e-5 * np.array([1.0, 1.0 / math.e, 0.0]), rel=2e-3, abs=2e-9)
    one.t_s += 10.0 * ramps_s
    one.move(0, 1.6, speed=100.0, rest_s=0.0)
    # Over two coordinates the other one counts at once: it stands in the middle of its nodes, and then at one end.
    begins, ends = np.mean(rows[1]) + (HOME_M - 1.0) / 0.6 * (np.mean(rows[2]) - np.mean(rows[1])), np.mean(rows[2])
    assert one.travel_m() == pytest.approx(0.5 * begins, rel=2e-3)
    at_end = one.deviation(t_s=one.t_s, q=[[1.6, 1.5]]).travel_m[0, 0]
    assert at_end == pytest.approx(0.5 * (rows[2][1] + begins - ends), rel=2e-3)
    rested = one.deviation(t_s=one.t_s + 20.0 * ramps_s, q=along([1.6])).travel_m[0, 0]
    assert rested == pytest.approx(0.5 * np.interp(HOME_M, (0.5, 1.5), rows[2]))
