"""Second former final forms of drives, guides and controls against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects.base import GRAVITY_M_PER_S2
from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, Temperatures, along, travel

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA_SCREW = 10.5e-6


def test_only_what_is_lifted_warms_the_motor_and_its_end_of_the_screw():
    tau = 1000.0
    one = Alone("screw_thermal_growth", 2.0, variant="lifting", tau_s=tau)
    one.move(0, 0.7, speed=0.1, rest_s=0.0)
    assert one.travel_m(t_s=400.0) == 0.0  # it went down
    begins_s = one.t_s
    one.move(0, 1.3, speed=0.1, rest_s=0.0)
    a_second = 2.0 / (0.01 * tau) * math.exp(-(400.0 - begins_s - 3.0) / tau)
    at = np.array([LOW_M, 0.9, 1.3, HIGH_M])
    grown = travel(one, at, t_s=400.0)
    for place, found in zip(at, grown, strict=True):  # warmth falls off by e in 0.6 m from the upper end
        warm = a_second * max(place - 0.7, 0.0) / 0.1  # as long as it was lifted to where it stands
        cells = np.linspace(LOW_M, place, 20001)
        warmth = warm * np.exp((cells - HIGH_M) / 0.6)
        expected = ALPHA_SCREW * float(np.sum(0.5 * (warmth[1:] + warmth[:-1]) * np.diff(cells)))
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-15)
    fast = Alone("screw_thermal_growth", 2.0, variant="lifting", tau_s=tau)
    fast.t_s = 12.0 - 3.0
    fast.move(0, HOME_M + 0.6, speed=0.5, rest_s=0.0)
    slow = Alone("screw_thermal_growth", 2.0, variant="lifting", tau_s=tau)
    slow.t_s = 12.0 - 5.4
    slow.move(0, HOME_M + 0.6, speed=0.1, rest_s=0.0)
    assert slow.travel_m(t_s=400.0) == pytest.approx(5.0 * fast.travel_m(t_s=400.0), rel=0.01)
    assert slow.travel_m(drive=1, t_s=400.0) == 0.0


def test_the_play_of_a_nut_grows_with_its_way():
    one = Alone("backlash", 2e-5, variant="wearing")
    one.move(0, 1.3)
    assert one.travel_m() == pytest.approx(-1e-5 * (0.15 + 0.85 * 0.2 / 100.0))
    for k in range(99):
        one.move(0, 1.3 - 0.5 * ((k + 1) % 2), speed=0.1 + 0.004 * k, rest_s=1.0 + k)
        one.move(1, 1.3 - 0.3 * (k % 2))
    way_m = 0.2 + 99 * 0.5
    assert one.travel_m() == pytest.approx(1e-5 * (0.15 + 0.85 * way_m / 100.0))  # it went down last
    one.move(0, 1.3)
    assert one.travel_m() == pytest.approx(-1e-5 * (0.15 + 0.85 * (way_m + 0.5) / 100.0))
    assert one.travel_m(drive=1) == 0.0


def test_seals_rub_less_downwards_and_by_the_root_of_the_speed():
    one = Alone("friction_windup", 1e-8, variant="seal_lips", friction_n=200.0)
    rubs = {}
    for speed in (0.5, 0.125):
        for to_m in (1.3, 1.0):
            one.move(0, to_m, speed=speed)
            d = one.deviation()
            rubs[speed, to_m] = d.force_n[0, 0]
            assert d.travel_m[0, 0] == pytest.approx(-1e-8 * (150.0 * GRAVITY_M_PER_S2 / 2.0 + d.force_n[0, 0]))
            assert d.force_n[0, 1] == 0.0
    assert rubs[0.5, 1.3] == pytest.approx(200.0)
    assert rubs[0.5, 1.0] == pytest.approx(-0.45 * 200.0)
    assert rubs[0.125, 1.3] == pytest.approx((0.35 + 0.65 / 2.0) * 200.0)
    assert rubs[0.125, 1.0] == pytest.approx(-0.45 * (0.35 + 0.65 / 2.0) * 200.0)


def test_wheels_of_a_grinder_are_copied_into_a_screw():
    one = Alone("screw_cumulative_error", 1e-5, variant="copied_gear")
    copied_m = one.effect.copied_m
    assert 0.2 <= copied_m <= 0.45
    at = np.linspace(LOW_M, HIGH_M, 2001)
    off = travel(one, at)
    assert np.abs(off).max() == pytest.approx(1e-5)
    assert np.polyfit(at - MIDDLE_M, off, 1) == pytest.approx([0.0, 0.0], abs=1e-12)
    turn = 2.0 * np.pi * at / copied_m
    terms = np.stack([np.ones_like(at), at, np.sin(turn), np.cos(turn), np.sin(3.0 * turn), np.cos(3.0 * turn)], axis=1)
    found, left, *_ = np.linalg.lstsq(terms, off, rcond=None)
    assert float(left[0]) < 1e-20
    assert math.hypot(*found[4:]) == pytest.approx(0.4 * math.hypot(*found[2:4]))
    assert np.ptp(travel(Alone("screw_cumulative_error", 1e-5, variant="copied_gear", seed=2), at) - off) > 1e-6


def test_torque_ripples_with_what_the_motor_carries():
    one = Alone("screw_periodic_error", 1e-5, variant="torque_ripple", period_m=0.012)
    at = HOME_M + np.linspace(0.0, 0.012, 240, endpoint=False)

    def ripple(payload_kg):
        spectrum = np.abs(np.fft.rfft(travel(one, at, payload_kg=payload_kg))) / 120.0
        assert np.delete(spectrum, 6).max() < 1e-12
        return spectrum[6]

    one.move(0, HOME_M - 0.1)
    one.move(0, HOME_M - 0.05)  # upwards
    assert ripple(0.0) == pytest.approx(1e-5)
    assert ripple(300.0) == pytest.approx((0.6 * 3.0 + 0.4) * 1e-5)
    one.move(0, HOME_M - 0.1)
    assert ripple(0.0) == pytest.approx(0.2e-5)
    assert ripple(300.0) == pytest.approx((0.6 * 3.0 - 0.4) * 1e-5)
    assert not np.any(one.deviation().travel_m[:, 1])


def test_signals_are_right_at_one_temperature_only():
    one = Alone("encoder_interpolation", 1e-5, variant="warm_signals", pitch_m=2e-4)
    set_k = one.effect.set_k
    assert 1.5 <= abs(set_k) <= 4.0
    assert {np.sign(Alone("encoder_interpolation", 1e-5, seed=k).effect.set_k) for k in range(12)} == {-1.0, 1.0}
    at = HOME_M + np.linspace(0.0, 2e-4, 64, endpoint=False)
    for kelvin in (set_k, set_k + 1.5, set_k - 3.0):
        one.temperatures = Temperatures(lambda t, kelvin=kelvin: np.full_like(t, 20.0 + kelvin))
        spectrum = np.abs(np.fft.rfft(travel(one, at))) / 32.0
        share = abs(kelvin - set_k) / 1.5
        assert spectrum[1:3] == pytest.approx([share * 1e-5, share * 0.5e-5], abs=1e-16)
        assert spectrum[3:].max() < 1e-12


def test_a_rail_sags_between_its_supports_under_what_its_carriage_carries():
    one = Alone("guide_straightness", 1e-5, variant="moving_load")
    span_m = one.effect.span_m
    assert 0.26 <= span_m <= 0.4
    at = np.linspace(LOW_M, HIGH_M, 1381)
    empty, full = (
        one.deviation(t_s=np.zeros(1381), q=along(at), payload_kg=kg).sideways_m[:, 0] for kg in (0.0, 300.0)
    )
    assert full == pytest.approx(3.0 * empty)
    assert empty.max() <= 0.0
    assert empty.min() == pytest.approx(-0.6e-5, rel=1e-3)
    # A beam that is clamped at both ends yields by a^3 b^3 / (3 E I l^3) under a force at a from one end, b the other.
    first = (-one.effect.phase) % 1.0 * span_m
    a = (at - first) % span_m
    yields = (a * (span_m - a)) ** 3
    assert empty == pytest.approx(-0.6e-5 * yields / (0.5 * span_m) ** 6, abs=1e-15)
    d = one.deviation()
    assert not np.any(d.yaw_rad)
    assert not np.any(d.sideways_m[:, 1])


def test_two_rollers_that_are_not_round_turn_their_carriage():
    one = Alone("guide_angular", 1e-5, variant="unround_rollers")
    turns_m = one.effect.turns_m
    assert 0.025 * math.pi <= turns_m[0] < turns_m[1] <= 0.045 * math.pi * 1.1
    at = np.linspace(LOW_M, HIGH_M, 2001)
    d = one.deviation(t_s=np.zeros(2001), q=along(at))
    terms = [f(k * 2.0 * np.pi * at / turn_m) for turn_m in turns_m for k in (1, 2) for f in (np.sin, np.cos)]
    found, left, *_ = np.linalg.lstsq(np.stack(terms, axis=1), d.yaw_rad[:, 0], rcond=None)
    assert float(left[0]) < 1e-18
    assert np.hypot(found[::2], found[1::2]) == pytest.approx(1e-5 * np.array([0.7, 0.28, 0.7, 0.28]))
    assert not np.any(d.sideways_m)
    assert not np.any(d.yaw_rad[:, 1])


def test_a_bridge_gives_way_to_the_other_axis_and_the_load():
    one = Alone("axis_coupling", 1e-4, variant="loaded_bridge", place="right")
    at = np.array([LOW_M, MIDDLE_M, 1.5])
    for payload_kg, times in ((0.0, 1.0), (300.0, 3.0)):
        d = one.deviation(t_s=np.zeros(3), q=along(at), payload_kg=payload_kg)
        assert d.travel_m[:, 1] == pytest.approx(1e-4 * times * (at - MIDDLE_M), abs=1e-18)
        assert not np.any(d.travel_m[:, 0])


def test_a_value_is_older_and_older_until_two_cycles_have_run_past_one_another():
    one = Alone("latency", 1e-3, variant="beating_cycles", start_s=100.0)
    beats_s = one.effect.beats_s
    assert 150.0 <= beats_s <= 500.0
    t = 100.0 + np.linspace(0.0, 3.0 * beats_s, 3000, endpoint=False)
    early = np.asarray(one.effect.early_s(one.motion_states(t_s=t, q=np.full((3000, 2), HOME_M))))
    assert early.min() >= 0.0
    assert early.max() < 2e-3
    assert early.mean() == pytest.approx(1e-3, rel=2e-3)
    rises = np.diff(early)
    slope = 2e-3 / beats_s * (t[1] - t[0])
    assert np.sort(rises)[3:] == pytest.approx(np.full(2996, slope))
    assert np.sort(rises)[:3] == pytest.approx(np.full(3, slope - 2e-3))


def test_rubber_relaxes_by_half_an_order():
    tau = 2.0
    one = Alone("servo_settling", 1e-5, variant="half_order", tau_s=tau)
    assert one.travel_m(t_s=1.0) == 0.0
    one.move(0, 1.3, speed=0.25, rest_s=0.0)
    # exp(t) erfc(sqrt(t)) is spread over all rates: the integral of exp(-r t) / (pi sqrt(r) (1 + r)); with r = tan^2:
    angle = (np.arange(200000) + 0.5) * (0.5 * math.pi / 200000)
    for wait_s in (0.0, 0.3, 2.0, 11.0, 60.0):
        left = float(np.mean(np.exp(-(np.tan(angle) ** 2) * wait_s / tau)))
        assert one.travel_m(t_s=one.t_s + wait_s) == pytest.approx(-0.5e-5 * left, rel=2e-5)
    late = one.travel_m(t_s=one.t_s + 400.0)
    assert late == pytest.approx(-0.5e-5 / math.sqrt(math.pi * 200.0), rel=0.01)  # not yet gone
    one.move(0, 1.0, speed=0.5, rest_s=0.0)
    assert one.travel_m() == pytest.approx(1e-5)
    assert one.travel_m(drive=1) == 0.0


def test_a_scale_takes_up_moisture_by_diffusion():
    one = Alone("drive_scale", 3e-5, variant="damp_scale", onset_s=200.0)
    damp_s = one.effect.damp_s
    assert 1500.0 <= damp_s <= 5000.0
    # Half of a plate in 60 cells, its face in damp air, its middle tight; the slowest time constant is damp_s.
    cells, step = np.zeros(60), damp_s / 20000.0
    rate = 4.0 / math.pi**2 / damp_s * 60.0**2 * step
    for k in range(1, 30001):
        held = np.concatenate([[2.0 - cells[0]], cells, [cells[-1]]])
        cells = cells + rate * np.diff(held, 2)
        if k in (400, 6000, 30000):
            found = travel(one, np.array([LOW_M, MIDDLE_M, HIGH_M]), t_s=200.0 + k * step)
            assert found == pytest.approx(3e-5 * cells.mean() * np.array([0.0, 0.5, 1.0]), rel=0.01, abs=1e-18)
    assert one.travel_m(t_s=199.0) == 0.0
    assert one.travel_m(drive=1, t_s=9000.0) == 0.0
