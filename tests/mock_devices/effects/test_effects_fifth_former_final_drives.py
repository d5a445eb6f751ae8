"""Fifth former final forms of drives, guides and controls against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, Temperatures, along, amplitude, drawn, travel

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA_SCREW = 10.5e-6


def beside_grid(apart_m):
    """Places of both drives (n, 2), the right one above the left one by apart_m (n,)."""
    return np.stack([MIDDLE_M - 0.5 * apart_m, MIDDLE_M + 0.5 * apart_m], axis=1)


def test_oil_that_its_heat_has_thinned_warms_a_screw_less():
    tau = 900.0
    one = Alone("screw_thermal_growth", 3.0, variant="thinning_oil", tau_s=tau)
    one.t_s = 100.0
    for k in range(30):
        one.move(0, HOME_M + 0.4 * (1 - 2 * (k % 2)), speed=(0.5, 0.1, 0.25)[k % 3], rest_s=5.0 + k)
        one.move(1, HOME_M - 0.4 * (k % 2), rest_s=0.0)  # the other one's does nothing
    warm, at_s = 0.0, 0.0
    for leg in one.history.legs(0)[1:]:
        middle_s = 0.5 * (leg.start_s + leg.end_s)
        warm, at_s = warm * math.exp(-(middle_s - at_s) / tau), middle_s
        parts = 4000
        for _ in range(parts):  # each millimetre heats by the speed and by how thick the oil still is
            way_m = abs(leg.to_m - leg.from_m) / parts
            warm += way_m / (0.01 * tau) * leg.speed_m_per_s / 0.25 * math.exp(-1.5 * (warm - 1.0))
    warm *= math.exp(-(one.t_s - at_s) / tau)
    assert warm > 0.5
    assert one.travel_m() == pytest.approx(ALPHA_SCREW * 3.0 * warm * (one.q[0] - LOW_M), rel=2e-3)
    assert one.travel_m(drive=1) == 0.0
    steady = Alone("screw_thermal_growth", 3.0, variant="thinning_oil", tau_s=300.0)
    for k in range(150):
        steady.move(0, HOME_M + 0.05 * (1 - 2 * (k % 2)), speed=0.25, rest_s=9.6)
    assert steady.travel_m() == pytest.approx(ALPHA_SCREW * 3.0 * (steady.q[0] - LOW_M), rel=0.03)


def test_an_eccentric_wheel_opens_and_closes_play_once_a_turn():
    wheel_m = drawn("backlash", "eccentric_wheel", "wheel_m", low=0.03, high=0.09)
    one = Alone("backlash", 4e-5, variant="eccentric_wheel")
    at = HOME_M + np.arange(60) * wheel_m / 60.0
    for came_from in (1.0, -1.0):
        one.move(0, HOME_M + 0.2 * came_from)
        one.move(0, HOME_M, rest_s=3.0)
        off = came_from * travel(one, at)  # the slider stays behind on that side
        assert np.mean(off) == pytest.approx(1e-5)
        assert abs(amplitude(off, at, wheel_m)) == pytest.approx(1e-5)
        assert (off.min(), off.max()) == pytest.approx((0.0, 2e-5), abs=1e-7)
    assert one.travel_m(drive=1) == 0.0


def test_carriages_far_apart_jam_a_guide_like_a_drawer():
    jams_m = drawn("friction_windup", "jammed_drawer", "jams_m", low=0.6, high=1.0)
    one = Alone("friction_windup", 1e-8, variant="jammed_drawer", friction_n=300.0)
    for side in (1.0, -1.0):
        one.move(0, HOME_M - 0.2 * side)
        one.move(0, HOME_M)
        for apart_m in (0.0, 0.3, -0.3, 0.9 * jams_m, 1.3):
            d = one.deviation(q=[[HOME_M, HOME_M + apart_m]])
            lever = min(abs(apart_m) / jams_m, 1.0)
            friction_n = 60.0  # and what it presses by its own lever rubs again
            for _ in range(200):
                friction_n = 60.0 + 0.8 * lever * friction_n
            assert d.force_n[0] == pytest.approx([side * friction_n, 0.0])
            load_n = 150.0 * 9.80665 / 2.0
            assert d.travel_m[0, 0] == pytest.approx(-1e-8 * (load_n + side * friction_n))


def test_a_blow_has_left_waves_that_grow_shorter_towards_it():
    drawn("screw_cumulative_error", "dispersed_blow", "waves", low=4.0, high=7.0)
    one = Alone("screw_cumulative_error", 1e-5, variant="dispersed_blow")
    blow_m, waves = one.effect.blow_m, one.effect.waves
    assert 0.4 <= LOW_M - blow_m <= 0.7
    at = np.linspace(LOW_M, HIGH_M, 2001)
    off = travel(one, at)
    from_m = at - blow_m
    phase = 2.0 * np.pi * waves * (1.0 / from_m) / (1.0 / from_m[0] - 1.0 / from_m[-1])
    columns = np.column_stack([from_m**-1.5 * np.cos(phase), from_m**-1.5 * np.sin(phase), np.ones(2001), at])
    found, *_ = np.linalg.lstsq(columns, off, rcond=None)
    assert columns @ found == pytest.approx(off, abs=1e-13)
    assert found[0] == pytest.approx(found[1])  # an eighth of a turn, as on water
    assert np.abs(off).max() == pytest.approx(1e-5, rel=1e-3)
    assert np.polyfit(at, off, 1)[0] == pytest.approx(0.0, abs=1e-9)  # which would be the drive's scale
    crossings = at[1:][np.diff(np.sign(off - columns[:, 2:] @ found[2:])) != 0]
    assert np.all(np.diff(np.diff(crossings)) > 0.0)
    assert len(crossings) == pytest.approx(2.0 * waves, abs=1.5)


def test_a_shaft_gears_the_error_of_a_screw_to_the_next_one():
    geared = drawn("screw_periodic_error", "geared_together", "geared", low=0.25, high=0.6)
    one = Alone("screw_periodic_error", 1e-5, variant="geared_together", period_m=0.01)
    mine = HOME_M + np.linspace(0.0, 0.01, 50, endpoint=False)
    others = np.linspace(1.0, 1.0 + 0.01 / geared, 40, endpoint=False)
    found = []
    for other_m in others:
        q = np.stack([mine, np.full(50, other_m)], axis=1)
        d = one.deviation(t_s=np.zeros(50), q=q)
        assert np.abs(np.fft.rfft(d.travel_m[:, 0])[2:]).max() < 1e-15  # once a turn of its own
        assert not np.any(d.travel_m[:, 1])
        found.append(amplitude(d.travel_m[:, 0], mine, 0.01))
    own, shaft = np.mean(found), np.array(found) - np.mean(found)
    assert abs(own) == pytest.approx(2e-6)
    assert np.abs(shaft) == pytest.approx(np.full(40, 8e-6))
    turned = np.unwrap(np.angle(shaft))
    assert turned - turned[0] == pytest.approx(2.0 * np.pi * geared * (others - others[0]) / 0.01)


def test_errors_of_two_tracks_of_unequal_pitch_beat():
    periods = drawn("encoder_interpolation", "two_tracks", "periods", low=15, high=40)
    one = Alone("encoder_interpolation", 1e-5, variant="two_tracks", pitch_m=2e-4)
    long_m = 2e-4 * periods
    at = HOME_M + np.linspace(0.0, long_m, 64 * periods, endpoint=False)
    off = travel(one, at)
    spectrum = 2.0 * np.abs(np.fft.rfft(off)) / len(at)
    assert spectrum[[periods, periods + 1]] == pytest.approx([7e-6, 7e-6])
    spectrum[[periods, periods + 1]] = 0.0
    assert spectrum.max() < 1e-12
    loud = np.abs(off).reshape(periods, -1).max(axis=1)  # within each period
    assert loud.max() > 1.3e-5
    assert loud.min() < 2.5e-6


def test_a_carriage_that_comes_abreast_presses_a_guide_aside():
    reach_m = drawn("guide_straightness", "carriage_abreast", "abreast_m", low=0.12, high=0.22)
    apart = np.array([-0.6, -reach_m, -0.05, 0.0, 0.05, reach_m, 2.0 * reach_m])
    expected = 1e-5 * np.array([math.exp(-0.6 / reach_m), math.exp(-1.0), math.exp(-0.05 / reach_m), 1.0,
                                math.exp(-0.05 / reach_m), math.exp(-1.0), math.exp(-2.0)])  # fmt: skip
    for place, drive in (("left", 0), ("right", 1)):
        one = Alone("guide_straightness", 1e-5, variant="carriage_abreast", place=place)
        for moved_m in (-0.2, 0.0, 0.15):  # wherever they are abreast
            d = one.deviation(t_s=np.zeros(7), q=beside_grid(apart) + moved_m)
            assert d.sideways_m[:, drive] == pytest.approx(expected)
            assert not np.any(d.sideways_m[:, 1 - drive])
            assert not np.any(d.travel_m)


def test_warm_blocks_follow_the_waves_of_their_rail_further():
    opens_k = drawn("guide_angular", "warm_gap", "opens_k", low=-0.4, high=0.4)
    one = Alone("guide_angular", 1e-4, variant="warm_gap", wavelength_m=0.4)
    at = HOME_M - 0.2 + np.linspace(0.0, 0.4, 40, endpoint=False)
    for celsius, follows in ((17.0, 0.25), (20.0 + opens_k, 0.25), (20.5 + opens_k, 0.75), (23.0 + opens_k, 3.25)):
        one.temperatures = Temperatures(lambda t, celsius=celsius: np.full_like(t, celsius))
        yaw = one.deviation(t_s=np.zeros(40), q=along(at)).yaw_rad
        assert abs(amplitude(yaw[:, 0], at, 0.4)) == pytest.approx(1e-4 * follows)
        assert np.mean(yaw[:, 0]) == pytest.approx(0.0, abs=1e-15)
        assert not np.any(yaw[:, 1])


def test_a_thread_gives_way_by_half_while_the_other_axis_rests():
    silk_s = drawn("axis_coupling", "silk_after_effect", "silk_s", low=5.0, high=20.0)
    one = Alone("axis_coupling", 1e-4, variant="silk_after_effect")
    for to_m in (1.41, 0.61):
        one.move(1, to_m, rest_s=0.0)
        begins_s, given, step, now_s = one.t_s, 0.0, 2e-3, 0.0
        for rest_s in (0.0, 3.0, 12.0, 60.0):
            while now_s < rest_s - 0.5 * step:
                given, now_s = given + step / silk_s * (0.5 - given), now_s + step
            one.move(0, HOME_M + 0.01 * rest_s, speed=1e3, rest_s=0.0)  # its own motions do not tighten the thread
            off = one.travel_m(t_s=begins_s + rest_s)
            assert off == pytest.approx(1e-4 * (to_m - MIDDLE_M) * (1.0 - given), rel=1e-3)
        one.t_s = begins_s + 70.0
    assert one.travel_m(drive=1) == 0.0


def test_messages_wait_on_a_bus_that_moving_drives_crowd():
    full = drawn("latency", "crowded_bus", "crowded_m_per_s", low=1.3, high=2.0)
    one = Alone("latency", 1e-3, variant="crowded_bus")
    for velocity in ((0.0, 0.0), (0.5, 0.0), (0.0, -0.5), (0.5, -0.5), (-0.25, -0.1)):
        busy = (abs(velocity[0]) + abs(velocity[1])) / full
        waits = sum(busy**k for k in range(400))  # behind others, which wait behind others
        assert one.effect.early_s(one.motion_states(velocity=velocity)) == pytest.approx(1e-3 * waits)
    assert one.effect.early_s(one.motion_states(velocity=(5.0, 5.0))) == pytest.approx(0.02)
    assert not np.any(one.deviation(velocity=(0.5, 0.5)).travel_m)


def test_what_swings_on_depends_on_how_long_the_motion_lasted():
    tau = 2.0
    rate, falls = 8.0 / tau, 0.15 / tau
    one = Alone("servo_settling", 1e-4, variant="half_swings", tau_s=tau)
    whole_s = 2.0 * math.pi / rate
    after_s, most = np.linspace(0.0, whole_s, 40), []
    for moves_s, speed in ((whole_s, 0.2), (0.5 * whole_s, 0.2), (0.25, 0.5), (3.1, 0.1)):
        for side in (1.0, -1.0):
            one.t_s += 100.0
            one.move(0, one.q[0] + side * moves_s * speed, speed=speed, rest_s=0.0)
            one.move(1, HOME_M + 0.1 * side, rest_s=0.0, speed=1e4)  # the other one's does nothing
            off = one.deviation(t_s=one.history.legs(0)[-1].end_s + after_s, q=np.tile(one.q, (40, 1))).travel_m
            ends = [math.exp(-falls * (t + moves_s)) * math.sin(rate * (t + moves_s)) for t in after_s]  # of the start
            stops = [math.exp(-falls * t) * math.sin(rate * t) for t in after_s]
            expected = -0.5e-4 * side * speed / 0.5 * (np.array(stops) - np.array(ends))
            assert off[:, 0] == pytest.approx(expected, abs=1e-14)
            assert not np.any(off[:, 1])
        most.append(float(np.abs(off).max()))
    assert most[1] > 15.0 * most[0]  # half a swing and a whole one, at the same speed


def test_a_reader_switches_its_range_and_back_where_it_is_cooler():
    swing = Temperatures(lambda t: 21.0 + 0.6 * np.sin(np.maximum(t - 60.0, 0.0) / 900.0))
    up_k = drawn("drive_scale", "switching_range", "up_k", low=0.05, high=0.25)
    one = Alone("drive_scale", 3e-5, variant="switching_range", temperatures=swing, start_s=60.0, onset_s=5000.0)
    back_k, sign = one.effect.back_k, one.effect.sign
    assert 0.1 <= up_k - back_k <= 0.25
    t = 60.0 + 900.0 * np.linspace(0.0, 4.0 * math.pi, 300)
    off = one.deviation(t_s=t, q=along(np.full(300, HIGH_M))).travel_m
    assert not np.any(off[:, 1])
    turn = (t - 60.0) / 900.0 % (2.0 * math.pi)
    rises, falls = math.asin(up_k / 0.6), math.pi - math.asin(back_k / 0.6)
    clear = (np.abs(turn - rises) > 0.05) & (np.abs(turn - falls) > 0.05)
    on = (turn > rises) & (turn < falls)
    assert off[clear, 0] == pytest.approx(np.where(on, sign * 3e-5, 0.0)[clear])
    places = np.array([LOW_M, MIDDLE_M, HIGH_M])
    assert travel(one, places, t_s=60.0 + 450.0 * math.pi) == pytest.approx(sign * 3e-5 * np.array([-1.0, 0.0, 1.0]))
