"""Seventh former final forms of drives, guides and controls against publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, Temperatures, along, amplitude, drawn, travel

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA_SCREW = 10.5e-6


def diffused(after_s, slowest_s, cells=200):
    """Mean of a plate one face of which is kept at one: Fick's second law, by implicit steps from cell to cell."""
    apart = 1.0 / cells
    diffuses = 4.0 / math.pi**2 / slowest_s  # of a plate of unit thickness
    steps = 800
    rate = diffuses * after_s / steps / apart**2
    matrix = (1.0 + 2.0 * rate) * np.eye(cells) - rate * (np.eye(cells, k=1) + np.eye(cells, k=-1))
    matrix[-1, -1] = 1.0 + rate  # nothing passes the other face
    matrix[0, 0] = 1.0 + 3.0 * rate  # half a cell to the face
    inverse, level = np.linalg.inv(matrix), np.zeros(cells)
    for _ in range(steps):
        begins = level.copy()
        begins[0] += 2.0 * rate
        level = inverse @ begins
    return float(level.mean())


def test_only_fast_motions_heat_a_screw_through_bubbling_oil():
    tau = 800.0
    bubbles = drawn("screw_thermal_growth", "bubbling_oil", "bubbles_m_per_s", low=0.15, high=0.3)
    one = Alone("screw_thermal_growth", 2.0, variant="bubbling_oil", tau_s=tau, place="right")
    warm, at_s = 0.0, 0.0
    speeds = (0.5, 0.1, bubbles + 1e-6, bubbles - 1e-6)
    for k in range(32):
        to_m, speed, begins_s = (LOW_M + 0.1, HIGH_M - 0.2, MIDDLE_M)[k % 3], speeds[k % 4], one.t_s
        way_m = abs(to_m - one.q[1])
        one.move(1, to_m, speed=speed, rest_s=9.0)
        one.move(0, 2.2 - to_m, speed=1e4, rest_s=0.0)  # the other one's
        if speed > bubbles:
            middle_s = begins_s + 0.5 * way_m / speed
            warm, at_s = warm * math.exp(-(middle_s - at_s) / tau) + way_m / (0.01 * tau), middle_s
        now = warm * math.exp(-(one.t_s - at_s) / tau)
        expected = -ALPHA_SCREW * 2.0 * now * (HIGH_M - to_m)  # held above
        assert one.deviation().travel_m[0] == pytest.approx([0.0, expected], abs=1e-12)
    assert now > 1.0


def test_a_nut_that_swells_closes_its_play_as_oil_diffuses_into_it():
    swells_s = drawn("backlash", "swollen_nut", "swells_s", low=2000.0, high=6000.0)
    one = Alone("backlash", 4e-5, variant="swollen_nut", start_s=70.0)
    shares = []
    for came_from in (1.0, -1.0):
        one.move(0, HOME_M + 0.2 * came_from)
        one.move(0, HOME_M)
        for after_s in (60.0, 900.0, 4000.0):
            share = 1.0 - 0.9 * diffused(after_s, swells_s)
            assert one.travel_m(t_s=70.0 + after_s) == pytest.approx(came_from * 2e-5 * share, rel=5e-3)
            shares.append(share)
    assert shares[0] > 0.85
    assert shares[2] < 0.7
    assert one.travel_m(drive=1, t_s=4000.0) == 0.0


def test_friction_jumps_as_a_payload_sets_the_carriage_onto_a_shoe():
    touches_kg = drawn("friction_windup", "overloaded_shoe", "touches_kg", low=60.0, high=300.0)
    clear = drawn("friction_windup", "overloaded_shoe", "clear", low=0.1, high=0.4)
    one = Alone("friction_windup", 1e-8, variant="overloaded_shoe", friction_n=400.0)
    for side in (1.0, -1.0):
        one.move(0, HOME_M + 0.3 * side)
        for payload_kg, share in ((0.0, clear), (touches_kg - 0.1, clear), (touches_kg + 0.1, 1.0), (400.0, 1.0)):
            d = one.deviation(payload_kg=payload_kg)
            assert d.force_n[0] == pytest.approx([side * 400.0 * share, 0.0])
            load_n = 9.80665 * (150.0 + payload_kg) / 2.0
            assert d.travel_m[0, 0] == pytest.approx(-1e-8 * (load_n + side * 400.0 * share))


