"""Final forms of structure, parts' temperatures and stated values: equations solved here step by step."""

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


def test_resin_in_a_strut_warms_it_while_it_sets():
    tau = 900.0
    sets_s = drawn("link_thermal_growth", "setting_resin", "sets_s", low=800.0, high=2400.0)
    catalyses = drawn("link_thermal_growth", "setting_resin", "catalyses", low=30.0, high=150.0)
    one = Alone("link_thermal_growth", 2.0, variant="setting_resin", tau_s=tau, place="right_lower", start_s=80.0)
    step = 0.5
    # How long half takes at a rate of one: what a rate has to be for half of it to set after sets_s.
    share, took = 0.0, 0.0
    while share < 0.5:
        share, took = share + 1e-4 * (1.0 + catalyses * share) * (1.0 - share), took + 1e-4
    rate = took / sets_s
    share, warm, now_s, seen = 0.0, 0.0, 0.0, []
    for after_s in np.arange(100.0, 9000.0, 300.0).tolist():
        while now_s < after_s - 0.5 * step:
            sets = rate * (1.0 + catalyses * share) * (1.0 - share)
            share, warm, now_s = share + step * sets, warm + step * (sets - warm / tau), now_s + step
        length_m = one.deviation(t_s=80.0 + after_s).length_m[0]
        assert length_m[3] == pytest.approx(ALPHA * 2.0 * 1.5 * warm, abs=ALPHA * 3.0 * 5e-3)
        assert not np.any(length_m[:3])
        seen.append(warm)
    assert 0.3 < max(seen) < 1.0  # it loses heat while it sets
    assert 0 < int(np.argmax(seen)) < len(seen) - 5
    assert seen[-1] < 0.2 * max(seen)


def test_a_lamp_on_the_carriage_warms_the_column_where_it_stands():
    tau = 600.0
    lamp_m = drawn("column_thermal_growth", "carriages_lamp", "lamp_m", low=0.12, high=0.3)
    one = Alone("column_thermal_growth", 2.0, variant="carriages_lamp", tau_s=tau, place="right")
    foot_m = -1.2 - FILE.struts[2].base_joint.imag  # by the drive's coordinate
    heights_m = np.linspace(foot_m, HIGH_M + 0.2, 3000)
    warm = np.zeros_like(heights_m)
    for to_m, rest_s in ((HIGH_M - 0.1, 500.0), (LOW_M + 0.1, 300.0), (MIDDLE_M, 900.0), (HIGH_M, 30.0)):
        one.move(1, to_m, speed=1e4, rest_s=rest_s)
        one.history.add(0, one.t_s, one.t_s + 1e-6, HOME_M + 0.2, 1e4)  # the other one's warms nothing here
        at_m = to_m
        aim = np.exp(-(((heights_m - at_m) / lamp_m) ** 2))
        for _ in range(round(rest_s)):
            warm += 1.0 / tau * (aim - warm)
        d = one.deviation(t_s=one.t_s)
        below = heights_m <= at_m
        expected = ALPHA * 2.0 * np.trapezoid(warm[below], heights_m[below])
        assert d.travel_m[0] == pytest.approx([0.0, expected], rel=2e-2, abs=ALPHA * 1e-3)
        assert not np.any(d.yaw_rad)
    assert expected > ALPHA * 2.0 * 0.02


def test_every_exchange_lets_bolts_sink_in_by_a_share_of_their_tension():
    sinks_in = drawn("column_compliance", "embedding_bolts", "sinks_in", low=1.5, high=5.0)
    one = Alone("column_compliance", 1e-8, variant="embedding_bolts", place="right")
    tension, kept = 1.0, (1.0 - 1e-4 / sinks_in) ** 10000
    for exchanges in range(10):
        soft = one.deviation(exchanges=exchanges, t_s=100.0 * exchanges).carriage_compliance
        assert soft[0, 1, 1] == pytest.approx(1e-8 * (1.0 - 0.85 * tension), rel=1e-4)
        assert not np.any(soft[0, 0])
        assert not np.any(soft[0, 1, [0, 2]])
        tension *= kept
    assert one.deviation().carriage_compliance[0, 1, 1] == pytest.approx(0.15e-8)


