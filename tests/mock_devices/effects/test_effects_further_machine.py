"""Further forms of structure, parts' temperatures and stated values: equations solved here step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Site
from mock_devices.effects.catalogue import make
from mock_devices.effects.strut_laws import bowed
from mock_devices.known_tables import KnownTable
from mock_devices.recordings.design import nominal_drives
from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, Temperatures, along

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA = 11.5e-6


def test_a_heater_warms_the_strut_whose_drive_stands_before_it():
    tau = 600.0
    one = Alone("link_thermal_growth", 3.0, variant="radiant_heater", tau_s=tau, place="left_lower")
    heater_m = one.effect.heater_m
    assert abs(heater_m - MIDDLE_M) <= 0.5 * HALF_M
    assert heater_m != Alone("link_thermal_growth", 3.0, variant="radiant_heater", seed=2).effect.heater_m
    one.move(0, heater_m, speed=0.5, rest_s=400.0)
    one.move(0, heater_m + 0.35, speed=0.5, rest_s=900.0)
    one.move(1, 0.5)
    one.move(0, heater_m, speed=0.5, rest_s=0.0)
    warm, step, at = 0.0, 0.05, 0.0
    marks = {leg.start_s: leg for leg in one.history.legs(0)}
    legs = [marks[s] for s in sorted(marks)]
    while at < one.t_s:  # by the place at every moment
        leg = next(x for x in reversed(legs) if x.start_s <= at)
        moved = min(max((at - leg.start_s) / max(leg.end_s - leg.start_s, 1e-9), 0.0), 1.0)
        q = leg.from_m + (leg.to_m - leg.from_m) * moved
        warm += step / tau * ((1.0 + ((q - heater_m) / 0.35) ** 2) ** -1.5 - warm)
        at += step
    grown = one.deviation().length_m[0]
    assert grown[1] == pytest.approx(ALPHA * 1.5 * 3.0 * warm, rel=2e-3)
    assert not np.any(grown[[0, 2, 3]])
    one.t_s += 1e5
    assert one.deviation().length_m[0, 1] == pytest.approx(ALPHA * 1.5 * 3.0)  # Lambert: right before it


def test_a_column_bends_while_its_thick_wall_is_behind_its_thin_one():
    tau = 2000.0
    air = Temperatures(lambda t: np.where(t < 300.0, 20.0, 21.0))
    one = Alone("column_thermal_growth", 1.0, variant="two_walls", tau_s=tau, temperatures=air)
    t = np.array([0.0, 260.0, 300.0 + 300.0, 300.0 + 2000.0, 60000.0])
    d = one.deviation(t_s=t, q=np.full((5, 2), 1.1))
    after = np.maximum(t - 300.0, 0.0)
    apart = np.exp(-after / tau) - np.exp(-after / 300.0)
    apart[:2] = 0.0
    height = 1.1 + 0.125 + 1.2
    assert d.yaw_rad[:, 0] == pytest.approx(ALPHA * apart / 0.4 * height, rel=0.05, abs=1e-9)
    assert d.sideways_m[:, 0] == pytest.approx(0.5 * d.yaw_rad[:, 0] * height)
    assert not np.any(d.travel_m)
    assert not np.any(d.yaw_rad[:, 1])


def test_resin_under_a_rail_creeps_at_every_rest():
    one = Alone("column_compliance", 1e-8, variant="resin_bed")
    creeps_s = one.effect.creeps_s
    assert 6.0 <= creeps_s <= 20.0
    for to_m in (1.3, 0.9):
        one.move(0, to_m, rest_s=0.0)
        for wait_s, share in ((0.0, 0.4), (creeps_s, 1.0 - 0.6 / math.e), (1e4, 1.0)):
            soft = one.deviation(t_s=one.t_s + wait_s).carriage_compliance[0]
            assert soft[0] == pytest.approx([0.0, 1e-8 * share, 0.0])
            assert not np.any(soft[1])
        one.t_s += 50.0


def test_a_bowed_strut_is_straightened_by_tension():
    k, ratio, buckles_n = np.full(7, 1e8), 2.0, 5000.0
    law = bowed(ratio, buckles_n)
    length, bow = 1.5, math.sqrt(ratio * buckles_n / 1e8 * 2.0 * 1.5) / math.pi  # softer by 1 + ratio without force
    force = np.array([-3500.0, -1000.0, -10.0, 0.0, 10.0, 2000.0, 20000.0])
    x = (np.arange(4000) + 0.5) / 4000.0 * length
    nearer = []
    for f in force:  # the bow is bow / (1 + F / P), half a sine; its chord is shorter by half its slope squared
        slopes = [bow / (1.0 + g / buckles_n) * math.pi / length * np.cos(math.pi * x / length) for g in (0.0, f)]
        nearer.append(0.5 * length * (np.mean(slopes[0] ** 2) - np.mean(slopes[1] ** 2)))
    elongation = force / 1e8 + np.array(nearer)
    found, slope = law(elongation, k)
    assert found == pytest.approx(force, rel=1e-6, abs=1e-3)
    assert slope[3] == pytest.approx(1e8 / 3.0, rel=1e-6)
    h = 1e-9
    assert slope == pytest.approx((law(elongation + h, k)[0] - law(elongation - h, k)[0]) / (2.0 * h), rel=1e-4)
    far, _ = law(np.array([-1e-3]), np.array([1e8]))
    assert -buckles_n < far[0] < -3500.0
    one = Alone("link_stiffness", 0.7, variant="bowed", place="right_upper")
    assert list(one.deviation().laws) == [2]
    assert 3000.0 <= one.effect.buckles_n <= 12000.0


def test_a_hole_has_most_play_where_its_pin_has_worn_it():
    one = Alone("joint_clearance", 2e-5, variant="worn_hole", place="left_upper")
    stiff = 1e8

    def play(place):
        (law,) = one.deviation(q=[nominal_drives(FILE, place)]).laws[0]
        e = np.array([1e-3])
        return float((e - law(e, np.array([stiff]))[0] / stiff)[0])  # far out: the whole gap

    q = np.full((1, 2), MIDDLE_M)
    (law,) = one.deviation(q=q).laws[0]
    e = np.array([1e-3])
    assert float((e - law(e, np.array([stiff]))[0] / stiff)[0]) == pytest.approx(2e-5, rel=1e-6)
    for x in (-0.3, 0.2):
        swing = math.asin((1.0 + x) / 1.5) - math.asin(1.0 / 1.5)
        assert play(complex(x, 0.0)) == pytest.approx(2e-5 * (0.2 + 0.8 * math.exp(-((swing / 0.15) ** 2))), rel=1e-4)
    assert play(0.3j) == pytest.approx(play(0.0j), rel=1e-6)  # straight up the struts do not swing


def test_ground_sinks_late_with_a_well_and_comes_back():
    tau = 800.0
    one = Alone("foundation_settling", 1e-4, variant="pumped_well", onset_s=500.0, tau_s=tau, tilt_per_m=0.2)
    pumps_s = one.effect.pumps_s
    assert 2.0 * tau <= pumps_s <= 4.0 * tau

    def integral(low):  # of exp(-u) / u from `low` to infinity
        u = np.exp(np.linspace(math.log(low), math.log(60.0), 200001))
        return float(np.sum(np.exp(-0.5 * (u[1:] + u[:-1])) * np.diff(np.log(u))))

    whole = integral(1.0 / 32.0)
    for t in (0.1, 0.5, 1.0, 1.9, 3.0, 8.0):
        sunk = integral(1.0 / (8.0 * t)) / whole
        if t * tau > pumps_s:
            sunk -= integral(tau / (8.0 * (t * tau - pumps_s))) / whole
        d = one.deviation(t_s=500.0 + t * tau)
        assert d.travel_m[0, 0] == pytest.approx(-1e-4 * sunk, rel=1e-3, abs=1e-9)
        assert d.yaw_rad[0, 0] == pytest.approx(-0.2 * d.travel_m[0, 0])
        assert d.travel_m[0, 1] == 0.0
    assert one.travel_m(t_s=400.0) == 0.0
    assert one.travel_m(t_s=500.0 + 1e5) > one.travel_m(t_s=500.0 + pumps_s)


def test_struts_of_another_batch_grow_otherwise():
    one = Alone("expansion_coefficient", 2e-6, variant="two_batches", temperatures=Temperatures(lambda t: 20.0 + t))
    grown = one.deviation(t_s=[0.0, 3.0], q=np.full((2, 2), HOME_M)).length_m
    assert not np.any(grown[0])
    assert sorted(grown[1].tolist()) == pytest.approx([0.0, 0.0, 2e-6 * 3.0 * 1.5, 2e-6 * 3.0 * 1.5])
    lots = {tuple(Alone("expansion_coefficient", 1e-6, variant="two_batches", seed=k).effect.batch) for k in range(40)}
    assert len(lots) == 6


def test_a_platform_carries_what_it_has_lifted_of_a_chain():
    one = Alone("payload", 30.0, variant="hanging_chain")
    q = [[LOW_M, LOW_M], [MIDDLE_M, MIDDLE_M], [HIGH_M, HIGH_M], [LOW_M, HIGH_M]]
    d = one.deviation(t_s=np.zeros(4), q=q, payload_kg=100.0)
    assert d.payload_mass_kg == pytest.approx([0.0, 30.0, 60.0, 30.0])
    assert d.force_n[:, 0] == pytest.approx(d.payload_mass_kg * 9.80665 / 2.0)
    assert not np.any(one.deviation(t_s=np.zeros(4), q=q).payload_mass_kg)  # nothing is on the platform


def test_tables_correct_beside_their_place_after_a_zero_was_moved():
    nodes, rows = (0.4, 1.0, 1.6), ((1e-5,), (4e-5,), (-2e-5,))
    tables = tuple(KnownTable(1, drive, nodes, rows) for drive in ("left", "right"))
    one = Alone("tables_left_on", 0.5, variant="moved_zero")
    one.effect = make(EffectChoice("tables_left_on", 0.5, variant="moved_zero"), Site(FILE, STATION_M, 0.0, tables), 1)
    moved = one.effect.moved_m
    assert np.all((np.abs(moved) >= 0.08) & (np.abs(moved) <= 0.2))
    at = np.linspace(0.65, 1.35, 15)
    off = one.deviation(t_s=np.zeros(15), q=along(at)).travel_m
    assert off[:, 0] == pytest.approx(0.5 * np.interp(at + moved[0], nodes, [1e-5, 4e-5, -2e-5]))
    assert off[0, 1] == pytest.approx(0.5 * np.interp(HOME_M + moved[1], nodes, [1e-5, 4e-5, -2e-5]))