def test_a_lone_wave_in_a_tape_solves_the_equation_of_long_waves():
    one = Alone("screw_cumulative_error", 1e-5, variant="lone_wave")
    at_m, wide_m = one.effect.lone_at_m, abs(one.effect.lone_m)
    drawn("screw_cumulative_error", "lone_wave", "lone_at_m", low=MIDDLE_M - 0.5 * HALF_M, high=MIDDLE_M + 0.5 * HALF_M)
    assert 0.05 <= wide_m <= 0.15
    signs = {math.copysign(1.0, Alone("screw_cumulative_error", 1e-5, variant="lone_wave", seed=k).effect.lone_m)
             for k in range(12)}  # fmt: skip
    assert signs == {-1.0, 1.0}
    places = np.linspace(LOW_M, HIGH_M, 2001)
    off = travel(one, places)
    assert np.abs(off).max() == pytest.approx(1e-5)
    assert np.polyfit(places, off, 1) == pytest.approx([0.0, 0.0], abs=1e-12)  # which would be scale and zero
    # What is left is one wave and a straight line: fitted here, with a wave that u'' = 4 u - 6 u^2 makes, step by step.
    step = 1e-3
    heights, slope = [1.0], 0.0
    for _ in range(40000):
        half = slope + 0.5 * step * (4.0 * heights[-1] - 6.0 * heights[-1] ** 2)
        heights.append(heights[-1] + step * half)
        slope = half + 0.5 * step * (4.0 * heights[-1] - 6.0 * heights[-1] ** 2)
        if heights[-1] < 1e-4:
            break
    away = np.abs(places - at_m) / wide_m
    wave = np.interp(away, step * np.arange(len(heights)), heights, right=0.0)
    columns = np.column_stack([wave, np.ones_like(places), places])
    found, *_ = np.linalg.lstsq(columns, off, rcond=None)
    assert columns @ found == pytest.approx(off, abs=2e-8)  # two parts in a thousand: the tail of a wave is unstable
    assert found[0] * one.effect.lone_m > 0.0
    assert abs(found[0]) > 1e-5  # the line takes some of it away
    assert one.travel_m(drive=1) == 0.0


def test_a_screw_is_true_up_to_where_it_is_bent():
    low_m, high_m = MIDDLE_M - 0.95 * HALF_M, MIDDLE_M - 0.4 * HALF_M
    bends_m = drawn("screw_periodic_error", "bent_end", "bends_m", low=low_m, high=high_m)
    one = Alone("screw_periodic_error", 1e-5, variant="bent_end", period_m=0.01)
    assert not np.any(travel(one, np.linspace(LOW_M, bends_m, 200)))
    seen = []
    for begin_m in np.linspace(bends_m + 0.01, HIGH_M - 0.01, 9):
        at = begin_m + 0.01 * np.arange(64) / 64.0
        seen.append(abs(amplitude(travel(one, at), at, 0.01)))
    run = (np.linspace(bends_m + 0.015, HIGH_M - 0.005, 9) - bends_m) / (HIGH_M - bends_m)
    assert seen == pytest.approx(1e-5 * run, abs=4e-8)
    assert one.travel_m(drive=1) == 0.0


def test_a_neighbours_signal_gets_into_the_sine_of_an_encoder():
    pitch_m = 2e-4
    one = Alone("encoder_interpolation", 1e-5, variant="neighbours_signal", pitch_m=pitch_m)
    assert (
        Alone("encoder_interpolation", 1e-5, variant="neighbours_signal", seed=2).effect.next_at != one.effect.next_at
    )
    turn = pitch_m * np.arange(16) / 16.0
    own, others = (HOME_M + x.ravel() for x in np.meshgrid(turn, turn, indexing="ij"))
    d = one.deviation(t_s=np.zeros(256), q=np.stack([own, others], axis=1))
    whole = np.abs(np.fft.fft2(d.travel_m[:, 0].reshape(16, 16))) / 256.0
    assert whole[1, 1] == pytest.approx(0.5e-5)
    assert whole[1, 15] == pytest.approx(0.5e-5)  # sum and difference of both phases, and nothing else
    assert whole.sum() == pytest.approx(2e-5)
    assert not np.any(d.travel_m[:, 1])
    # As an arc tangent of signals has it: a little of the other one's in the sine turns the pointer.
    phase = 2.0 * np.pi * own / pitch_m + one.effect.phase
    leak = 1e-6 * np.sin(2.0 * np.pi * others / pitch_m + one.effect.next_at)
    turned = np.angle(np.exp(1j * (np.arctan2(np.sin(phase) + leak, np.cos(phase)) - phase)))
    assert d.travel_m[:, 0] == pytest.approx(2e-5 * turned / 1e-6, abs=1e-9)


