"""Further forms of drives, guides and controls against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects.base import GRAVITY_M_PER_S2
from mock_devices.recordings.design import nominal_drives
from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA_SCREW = 10.5e-6


def test_a_chilled_screw_goes_up_and_down_between_its_limits():
    tau, size = 1500.0, 2.0
    one = Alone("screw_thermal_growth", size, variant="chilled", tau_s=tau)
    warm, runs, seen, starts = 0.0, False, [], 0
    now_s = one.t_s
    for k in range(220):
        to_m = HOME_M + (0.5 if k % 2 == 0 else 0.0)
        middle_s = one.t_s + 0.5
        one.move(0, to_m, speed=0.5, rest_s=39.0)
        for until_s, heat in ((middle_s, 0.5 / (0.4 * 0.01 * tau)), (one.t_s, 0.0)):
            step = (until_s - now_s) / 400
            for _ in range(400):  # step by step: air, or air and coolant
                warm *= math.exp(-step * (20.0 if runs else 1.0) / tau)
                runs = runs and warm > 0.25
            now_s, warm = until_s, warm + heat
            if heat and warm >= 1.0 and not runs:
                runs, starts = True, starts + 1
        seen.append((one.travel_m() / (ALPHA_SCREW * size * (to_m - LOW_M)), warm))
    found, expected = np.array(seen).T
    assert found == pytest.approx(expected, abs=6e-3)
    assert starts >= 2
    assert found.max() < 1.09
    assert one.travel_m(q=along([LOW_M])) == 0.0
    assert one.travel_m(drive=1) == 0.0


def test_inertia_carries_a_slider_through_its_play():
    for speed, share in ((0.01, 1.0), (0.125, 0.5), (0.25, -1.0), (0.5, -1.0)):
        one = Alone("backlash", 1e-5, variant="runs_on")
        one.move(0, 1.3, speed=speed)
        assert one.travel_m() == pytest.approx(-0.5e-5 * share, rel=5e-3)
        one.move(0, 1.0, speed=speed)
        assert one.travel_m() == pytest.approx(0.5e-5 * share, rel=5e-3)
        assert one.travel_m(t_s=one.t_s + 500.0) == one.travel_m()


def test_a_guide_rubs_by_what_the_struts_press_it():
    one = Alone("friction_windup", 1e-8, variant="guide_pressed", friction_n=100.0)
    one.move(0, 1.3)
    x, y = 0.25, 0.05
    left, _ = nominal_drives(FILE, complex(x, y))

    def friction(place, kg=0.0):  # below where it last came from, and so as after a way down
        return one.deviation(q=[nominal_drives(FILE, place)], payload_kg=kg).force_n[0, 0]

    q = np.full((1, 2), MIDDLE_M)
    middle = one.deviation(q=q).force_n[0, 0]
    assert middle == pytest.approx(-100.0 * one.effect.side(one.motion_states(q=q), 0)[0])
    assert friction(complex(x, y), 150.0) == pytest.approx(2.0 * friction(complex(x, y)) + 100.0 * 0.3)
    across, along_m = 1.0 + x, left - y  # of the upper strut, from the slider to the platform
    tangent = across / along_m
    assert math.hypot(across, along_m) == pytest.approx(1.5)
    upright = 1.0 / math.sqrt(1.5**2 - 1.0)  # both drives alike: the platform hangs in the middle
    assert friction(complex(x, y)) == pytest.approx(-100.0 * (0.3 + 0.7 * tangent / upright), rel=1e-6)
    d = one.deviation(q=[nominal_drives(FILE, complex(x, y))])
    load = 150.0 * GRAVITY_M_PER_S2 / 2.0
    assert d.travel_m[0, 0] == pytest.approx(-1e-8 * (load + d.force_n[0, 0]))


def test_a_rack_jumps_where_its_pieces_meet_and_is_straight_in_between():
    one = Alone("screw_cumulative_error", 1e-5, variant="rack_pieces")
    at = np.linspace(LOW_M, HIGH_M, 2001)
    off = one.deviation(t_s=np.zeros(2001), q=along(at)).travel_m[:, 0]
    assert np.abs(off).max() == pytest.approx(1e-5)
    assert np.polyfit(at - MIDDLE_M, off, 1) == pytest.approx([0.0, 0.0], abs=1e-12)
    bends = np.abs(np.diff(off, 2)) > 1e-12
    jumps = np.flatnonzero(bends[1:] & bends[:-1]) + 1
    assert np.diff(at[jumps]) == pytest.approx(np.full(len(jumps) - 1, 0.2), abs=0.002)
    assert len(jumps) >= 6
    other = Alone("screw_cumulative_error", 1e-5, variant="rack_pieces", seed=2)
    assert np.ptp(other.deviation(t_s=np.zeros(2001), q=along(at)).travel_m[:, 0] - off) > 1e-6


def test_each_flank_of_a_thread_errs_in_its_own_way():
    one = Alone("screw_periodic_error", 1e-5, variant="other_flank", period_m=0.01)
    at = HOME_M + np.linspace(0.0, 0.01, 400, endpoint=False)
    seen = {}
    for to_m in (1.3, 1.0):
        one.move(0, to_m)
        seen[to_m] = np.fft.rfft(one.deviation(t_s=np.full(400, one.t_s), q=along(at)).travel_m[:, 0]) / 200.0
    up, down = seen[1.3], seen[1.0]
    assert np.abs(up[1:4]) == pytest.approx([1e-5, 0.0, 0.0], abs=1e-12)
    assert np.abs(down[1:4]) == pytest.approx([0.8e-5, 0.3e-5, 0.0], abs=1e-12)
    assert np.angle(down[1] / up[1]) == pytest.approx(one.effect.apart)
    assert 0.3 * np.pi <= one.effect.apart <= 0.7 * np.pi


def test_the_image_of_a_grating_comes_back_along_the_travel():
    one = Alone("encoder_interpolation", 1e-5, variant="self_images", pitch_m=2e-4)
    image_m = one.effect.image_m
    fine = np.linspace(0.0, 2e-4, 40, endpoint=False)

    def fourth(at_m):
        off = one.deviation(t_s=np.zeros(40), q=along(at_m + fine)).travel_m[:, 0]
        spectrum = np.fft.rfft(off) / 20.0
        assert np.abs(np.delete(spectrum, 4)).max() < 0.01e-5
        return spectrum[4]

    begins = 0.5 + np.round(np.arange(9) * image_m / 8.0 / 2e-4) * 2e-4
    course = np.array([fourth(at_m) for at_m in begins])
    assert course[8] == pytest.approx(course[0], abs=2e-8)
    assert course[4] == pytest.approx(-course[0], abs=2e-8)
    assert np.abs(course[:8]).max() == pytest.approx(1e-5, rel=0.08)


def test_a_cage_that_creeps_moves_the_line_of_its_guide():
    one = Alone("guide_straightness", 1e-5, variant="creeping_cage")
    at = np.linspace(0.6, 1.4, 81)

    def line():
        d = one.deviation(t_s=np.full(81, one.t_s), q=along(at))
        assert not np.any(d.travel_m)
        return d.sideways_m[:, 0]

    for to_m in (1.3, HOME_M):
        one.move(0, to_m)
    before = line()
    one.t_s += 3000.0
    assert line() == pytest.approx(before, abs=1e-15)
    way = 0.0
    while way < 24.99:
        one.move(0, 1.6 if one.q[0] < 1.3 else HOME_M)
        way += 0.5
    # 25 m to and fro: the cage, which goes half the way, has crept by 0.1 m, as if the carriage stood 0.2 m further up
    # (all states here count the way from the last turn to each place, which creeps by less than a millimetre).
    after = line()
    assert after[:61] == pytest.approx(before[20:], abs=0.5e-6)
    spread = [
        np.std(
            Alone("guide_straightness", 1e-5, variant="creeping_cage", seed=k)
            .deviation(t_s=np.zeros(400), q=along(np.linspace(LOW_M, HIGH_M, 400)))
            .sideways_m[:, 0]
        )
        for k in range(40)
    ]
    assert np.median(spread) == pytest.approx(0.7e-5, rel=0.15)


def test_balls_tilt_their_block_as_they_pass_and_lag_on_the_way_back():
    one = Alone("guide_angular", 1e-5, variant="ball_passage")
    ball_m = one.effect.balls_m
    assert 0.018 <= ball_m <= 0.03
    at = HOME_M + np.linspace(0.0, 4.0 * ball_m, 400, endpoint=False)
    seen = {}
    for to_m in (1.3, 1.0):
        one.move(0, to_m)
        d = one.deviation(t_s=np.full(400, one.t_s), q=along(at))
        seen[to_m] = np.fft.rfft(d.yaw_rad[:, 0]) / 200.0
        assert not np.any(d.sideways_m)
    assert np.abs(seen[1.3][[4, 8]]) == pytest.approx([1e-5, 0.35e-5])
    assert np.angle(seen[1.0][4] / seen[1.3][4]) == pytest.approx(0.3 * 2.0 * np.pi)


def test_a_chain_follows_the_other_axis_behind_its_play():
    one = Alone("axis_coupling", 1e-4, variant="dragged_chain")
    chain = MIDDLE_M
    for to_m in (1.1, 1.5, 1.45, 1.3, 1.2, 1.2, 0.6):
        one.move(1, to_m)
        chain = min(max(chain, to_m - 0.12), to_m + 0.12)
        assert one.travel_m() == pytest.approx(1e-4 * (chain - MIDDLE_M), abs=1e-15)
    assert one.travel_m() == pytest.approx(1e-4 * (0.72 - MIDDLE_M))
    one.move(0, 1.5)
    assert one.travel_m() == pytest.approx(1e-4 * (0.72 - MIDDLE_M))
    assert one.travel_m(drive=1) == 0.0


def test_a_restart_draws_another_phase():
    one = Alone("latency", 1e-3, variant="restarted")
    early = [float(np.asarray(one.effect.early_s(one.motion_states(exchanges=float(n))))[0]) for n in range(32)]
    assert early[0] == 1e-3
    assert len(set(early)) == 32
    assert 0.0 <= min(early) < max(early) <= 2e-3
    later = np.asarray(one.effect.early_s(one.motion_states(t_s=9000.0, exchanges=3.0)))
    assert later[0] == early[3]
    again = Alone("latency", 1e-3, variant="restarted", seed=2)
    assert float(np.asarray(again.effect.early_s(one.motion_states(exchanges=3.0)))[0]) != early[3]


def test_a_cleared_integrator_lets_the_slider_arrive_too_low_from_either_side():
    one = Alone("servo_settling", 1e-5, variant="integrator_reset", tau_s=3.0)
    assert one.travel_m() == 0.0  # it has not moved yet
    for to_m, speed in ((1.3, 0.5), (1.0, 0.1)):
        one.move(0, to_m, speed=speed, rest_s=0.0)
        for wait_s in (0.0, 3.0, 12.0):
            off = one.travel_m(t_s=one.t_s + wait_s)
            assert off == pytest.approx(-1e-5 * math.exp(-wait_s / 3.0))
            assert one.travel_m(t_s=one.t_s + wait_s, payload_kg=75.0) == pytest.approx(1.5 * off)
    assert one.travel_m(drive=1) == 0.0


def test_a_strained_tape_relaxes_with_the_logarithm_of_time():
    one = Alone("drive_scale", 2e-5, variant="relaxing_tape", onset_s=300.0)
    t = 300.0 + np.array([-200.0, 0.0, 60.0, 180.0, 3600.0, 60.0 * (61.0**2 - 1.0)])
    off = one.deviation(t_s=t, q=along([HIGH_M] * 6)).travel_m[:, 0]
    expected = np.array([0.0, 0.0, math.log(2.0), math.log(4.0), math.log(61.0), 2.0 * math.log(61.0)])
    assert off == pytest.approx(-2e-5 * expected / math.log(61.0), abs=1e-15)
    places = one.deviation(t_s=np.full(3, 3900.0), q=along([LOW_M, MIDDLE_M, HIGH_M])).travel_m[:, 0]
    assert places == pytest.approx([0.0, -1e-5, -2e-5], abs=1e-15)