def test_after_each_motion_other_spots_of_an_end_touch():
    one = Alone("link_stiffness", 0.7, variant="chance_contacts", place="right_lower")
    softs = []
    for k in range(300):
        one.move(1, HOME_M + 0.1 * (k % 2))
        ln = one.deviation().ln_stiffness[0]
        one.move(0, HOME_M + 0.1 * (k % 3))  # another strut's
        assert np.array_equal(one.deviation(t_s=one.t_s + 9.0, payload_kg=200.0).ln_stiffness[0], ln)
        assert not np.any(ln[:3])
        softs.append((math.exp(-ln[3]) - 1.0) / (math.exp(0.7) - 1.0))
    assert len(set(softs)) == 300
    assert 0.02 <= min(softs) < 0.08
    assert 0.94 < max(softs) <= 1.0
    assert np.mean(softs) == pytest.approx(0.51, abs=0.06)
    assert abs(np.corrcoef(softs[:-1], softs[1:])[0, 1]) < 0.2
    other = Alone("link_stiffness", 0.7, variant="chance_contacts", place="right_lower", seed=2)
    assert other.effect.touches[1] != one.effect.touches[1]


def test_a_fast_stop_beats_a_hole_wide_until_the_next():
    beats = drawn("joint_clearance", "beaten_wide", "beats_m_per_s", low=0.25, high=0.5)
    one = Alone("joint_clearance", 2e-5, variant="beaten_wide", place="left_lower")
    elongations, stiff, plays = np.array([-6e-5, 6e-5]), np.full(2, 1e8), []
    for k, speed in enumerate((0.5 * beats, 0.02, 0.9 * beats, 2.0 * beats)):
        one.move(0, HOME_M + 0.1 * (k % 2 + 1), speed=speed)
        one.move(1, HOME_M + 0.1 * (k % 2 + 1), speed=0.4)  # another strut's
        laws = [one.deviation(t_s=one.t_s + rest_s).laws for rest_s in (0.0, 500.0)]
        assert list(laws[0]) == [1]
        forces = [law[1][0](elongations, stiff)[0] for law in laws]
        assert np.array_equal(*forces)
        play_m = 6e-5 - np.abs(forces[0]) / 1e8
        assert play_m[0] == pytest.approx(play_m[1])
        plays.append(play_m[0])
    energy = np.minimum(np.array([0.5, 0.02 / beats, 0.9, 2.0]) ** 2, 1.0)
    assert np.array(plays) == pytest.approx(2e-5 * (0.1 + 0.9 * energy), abs=2e-8)


def test_trains_pack_a_share_of_what_is_loose_under_a_foot():
    packs = drawn("foundation_settling", "passing_trains", "packs", low=0.15, high=0.4)
    one = Alone("foundation_settling", 1e-4, variant="passing_trains", onset_s=200.0, tilt_per_m=0.2, start_s=30.0)
    trains_s = one.effect.trains_s
    assert np.mean(np.diff(trains_s)) == pytest.approx(300.0, rel=0.25)
    assert np.std(np.diff(trains_s)) == pytest.approx(300.0, rel=0.35)
    other = Alone("foundation_settling", 1e-4, variant="passing_trains", seed=2).effect.trains_s
    assert not np.array_equal(trains_s, other)
    assert not np.any(one.deviation(t_s=229.0).travel_m)
    loose = 1.0
    for train_s in trains_s[:15].tolist():
        for off_s in (-1e-3, 1e-3):
            d = one.deviation(t_s=230.0 + train_s + off_s)
            assert d.travel_m[0] == pytest.approx([-1e-4 * (1.0 - loose), 0.0], abs=1e-15)
            assert d.yaw_rad[0, 0] == pytest.approx(-0.2 * d.travel_m[0, 0])
            if off_s < 0.0:
                loose -= packs * loose
    assert loose < 0.1


