"""Third former final forms of structure, temperatures and stated values: equations solved here step by step."""

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
LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M = 0.5 * (LOW_M + HIGH_M)


def test_every_stop_warms_a_damping_layer_however_short_its_way_was():
    tau = 600.0
    one = Alone("link_thermal_growth", 2.0, variant="damping_layer", tau_s=tau, place="right_lower")
    one.t_s = 300.0
    stops = []
    for to_m, speed, rest_s in ((1.5, 0.5, 100.0), (1.49, 0.1, 30.0), (1.0, 0.25, 0.0)):
        middle_s = one.t_s + 0.5 * abs(to_m - one.q[1]) / speed
        stops.append((middle_s, speed))
        one.move(1, to_m, speed=speed, rest_s=rest_s)
        one.move(0, 1.3 if one.q[0] == HOME_M else HOME_M, rest_s=0.0)  # another strut's
    # The layer, of a fifth of the strut's time constant, takes the heat and passes it on to the strut.
    layer, strut, step, now_s = 0.0, 0.0, 0.02, 0.0
    times = [250.0, 301.0, 420.0, one.t_s, one.t_s + 900.0]
    for until_s in times:
        while now_s < until_s:
            heat = sum((speed / 0.5) ** 2 * 60.0 / tau for at_s, speed in stops if now_s <= at_s < now_s + step)
            strut += step / tau * (layer - strut)
            layer += heat * 5.0 - step / (0.2 * tau) * layer
            now_s += step
        d = one.deviation(t_s=until_s)
        assert d.length_m[0, 3] == pytest.approx(ALPHA * 2.0 * 1.5 * strut, rel=5e-3, abs=1e-9)
        assert not np.any(d.length_m[0, :3])
    assert strut > 0.02
    steady = Alone("link_thermal_growth", 2.0, variant="damping_layer", tau_s=tau)
    for k in range(150):
        steady.move(0, HOME_M + 0.01 * (1 - k % 2), speed=0.5, rest_s=59.98)
    assert steady.deviation().length_m[0, 0] == pytest.approx(ALPHA * 2.0 * 1.5, rel=0.01)


def test_heat_runs_up_a_column_as_a_damped_wave():
    tau = 900.0
    one = Alone("column_thermal_growth", 2.0, variant="heat_wave", tau_s=tau, start_s=100.0)
    wave_m = one.effect.wave_m
    assert 0.6 <= wave_m <= 1.2
    assert Alone("column_thermal_growth", 2.0, variant="heat_wave", seed=2).effect.wave_m != wave_m
    at = np.array([LOW_M, 1.1, HIGH_M])
    for t_s in (0.0, 400.0, 1500.0):
        d = one.deviation(t_s=np.full(3, 100.0 + t_s), q=along(at))
        for place, found in zip(at, d.travel_m[:, 0], strict=True):
            up = np.linspace(0.0, place + 0.125 + 1.2, 20001)
            warm = np.exp(-up / wave_m) * np.sin(2.0 * np.pi * t_s / (2.0 * tau) - up / wave_m)
            expected = ALPHA * 2.0 * float(np.sum(0.5 * (warm[1:] + warm[:-1]) * np.diff(up)))
            assert found == pytest.approx(expected, rel=1e-6)
        assert not np.any(d.travel_m[:, 1])
        assert not np.any(d.sideways_m)


def test_a_frame_sways_by_the_height_of_the_other_carriage():
    one = Alone("column_compliance", 1e-8, variant="swaying_frame", place="right")
    height = np.array([LOW_M, MIDDLE_M, HIGH_M]) + 0.125 + 1.2
    d = one.deviation(t_s=np.zeros(3), q=along([LOW_M, MIDDLE_M, HIGH_M]))
    assert d.carriage_compliance[:, 1, 1] == pytest.approx(1e-8 * (height / height[1]) ** 3)
    assert not np.any(d.carriage_compliance[:, 0])
    assert not np.any(d.carriage_compliance[:, 1, [0, 2]])
    own = one.deviation(t_s=np.zeros(3), q=along([LOW_M, MIDDLE_M, HIGH_M], drive=1)).carriage_compliance[:, 1, 1]
    assert own == pytest.approx(np.full(3, own[0]))


