"""Fourth former final forms of drives, guides and controls against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects.base import GRAVITY_M_PER_S2
from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, Temperatures, along, travel

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA_SCREW = 10.5e-6


def to_and_fro(one, times, *, reach_m=0.25, speed=0.5, rest_s=1.0, drive=0):
    """Moves a drive to and fro about its home and gives the way."""
    way_m = 0.0
    for k in range(times):
        to_m = HOME_M + reach_m * (1 - 2 * (k % 2))
        way_m += abs(to_m - one.q[drive])
        one.move(drive, to_m, speed=speed, rest_s=rest_s)
    return way_m


def test_a_starved_stretch_warms_its_screw_by_the_passes_of_the_nut():
    tau = 900.0
    one = Alone("screw_thermal_growth", 3.0, variant="starved_stretch", tau_s=tau)
    starved_m = one.effect.starved_m
    assert abs(starved_m - MIDDLE_M) <= 0.5 * HALF_M
    assert Alone("screw_thermal_growth", 3.0, variant="starved_stretch", seed=2).effect.starved_m != starved_m
    one.t_s = 100.0
    for to_m, speed, rest_s in (
        (starved_m + 0.3, 0.5, 50.0),
        (starved_m - 0.3, 0.1, 200.0),
        (starved_m + 0.02, 0.25, 5.0),
        (starved_m + 0.25, 0.5, 0.0),
        (starved_m + 0.4, 0.5, 30.0),  # beside the stretch
    ):
        one.move(1, 2.2 - one.q[1], rest_s=0.0)  # the other one's does nothing
        one.move(0, to_m, speed=speed, rest_s=rest_s)
    warmth = 0.0
    for leg in one.history.legs(0)[1:]:
        path = np.linspace(leg.from_m, leg.to_m, 100001)
        inside_m = abs(leg.to_m - leg.from_m) * float(np.mean(np.abs(path - starved_m) < 0.075))
        evenly_m = 0.15 / (HIGH_M - LOW_M) * 0.01 * tau  # what passes there at a mean of 0.01 m/s everywhere
        warmth += inside_m / evenly_m * math.exp(-(one.t_s - 0.5 * (leg.start_s + leg.end_s)) / tau)
    cells = np.linspace(LOW_M, starved_m + 0.4, 40001)
    profile = np.exp(-np.abs(cells - starved_m) / 0.4)
    expected = ALPHA_SCREW * 3.0 * warmth * float(np.sum(0.5 * (profile[1:] + profile[:-1]) * np.diff(cells)))
    assert one.travel_m() == pytest.approx(expected, rel=1e-3)
    assert one.travel_m(drive=1) == 0.0


def test_play_widens_with_every_ball_that_breaks():
    one = Alone("backlash", 4e-5, variant="breaking_balls")
    breaks_m = one.effect.breaks_m
    assert len(breaks_m) == 8
    lives = np.concatenate(
        [Alone("backlash", 4e-5, variant="breaking_balls", seed=k).effect.breaks_m for k in range(80)]
    )
    assert lives.mean() == pytest.approx(80.0 * math.gamma(1.5), rel=0.08)
    assert np.mean(lives < 80.0) == pytest.approx(1.0 - math.exp(-1.0), abs=0.05)
    way_m, seen = 0.0, []
    for k in range(300):
        way_m += to_and_fro(one, 2)
        one.move(1, HOME_M + 0.1 * (k % 2))  # the other one's way does nothing
        broken = sum(way_m >= life_m for life_m in breaks_m.tolist())
        assert one.travel_m() == pytest.approx(2e-5 * (0.15 + 0.85 * broken / 8))  # it has come down
        seen.append(broken)
    assert seen[0] == 0
    assert seen[-1] == 8
    assert one.travel_m(drive=1) == 0.0


def test_a_bent_guide_binds_within_one_stretch():
    one = Alone("friction_windup", 1e-8, variant="tight_stretch", friction_n=300.0)
    binds_m = one.effect.binds_m
    assert abs(binds_m - MIDDLE_M) <= 0.4 * HALF_M
    assert Alone("friction_windup", 1e-8, variant="tight_stretch", seed=2).effect.binds_m != binds_m
    edge_m = 0.3 * HALF_M
    for side in (1.0, -1.0):
        for away_m, binds in ((-0.99 * edge_m, 1.0), (0.99 * edge_m, 1.0), (1.01 * edge_m, 0.15), (-0.3, 0.15)):
            one.move(0, binds_m + away_m - 0.05 * side)
            one.move(0, binds_m + away_m)
            d = one.deviation(payload_kg=50.0)
            assert d.force_n[0] == pytest.approx([side * 300.0 * binds, 0.0])
            load_n = 200.0 * GRAVITY_M_PER_S2 / 2.0
            assert d.travel_m[0, 0] == pytest.approx(-1e-8 * (load_n + side * 300.0 * binds))


def test_two_change_wheels_leave_waves_that_beat():
    one = Alone("screw_cumulative_error", 1e-5, variant="beating_wheels")
    first_m, other_m = one.effect.change_m
    assert 0.06 <= first_m <= 0.1
    assert 1.06 <= other_m / first_m <= 1.12
    assert Alone("screw_cumulative_error", 1e-5, variant="beating_wheels", seed=2).effect.change_m[0] != first_m
    at = np.linspace(LOW_M, HIGH_M, 4001)
    off = travel(one, at)
    turns = 2.0 * np.pi * at[:, None] / np.array([first_m, other_m])
    columns = np.column_stack([np.sin(turns), np.cos(turns), np.ones(4001), at])
    found, *_ = np.linalg.lstsq(columns, off, rcond=None)
    assert columns @ found == pytest.approx(off, abs=1e-12)
    amplitudes = np.hypot(found[:2], found[2:4])
    assert amplitudes[0] == pytest.approx(amplitudes[1])
    assert np.abs(off).max() == pytest.approx(1e-5, rel=2e-3)
    assert np.polyfit(at, off, 1)[0] == pytest.approx(0.0, abs=2e-9)  # which would be the drive's scale


def test_runout_grows_with_the_way_of_its_drive():
    one = Alone("screw_periodic_error", 1e-5, variant="growing_runout", period_m=0.01)
    at = HOME_M + np.linspace(0.0, 0.01, 100, endpoint=False)

    def amplitudes():
        return np.abs(np.fft.rfft(travel(one, at))) / 50.0

    assert amplitudes()[1] == pytest.approx(1e-6, rel=2e-3)
    way_m = 0.0
    for _ in range(4):
        way_m += to_and_fro(one, 60)
        to_and_fro(one, 7, drive=1)
        one.move(0, HOME_M)
        way_m += 0.25
        found = amplitudes()
        assert found[1] == pytest.approx(1e-5 * (0.1 + 0.9 * way_m / 100.0), rel=1e-3)
        assert found[2:].max() < 2e-4 * found[1]
    assert way_m > 100.0


def test_a_twisted_grating_errs_one_way_and_the_other_on_both_sides():
    one = Alone("encoder_interpolation", 1e-5, variant="twisted_grating", pitch_m=2e-4)
    square_m = one.effect.square_m
    assert abs(square_m - MIDDLE_M) <= 0.4 * HALF_M
    assert Alone("encoder_interpolation", 1e-5, variant="twisted_grating", seed=2).effect.square_m != square_m
    fine = np.linspace(0.0, 2e-4, 64, endpoint=False)

    def twice_a_period(from_square_m):
        at = square_m + from_square_m + fine
        off = travel(one, at)
        once = np.mean(off * np.exp(-2j * np.pi * at / 2e-4))
        assert abs(once) < 1e-9
        return complex(2.0 * np.mean(off * np.exp(-4j * np.pi * at / 2e-4)))

    whole = twice_a_period(0.3)
    assert abs(whole) == pytest.approx(1e-5 * 0.3001 / HALF_M, rel=1e-5)
    for away_m in (-0.35, -0.1, 0.05, 0.2):
        assert twice_a_period(away_m) / whole == pytest.approx((away_m + 1e-4) / 0.3001, rel=2e-3)


def test_the_next_carriage_racks_the_frame_of_both_guides():
    one = Alone("guide_straightness", 1e-5, variant="racked_frame", place="right")
    mine, others = (grid.ravel() for grid in np.meshgrid(np.linspace(LOW_M, HIGH_M, 7), np.linspace(LOW_M, HIGH_M, 5)))
    d = one.deviation(t_s=np.zeros(35), q=np.stack([others, mine], axis=1))
    x, other = (mine - 1.01) / 0.69, (others - 1.01) / 0.69
    assert d.sideways_m[:, 1] == pytest.approx(1e-5 * other * (0.7 * x + 1.6 * x**2 - 0.8), abs=1e-18)
    assert not np.any(d.sideways_m[:, 0])
    assert not np.any(d.yaw_rad)


def test_a_pad_rides_up_at_the_edge_that_leads():
    one = Alone("guide_angular", 1e-4, variant="tilting_pad", wavelength_m=0.4)
    pad_s = one.effect.pad_s
    assert 6.0 <= pad_s <= 20.0
    assert Alone("guide_angular", 1e-4, variant="tilting_pad", seed=2).effect.pad_s != pad_s
    at = HOME_M - 0.2 + np.linspace(0.0, 0.4, 40, endpoint=False)
    for to_m, speed, sign in ((1.4, 0.5, 1.0), (0.8, 0.1, -1.0), (1.0, 0.25, 1.0)):
        one.move(0, to_m, speed=speed, rest_s=0.0)
        film, step, now_s = math.sqrt(speed / 0.5), 0.01, 0.0
        begins = film
        for rest_s in (0.0, 3.0, 25.0):
            while now_s < rest_s - 0.5 * step:  # a film that is squeezed: its rate goes with its cube
                film, now_s = film - step * film**3 / (2.0 * pad_s * begins**2), now_s + step
            yaw = one.deviation(t_s=np.full(40, one.t_s + rest_s), q=along(at)).yaw_rad
            spectrum = np.fft.rfft(yaw[:, 0]) / 40.0
            assert spectrum[0].real == pytest.approx(1e-4 * sign * film, rel=2e-3)
            assert 2.0 * np.abs(spectrum[1]) == pytest.approx(3e-5)
            assert np.abs(spectrum[2:]).max() < 1e-12
            assert not np.any(yaw[:, 1])


def test_an_oily_link_passes_less_the_warmer_it_is():
    one = Alone("axis_coupling", 1e-4, variant="oily_link")
    one.move(1, 1.41)
    passed = []
    for celsius in (15.0, 20.0, 25.0):
        one.temperatures = Temperatures(lambda t, celsius=celsius: np.full_like(t, celsius))
        passed.append(one.travel_m())
        assert one.travel_m(drive=1) == 0.0
    assert passed[1] == pytest.approx(1e-4 * 0.4)
    # d ln(viscosity) / dT = -B / T^2, summed in small steps
    steps = np.linspace(288.15, 298.15, 100001)
    falls = float(np.sum(1e4 / (0.5 * (steps[1:] + steps[:-1])) ** 2 * np.diff(steps)))
    assert math.log(passed[0] / passed[2]) == pytest.approx(falls, rel=1e-6)


def test_a_tuned_filter_delays_most_at_one_speed():
    one = Alone("latency", 1e-3, variant="group_delay")
    most = one.effect.resonates_m_per_s
    assert 0.15 <= most <= 0.4
    assert Alone("latency", 1e-3, variant="group_delay", seed=2).effect.resonates_m_per_s != most
    for speed, share in ((most, 1.0), (0.75 * most, 0.5), (1.25 * most, 0.5), (0.0, 1.0 / 17.0), (1.5 * most, 0.2)):
        for velocity in ((speed, 0.0), (0.1 * speed, -speed)):
            assert one.effect.early_s(one.motion_states(velocity=velocity)) == pytest.approx(1e-3 * share)
    assert not np.any(one.deviation(velocity=(0.5, 0.5)).travel_m)


def test_a_controller_learns_from_every_motion():
    tau = 2.0
    one = Alone("servo_settling", 1e-4, variant="learning", tau_s=tau)
    left = 1.0
    for k in range(200):
        speed = (0.1, 0.25, 0.5)[k % 3]
        side = 1.0 if k % 2 == 0 else -1.0
        one.move(0, HOME_M + 0.2 * side, speed=speed, rest_s=3.0)
        one.move(1, HOME_M + 0.1 * side, rest_s=0.0)  # teaches it nothing
        left *= math.exp(-1.0 / 150.0)
        rested_s = one.t_s - one.history.legs(0)[-1].end_s
        expected = -1e-4 * side * speed / 0.5 * left * math.exp(-rested_s / (3.0 * tau))
        assert one.travel_m() == pytest.approx(expected)
        assert one.travel_m(drive=1) == 0.0


def test_a_worn_belt_jumps_at_random_moments():
    one = Alone("drive_scale", 3e-5, variant="jumping_belt", onset_s=500.0, start_s=100.0)
    t = np.arange(100.0, 12100.0, 2.0)
    off = one.deviation(t_s=t, q=along(np.linspace(LOW_M, HIGH_M, len(t)))).travel_m
    assert not np.any(off[:, 1])
    assert not np.any(off[t < 600.0])
    assert off[t == 600.0, 0] == pytest.approx([-1e-5])
    falls = -np.diff(off[:, 0])
    jumps = falls[falls != 0.0] / 1e-5
    assert jumps == pytest.approx(np.round(jumps))
    assert jumps.min() == pytest.approx(1.0)
    waits_s = np.concatenate([np.diff(Alone("drive_scale", 3e-5, variant="jumping_belt", seed=k).effect.jumps_s)
                              for k in range(30)])  # fmt: skip
    assert waits_s.mean() == pytest.approx(900.0, rel=0.1)
    assert waits_s.std() == pytest.approx(900.0, rel=0.1)  # of an exponential, as rare events have it
