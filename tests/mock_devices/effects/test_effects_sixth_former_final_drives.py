"""Sixth former final forms of drives, guides and controls against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, Temperatures, along, amplitude, drawn, travel

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA_SCREW = 10.5e-6


def at_celsius(one, celsius):
    """All parts at one temperature from now on."""
    one.temperatures = Temperatures(lambda t: np.full_like(t, celsius))


def test_ways_of_the_next_drive_warm_a_screw_from_its_upper_end():
    tau = 900.0
    one = Alone("screw_thermal_growth", 3.0, variant="neighbours_motor", tau_s=tau, place="right")
    one.t_s = 100.0
    warm, at_s = 0.0, 0.0
    for k in range(40):
        to_m = HOME_M + 0.4 * (1 - 2 * (k % 2))
        way_m, begins_s = abs(to_m - one.q[0]), one.t_s
        one.move(0, to_m, speed=(0.5, 0.1)[k % 2], rest_s=5.0 + k)
        middle_s = begins_s + 0.5 * way_m / (0.5, 0.1)[k % 2]
        warm = warm * math.exp(-(middle_s - at_s) / tau) + way_m / (0.01 * tau)
        at_s = middle_s
        one.move(1, HOME_M - 0.3 * (k % 2), speed=1e4, rest_s=0.0)  # its own do nothing
    warm *= math.exp(-(one.t_s - at_s) / tau)
    assert warm > 0.5
    places = np.array([LOW_M, 0.7, 1.2, HIGH_M])
    grown = []
    for place in places:  # what is below its nut has grown, each part as warm as it is
        along_m = np.linspace(LOW_M, place, 4001)
        profile = np.exp((along_m - HIGH_M) / 0.9)
        grown.append(float(np.sum(0.5 * (profile[1:] + profile[:-1]) * np.diff(along_m))))
    d = one.deviation(t_s=np.full(4, one.t_s), q=np.stack([np.full(4, one.q[0]), places], axis=1))
    assert d.travel_m[:, 1] == pytest.approx(ALPHA_SCREW * 3.0 * warm * np.array(grown), rel=1e-5)
    assert not np.any(one.deviation().travel_m[:, 0])


def test_a_counterweight_leaves_play_only_near_balance():
    balanced_kg = drawn("backlash", "counterpoised", "balanced_kg", low=0.0, high=400.0)
    one = Alone("backlash", 4e-5, variant="counterpoised")
    for came_from in (1.0, -1.0):
        one.move(0, HOME_M + 0.2 * came_from)
        one.move(0, HOME_M, rest_s=3.0)
        for payload_kg in (balanced_kg, balanced_kg + 180.0, abs(balanced_kg - 90.0), balanced_kg + 900.0):
            off = (payload_kg - balanced_kg) / 180.0
            expected = came_from * 2e-5 * math.exp(-off * off)
            assert one.travel_m(payload_kg=payload_kg) == pytest.approx(expected, abs=1e-15)
    assert one.travel_m(drive=1, payload_kg=balanced_kg) == 0.0


def test_friction_rises_until_a_lubricator_gives_oil():
    oils_s = drawn("friction_windup", "oiled_anew", "oils_s", low=700.0, high=1800.0)
    one = Alone("friction_windup", 1e-8, variant="oiled_anew", friction_n=400.0, start_s=50.0)
    one.move(0, HOME_M + 0.2)
    t = 200.0 + np.arange(0.0, 4000.0, 1.0)
    d = one.deviation(t_s=t, q=np.tile(one.q, (len(t), 1)))
    friction = d.force_n[:, 0]
    assert friction.min() == pytest.approx(100.0, abs=0.5)  # right after a pulse
    assert friction.max() == pytest.approx(400.0, abs=0.5)
    steps = np.diff(friction)
    falls = np.flatnonzero(steps < 0.0)
    assert np.diff(t[falls]) == pytest.approx(np.full(len(falls) - 1, oils_s), abs=1.0)
    assert np.delete(steps, falls) == pytest.approx(np.full(len(steps) - len(falls), 300.0 / oils_s))
    assert 2 <= len(falls) <= 5
    first = 1.0 - one.effect.oiled  # of a cycle: when the first pulse after the begin comes
    assert math.remainder((t[falls[0]] - 50.0) / oils_s - first, 1.0) == pytest.approx(0.0, abs=2e-3)
    load_n = 150.0 * 9.80665 / 2.0
    assert d.travel_m[:, 0] == pytest.approx(-1e-8 * (load_n + friction))
    one.move(0, HOME_M)
    assert one.deviation().force_n[0, 0] < -99.0
    assert not np.any(d.force_n[:, 1])


def test_a_corrector_of_few_harmonics_rings_beside_a_step():
    one = Alone("screw_cumulative_error", 1e-5, variant="few_terms")
    step_m, terms = one.effect.step_m, one.effect.terms
    assert abs(step_m - MIDDLE_M) <= 0.4 * HALF_M
    assert 2 <= terms <= 5
    assert len({Alone("screw_cumulative_error", 1e-5, variant="few_terms", seed=k).effect.terms for k in range(20)}) > 3
    at = np.linspace(LOW_M, HIGH_M, 4001)
    off = travel(one, at)
    assert np.abs(off).max() == pytest.approx(1e-5, rel=2e-2)
    assert np.polyfit(at, off, 1) == pytest.approx([0.0, 0.0], abs=2e-8)  # which would be the drive's scale and zero
    wave = 2.0 * HALF_M  # half of the period
    harmonics = np.array([np.sin(np.pi * k * (at - step_m) / wave) for k in range(1, 2 * terms, 2)])
    columns = np.column_stack([np.where(at < step_m, -1.0, 1.0), *harmonics, np.ones(len(at)), at])
    found, *_ = np.linalg.lstsq(columns, off, rcond=None)
    assert columns @ found == pytest.approx(off, abs=1e-13)
    odd = np.arange(1, 2 * terms, 2)
    assert found[1 : 1 + terms] == pytest.approx(-found[0] * 4.0 / np.pi / odd)  # Fourier's series of a step
    # Beside the step a series of few terms is too far over, by nearly a fifth of half the step (Gibbs).
    over = (columns[:, : 1 + terms] @ found[: 1 + terms] - found[0] * columns[:, 0])[np.abs(at - step_m) < wave / terms]
    assert np.abs(over).max() / abs(found[0]) == pytest.approx(1.18, abs=0.03)


def test_a_turn_of_a_conical_drum_takes_a_longer_way_higher_up():
    cone = drawn("screw_periodic_error", "conical_drum", "cone", low=0.08, high=0.3)
    one = Alone("screw_periodic_error", 1e-5, variant="conical_drum", period_m=0.02)
    at = np.linspace(LOW_M, HIGH_M, 40001)
    off = travel(one, at)
    assert np.abs(off).max() == pytest.approx(1e-5, rel=1e-4)
    up = np.flatnonzero((off[:-1] < 0.0) & (off[1:] >= 0.0))
    crossings = at[up] - off[up] * (at[1] - at[0]) / (off[up + 1] - off[up])
    middles = 0.5 * (crossings[1:] + crossings[:-1])
    periods = 0.02 * (1.0 + cone * (middles - MIDDLE_M) / HALF_M)
    assert np.diff(crossings) == pytest.approx(periods, rel=1e-3)
    assert len(crossings) > 60
    assert one.travel_m(drive=1) == 0.0


def test_a_lifted_head_has_one_weaker_signal():
    lifts_kg = drawn("encoder_interpolation", "lifted_head", "lifts_kg", low=200.0, high=500.0)
    one = Alone("encoder_interpolation", 1e-5, variant="lifted_head", pitch_m=2e-4)
    at = HOME_M + np.linspace(0.0, 2e-4, 256, endpoint=False)
    firsts = {}
    for payload_kg in (0.0, 150.0, 400.0):
        spectrum = 2.0 * np.abs(np.fft.rfft(travel(one, at, payload_kg=payload_kg))) / len(at)
        kept = 0.9 * math.exp(-payload_kg / lifts_kg)
        least = 0.9 * math.exp(-400.0 / lifts_kg)
        share, whole = (1.0 - kept) / (1.0 + kept), (1.0 - least) / (1.0 + least)
        for k in (1, 2, 3):  # the arc tangent's series
            assert spectrum[2 * k] == pytest.approx(1e-5 * share**k / k / whole, rel=1e-6)
        assert np.abs(spectrum[1::2]).max() < 1e-16
        firsts[payload_kg] = spectrum[2]
    assert firsts[400.0] == pytest.approx(1e-5)
    assert firsts[0.0] < 0.5 * firsts[150.0] < 0.5 * firsts[400.0]


def test_a_rail_buckles_aside_above_one_temperature():
    buckle_m = drawn("guide_straightness", "buckled_rail", "buckle_m", low=0.5, high=0.9)
    buckles_k = drawn("guide_straightness", "buckled_rail", "buckles_k", low=-0.4, high=0.4)
    one = Alone("guide_straightness", 1e-5, variant="buckled_rail")
    middle_m = one.effect.buckle_at_m
    assert abs(middle_m - MIDDLE_M) <= 0.3 * HALF_M
    at = middle_m + buckle_m * np.array([-0.6, -0.5, -0.25, 0.0, 0.125, 0.5, 0.7])
    shape = np.array([0.0, 0.0, 0.5, 1.0, math.cos(math.pi / 8.0) ** 2, 0.0, 0.0])
    for warmer_k, height in ((-3.0, 0.0), (0.0, 0.0), (0.25, 0.5), (1.0, 1.0), (4.0, 2.0)):
        at_celsius(one, 20.0 + buckles_k + warmer_k)
        d = one.deviation(t_s=np.zeros(7), q=along(at))
        assert d.sideways_m[:, 0] == pytest.approx(1e-5 * height * shape, abs=1e-12)
        assert not np.any(d.sideways_m[:, 1])
        assert not np.any(d.travel_m)


def test_pockets_whose_pressure_pulses_follow_the_waves_of_their_rail():
    pockets_s = drawn("guide_angular", "pulsing_pockets", "pockets_s", low=200.0, high=700.0)
    one = Alone("guide_angular", 1e-4, variant="pulsing_pockets", wavelength_m=0.4, start_s=20.0)
    at = HOME_M - 0.2 + np.linspace(0.0, 0.4, 40, endpoint=False)
    found = []
    for k in range(24):
        yaw = one.deviation(t_s=np.full(40, 20.0 + k * pockets_s / 24.0), q=along(at)).yaw_rad
        found.append(amplitude(yaw[:, 0], at, 0.4))
        assert not np.any(yaw[:, 1])
    found = np.array(found)
    steady = np.mean(found)
    assert abs(steady) == pytest.approx(0.4e-4)
    pulses = (found / steady).real * 0.4 - 0.4
    assert (found / steady).imag == pytest.approx(np.zeros(24), abs=1e-9)
    spectrum = 2.0 * np.abs(np.fft.rfft(pulses)) / 24.0
    assert spectrum[1] == pytest.approx(1.2)
    assert np.delete(spectrum, 1).max() < 1e-9


def test_a_rope_pulls_only_where_it_is_taut():
    taut_m = drawn("axis_coupling", "taut_rope", "taut_m", low=-0.4 * HALF_M, high=0.2 * HALF_M)
    one = Alone("axis_coupling", 1e-4, variant="taut_rope", place="right")
    for beyond_m, pull_m in ((-0.3, 0.0), (-1e-3, 0.0), (0.1, 0.1), (0.35, 0.35)):
        q = [[MIDDLE_M + taut_m + beyond_m, 0.9]]
        assert one.deviation(q=q).travel_m[0] == pytest.approx([0.0, 1e-4 * 2.0 * pull_m], abs=1e-15)


def test_a_clock_loses_by_the_square_of_how_far_its_quartz_is_off():
    best_k = drawn("latency", "warm_quartz", "best_k", low=-1.0, high=1.0)
    course = Temperatures(lambda t: 20.0 + 0.7 * np.sin(np.maximum(t - 500.0, 0.0) / 800.0))
    one = Alone("latency", 1e-3, variant="warm_quartz", start_s=500.0, temperatures=course)
    lost, step, now_s = 0.0, 0.5, 0.0
    for after_s in (0.0, 720.0, 2520.0, 5400.0):
        while now_s < after_s - 0.5 * step:
            off_k = 0.7 * math.sin((now_s + 0.5 * step) / 800.0) - best_k
            lost, now_s = lost + off_k**2 * step / 3600.0, now_s + step
        states = one.motion_states(500.0 + after_s, velocity=(0.3, -0.1))
        assert one.effect.early_s(states) == pytest.approx(1e-3 * lost, rel=1e-3)
    assert lost > 0.1
    assert not np.any(one.deviation(t_s=5000.0).travel_m)


def test_a_sampled_loop_takes_half_of_what_is_left_each_time_it_looks():
    tau = 2.0
    looks = drawn("servo_settling", "sampled_loop", "looks", low=0.0, high=1.0)
    one = Alone("servo_settling", 1e-4, variant="sampled_loop", tau_s=tau, start_s=10.0)
    for side, speed in ((1.0, 0.5), (-1.0, 0.1), (1.0, 0.25)):
        one.move(0, HOME_M + 0.13 * side, speed=speed, rest_s=0.0)
        stops_s = one.t_s
        one.move(1, HOME_M + 0.1 * side, rest_s=0.0, speed=1e4)  # the other one's does nothing
        moments_s = 10.0 + tau * (np.arange(200.0) - looks)
        after_s = np.linspace(0.01, 11.0, 60)
        looked = [int(np.sum((moments_s > stops_s) & (moments_s <= stops_s + s))) for s in after_s]
        d = one.deviation(t_s=stops_s + after_s, q=np.tile(one.q, (60, 1)))
        assert d.travel_m[:, 0] == pytest.approx(-1e-4 * side * speed / 0.5 * 0.5 ** np.array(looked, dtype=float))
        assert not np.any(d.travel_m[:, 1])
        assert len(set(looked)) >= 5
        one.t_s = stops_s + 17.3


def test_a_scale_swings_with_the_mains():
    mains_s = drawn("drive_scale", "wandering_mains", "mains_s", low=250.0, high=800.0)
    one = Alone("drive_scale", 3e-5, variant="wandering_mains", start_s=60.0, onset_s=900.0)
    assert not np.any(travel(one, np.array([LOW_M, HIGH_M]), t_s=959.0))
    t = 960.0 + np.arange(40) / 40.0 * mains_s
    upper, lower, middle = (one.deviation(t_s=t, q=along(np.full(40, at))).travel_m for at in (HIGH_M, LOW_M, MIDDLE_M))
    spectrum = 2.0 * np.abs(np.fft.rfft(upper[:, 0])) / 40.0
    assert spectrum[1] == pytest.approx(3e-5)
    assert np.delete(spectrum, 1).max() < 1e-16
    assert lower[:, 0] == pytest.approx(-upper[:, 0])
    assert middle[:, 0] == pytest.approx(np.zeros(40), abs=1e-18)
    assert not np.any(upper[:, 1])