def test_a_shoe_with_play_follows_the_line_of_its_rail_late():
    lags_m = drawn("guide_straightness", "lagging_shoe", "lags_m", low=0.02, high=0.06)
    one = Alone("guide_straightness", 1e-5, variant="lagging_shoe", wavelength_m=0.5)
    phase, shoe_m, loops = one.effect.phase, MIDDLE_M, 0
    shoe_m = min(max(shoe_m, HOME_M - lags_m), HOME_M + lags_m)
    for to_m in (1.3, 1.29, 1.1, 1.11, 1.1 + 1.5 * lags_m, 0.6, 1.4, 1.39, 1.1):
        for at_m in np.linspace(one.q[0], to_m, 500):  # it is pushed by whichever end of the play it has reached
            if at_m - shoe_m > lags_m:
                shoe_m = at_m - lags_m
            elif shoe_m - at_m > lags_m:
                shoe_m = at_m + lags_m
        one.move(0, to_m)
        one.move(1, 2.2 - to_m)  # the other one's
        d = one.deviation()
        assert d.sideways_m[0] == pytest.approx([1e-5 * math.sin(2.0 * math.pi * shoe_m / 0.5 + phase), 0.0], abs=1e-12)
        assert not np.any(d.travel_m)
        loops += abs(shoe_m - to_m) < 0.9 * lags_m
    assert loops >= 2  # it has been within its play


def test_a_carriage_tilts_beside_the_dent_of_its_last_long_rest():
    dent_m = drawn("guide_angular", "dented_by_rest", "dent_m", low=0.15, high=0.3)
    dents_s = drawn("guide_angular", "dented_by_rest", "dents_s", low=5.0, high=20.0)
    one = Alone("guide_angular", 1e-4, variant="dented_by_rest")
    one.move(0, 1.3, rest_s=1.0)
    assert not np.any(one.deviation().yaw_rad)  # no rest so far
    for rest_m, rest_s in ((0.9, 8.0), (1.4, 30.0)):
        one.move(0, rest_m, rest_s=rest_s)
        one.move(0, rest_m + 0.3, rest_s=1.0)  # too short to leave another one
        one.move(1, rest_m - 0.2, rest_s=0.0)
        at = rest_m + dent_m * np.linspace(-2.0, 2.0, 401)
        yaw = one.deviation(t_s=np.full(401, one.t_s), q=along(at)).yaw_rad
        assert not np.any(yaw[:, 1])
        deep = 1e-4 * (1.0 - math.exp(-rest_s / dents_s))
        assert yaw[:, 0].max() == pytest.approx(deep, rel=1e-3)
        assert at[np.argmax(yaw[:, 0])] == pytest.approx(rest_m + dent_m / math.sqrt(2.0), abs=0.01 * dent_m)
        assert yaw[::-1, 0] == pytest.approx(-yaw[:, 0], abs=1e-15)
        # It is the slope of a dent of the form of a bell.
        bell = np.exp(-(((at - rest_m) / dent_m) ** 2))
        slope = np.gradient(bell, at)
        assert yaw[5:-5, 0] == pytest.approx((-slope * deep / np.abs(slope).max())[5:-5], abs=1e-3 * deep)


def test_magnets_on_both_axes_draw_them_together():
    poles_m = drawn("axis_coupling", "drawn_together", "poles_m", low=0.08, high=0.2)
    one = Alone("axis_coupling", 1e-4, variant="drawn_together", place="right")
    above = np.array([-0.5, -0.1, 0.0, 0.05, poles_m / math.sqrt(2.0), 0.2, 0.6])
    q = np.stack([np.full(7, HOME_M) + above, np.full(7, HOME_M)], axis=1)
    d = one.deviation(t_s=np.zeros(7), q=q)
    pull = above / np.hypot(above, poles_m) / (above**2 + poles_m**2)  # what of the inverse square is along the axis
    assert d.travel_m[:, 1] == pytest.approx(0.25e-4 * pull / pull[4])
    assert d.travel_m[4, 1] == pytest.approx(0.25e-4)
    assert not np.any(d.travel_m[:, 0])