def test_stops_seat_a_taper_on_the_way_up_and_loosen_it_on_the_way_down():
    one = Alone("link_stiffness", 0.7, variant="seated_taper", place="left_lower")
    assert one.deviation().ln_stiffness[0] == pytest.approx([0.0, -0.7, 0.0, 0.0])
    for drive, to_m, speed, loose in (
        (0, 1.3, 0.12, math.exp(-1.0)),
        (1, 1.0, 0.5, math.exp(-1.0)),
        (0, 1.2, 0.3, 1.0),
        (0, 1.5, 0.06, math.exp(-0.25)),
    ):
        one.move(drive, to_m, speed=speed, rest_s=20.0)
        ln = one.deviation().ln_stiffness[0]
        assert not np.any(np.delete(ln, 1))
        softer = (math.exp(-ln[1]) - 1.0) / (math.exp(0.7) - 1.0)  # of the compliance that a loose one adds
        assert softer == pytest.approx(loose)


def test_a_bush_closes_its_play_as_it_grows_warmer():
    one = Alone("joint_clearance", 2e-5, variant="shrinking_bush", place="left_lower")
    for kelvin, share in ((-1.0, 1.4), (0.0, 1.0), (1.5, 0.4), (2.5, 0.0), (6.0, 0.0)):
        one.temperatures = Temperatures(lambda t, kelvin=kelvin: np.full_like(t, 20.0 + kelvin))
        (law,) = one.deviation().laws[1]
        force, slope = law(np.array([-6e-5, 6e-5]), np.full(2, 1e8))
        assert slope == pytest.approx(np.full(2, 1e8), rel=1e-3)
        play_m = 6e-5 - np.abs(force) / 1e8  # what the strut was longer before it felt anything
        assert play_m == pytest.approx(np.full(2, 2e-5 * share), abs=2e-8)
    assert list(one.deviation().laws) == [1]


def test_wet_soil_follows_what_stands_on_it():
    tau = 1000.0
    one = Alone("foundation_settling", 1e-4, variant="follows_weight", onset_s=200.0, tau_s=tau, tilt_per_m=0.2)
    one.t_s = 500.0
    for to_m, rest_s in ((LOW_M, 60.0), (HIGH_M, 30.0), (1.2, 200.0)):
        one.move(0, to_m, speed=100.0, rest_s=rest_s)  # at once
        one.move(1, 0.9, rest_s=0.0)
    legs = one.history.legs(0)[1:]
    sunk, step, now_s = 0.0, 0.05, 0.0
    for until_s in (150.0, 480.0, legs[0].end_s + 50.0, legs[1].start_s, legs[2].start_s, one.t_s):
        while now_s < until_s:
            at_m = next((leg.to_m for leg in reversed(legs) if leg.start_s <= now_s), HOME_M)
            sunk += step / (0.05 * tau) * ((HIGH_M - at_m) / (HIGH_M - LOW_M) - sunk)
            now_s += step
        softened = 1.0 - math.exp(-max(until_s - 200.0, 0.0) / tau)
        q = next((leg.to_m for leg in reversed(legs) if leg.start_s < until_s), HOME_M)
        d = one.deviation(t_s=until_s - 1e-6, q=[[q, 0.9]])
        assert -d.travel_m[0, 0] == pytest.approx(1e-4 * softened * sunk, rel=2e-3, abs=1e-9)
        assert d.yaw_rad[0, 0] == pytest.approx(-0.2 * d.travel_m[0, 0])
        assert not np.any(d.travel_m[:, 1])
    assert not np.any(one.deviation(t_s=199.0).travel_m)


