"""Final forms of drives, guides and controls against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, Temperatures, along, amplitude, drawn, travel

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA_SCREW = 10.5e-6


def test_a_fan_of_the_next_drive_cools_a_screw_while_that_moves():
    tau = 500.0
    fans = drawn("screw_thermal_growth", "neighbours_fan", "fans", low=4.0, high=12.0)
    one = Alone("screw_thermal_growth", 2.0, variant="neighbours_fan", tau_s=tau, place="right")
    warm, step, seen = 0.0, 0.05, []
    for k in range(30):
        way_m, speed, rest_s = ((0.4, 0.02, 100.0), (-0.4, 0.5, 30.0), (0.2, 0.005, 10.0), (-0.2, 0.1, 60.0))[k % 4]
        one.move(0, one.q[0] + way_m, speed=speed, rest_s=rest_s)
        for lasts_s, faster in ((abs(way_m) / speed, 1.0 + fans * math.sqrt(speed / 0.5)), (rest_s, 1.0)):
            for _ in range(round(lasts_s / step)):
                warm += step / tau * (1.0 - faster * warm)  # heated as ever
        d = one.deviation(q=along(np.array([HIGH_M - 0.1]), 1) + np.array([one.q[0] - HOME_M, 0.0]))
        expected = ALPHA_SCREW * 2.0 * warm * (HIGH_M - 0.1 - LOW_M)
        assert d.travel_m[0] == pytest.approx([0.0, expected], rel=2e-3, abs=1e-9)
        one.history.add(1, one.t_s, one.t_s + 1e-6, HOME_M + 0.1 * (k % 2), 1e5)  # its own blows nothing
        seen.append(warm)
    assert min(np.diff(seen)) < -0.02 < 0.02 < max(np.diff(seen))


def test_grit_takes_up_another_part_of_a_play_after_each_motion():
    one = Alone("backlash", 4e-5, variant="grit_in_thread")
    other = Alone("backlash", 4e-5, variant="grit_in_thread", seed=2)
    assert not np.array_equal(one.effect.grit, other.effect.grit)
    shares = []
    for k in range(400):
        way_m = (0.1, 0.2, -0.25, -0.01, -0.04)[k % 5]
        one.move(0, one.q[0] + way_m)
        off_m = one.travel_m()
        one.move(1, HOME_M + 0.1 * (k % 2))  # the other one's carry nothing here
        assert one.travel_m(t_s=one.t_s + 50.0) == off_m
        assert math.copysign(1.0, off_m) == -math.copysign(1.0, way_m)
        shares.append(abs(off_m) / 2e-5)
    assert 0.05 <= min(shares) < 0.08
    assert 0.97 < max(shares) <= 1.0
    assert np.mean(shares) == pytest.approx(0.525, abs=0.05)
    assert abs(np.corrcoef(shares[:-1], shares[1:])[0, 1]) < 0.15
    assert one.travel_m(drive=1) == 0.0


def test_bearings_pinch_above_one_temperature():
    pinches_k = drawn("friction_windup", "pinched_by_warmth", "pinches_k", low=-0.4, high=0.4)
    seen = {}
    for above_k in (-2.0, pinches_k, pinches_k + 0.5, pinches_k + 1.0, pinches_k + 2.0):
        warm = Temperatures(lambda t, above_k=above_k: np.full_like(t, 20.0 + above_k))
        one = Alone("friction_windup", 1e-8, variant="pinched_by_warmth", friction_n=400.0, temperatures=warm)
        for side in (1.0, -1.0):
            one.move(0, one.q[0] + 0.1 * side, rest_s=5.0)
            d = one.deviation(payload_kg=100.0)
            seen[above_k] = side * d.force_n[0, 0]
            assert d.travel_m[0] == pytest.approx([-1e-8 * (9.80665 * 250.0 / 2.0 + d.force_n[0, 0]), 0.0])
            assert d.force_n[0, 1] == 0.0
    assert list(seen.values()) == pytest.approx([100.0, 100.0, 250.0, 400.0, 700.0])


def chain_shape(at, rate, cells=20000):
    """A hanging chain that swings at a rate, from its free end up: (s y')' = -rate^2 y / 4, at from 0 to 1."""
    step = 1.0 / cells
    y, line = 1.0, [1.0]
    pull = 0.0  # s y' at the lower end of each cell
    for k in range(cells):
        pull -= step * 0.25 * rate**2 * y
        y += step * pull / ((k + 1.0) * step) if k else -step * 0.25 * rate**2
        line.append(y)
    return np.interp(at, np.linspace(0.0, 1.0, cells + 1), line)


def test_a_tape_has_kept_how_it_swung_while_it_hung():
    one = Alone("screw_cumulative_error", 1e-5, variant="hung_tape")
    others = [Alone("screw_cumulative_error", 1e-5, variant="hung_tape", seed=k).effect for k in range(40)]
    assert {effect.nodes for effect in others} == {4, 5, 6, 7}
    assert len({effect.hangs_m for effect in others}) == 40
    free_m, held_m = one.effect.hangs_m
    assert 0.02 <= LOW_M - free_m <= 0.25
    assert 0.0 <= held_m - HIGH_M <= 0.4
    # The zeros of Bessel's function lie nearly pi apart: 2.405, 5.520, 8.654, 11.792, 14.931, 18.071, 21.212.
    rate = (2.40483, 5.52008, 8.65373, 11.79153, 14.93092, 18.07106, 21.21164)[one.effect.nodes - 1]
    places = np.linspace(LOW_M, HIGH_M, 2001)
    off = travel(one, places)
    assert np.abs(off).max() == pytest.approx(1e-5)
    assert np.polyfit(places, off, 1) == pytest.approx([0.0, 0.0], abs=1e-12)  # which would be scale and zero
    hung = chain_shape((places - free_m) / (held_m - free_m), rate)
    columns = np.column_stack([hung, np.ones_like(places), places])
    found, *_ = np.linalg.lstsq(columns, off, rcond=None)
    assert columns @ found == pytest.approx(off, abs=1e-7)
    assert abs(found[0]) > 0.5e-5
    assert one.travel_m(drive=1) == 0.0


def test_a_wheel_turns_a_screw_as_a_planet_goes_round_its_sun():
    orbit = drawn("screw_periodic_error", "off_focus", "orbit", low=0.25, high=0.6)
    one = Alone("screw_periodic_error", 1e-5, variant="off_focus", period_m=0.01)
    at = 0.9 + 0.01 * np.arange(256) / 256.0
    off = travel(one, at)
    assert abs(amplitude(off, at, 0.01)) == pytest.approx(1e-5)
    # Equal areas in equal times, swept step by step from where the planet is nearest.
    angle, steps = 0.0, 200000
    area = 2.0 * math.pi * math.sqrt(1.0 - orbit**2) / steps  # of a step, twice, over the square of the half axis
    ahead = []
    for k in range(steps):
        if k % (steps // 256) == 0 and len(ahead) < 256:
            ahead.append(angle - 2.0 * math.pi * k / steps)
        radius = (1.0 - orbit**2) / (1.0 + orbit * math.cos(angle))
        half = angle + 0.5 * area / radius**2
        radius = (1.0 - orbit**2) / (1.0 + orbit * math.cos(half))
        angle += area / radius**2
    assert angle == pytest.approx(2.0 * math.pi, abs=1e-6)
    spectrum, swept = np.abs(np.fft.fft(off)), np.abs(np.fft.fft(ahead))
    assert spectrum[1:9] / spectrum[1] == pytest.approx(swept[1:9] / swept[1], abs=2e-2)
    assert spectrum[2] > 0.1 * spectrum[1]
    assert np.mean(off) == pytest.approx(0.0, abs=1e-9)
    assert one.travel_m(drive=1) == 0.0


def test_fog_on_a_lens_sets_a_signal_off_and_clears():
    fogs_s = drawn("encoder_interpolation", "fogged_lens", "fogs_s", low=500.0, high=1800.0)
    pitch_m = 2e-4
    one = Alone("encoder_interpolation", 1e-5, variant="fogged_lens", pitch_m=pitch_m, start_s=70.0)
    at = HOME_M + pitch_m * np.arange(64) / 64.0
    # Fog that comes as it is fed and goes as it dries, both as fast: two equal first orders in a row.
    fed, fog, step, now_s, seen = math.e, 0.0, 0.25, 0.0, []
    for after_s in (0.0, 0.3 * fogs_s, fogs_s, 2.0 * fogs_s, 6.0 * fogs_s):
        while now_s < after_s - 0.5 * step:
            fed, fog, now_s = fed - step / fogs_s * fed, fog + step / fogs_s * (fed - fog), now_s + step
        off = travel(one, at, t_s=70.0 + after_s)
        assert abs(amplitude(off, at, pitch_m)) == pytest.approx(1e-5 * fog, abs=2e-8)
        assert np.mean(off) == pytest.approx(0.0, abs=1e-15)
        assert abs(amplitude(off, at, 0.5 * pitch_m)) < 1e-12
        seen.append(fog)
    assert seen[2] == pytest.approx(1.0, abs=2e-3) == max(seen)
    assert seen[4] < 0.1


def test_at_rest_a_carriage_sinks_into_the_waves_of_its_rail():
    sinks_s = drawn("guide_straightness", "sinks_into_waves", "sinks_s", low=4.0, high=15.0)
    one = Alone("guide_straightness", 1e-5, variant="sinks_into_waves", wavelength_m=0.4, place="right")
    at = 0.8 + 0.4 * np.arange(64) / 64.0
    one.move(1, 1.3, rest_s=0.0)
    stops_s = one.t_s
    one.move(0, 1.3, speed=1e4, rest_s=0.0)  # the other one's
    film, now_s, step = 0.8, 0.0, 1e-2
    for after_s in (0.0, 2.0, 10.0, 60.0):
        while now_s < after_s - 0.5 * step:
            film, now_s = film - step * film / sinks_s, now_s + step
        d = one.deviation(t_s=np.full(64, stops_s + after_s), q=along(at, 1) + np.array([1.3 - HOME_M, 0.0]))
        assert abs(amplitude(d.sideways_m[:, 1], at, 0.4)) == pytest.approx(1e-5 * (1.0 - film), rel=2e-3)
        assert np.mean(d.sideways_m[:, 1]) == pytest.approx(0.0, abs=1e-15)
        assert not np.any(d.sideways_m[:, 0])
        assert not np.any(d.yaw_rad)
    assert film < 0.02


def test_skewed_rollers_turn_a_carriage_until_they_slide():
    rolls_m = drawn("guide_angular", "skewed_rollers", "rolls_m", low=0.08, high=0.3)
    one = Alone("guide_angular", 1e-4, variant="skewed_rollers")
    turned = min(max((HOME_M - MIDDLE_M) / rolls_m, -1.0), 1.0)
    seen = []
    for k in range(40):
        way_m = (0.35, -0.05, 0.02, -0.45, 0.3, -0.17)[k % 6]
        one.move(0, one.q[0] + way_m)
        one.move(1, HOME_M + 0.1 * (k % 2))
        for _ in range(100):  # each way on turns it on, but for where it slides
            turned = min(max(turned + 0.01 * way_m / rolls_m, -1.0), 1.0)
        d = one.deviation(t_s=one.t_s + 20.0)
        assert d.yaw_rad[0] == pytest.approx([1e-4 * turned, 0.0], abs=1e-12)
        assert not np.any(d.sideways_m)
        seen.append(turned)
    assert min(seen) < -0.8 < 0.9 < max(seen)
    assert sum(abs(x) < 0.9 for x in seen) > 5


def test_every_way_of_the_other_axis_pumps_oil_that_leaks_away():
    leaks_s = drawn("axis_coupling", "pumped_jack", "leaks_s", low=60.0, high=300.0)
    one = Alone("axis_coupling", 1e-5, variant="pumped_jack", place="right")
    assert not np.any(one.deviation().travel_m)
    pumped, step, seen = 0.0, 0.02, []
    for k in range(40):
        way_m, speed, rest_s = ((0.4, 0.5, 3.0), (-0.3, 0.1, 20.0), (-0.1, 0.25, 90.0))[k % 3]
        one.move(0, one.q[0] + way_m, speed=speed, rest_s=rest_s)
        moves_s = abs(way_m) / speed
        for lasts_s, pace in ((moves_s, speed), (rest_s, 0.0)):
            for _ in range(round(lasts_s / step)):
                pumped += step * (pace - pumped / leaks_s)
        assert one.deviation().travel_m[0] == pytest.approx([0.0, 1e-5 * pumped], abs=1e-5 * 1e-2)
        one.history.add(1, one.t_s, one.t_s + 1e-6, HOME_M + 0.1 * (k % 2), 1e5)  # its own
        seen.append(pumped)
    assert min(np.diff(seen)) < -0.1 < 0.1 < max(np.diff(seen))


def test_a_window_grows_with_the_payload_and_delays_with_it():
    empty = drawn("latency", "scheduled_window", "empty", low=0.05, high=0.4)
    one = Alone("latency", 1e-3, variant="scheduled_window", start_s=100.0)
    for t_s in (100.0, 5000.0):
        for payload_kg, share in ((0.0, empty), (200.0, 0.5 * (1.0 + empty)), (400.0, 1.0)):
            state = one.motion_states(t_s, velocity=(0.3, 0.0), payload_kg=payload_kg)
            assert np.atleast_1d(one.effect.early_s(state)) == pytest.approx([1e-3 * share])
    assert not np.any(one.deviation(t_s=5000.0).travel_m)


def test_an_amplifier_that_is_fully_on_takes_away_no_more_than_it_can():
    tau = 2.0
    fully_on = drawn("servo_settling", "saturated_amplifier", "fully_on", low=0.02, high=0.06)
    one = Alone("servo_settling", 1e-4, variant="saturated_amplifier", tau_s=tau)
    for to_m, speed in ((1.3, 0.5), (0.9, 0.1), (1.2, 0.4 * fully_on)):
        side = math.copysign(1.0, to_m - one.q[0])
        one.move(0, to_m, speed=speed, rest_s=0.0)
        stops_s = one.t_s
        one.move(1, to_m, speed=1e4, rest_s=0.0)  # the other one's
        behind, step = speed / 0.5, 2e-3
        for k in range(60001):
            if k % 6000 == 0:
                d = one.deviation(t_s=stops_s + k * step)
                assert d.travel_m[0] == pytest.approx([-1e-4 * side * behind, 0.0], abs=1e-4 * 2e-3 * speed)
            behind -= step / tau * min(behind, fully_on)
        one.t_s = stops_s + 200.0
    assert behind < 1e-6


def test_the_last_motion_of_the_next_drive_magnetises_a_scale():
    pinned = drawn("drive_scale", "neighbours_magnet", "pinned", low=-0.5, high=0.5)
    one = Alone("drive_scale", 3e-5, variant="neighbours_magnet", place="right", onset_s=200.0, start_s=50.0)
    places = np.array([LOW_M, MIDDLE_M + pinned * HALF_M, HIGH_M])
    at = along(places, 1)
    assert not np.any(one.deviation(t_s=np.full(3, 260.0), q=at).travel_m)  # no motion so far
    for side in (1.0, 1.0, -1.0, 1.0, -1.0):
        one.move(0, one.q[0] + 0.1 * side)
        one.move(1, one.q[1] + 0.02 * (1.0 if one.t_s % 2.0 < 1.0 else -1.0))  # its own
        at = np.stack([np.full(3, one.q[0]), places], axis=1)
        if one.t_s < 250.0:
            assert not np.any(one.deviation(t_s=np.full(3, one.t_s), q=at).travel_m)
        d = one.deviation(t_s=np.full(3, 251.0 + one.t_s), q=at, payload_kg=200.0)
        strain = 3e-5 * side / (HIGH_M - places[1])
        assert d.travel_m[:, 1] == pytest.approx(strain * (places - places[1]), abs=1e-15)
        assert not np.any(d.travel_m[:, 0])