def test_a_hot_processor_takes_twice_as_long():
    hot_k = drawn("latency", "hot_processor", "hot_k", low=3.0, high=8.0)
    course = Temperatures(lambda t: 20.0 + 1.2 * np.sin(t / 500.0))
    one = Alone("latency", 1e-3, variant="hot_processor", start_s=100.0, temperatures=course)
    slow = []
    for after_s in range(0, 7200, 150):
        now_s = 100.0 + after_s
        own_k = 10.0 * (1.0 - math.exp(-after_s / 1500.0))
        warm_k = own_k + 6.0 * 1.2 * (math.sin(now_s / 500.0) - math.sin(0.2))
        early = np.atleast_1d(one.effect.early_s(one.motion_states(now_s, velocity=(0.3, 0.0))))
        assert early == pytest.approx([2e-3 if warm_k > hot_k else 1e-3])
        slow.append(warm_k > hot_k)
    assert 5 < sum(slow) < 43
    assert sum(np.diff(slow)) > 2  # cool again in between
    assert not np.any(one.deviation(t_s=5000.0).travel_m)


def test_a_magnet_damps_a_slider_quickly_within_its_stretch():
    tau = 2.0
    low_m, high_m = MIDDLE_M - 0.4 * HALF_M, MIDDLE_M + 0.4 * HALF_M
    braked_m = drawn("servo_settling", "eddy_brake", "braked_m", low=low_m, high=high_m)
    one = Alone("servo_settling", 1e-4, variant="eddy_brake", tau_s=tau)
    edge_m = 0.35 * HALF_M
    for to_m, speed, within in ((braked_m - edge_m + 1e-3, 0.5, True), (braked_m + edge_m + 1e-3, 0.25, False),
                                (braked_m, 0.1, True), (braked_m - edge_m - 1e-3, 0.5, False)):  # fmt: skip
        side = math.copysign(1.0, to_m - one.q[0])
        one.move(0, to_m, speed=speed, rest_s=0.0)
        stops_s = one.t_s
        one.move(1, to_m, speed=1e4, rest_s=0.0)  # the other one's
        left, step = -1e-4 * side * speed / 0.5, 1e-3
        for k in range(1, 6001):
            left -= step * left / (tau * (0.5 if within else 4.0))
            if k % 1500 == 0:
                d = one.deviation(t_s=stops_s + k * step)
                assert d.travel_m[0] == pytest.approx([left, 0.0], rel=5e-3)
        one.t_s = stops_s + 20.0


def test_a_wheel_whose_rim_is_through_makes_the_scale_grow_with_the_way():
    rim_m = drawn("drive_scale", "worn_wheel", "rim_m", low=5.0, high=25.0)
    one = Alone("drive_scale", 3e-5, variant="worn_wheel", place="right")
    way_m = 0.0
    places = np.array([LOW_M, MIDDLE_M, HIGH_M])
    for k in range(160):
        to_m = HOME_M + 0.25 * (1 - 2 * (k % 2))  # ends below
        way_m += abs(to_m - one.q[1])
        one.move(1, to_m)
        one.move(0, to_m, rest_s=0.0)
        expected = -3e-5 * max(way_m - rim_m, 0.0) / 80.0 * (to_m - LOW_M) / (HIGH_M - LOW_M)
        assert one.deviation().travel_m[0] == pytest.approx([0.0, expected], abs=1e-15)
    assert way_m > rim_m + 40.0
    off = one.deviation(t_s=np.full(3, one.t_s), q=along(places, 1)).travel_m[:, 1]
    before_m = way_m - 0.5  # the last way is the one to each place
    worn_m = before_m + np.abs(places - (HOME_M + 0.25)) - rim_m
    assert off == pytest.approx(-3e-5 / 80.0 * worn_m * np.array([0.0, 0.5, 1.0]), abs=1e-15)