def test_metal_that_ratchets_grows_with_every_warming():
    bears_k = drawn("expansion_coefficient", "ratcheting_metal", "ratchets_k", low=0.02, high=0.15)
    swing = Temperatures(lambda t: 21.0 + 0.4 * np.sin((t - 10.0) / 700.0))
    one = Alone("expansion_coefficient", 5e-6, variant="ratcheting_metal", temperatures=swing, start_s=10.0)
    lengths_m = np.array([strut.length_m for strut in FILE.struts])
    # The first warming goes from the middle and beyond half of what it bears, each later one through the whole swing.
    for turns, warmings_k in ((0, 0.4 - 0.5 * bears_k), (1, 1.2 - 1.5 * bears_k), (2, 2.0 - 2.5 * bears_k)):
        top_s = 10.0 + 700.0 * (0.5 * math.pi + 2.0 * math.pi * turns)
        for after_s in (100.0, 1500.0):  # while it cools, and all the way down, it stays as it is
            d = one.deviation(t_s=top_s + after_s)
            assert d.length_m[0] == pytest.approx(5e-6 * warmings_k * lengths_m, abs=5e-6 * 2e-3 * 1.5)
            assert not np.any(d.travel_m)
    still = Alone("expansion_coefficient", 5e-6, variant="ratcheting_metal", start_s=10.0)
    assert not np.any(still.deviation(t_s=9000.0).length_m)
    small = Temperatures(lambda t: 21.0 + 0.49 * bears_k * np.sin((t - 10.0) / 200.0))
    calm = Alone("expansion_coefficient", 5e-6, variant="ratcheting_metal", temperatures=small, start_s=10.0)
    assert not np.any(calm.deviation(t_s=9000.0).length_m)


def test_a_heap_of_chips_slides_off_now_and_then():
    one = Alone("payload", 12.0, variant="sandpile", start_s=50.0)
    slides_s, stays = one.effect.slides_s[1:], one.effect.stays
    assert np.mean(np.diff(slides_s)) == pytest.approx(300.0, rel=0.25)
    assert 0.0 <= stays.min() < 0.15
    assert 0.6 < np.median(stays) < 0.85  # mostly a few: a quarter, where a number by chance is a half
    assert not np.array_equal(stays, Alone("payload", 12.0, variant="sandpile", seed=2).effect.stays)
    heap, now_s, fell = 0.0, 0.0, []
    for slide_s, stay in zip(slides_s[:25].tolist(), stays.tolist(), strict=False):
        for off_s in (-1e-3, 1e-3):
            heap, now_s = heap + (slide_s + off_s - now_s) / 3600.0, slide_s + off_s
            for payload_kg in (0.0, 400.0):
                d = one.deviation(t_s=50.0 + now_s, payload_kg=payload_kg)
                assert d.payload_mass_kg[0] == pytest.approx(12.0 * heap, rel=1e-4, abs=1e-4)
                assert d.force_n[0] == pytest.approx(np.full(2, 0.5 * 9.80665 * d.payload_mass_kg[0]))
                assert not np.any(d.payload_shift_m)
            if off_s < 0.0:
                fell.append((1.0 - stay) * heap)
                heap *= stay
    assert max(fell) > 5.0 * np.median(fell)


def test_entries_without_their_signs_all_have_the_same_one():
    left = KnownTable(1, "left", (0.4, 1.0, 1.6), ((1e-5,), (4e-5,), (-2e-5,)))
    right = KnownTable(1, "right", (0.4, 1.0, 1.6), ((-3e-5,), (1e-5,), (6e-5,)))
    choice = EffectChoice("tables_left_on", 0.5, variant="lost_signs")
    signs = set()
    for seed in range(12):
        one = Alone("tables_left_on", 0.5, variant="lost_signs")
        one.effect = make(choice, Site(FILE, STATION_M, 0.0, (left, right)), seed)
        sign = math.copysign(1.0, one.deviation(t_s=5.0, q=[[0.4, 0.4]]).travel_m[0, 0])
        signs.add(sign)
        for at_m, own in ((0.4, (1e-5, 3e-5)), (1.0, (4e-5, 1e-5)), (1.6, (2e-5, 6e-5)), (0.7, (2.5e-5, 2e-5))):
            d = one.deviation(t_s=5.0, q=[[at_m, at_m]])
            assert d.travel_m[0] == pytest.approx(0.5 * sign * np.array(own), abs=1e-18)
    assert signs == {-1.0, 1.0}
