"""Former final forms of drives, guides and controls against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects.base import GRAVITY_M_PER_S2
from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, Temperatures, along, travel

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA_SCREW = 10.5e-6


def test_a_screw_goes_on_growing_while_its_nut_is_warmer():
    tau = 1000.0
    one = Alone("screw_thermal_growth", 2.0, variant="nut_then_screw", tau_s=tau)
    one.move(0, 1.5, speed=0.5, rest_s=0.0)
    one.move(0, 1.1, speed=0.1, rest_s=0.0)
    marks = [(leg.start_s, leg.end_s, abs(leg.to_m - leg.from_m)) for leg in one.history.legs(0)]
    heat = [(0.5 * (start + end), way / (0.01 * tau)) for start, end, way in marks if way]
    assert len(heat) == 2
    nut = screw = 0.0
    now_s, step, seen = 0.0, 0.05, []
    while now_s < 2500.0:  # heat goes into the nut, which hands it on; the screw loses it to the air
        for at_s, by in heat:
            if now_s <= at_s < now_s + step:
                nut += by
        given = nut / (0.4 * tau) * step
        nut, screw, now_s = nut - given, screw + given - screw / tau * step, now_s + step
        seen.append(screw)
    for t in (30.0, 300.0, 611.0, 2000.0):
        grown = one.travel_m(t_s=t) / (ALPHA_SCREW * 2.0 * (1.1 - LOW_M))
        assert grown == pytest.approx(seen[round(t / step) - 1], rel=3e-3)
    assert one.travel_m(t_s=300.0) > 5.0 * one.travel_m(t_s=one.t_s + 10.0) > 0.0
    assert one.travel_m(q=along([LOW_M]), t_s=300.0) == 0.0
    assert one.travel_m(drive=1) == 0.0


def test_a_play_opens_or_closes_with_the_drive_s_temperature():
    signs = set()
    for seed in range(12):
        one = Alone("backlash", 1e-5, variant="temperature_gap", seed=seed)
        opens = one.effect.opens_per_k
        signs.add(math.copysign(1.0, opens))
        for to_m, side in ((1.3, -1.0), (1.1, 1.0)):
            one.move(0, to_m, speed=0.5)
            for kelvin in (-2.0, 0.0, 2.0, 6.0):
                one.temperatures = Temperatures(lambda t, kelvin=kelvin: np.full_like(t, 20.0 + kelvin))
                wide = max(1.0 + math.copysign(0.25, opens) * kelvin, 0.0)
                assert one.travel_m() == pytest.approx(0.5e-5 * side * wide, abs=1e-15)
    assert signs == {-1.0, 1.0}


def test_oil_rubs_less_the_warmer_it_is():
    warm = Temperatures(lambda t: 20.0 + t / 100.0)
    one = Alone("friction_windup", 1e-8, variant="ambient_viscosity", friction_n=200.0, temperatures=warm)
    one.move(0, 1.3)
    t = np.array([-300.0, 0.0, 300.0, 1000.0])
    d = one.deviation(t_s=t, q=np.full((4, 2), 1.3))
    rubs = d.force_n[:, 0]
    assert rubs[1] == pytest.approx(200.0)
    celsius = 20.0 + t / 100.0
    assert np.log(rubs / 200.0) == pytest.approx(1000.0 / (celsius + 95.0) - 1000.0 / 115.0)
    assert 0.4 < rubs[3] / rubs[1] < 0.6  # an oil for gears loses half of its viscosity in ten degrees
    assert d.travel_m[:, 0] == pytest.approx(-1e-8 * (150.0 * GRAVITY_M_PER_S2 / 2.0 + rubs))
    assert not np.any(d.force_n[:, 1])


def test_a_tape_is_too_long_by_the_sag_of_its_fields():
    one = Alone("screw_cumulative_error", 1e-5, variant="sagging_tape")
    at = np.linspace(LOW_M, HIGH_M, 2001)
    off = travel(one, at)
    assert np.abs(off).max() == pytest.approx(1e-5)
    assert np.polyfit(at - MIDDLE_M, off, 1) == pytest.approx([0.0, 0.0], abs=1e-12)
    # A parabola of sag b over a field of length l has the slope 4 b (1 - 2 s) / l, and is longer by half its square.
    step = (HIGH_M - LOW_M) / 2000.0
    field = np.minimum((at - LOW_M) // 0.25, 5).astype(int)
    s = (at - LOW_M) / 0.25 - field
    longer = np.cumsum(one.effect.slack[field] * (4.0 * (1.0 - 2.0 * s)) ** 2 / 2.0) * step
    longer -= np.polyval(np.polyfit(at, longer, 1), at)
    assert off / 1e-5 == pytest.approx(longer / np.abs(longer).max(), abs=0.02)
    other = Alone("screw_cumulative_error", 1e-5, variant="sagging_tape", seed=2)
    assert np.ptp(travel(other, at) - off) > 1e-6


def test_two_faces_that_are_askew_touch_where_they_stand_out_most():
    one = Alone("screw_periodic_error", 1e-5, variant="thrust_faces", period_m=0.01)
    at = HOME_M + np.linspace(0.0, 0.01, 360, endpoint=False)
    off = travel(one, at)
    around = np.linspace(0.0, 2.0 * np.pi, 2880, endpoint=False)
    begins = 2.0 * np.pi * HOME_M / 0.01 + one.effect.phase
    lifts = []
    for turn in begins + 2.0 * np.pi * (at - HOME_M) / 0.01:  # fixed face against turning face, all around the rim
        lifts.append(np.max(np.cos(around) + one.effect.askew * np.cos(around - turn)))
    expected = np.array(lifts) - np.mean(lifts)
    spectrum = np.abs(np.fft.rfft(off)) / 180.0
    assert spectrum[1] == pytest.approx(1e-5, rel=1e-3)
    assert off == pytest.approx(expected * 1e-5 / (np.abs(np.fft.rfft(expected))[1] / 180.0), abs=2e-10)
    assert spectrum[2] > 0.05e-5
    assert 0.6 <= one.effect.askew <= 0.95


def test_a_converter_of_few_bits_leaves_steps():
    one = Alone("encoder_interpolation", 1e-5, variant="few_bits", pitch_m=2e-4)
    at = HOME_M + np.linspace(0.0, 2e-4, 7200, endpoint=False)
    off = travel(one, at)
    assert np.std(off) == pytest.approx(1e-5 * math.sqrt(0.5), rel=5e-3)
    step = 2.0 * np.pi / 7200
    slope = np.median(np.diff(off)) / step  # between steps the angle that is told stands still
    told = off - slope * np.arange(7200) * step
    places = np.unique(np.round(told / 1e-9))
    codes = {
        (math.floor(one.effect.levels * math.cos(x)), math.floor(one.effect.levels * math.sin(x)))
        for x in np.arange(7200) * step + 2.0 * np.pi * HOME_M / 2e-4 + one.effect.phase
    }
    assert abs(len(places) - len(codes)) <= 3
    assert max(max(pair) for pair in codes) <= 7
    assert min(min(pair) for pair in codes) >= -8


def test_a_rail_dips_at_every_bolt():
    one = Alone("guide_straightness", 1e-5, variant="bolt_dips")
    bolts = one.effect.bolts
    assert 0.08 <= bolts.pitch_m <= 0.12
    at = np.linspace(LOW_M, HIGH_M, 6901)
    d = one.deviation(t_s=np.zeros(6901), q=along(at))
    line = d.sideways_m[:, 0]
    assert np.std(line) == pytest.approx(0.7e-5, rel=1e-3)
    lowest = at[1:-1][(line[1:-1] < line[:-2]) & (line[1:-1] < line[2:])]
    assert np.diff(lowest) == pytest.approx(np.full(len(lowest) - 1, bolts.pitch_m), abs=0.002)
    assert len(lowest) >= 11
    dips = line[np.searchsorted(at, lowest)]
    assert np.std(dips) > 0.5e-6  # no bolt is as tight as the next
    assert not np.any(d.yaw_rad)
    assert not np.any(d.travel_m)


def test_a_drive_beside_the_centre_of_friction_turns_its_carriage():
    one = Alone("guide_angular", 1e-5, variant="off_centre_drive")
    assert not np.any(one.deviation(payload_kg=400.0).yaw_rad)  # it has not moved yet
    for to_m, side in ((1.3, 1.0), (1.2, -1.0)):
        one.move(0, to_m)
        for payload_kg, share in ((0.0, 0.5), (200.0, 0.85), (400.0, 1.2)):
            d = one.deviation(payload_kg=payload_kg)
            assert d.yaw_rad[0] == pytest.approx([side * share * 1e-5, 0.0])
            assert not np.any(d.sideways_m)


def test_the_other_axis_pushes_once_a_turn_of_its_screw():
    one = Alone("axis_coupling", 1e-4, variant="turn_of_other")
    lead_m = one.effect.lead_m
    assert {Alone("axis_coupling", 1e-4, variant="turn_of_other", seed=k).effect.lead_m for k in range(40)} == {
        0.01, 0.016, 0.02, 0.025,
    }  # fmt: skip
    at = HOME_M + np.linspace(0.0, 2.0 * lead_m, 100, endpoint=False)
    d = one.deviation(t_s=np.zeros(100), q=along(at, drive=1))
    spectrum = np.abs(np.fft.rfft(d.travel_m[:, 0])) / 50.0
    assert spectrum[2] == pytest.approx(0.25e-4)
    assert np.delete(spectrum, 2).max() < 1e-10
    assert not np.any(d.travel_m[:, 1])
    assert np.ptp(one.deviation(t_s=np.zeros(100), q=along(at)).travel_m[:, 0]) == 0.0  # not by its own


def test_a_clock_swings_about_the_other_one_until_its_loop_has_caught_up():
    one = Alone("latency", 1e-3, variant="steered_clock")
    rate = 2.0 * np.pi / one.effect.steers_s / math.sqrt(1.0 - 0.05**2)  # of the loop without damping
    assert 900.0 <= one.effect.steers_s <= 1800.0
    error, drift, step = 1e-3, -2.0 * 0.05 * rate * 1e-3, 0.05
    for k in range(1, 80001):  # e'' + 2 d w e' + w^2 e = 0, from a step of the phase
        drift -= step * (2.0 * 0.05 * rate * drift + rate**2 * error)
        error += step * drift
        if k % 10000 == 0:
            found = float(np.asarray(one.effect.early_s(one.motion_states(t_s=k * step)))[0])
            assert found == pytest.approx(error, abs=2e-6)
    assert float(np.asarray(one.effect.early_s(one.motion_states(t_s=0.0)))[0]) == pytest.approx(1e-3)


def test_a_heavier_load_swings_further_and_more_slowly():
    one = Alone("servo_settling", 1e-5, variant="swinging_load", tau_s=3.0)
    assert one.travel_m(t_s=2.0) == 0.0
    one.move(0, 1.3, speed=0.25, rest_s=0.0)
    for wait_s in (0.0, 0.5, 1.3, 4.0, 12.0):
        t = wait_s / 3.0
        off = one.travel_m(t_s=one.t_s + wait_s)
        assert off == pytest.approx(0.5e-5 * math.exp(-0.5 * t) * math.sin(3.0 * t), abs=1e-15)  # at half the speed
        loaded = one.travel_m(t_s=one.t_s + wait_s, payload_kg=450.0)  # four times the mass: twice the period
        assert loaded == pytest.approx(1e-5 * math.exp(-0.5 * t) * math.sin(1.5 * t), abs=1e-15)
    one.move(0, 1.0, speed=0.5, rest_s=0.0)
    assert one.travel_m(t_s=one.t_s + 1.0) < 0.0
    assert one.travel_m(drive=1) == 0.0


def test_a_reading_head_goes_with_the_heat_of_its_drive():
    one = Alone("drive_scale", 2e-5, variant="warm_reader")
    now_s, warm, heat = 0.0, 0.0, 0.5 / (0.02 * 900.0)
    for k in range(60):
        middle_s = one.t_s + 0.5
        one.move(0, HOME_M + (0.5 if k % 2 == 0 else 0.0), speed=0.5, rest_s=24.0)
        one.move(1, HOME_M + (0.1 if k % 2 == 0 else 0.0))
        warm = warm * math.exp(-(middle_s - now_s) / 900.0) + heat
        now_s = middle_s
    off = one.travel_m()
    assert abs(off) == pytest.approx(2e-5 * warm * math.exp(-(one.t_s - now_s) / 900.0), rel=1e-9)
    assert 0.5 < warm < 1.0
    assert travel(one, np.array([1.1, 1.1]))[0] == pytest.approx(off)  # the zero, wherever the drive stands
    assert one.travel_m(t_s=one.t_s + 900.0) == pytest.approx(off / math.e)
    assert one.travel_m(drive=1) == 0.0
    assert {np.sign(Alone("drive_scale", 2e-5, seed=k).effect.sign) for k in range(12)} == {-1.0, 1.0}
