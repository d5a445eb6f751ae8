"""Eighth former final forms of drives, guides and controls against publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along, amplitude, drawn, travel

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA_SCREW = 10.5e-6


def test_only_short_ways_heat_a_screw_whose_grease_is_not_renewed():
    tau = 800.0
    short_m = drawn("screw_thermal_growth", "short_strokes", "short_m", low=0.1, high=0.25)
    one = Alone("screw_thermal_growth", 2.0, variant="short_strokes", tau_s=tau, place="right")
    warm, at_s = 0.0, 0.0
    for k in range(40):
        way_m = (short_m - 1e-6, -0.02, 0.4, -(short_m + 1e-6), 0.05, -0.43)[k % 6]
        begins_s, to_m = one.t_s, one.q[1] + way_m
        one.move(1, to_m, speed=0.2, rest_s=9.0)
        one.move(0, HOME_M + 0.01 * (k % 2), speed=1e4, rest_s=0.0)  # the other one's
        if abs(way_m) < short_m:
            middle_s = begins_s + 0.5 * abs(way_m) / 0.2
            warm, at_s = warm * math.exp(-(middle_s - at_s) / tau) + abs(way_m) / (0.002 * tau), middle_s
        now = warm * math.exp(-(one.t_s - at_s) / tau)
        expected = ALPHA_SCREW * 2.0 * now * (to_m - LOW_M)
        assert one.deviation().travel_m[0] == pytest.approx([0.0, expected], abs=1e-12)
    assert now > 0.5


def test_every_reversal_frets_a_key_looser():
    frets = drawn("backlash", "fretted_key", "frets", low=40.0, high=150.0)
    one = Alone("backlash", 4e-5, variant="fretted_key")
    reversals, last, shares = 0, 0.0, []
    for k in range(90):
        way_m = (0.1, 0.2, -0.25, -0.01, -0.04)[k % 5]  # two reversals in five motions
        one.move(0, one.q[0] + way_m)
        one.move(1, HOME_M + 0.1 * (k % 2))  # the other one's fret nothing here
        reversals += way_m * last < 0.0
        last = way_m
        share = 1.0 - 0.9 * math.exp(-reversals / frets)
        assert one.travel_m() == pytest.approx(-math.copysign(2e-5, way_m) * share)
        shares.append(share)
    assert reversals == 35
    assert shares[-1] - shares[0] > 0.15
    assert one.travel_m(drive=1) == 0.0


def test_a_belt_that_both_drives_share_rubs_by_the_motions_of_both():
    shared = drawn("friction_windup", "shared_belt", "shared", low=0.35, high=0.7)
    one = Alone("friction_windup", 1e-8, variant="shared_belt", friction_n=400.0, place="right")
    seen = {}
    for own in (1.0, -1.0):
        for other in (1.0, -1.0):
            one.move(1, one.q[1] + 0.1 * own)
            one.move(0, one.q[0] + 0.1 * other)
            d = one.deviation(payload_kg=100.0)
            seen[own, other] = d.force_n[0, 1]
            assert d.travel_m[0] == pytest.approx([0.0, -1e-8 * (9.80665 * 250.0 / 2.0 + d.force_n[0, 1])])
            assert d.force_n[0, 0] == 0.0
    apart = 400.0 * (1.0 - 2.0 * shared)
    assert seen == pytest.approx({(1, 1): 400.0, (-1, -1): -400.0, (1, -1): apart, (-1, 1): -apart})


def test_a_tape_has_kept_a_wave_for_each_turn_on_its_spool():
    one = Alone("screw_cumulative_error", 1e-5, variant="spooled_tape")
    first_m = drawn("screw_cumulative_error", "spooled_tape", "spool_m", low=0.12, high=0.22)
    thicker = drawn("screw_cumulative_error", "spooled_tape", "thicker", low=0.15, high=0.4)
    places = np.linspace(LOW_M, HIGH_M, 2001)
    off = travel(one, places)
    assert np.abs(off).max() == pytest.approx(1e-5)
    assert np.polyfit(places, off, 1) == pytest.approx([0.0, 0.0], abs=1e-12)  # which would be scale and zero
    # Wound up step by step: each step turns the spool the less the more lies on it already.
    turns, turn, step = [0.0], 0.0, (HIGH_M - LOW_M) / 200000
    for _ in range(200000):
        turn += step / (first_m * (1.0 + thicker * (turn + 0.5 * step / first_m)))
        turns.append(turn)
    phase = 2.0 * math.pi * np.interp(places, LOW_M + step * np.arange(len(turns)), turns)
    columns = np.column_stack([np.sin(phase), np.cos(phase), np.ones_like(places), places])
    found, *_ = np.linalg.lstsq(columns, off, rcond=None)
    assert columns @ found == pytest.approx(off, abs=1e-9)
    assert np.hypot(found[0], found[1]) > 0.5e-5
    assert turn > 2.0
    assert one.travel_m(drive=1) == 0.0


def test_the_next_carriage_racks_the_bearings_of_a_screw():
    square_m = drawn(
        "screw_periodic_error", "racked_bearings", "square_m", low=MIDDLE_M - 0.3 * HALF_M, high=MIDDLE_M + 0.3 * HALF_M
    )
    one = Alone("screw_periodic_error", 1e-5, variant="racked_bearings", period_m=0.01, place="right")
    at = 0.9 + 0.01 * np.arange(64) / 64.0
    seen = []
    for other_m in (LOW_M, square_m, square_m + 0.5 * HALF_M, HIGH_M):
        q = np.stack([np.full(64, other_m), at], axis=1)
        d = one.deviation(t_s=np.zeros(64), q=q)
        seen.append(amplitude(d.travel_m[:, 1], at, 0.01))
        assert not np.any(d.travel_m[:, 0])
    seen = np.array(seen)
    racked = np.array([LOW_M - square_m, 0.0, 0.5 * HALF_M, HIGH_M - square_m]) / HALF_M
    assert np.abs(seen) == pytest.approx(1e-5 * np.abs(racked), abs=1e-12)
    assert (seen / seen[3]).real == pytest.approx(racked / racked[3], abs=1e-9)  # the other way on the other side


def test_a_head_leans_by_the_direction_and_sets_a_signal_off():
    pitch_m = 2e-4
    one = Alone("encoder_interpolation", 1e-5, variant="leaning_head", pitch_m=pitch_m)
    drawn("encoder_interpolation", "leaning_head", "leans_at", low=0.0, high=2.0 * math.pi)
    at = HOME_M + pitch_m * np.arange(64) / 64.0
    assert not np.any(travel(one, at))  # no motion so far
    seen = []
    for side in (1.0, -1.0):
        one.move(0, HOME_M - 0.1 * side)
        one.move(0, HOME_M)
        one.move(1, HOME_M - 0.1)
        off = travel(one, at + 1e-2 * side)  # half a hundred periods on, the same way
        assert abs(amplitude(off, at, pitch_m)) == pytest.approx(1e-5)
        assert np.mean(off) == pytest.approx(0.0, abs=1e-15)
        seen.append(amplitude(off, at + 1e-2 * side, pitch_m))
    assert seen[0] == pytest.approx(-seen[1])
    # As an arc tangent has it of which one signal lies off its middle: once a period, and hardly anything else.
    phase = 2.0 * np.pi * at / pitch_m
    turned = np.angle(np.exp(1j * (np.arctan2(np.sin(phase) + 1e-5, np.cos(phase)) - phase)))
    assert abs(amplitude(turned, at, pitch_m)) == pytest.approx(1e-5)
    assert abs(amplitude(turned, at, 0.5 * pitch_m)) < 1e-9


def test_a_beam_that_the_next_carriage_drags_leans_on_a_guide():
    one = Alone("guide_straightness", 1e-5, variant="dragged_beam", place="right")
    leans = one.effect.beam_leans
    others = [Alone("guide_straightness", 1e-5, variant="dragged_beam", seed=k).effect.beam_leans for k in range(12)]
    assert {math.copysign(1.0, x) for x in others} == {-1.0, 1.0}
    assert 0.2 <= min(np.abs(others)) < max(np.abs(others)) <= 0.8
    assert not np.any(one.deviation().sideways_m)
    places = np.array([LOW_M, MIDDLE_M, HIGH_M])
    for side in (1.0, -1.0, -1.0, 1.0):
        one.move(0, one.q[0] + 0.2 * side)
        one.move(1, HOME_M + 0.1 * side)
        d = one.deviation(t_s=np.full(3, one.t_s), q=along(places, 1) + np.outer(np.ones(3), [one.q[0] - HOME_M, 0.0]))
        assert d.sideways_m[:, 1] == pytest.approx(1e-5 * side * np.array([1.0 - leans, 1.0, 1.0 + leans]))
        assert not np.any(d.sideways_m[:, 0])
        assert not np.any(d.yaw_rad)


def test_a_carriage_falls_into_one_of_three_seats_after_each_motion():
    one = Alone("guide_angular", 1e-4, variant="three_seats")
    middle = one.effect.seats[1]
    assert abs(middle) <= 0.4
    assert Alone("guide_angular", 1e-4, variant="three_seats", seed=2).effect.seats[1] != middle
    seen = []
    for k in range(600):
        one.move(0, HOME_M + 0.1 * (k % 2), rest_s=2.0)
        one.move(1, HOME_M + 0.1 * (k % 3), rest_s=0.0)
        d = one.deviation()
        assert d.yaw_rad[0, 1] == 0.0
        assert not np.any(d.sideways_m)
        assert one.deviation(t_s=one.t_s + 5.0).yaw_rad[0, 0] == d.yaw_rad[0, 0]  # until the next motion
        seen.append(d.yaw_rad[0, 0] / 1e-4)
    counts = [sum(abs(x - seat) < 1e-9 for x in seen) for seat in (-1.0, middle, 1.0)]
    assert sum(counts) == 600
    assert min(counts) > 150
    repeats = sum(np.diff(seen) == 0.0)
    assert 150 < repeats < 250  # one in three


def test_a_dashpot_lets_go_of_what_a_motion_of_the_other_axis_pulls():
    dashpot_s = drawn("axis_coupling", "relaxing_dashpot", "dashpot_s", low=20.0, high=80.0)
    one = Alone("axis_coupling", 1e-4, variant="relaxing_dashpot", place="right")
    piston_m, step = 0.0, 1e-2
    for _ in range(round(dashpot_s * 10.0 / step)):
        piston_m += step / dashpot_s * (HOME_M - MIDDLE_M - piston_m)
    one.t_s = dashpot_s * 10.0
    for to_m, rest_s in ((1.5, 7.0), (0.7, 60.0), (1.2, 2.0), (1.21, 300.0)):
        one.move(0, to_m, speed=1e4, rest_s=rest_s)
        for _ in range(round(rest_s / step)):
            piston_m += step / dashpot_s * (to_m - MIDDLE_M - piston_m)
        expected = 1e-4 * (to_m - MIDDLE_M - piston_m)
        assert one.deviation().travel_m[0] == pytest.approx([0.0, expected], abs=1e-4 * 2e-3)
        one.move(1, to_m, speed=1e4, rest_s=0.0)
    assert abs(expected) < 2e-5
    underway = Alone("axis_coupling", 1e-4, variant="relaxing_dashpot", place="right")
    underway.move(0, 1.6, speed=1e4, rest_s=0.0)
    begun_m = (1.6 - MIDDLE_M) * 1e-4
    assert underway.travel_m(drive=1) == pytest.approx(begun_m, abs=1e-9)  # nothing has let go yet


def test_messages_take_longer_while_the_channel_is_bad():
    repeats = drawn("latency", "burst_noise", "repeats", low=2.5, high=5.0)
    one = Alone("latency", 1e-3, variant="burst_noise", start_s=100.0)
    assert not np.array_equal(
        one.effect.bursts_s, Alone("latency", 1e-3, variant="burst_noise", seed=2).effect.bursts_s
    )
    lasts_s = np.diff(one.effect.bursts_s, prepend=0.0)
    assert np.mean(lasts_s[::2]) == pytest.approx(400.0, rel=0.3)
    assert np.mean(lasts_s[1::2]) == pytest.approx(250.0, rel=0.3)
    assert np.std(lasts_s[::2]) == pytest.approx(400.0, rel=0.35)  # of an exponential: as much as its mean
    now_s, bad, seen = 0.0, False, set()
    for lasts in lasts_s[:20].tolist():
        early = np.atleast_1d(one.effect.early_s(one.motion_states(100.0 + now_s + 0.5 * lasts, velocity=(0.3, 0.0))))
        assert early == pytest.approx([1e-3 * repeats if bad else 1e-3])
        seen.add(bad)
        now_s, bad = now_s + lasts, not bad
    assert seen == {False, True}
    assert not np.any(one.deviation(t_s=5000.0).travel_m)


def test_a_weight_on_a_rope_swings_the_more_slowly_the_lower_its_drive_stands():
    tau = 2.0
    pulley_m = drawn("servo_settling", "pendulum_rope", "pulley_m", low=0.1, high=0.5)
    one = Alone("servo_settling", 1e-4, variant="pendulum_rope", tau_s=tau)
    for to_m, speed in ((HIGH_M - 0.02, 0.5), (LOW_M + 0.05, 0.25), (MIDDLE_M, 0.1)):
        side = math.copysign(1.0, to_m - one.q[0])
        one.move(0, to_m, speed=speed, rest_s=0.0)
        stops_s = one.t_s
        one.move(1, to_m, speed=1e4, rest_s=0.0)  # the other one's
        rope_m = HIGH_M + pulley_m - to_m
        rate = 2.5 / tau * math.sqrt((HALF_M + pulley_m) / rope_m)
        # y'' + 2 d y' + (rate^2 + d^2) y = 0 from -behind on, step by step.
        decay, behind = 0.3 / tau, 1e-4 * side * speed / 0.5
        place, pace, step = -behind, behind * decay, 2e-4
        for k in range(1, 40001):
            pace -= step * (2.0 * decay * pace + (rate**2 + decay**2) * place)
            place += step * pace
            if k % 8000 == 0:
                d = one.deviation(t_s=stops_s + k * step)
                assert d.travel_m[0] == pytest.approx([place, 0.0], abs=2e-3 * abs(behind))
        one.t_s = stops_s + 20.0


def test_a_tape_that_bears_a_part_of_the_payload_is_stretched_from_where_it_is_held():
    held = drawn("drive_scale", "loaded_tape", "held", low=-0.5, high=0.5)
    one = Alone("drive_scale", 3e-5, variant="loaded_tape", place="right", onset_s=200.0, start_s=50.0)
    places = np.array([LOW_M, MIDDLE_M + held * HALF_M, HIGH_M])
    for payload_kg in (0.0, 150.0, 400.0):
        assert not np.any(one.deviation(t_s=249.0, payload_kg=payload_kg).travel_m)
        d = one.deviation(t_s=np.full(3, 251.0), q=along(places, 1), payload_kg=payload_kg)
        strain = 3e-5 * payload_kg / 400.0 / (HIGH_M - places[1])
        assert d.travel_m[:, 1] == pytest.approx(strain * (places - places[1]), abs=1e-15)
        assert not np.any(d.travel_m[:, 0])