def test_an_alloy_changes_its_phase_later_while_it_grows_warmer_than_while_it_cools():
    swing = Temperatures(lambda t: 21.0 + 0.5 * np.sin(np.maximum(t - 60.0, 0.0) / 900.0))
    one = Alone("expansion_coefficient", 5e-6, variant="martensite", temperatures=swing, start_s=60.0)
    turns_k, back_k = one.effect.turns_k, one.effect.turns_back_k
    assert 0.05 <= turns_k <= 0.25
    assert 0.1 <= turns_k - back_k <= 0.25
    t = np.arange(60.0, 9000.0, 30.0)
    d = one.deviation(t_s=t, q=np.full((len(t), 2), HOME_M))
    lengths = np.array([strut.length_m for strut in FILE.struts])
    share = d.length_m[:, 0] / (5e-6 * 2.0 * lengths[0])
    assert d.length_m == pytest.approx(5e-6 * 2.0 * np.outer(share, lengths), abs=1e-18)
    warmer_k = 0.5 * np.sin((t - 60.0) / 900.0)
    rises = np.gradient(warmer_k) > 0.0
    late = t > 60.0 + 900.0 * 1.5 * math.pi  # after it has been cold
    for now, k, rising in zip(share[late], warmer_k[late], rises[late], strict=True):
        begins_k = turns_k if rising else back_k
        assert now == pytest.approx(np.clip((k - begins_k) / 0.1, 0.0, 1.0), abs=1e-6)
    assert share[0] == 0.0
    assert [share.min(), share.max()] == pytest.approx([0.0, 1.0])
    assert one.deviation(t_s=t[77]).length_m[0] == pytest.approx(d.length_m[77])  # alone as among others
    assert not np.any(d.travel_m)


def test_a_porous_block_draws_up_coolant():
    one = Alone("payload", 30.0, variant="soaking_block", start_s=500.0)
    # Washburn: the column in a capillary slows down as it grows, x dx/dt = constant.
    drawn, step, now_s = 1e-3, 0.02, 3600e-6
    for until_s in (36.0, 900.0, 3600.0):
        while now_s < until_s:
            drawn, now_s = drawn + step / (7200.0 * drawn), now_s + step
        d = one.deviation(t_s=500.0 + until_s, payload_kg=200.0)
        assert d.payload_mass_kg[0] == pytest.approx(30.0 * drawn, rel=0.01)
        assert d.force_n[0] == pytest.approx(np.full(2, 0.5 * 9.80665 * d.payload_mass_kg[0]))
        assert not np.any(d.payload_shift_m)
        empty = one.deviation(t_s=500.0 + until_s)
        assert not np.any(empty.payload_mass_kg)
        assert not np.any(empty.force_n)


def test_corrections_act_at_the_mirrored_place():
    nodes, rows = (0.4, 1.0, 1.6), ((1e-5, 3e-5), (4e-5, 0.0), (-2e-5, 2e-5))
    left = KnownTable(1, "left", nodes, rows, "right", (0.5, 1.5))
    right = KnownTable(1, "right", nodes, ((-3e-5,), (0.0,), (5e-5,)))
    choice = EffectChoice("tables_left_on", 0.5, variant="counted_from_above")
    one = Alone("tables_left_on", 0.5, variant="counted_from_above")
    one.effect = make(choice, Site(FILE, STATION_M, 0.0, (left, right)), 1)
    d = one.deviation(t_s=np.zeros(4), q=[[0.4, 0.5], [1.6, 1.5], [1.3, 0.5], [0.55, 1.0]])
    on_left = [-2e-5, 3e-5, 0.5 * (1e-5 + 4e-5), 0.25 * 1e-5 + 0.75 * 0.0]
    on_left[3] = 0.75 * 0.5 * (-2e-5 + 2e-5) + 0.25 * 0.5 * (4e-5 + 0.0)  # at 1.45, the other one in between
    on_right = np.interp([2.0 - 0.5, 2.0 - 1.5, 2.0 - 0.5, 2.0 - 1.0], nodes, [-3e-5, 0.0, 5e-5])
    assert d.travel_m[:, 0] == pytest.approx(0.5 * np.array(on_left))
    assert d.travel_m[:, 1] == pytest.approx(0.5 * on_right)
