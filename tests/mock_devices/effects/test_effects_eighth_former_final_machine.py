"""Eighth former final forms of structure, parts' temperatures and stated values: solved here step by step."""

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


def test_a_strut_cools_while_a_cloud_is_before_the_sun():
    tau = 600.0
    one = Alone("link_thermal_growth", 2.0, variant="drifting_clouds", tau_s=tau, place="right_lower", start_s=80.0)
    changes_s = one.effect.clouds_s
    assert not np.array_equal(
        changes_s, Alone("link_thermal_growth", 2.0, variant="drifting_clouds", seed=2).effect.clouds_s
    )
    assert np.mean(np.diff(changes_s)) == pytest.approx(400.0, rel=0.25)
    warm, now_s, step, seen = 0.0, 0.0, 0.5, []
    for after_s in np.arange(100.0, 9000.0, 200.0).tolist():
        while now_s < after_s - 0.5 * step:
            shines = np.sum(changes_s <= now_s + 0.5 * step) % 2 == 0
            warm, now_s = warm + step / tau * (shines - warm), now_s + step
        length_m = one.deviation(t_s=80.0 + after_s).length_m[0]
        assert length_m[3] == pytest.approx(ALPHA * 2.0 * 1.5 * warm, rel=5e-3, abs=1e-9)
        assert not np.any(length_m[:3])
        seen.append(warm)
    assert seen[0] == pytest.approx(1.0 - math.exp(-100.0 / tau), rel=1e-2)  # it begins to shine at once
    assert min(np.diff(seen)) < -0.05 < 0.05 < max(np.diff(seen))


def test_only_what_of_a_column_is_within_a_sinking_layer_grows():
    tau = 900.0
    fills_s = drawn("column_thermal_growth", "ceiling_layer", "fills_s", low=2000.0, high=6000.0)
    one = Alone("column_thermal_growth", 2.0, variant="ceiling_layer", tau_s=tau, start_s=40.0)
    foot_m = -1.2 - FILE.struts[0].base_joint.imag  # by the drive's coordinate
    edge_m, now_s, step = HIGH_M + 0.2 - foot_m, 0.0, 0.5  # above the foot, at first at the column's head
    head_m, places, warm, grew = edge_m, np.array([LOW_M, MIDDLE_M, HIGH_M]), 0.0, []
    for after_s in np.arange(0.0, 8000.0, 400.0).tolist():
        while now_s < after_s - 0.5 * step:
            edge_m -= step * 1.5 / fills_s * head_m * (edge_m / head_m) ** (5.0 / 3.0)  # as a plume carries air up
            warm, now_s = warm + step / tau * (1.0 - warm), now_s + step
        d = one.deviation(t_s=np.full(3, 40.0 + after_s), q=along(places))
        within_m = np.maximum(places - foot_m - edge_m, 0.0)
        assert d.travel_m[:, 0] == pytest.approx(ALPHA * 2.0 * warm * within_m, rel=5e-3, abs=2e-8)
        assert not np.any(d.travel_m[:, 1])
        assert not np.any(d.yaw_rad)
        grew.append(within_m > 0.0)
    assert not np.any(grew[0])
    assert np.all(grew[-1])
    assert any(high and not low for low, _, high in grew)


def test_a_motion_of_the_next_drive_takes_pressure_from_under_a_carriage():
    recovers_s = drawn("column_compliance", "shared_pressure", "recovers_s", low=6.0, high=20.0)
    one = Alone("column_compliance", 1e-8, variant="shared_pressure", place="right")
    assert one.deviation().carriage_compliance[0, 1, 1] == pytest.approx(0.15e-8)
    for to_m, speed in ((1.3, 0.3), (1.0, 0.1), (1.2, 0.5)):
        one.move(0, to_m, speed=speed, rest_s=0.0)
        stops_s = one.t_s
        one.move(1, to_m, speed=1e4, rest_s=0.0)  # its own
        for after_s in (0.0, 4.0, 20.0, 90.0):
            taken, step = speed / 0.3, 1e-2
            for _ in range(round(after_s / step)):
                taken -= step * taken / recovers_s
            soft = one.deviation(t_s=stops_s + after_s).carriage_compliance
            assert soft[0, 1, 1] == pytest.approx(1e-8 * (0.15 + 0.85 * taken), rel=2e-3)
            assert not np.any(soft[0, 0])
            assert not np.any(soft[0, 1, [0, 2]])
        one.t_s = stops_s + 200.0


