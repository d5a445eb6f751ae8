"""Third former final forms of drives, guides and controls against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects.base import GRAVITY_M_PER_S2
from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along, travel

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA_SCREW = 10.5e-6


def test_a_motor_that_holds_its_load_warms_and_its_fan_cools_it():
    tau = 800.0
    one = Alone("screw_thermal_growth", 2.0, variant="holding", tau_s=tau)
    one.t_s = 400.0
    one.move(0, 1.6, speed=0.01, rest_s=200.0)
    one.move(0, 0.8, speed=0.02, rest_s=0.0)
    legs = one.history.legs(0)[1:]
    warm, step, now_s, seen = 0.0, 0.05, 0.0, {}
    times = [150.0, 400.0, legs[0].end_s, legs[1].start_s, legs[1].end_s, legs[1].end_s + 300.0]
    for until_s in times:
        while now_s < until_s - 0.5 * step:
            moves = any(leg.start_s <= now_s < leg.end_s for leg in legs)
            warm, now_s = warm + step / tau * (-4.0 * warm if moves else 1.0 - warm), now_s + step
        seen[until_s] = warm
    place = one.q[0]
    for t_s, share in seen.items():
        at_m = np.interp(t_s, [400.0, legs[0].end_s, legs[1].start_s, legs[1].end_s], [HOME_M, 1.6, 1.6, place])
        cells = np.linspace(LOW_M, at_m, 20001)
        warmth = 2.0 * share * np.exp(-(cells - LOW_M) / 0.8)  # falls off by e in 0.8 m from the motor
        expected = ALPHA_SCREW * float(np.sum(0.5 * (warmth[1:] + warmth[:-1]) * np.diff(cells)))
        assert travel(one, np.array([at_m]), t_s=t_s)[0] == pytest.approx(expected, rel=2e-3)
        assert one.travel_m(drive=1, t_s=t_s) == 0.0
    assert seen[legs[0].end_s] < seen[400.0] < seen[legs[1].end_s + 300.0]


def test_the_other_drive_shakes_a_slider_down_through_its_play():
    def stands_m(own, other, *, waits_s=0.0, other_first=False):
        one = Alone("backlash", 2e-5, variant="shaken_down")
        moves = [(0, HOME_M + 0.1 * own, 0.1), (1, HOME_M + 0.1, other)]
        begins_s = 10.0
        for drive, to_m, speed in moves:
            if not speed:
                continue
            way_s = 0.1 / speed
            late_s = waits_s if drive == 1 and not other_first else 0.0
            ends_s = begins_s + 2.0 + late_s if drive == 0 or not other_first else begins_s + 1.0
            one.history.add(drive, ends_s - way_s, ends_s, to_m, speed)
            one.q[drive] = to_m
        one.t_s = begins_s + 60.0
        assert one.travel_m(drive=1) == 0.0
        return one.travel_m()

    assert stands_m(1, 0.0) == pytest.approx(-1e-5)
    assert stands_m(-1, 0.0) == pytest.approx(1e-5)
    assert stands_m(1, 0.15) == pytest.approx(-1e-5)  # it lies on the lower flank already
    for speed, share in ((0.1, 0.25), (0.14, 0.49), (0.2, 1.0), (0.4, 1.0)):
        assert stands_m(-1, speed) == pytest.approx(1e-5 - 2e-5 * share)
        assert stands_m(-1, speed, waits_s=5.0) == pytest.approx(1e-5 - 2e-5 * share)
    assert stands_m(-1, 0.4, other_first=True) == pytest.approx(1e-5)  # that one stood when this one arrived


def test_a_screw_runs_in():
    one = Alone("friction_windup", 1e-8, variant="running_in", friction_n=200.0)
    one.move(0, HOME_M + 0.2)
    way_m = 0.2
    for k in range(120):
        side = 1.0 if k % 2 else -1.0
        one.move(0, HOME_M + 0.2 * side, speed=0.1 + 0.003 * k, rest_s=1.0 + k)
        one.move(1, HOME_M + 0.3 * side)
        way_m += 0.4
        if k in (0, 33, 118, 119):
            d = one.deviation(payload_kg=100.0)
            friction = side * 200.0 * (0.25 + 0.75 * math.exp(-way_m / 40.0))
            assert d.force_n[0] == pytest.approx([friction, 0.0])
            assert d.travel_m[0, 0] == pytest.approx(-1e-8 * (250.0 * GRAVITY_M_PER_S2 / 2.0 + friction))


def test_a_grating_is_stitched_from_fields_that_are_too_long():
    one = Alone("screw_cumulative_error", 1e-5, variant="stitched_fields")
    field_m = one.effect.field_m
    assert 0.09 <= field_m <= 0.16
    at = np.linspace(LOW_M, HIGH_M, 20001)
    off = travel(one, at)
    jumps = np.diff(off) < -1e-5
    assert abs(int(jumps.sum()) - (HIGH_M - LOW_M) / field_m) <= 1.0
    assert np.diff(at[1:][jumps]) == pytest.approx(field_m, abs=2e-4)
    slopes = np.diff(off)[~jumps] / (at[1] - at[0])
    assert slopes == pytest.approx(np.full(len(slopes), 2e-5 / field_m), rel=1e-6)
    assert [off.min(), off.max()] == pytest.approx([-1e-5, 1e-5], rel=2e-3)
    assert not np.any(one.deviation(t_s=np.zeros(20001), q=along(at)).travel_m[:, 1])
    other = Alone("screw_cumulative_error", 1e-5, variant="stitched_fields", seed=2).effect
    assert other.field_m != field_m


def test_a_payload_twists_a_screw_against_its_encoder():
    one = Alone("screw_periodic_error", 1e-5, variant="twisted_phase", period_m=0.01)
    for begins in (LOW_M, HOME_M, HIGH_M - 0.01):
        at = begins + np.linspace(0.0, 0.01, 200, endpoint=False)
        phases = []
        for payload_kg in (0.0, 200.0, 400.0):
            # Taken at one place of the twist only: what is left of the screw changes by less than a hundredth.
            first = np.mean(travel(one, at, payload_kg=payload_kg) * np.exp(-2j * np.pi * (at - begins) / 0.01))
            assert 2.0 * abs(first) == pytest.approx(1e-5, rel=3e-3)
            phases.append(np.angle(first))
        late = -(np.unwrap(phases) - phases[0])
        above = (HIGH_M - begins - 0.005) / (HIGH_M - LOW_M)
        assert late == pytest.approx(2.5 * above * np.array([0.0, 0.5, 1.0]), abs=0.02)


def test_a_head_smears_a_drop_over_its_scale():
    one = Alone("encoder_interpolation", 1e-5, variant="smeared_drop", pitch_m=2e-4)
    drop_m = one.effect.drop_m
    assert abs(drop_m - MIDDLE_M) <= 0.5 * HALF_M
    assert Alone("encoder_interpolation", 1e-5, variant="smeared_drop", seed=2).effect.drop_m != drop_m
    fine = np.linspace(0.0, 2e-4, 16, endpoint=False)

    def amplitudes():
        found = []
        for from_drop in (-0.2, 0.0, 0.1):
            spectrum = np.abs(np.fft.rfft(travel(one, drop_m + from_drop + fine))) / 8.0
            assert spectrum[2:].max() < 2e-3 * max(spectrum[1], 1e-8)
            found.append(spectrum[1])
        return np.array(found)

    def expected(way_m):
        wide = 0.12 * np.sqrt(1.0 + way_m / 15.0)
        return 1e-5 * 2.0 * 0.12 / wide * np.exp(-np.square(np.array([-0.2, 0.0, 0.1]) / wide))

    # A state counts the way from where its leg began, here HOME_M, to the place that is asked for.
    assert amplitudes() == pytest.approx(expected(np.abs(drop_m + np.array([-0.2, 0.0, 0.1]) - HOME_M)), rel=4e-3)
    for k in range(150):
        one.move(0, HOME_M + 0.4 * (1 - k % 2), speed=0.1 + 0.002 * k)
        one.move(1, HOME_M + 0.2 * (1 - k % 2))
    one.move(0, HOME_M, rest_s=5.0)  # a leg without a way
    way_m = 60.0 + np.abs(drop_m + np.array([-0.2, 0.0, 0.1]) - HOME_M)
    assert amplitudes() == pytest.approx(expected(way_m), rel=2e-3)
    assert one.travel_m(drive=1) == 0.0


def test_both_blocks_of_a_carriage_pass_one_dent():
    one = Alone("guide_straightness", 1e-5, variant="two_blocks_one_dent")
    dent_m = MIDDLE_M + one.effect.joint * HALF_M
    at = dent_m + np.array([-0.3, -0.1, -0.1 + 0.045, 0.0, 0.1 - 0.045, 0.1, 0.3])
    d = one.deviation(t_s=np.zeros(7), q=along(at))
    sinks = -1.8e-5 * np.array(
        [0.0, 1.0, math.exp(-1.0), 2.0 * math.exp(-((0.1 / 0.045) ** 2)), math.exp(-1.0), 1.0, 0.0]
    )
    assert d.sideways_m[:, 0] == pytest.approx(sinks, abs=3e-10)
    assert not np.any(d.yaw_rad)
    assert not np.any(d.sideways_m[:, 1])


def test_a_block_loses_its_preload_above_a_certain_payload():
    one = Alone("guide_angular", 1e-4, variant="unloaded_block", wavelength_m=0.5)
    unloads_kg = one.effect.unloads_kg
    assert 60.0 <= unloads_kg <= 180.0
    assert Alone("guide_angular", 1e-4, variant="unloaded_block", seed=2).effect.unloads_kg != unloads_kg
    at = HOME_M - 0.3 + np.linspace(0.0, 0.5, 50, endpoint=False)
    for payload_kg in (0.0, unloads_kg, 0.5 * (unloads_kg + 400.0), 400.0):
        d = one.deviation(t_s=np.zeros(50), q=along(at), payload_kg=payload_kg)
        spectrum = np.abs(np.fft.rfft(d.yaw_rad[:, 0])) / 25.0
        beyond = max(payload_kg - unloads_kg, 0.0) / 400.0
        assert spectrum[1] == pytest.approx(1e-4 * (0.4 + 3.0 * beyond))
        assert d.yaw_rad[:, 0].mean() == pytest.approx(1e-4 * beyond, abs=1e-12)
        assert spectrum[2:].max() < 1e-12
        assert not np.any(d.sideways_m)
        assert not np.any(d.yaw_rad[:, 1])


def test_a_rope_pulls_by_which_way_the_other_axis_went():
    one = Alone("axis_coupling", 1e-4, variant="shared_rope")
    assert one.travel_m() == pytest.approx(1e-4 * (HOME_M - MIDDLE_M))
    for to_m, grows in ((MIDDLE_M + 0.3, 1.0), (MIDDLE_M - 0.2, -1.0), (MIDDLE_M + 0.1, 1.0)):
        one.move(0, HOME_M - 0.1 * grows)  # its own direction does nothing
        one.move(1, to_m, speed=0.2 + 0.1 * grows)
        # dT = mu T d(angle) in small steps around the pulleys.
        pull, steps = 1.0, 100000
        for _ in range(steps):
            pull += grows * 0.5 / steps * pull
        assert one.travel_m() == pytest.approx(1e-4 * (to_m - MIDDLE_M) * pull, rel=1e-4)
        assert one.travel_m(drive=1) == 0.0


def test_a_station_filters_less_above_a_certain_speed():
    one = Alone("latency", 1e-3, variant="adaptive_filter")
    switches, shorter = one.effect.switches_m_per_s, one.effect.shorter
    assert 0.15 <= switches <= 0.35
    assert 0.15 <= shorter <= 0.5
    for speed, share in ((0.0, 1.0), (0.99 * switches, 1.0), (1.01 * switches, shorter), (0.5, shorter)):
        for velocity in ((speed, 0.0), (0.0, -speed)):
            assert one.effect.early_s(one.motion_states(velocity=velocity)) == pytest.approx(1e-3 * share)
    other = Alone("latency", 1e-3, variant="adaptive_filter", seed=2).effect
    assert other.switches_m_per_s != switches
    assert not np.any(one.deviation(velocity=(0.5, 0.5)).travel_m)


def test_an_integral_part_that_a_long_way_has_wound_up_carries_a_slider_beyond():
    tau = 2.0
    one = Alone("servo_settling", 1e-5, variant="wound_up", tau_s=tau)
    assert one.travel_m() == 0.0
    left, at_s = 0.0, 0.0
    for to_m, speed, rest_s in (
        (1.5, 0.25, 1.0),
        (1.36, 0.1, 2.0),
        (1.35, 0.1, 0.5),
        (0.6, 0.5, 0.2),
        (0.61, 0.1, 4.0),
    ):
        way_m = to_m - one.q[0]
        winds = math.copysign(min(max((abs(way_m) - 0.04) / 0.21, 0.0), 1.0), way_m)
        middle_s = one.t_s + 0.5 * abs(way_m) / speed
        left, at_s = left * math.exp(-(middle_s - at_s) / (3.0 * tau)) + winds, middle_s
        one.move(0, to_m, speed=speed, rest_s=rest_s)
        expected = 1e-5 * left * math.exp(-(one.t_s - at_s) / (3.0 * tau))
        assert one.travel_m() == pytest.approx(expected)
        assert one.travel_m(drive=1) == 0.0
    assert left < -0.5  # it has gone far down, and the short way up has wound up nothing


def test_hard_stops_slip_a_coupling_in_their_sense():
    one = Alone("drive_scale", 3e-5, variant="slipping_coupling", onset_s=100.0)
    one.move(0, 1.6, speed=0.5)  # too early
    assert one.travel_m() == 0.0
    one.t_s = 200.0
    slipped = 0.0
    for drive, to_m, speed in (
        (0, 1.0, 0.5),
        (0, 1.1, 0.19),
        (1, 1.5, 0.5),
        (0, 1.5, 0.4),
        (0, 0.7, 0.3),
        (0, 0.8, 0.5),
    ):
        if drive == 0 and speed > 0.2:
            slipped += math.copysign((speed / 0.2) ** 2 - 1.0, to_m - one.q[0]) / 15.0
        one.move(drive, to_m, speed=speed, rest_s=7.0)
        assert travel(one, np.array([one.q[0]])) == pytest.approx(3e-5 * slipped, abs=1e-18)
        assert one.travel_m(drive=1) == 0.0
    assert slipped == pytest.approx((-5.25 + 3.0 - 1.25 + 5.25) / 15.0)