def test_a_crack_opens_with_every_stop_in_proportion_to_its_length():
    first = drawn("link_stiffness", "opening_crack", "crack", low=0.02, high=0.1)
    breaks = drawn("link_stiffness", "opening_crack", "breaks", low=20.0, high=80.0)
    one = Alone("link_stiffness", 0.7, variant="opening_crack", place="left_lower")
    crack, opened = first, []
    for k in range(150):
        speed = (0.5, 0.25, 0.7)[k % 3]
        one.move(0, HOME_M + 0.1 * (k % 2), speed=speed)
        one.move(1, HOME_M + 0.1 * (k % 3), speed=speed)  # another strut's
        for _ in range(400):  # its growth goes with its length, until nothing is left to break
            crack = min(crack * (1.0 - math.log(first) / breaks * (speed / 0.5) ** 2 / 400.0), 1.0)
        ln = one.deviation().ln_stiffness[0]
        assert math.exp(-ln[1]) == pytest.approx(1.0 + crack * (math.exp(0.7) - 1.0), rel=2e-2)
        assert not np.any(np.delete(ln, 1))
        opened.append(crack)
    assert max(np.diff(opened)) > 3.0 * np.diff(opened)[:3].mean()  # ever faster
    assert opened[-1] == 1.0
    assert math.exp(-one.deviation().ln_stiffness[0, 1]) == pytest.approx(math.exp(0.7))


def test_a_pin_has_another_play_after_each_exchange_of_the_payload():
    one = Alone("joint_clearance", 2e-5, variant="fitted_anew", place="left_lower")
    elongations, stiff, plays = np.array([-6e-5, 6e-5]), np.full(2, 1e8), []
    for exchanges in range(12):
        laws = [one.deviation(t_s=t_s, exchanges=exchanges).laws for t_s in (10.0, 5000.0)]
        assert list(laws[0]) == [1]
        forces = [law[1][0](elongations, stiff)[0] for law in laws]
        assert np.array_equal(*forces)  # until the next one
        play_m = 6e-5 - np.abs(forces[0]) / 1e8
        assert play_m[0] == pytest.approx(play_m[1])
        plays.append(play_m[0])
    assert np.array(plays) == pytest.approx(2e-5 * one.effect.fits[:12], abs=1e-10)
    assert len(set(plays)) == 12
    assert 0.05 <= one.effect.fits.min() < 0.2
    assert 0.9 < one.effect.fits.max() <= 1.0
    assert one.effect.fits[0] != Alone("joint_clearance", 2e-5, variant="fitted_anew", seed=2).effect.fits[0]


def test_the_water_of_a_lake_lets_a_foot_sink_and_rise_ever_less():
    tau = 1000.0
    seiche_s = drawn("foundation_settling", "lake_seiche", "seiche_s", low=600.0, high=1500.0)
    one = Alone(
        "foundation_settling", 1e-4, variant="lake_seiche", onset_s=200.0, tau_s=tau, tilt_per_m=0.2, start_s=30.0
    )
    assert not np.any(one.deviation(t_s=229.0).travel_m)
    rate, decay, step = 2.0 * math.pi / seiche_s, 1.0 / (3.0 * tau), 0.05
    level, pace, seen = 0.0, rate, []  # pushed once, at the onset
    for k in range(1, 100001):
        pace -= step * (2.0 * decay * pace + (rate**2 + decay**2) * level)
        level += step * pace
        if k % 4000 == 0:
            d = one.deviation(t_s=230.0 + k * step)
            assert d.travel_m[0] == pytest.approx([-1e-4 * level, 0.0], abs=2e-7)
            assert d.yaw_rad[0, 0] == pytest.approx(-0.2 * d.travel_m[0, 0])
            seen.append(level)
    assert min(seen) < -0.3 < 0.3 < max(seen)


def test_grey_iron_keeps_what_it_has_grown():
    from_k = drawn("expansion_coefficient", "grows_for_good", "for_good_k", low=0.0, high=0.2)
    swing = Temperatures(lambda t: 21.0 + (t - 10.0) / 5000.0 * np.sin((t - 10.0) / 700.0))
    one = Alone("expansion_coefficient", 5e-6, variant="grows_for_good", temperatures=swing, start_s=10.0)
    lengths_m = np.array([strut.length_m for strut in FILE.struts])
    fine_s, seen = np.arange(0.0, 9000.0, 1.0), []
    course_k = fine_s / 5000.0 * np.sin(fine_s / 700.0)
    for after_s in range(100, 9000, 400):
        kept_k = max(course_k[: after_s + 1].max() - from_k, 0.0)
        d = one.deviation(t_s=10.0 + after_s)
        assert d.length_m[0] == pytest.approx(5e-6 * kept_k * lengths_m, abs=5e-6 * 5e-2 * 1.5)
        assert not np.any(d.travel_m)
        seen.append(d.length_m[0, 0])
    assert min(np.diff(seen)) >= 0.0  # never shorter again
    assert sum(np.diff(seen) == 0.0) >= 5
    assert seen[-1] > 5e-6


def test_above_one_height_a_counterweight_has_landed():
    lands = drawn("payload", "landed_counterweight", "lands", low=0.4, high=0.65)
    one = Alone("payload", 12.0, variant="landed_counterweight")
    edge_m = LOW_M + lands * (HIGH_M - LOW_M)
    for left_m, right_m in ((LOW_M, HIGH_M), (edge_m, edge_m), (HIGH_M, HIGH_M), (HIGH_M, edge_m), (LOW_M, edge_m)):
        for off_m in (-1e-3, 1e-3):
            q = [[left_m + off_m, right_m + off_m]]
            landed = 0.5 * (left_m + right_m) + off_m > edge_m
            for payload_kg in (0.0, 400.0):
                d = one.deviation(q=q, payload_kg=payload_kg)
                assert d.payload_mass_kg[0] == pytest.approx(12.0 * landed)
                assert d.force_n[0] == pytest.approx(np.full(2, 0.5 * 9.80665 * 12.0 * landed))
                assert not np.any(d.payload_shift_m)


def test_entries_that_do_not_fit_come_out_with_the_other_sign():
    holds = drawn("tables_left_on", "overflowing_entries", "holds", low=0.45, high=0.8)
    left = KnownTable(1, "left", (0.4, 1.0, 1.6), ((1e-5,), (4e-5,), (-2e-5,)))
    right = KnownTable(1, "right", (0.4, 1.0, 1.6), ((-3e-5,), (1e-5,), (6e-5,)))
    choice = EffectChoice("tables_left_on", 0.5, variant="overflowing_entries")
    one = Alone("tables_left_on", 0.5, variant="overflowing_entries")
    one.effect = make(choice, Site(FILE, STATION_M, 0.0, (left, right)), 1)
    end_m = one.effect.holds * 6e-5  # of the largest entry of both
    assert 0.45 <= holds <= 0.8
    turned = 0
    for k, at_m in enumerate((0.4, 1.0, 1.6)):
        d = one.deviation(t_s=5.0, q=[[at_m, at_m]])
        for a, table in enumerate((left, right)):
            entry_m = table.corrections_m[k][0]
            stored_m = entry_m
            while stored_m >= end_m:
                stored_m -= 2.0 * end_m
            while stored_m < -end_m:
                stored_m += 2.0 * end_m
            turned += stored_m != entry_m
            assert d.travel_m[0, a] == pytest.approx(0.5 * stored_m, abs=1e-18)
    assert turned >= 1  # the largest one at least
    halfway = one.deviation(t_s=5.0, q=[[0.7, 1.3]]).travel_m[0]
    ends = [one.deviation(t_s=5.0, q=[q]).travel_m[0] for q in ([0.4, 1.0], [1.0, 1.6])]
    assert halfway == pytest.approx(np.mean(ends, axis=0), abs=1e-18)  # straight between what is stored
