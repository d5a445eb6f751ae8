"""Further forms of machine and drives against their publications: sums and equations solved here step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA, ALPHA_SCREW = 11.5e-6, 10.5e-6


def to_and_fro(one, drive=0, *, times, speed, way=0.2, rest_s=5.0):
    """Motions of a drive; the moments of their middles, and when the last rest ends."""
    middles = []
    for k in range(times):
        begun_s = one.t_s
        one.move(drive, HOME_M + (way if k % 2 == 0 else 0.0), speed=speed, rest_s=rest_s)
        middles.append(0.5 * (begun_s + one.t_s - rest_s))
    return np.array(middles), one.t_s


def test_a_joint_s_oil_warms_the_joint_and_then_its_strut():
    tau = 600.0
    one = Alone("link_thermal_growth", 2.0, variant="joint_heat", tau_s=tau, place="right_lower")
    middles, now_s = to_and_fro(one, 1, times=40, speed=0.25)
    to_and_fro(one, 0, times=3, speed=0.5)  # the other drive's joints are others
    joint, strut, step = 0.0, 0.0, 0.05
    grown = []
    wanted = {round(t / step): t for t in (0.5 * now_s, now_s, now_s + 2000.0)}
    shocks = set(np.round(middles / step).astype(int).tolist())
    for k in range(round((now_s + 2001.0) / step)):  # joint: tau / 5; what it has the strut follows with tau
        if k in wanted:
            grown.append(strut)
        if k in shocks:  # energy of 0.2 m at 0.25 m/s, as heat that would keep the strut at the size in the mean
            joint += 0.2 * 0.25 / (0.01 * 0.5) / (tau / 5.0)
        joint, strut = joint - step * joint / (tau / 5.0), strut + step * (joint - strut) / tau
    for t_s, expected in zip(wanted.values(), grown, strict=True):
        if t_s >= now_s:
            found = one.deviation(t_s=t_s).length_m[0]
            assert found[3] == pytest.approx(ALPHA * 1.5 * 2.0 * expected, rel=5e-3)
            assert not np.any(found[:3])
    slow = Alone("link_thermal_growth", 2.0, variant="joint_heat", tau_s=tau, place="right_lower")
    to_and_fro(slow, 1, times=40, speed=0.05)
    assert slow.deviation().length_m[0, 3] < 0.4 * one.deviation(t_s=now_s).length_m[0, 3]  # the same way, slowly


def test_a_warm_rail_bends_its_column_until_the_heat_has_gone_through():
    tau, depth, cells = 1000.0, 1.0, 100
    one = Alone("column_thermal_growth", 1.0, variant="rail_heat", tau_s=tau)
    begun_s = one.t_s
    one.move(0, 1.4, speed=1.0, rest_s=0.0)
    middle_s = 0.5 * (begun_s + one.t_s)
    heat = 0.3 / (0.01 * tau)
    theta = np.zeros(cells)
    theta[0] = heat * cells  # all of it in the face of the rail at first
    z = (np.arange(cells) + 0.5) / cells - 0.5
    diffusivity = depth**2 / (math.pi**2 * 0.1 * tau)
    step = 0.4 / cells**2 / diffusivity
    height = 1.4 + 0.125 + 1.2
    checked = {round(t / step): t for t in (40.0, 100.0, 300.0)}
    for k in range(max(checked) + 1):
        if k in checked:
            lost = math.exp(-checked[k] / tau)  # to the air
            d = one.deviation(t_s=middle_s + checked[k])
            assert d.travel_m[0, 0] == pytest.approx(ALPHA * heat * lost * height, rel=1e-3)
            slope = -12.0 * float(np.mean(theta * z)) * lost
            assert d.yaw_rad[0, 0] == pytest.approx(ALPHA * slope / 0.4 * height, rel=0.02)
            assert d.sideways_m[0, 0] == pytest.approx(0.5 * d.yaw_rad[0, 0] * height)
        ends = np.concatenate([theta[:1], theta, theta[-1:]])
        theta = theta + 0.4 * (ends[2:] - 2.0 * theta + ends[:-2])


def test_a_motor_s_starts_warm_the_screw_whatever_their_ways():
    grown = {}
    for way, speed in ((0.01, 0.5), (0.5, 0.5), (0.5, 0.25)):
        one = Alone("screw_thermal_growth", 10.0, variant="motor_starts", tau_s=5000.0)
        for k in range(4):
            one.move(0, HOME_M + (way if k % 2 == 0 else 0.0), speed=speed, rest_s=0.0)
        grown[way, speed] = one.travel_m()
    up = HIGH_M - HOME_M
    warm = 10.0 * 4.0 * 60.0 / 5000.0
    assert grown[0.01, 0.5] == pytest.approx(-ALPHA_SCREW * warm * 0.5 * (1.0 - math.exp(-up / 0.5)), rel=1e-3)
    assert grown[0.5, 0.5] == pytest.approx(grown[0.01, 0.5], rel=2e-3)
    assert grown[0.5, 0.25] == pytest.approx(0.5 * grown[0.01, 0.5], rel=5e-3)
    assert one.travel_m(q=along([HIGH_M])) == pytest.approx(0.0, abs=1e-15)  # where it is held


def test_the_play_of_a_nut_closes_as_it_runs_warm_and_opens_again():
    one = Alone("backlash", 1e-5, variant="warm_nut")
    one.move(0, 1.3)
    first = one.travel_m()
    assert first == pytest.approx(-0.5e-5, rel=0.02)
    middles, now_s = to_and_fro(one, times=101, speed=0.5, rest_s=1.0)
    warm = float(np.sum(0.2 * np.exp(-(now_s - middles) / 600.0))) / 24.0  # metres in 600 s at 0.04 m/s
    closed = 1.0 - 0.8 * (1.0 - math.exp(-warm - 0.2 * math.exp(-now_s / 600.0) / 24.0))
    assert one.travel_m() == pytest.approx(-0.5e-5 * closed, rel=0.01)
    assert closed < 0.8
    assert one.travel_m(t_s=one.t_s + 6000.0) == pytest.approx(-0.5e-5, rel=1e-3)
    to_and_fro(one, 1, times=20, speed=0.5)
    assert one.travel_m(drive=1) == 0.0


def test_rest_builds_a_grease_up_and_every_way_breaks_it_down():
    def friction(*legs):
        one = Alone("friction_windup", 1e-8, variant="thixotropic", friction_n=100.0)
        for to_m, rest_s in legs:
            one.move(0, to_m, rest_s=rest_s)
        return float(one.deviation().force_n[0, 0])

    fresh = friction((HOME_M + 0.4, 0.0))
    assert fresh == pytest.approx(100.0 * (0.25 + 0.75 / math.e), rel=1e-6)
    structure = 1.0 - (1.0 - 1.0 / math.e) * math.exp(-20.0 / 40.0)
    again = friction((HOME_M + 0.4, 20.0), (HOME_M + 0.2, 3.0))
    assert again == pytest.approx(-100.0 * (0.25 + 0.75 * structure * math.exp(-0.5)), rel=1e-6)
    assert friction((1.6, 0.0), (0.4, 0.0), (1.6, 0.0)) == pytest.approx(25.0, rel=0.05)  # no structure is left
    assert friction((1.6, 0.0), (0.4, 4e3), (0.41, 0.0)) == pytest.approx(100.0, rel=0.02)


def test_a_rail_gives_way_between_its_bolts():
    one = Alone("column_compliance", 1e-8, variant="rail_between_bolts")
    at = one.effect.first_m + 0.24 * (np.arange(12) // 4 + 2 + np.tile([0.0, 0.25, 0.5, 0.75], 3))
    soft = one.deviation(t_s=np.zeros(12), q=along(at)).carriage_compliance
    beam = [0.0, (0.25 * 0.75) ** 2 / 0.5**4, 1.0, (0.25 * 0.75) ** 2 / 0.5**4]  # a^2 b^2 over that in the middle
    assert soft[:, 0, 1] == pytest.approx(1e-8 * (0.2 + 0.8 * np.tile(beam, 3)))
    assert not np.any(soft[:, 0, [0, 2]])
    assert not np.any(soft[:, 1])


def test_every_swing_loosens_a_strut_s_end():
    one = Alone("link_stiffness", 1.2, place="left_lower", variant="loosening")
    assert not np.any(one.deviation().ln_stiffness)
    to_and_fro(one, 1, times=30, speed=0.5)
    assert not np.any(one.deviation().ln_stiffness)  # the other drive
    for times, ways in ((50, 0.01), (50, 0.3)):
        to_and_fro(one, times=times, speed=0.5, way=ways)
    lost = one.deviation().ln_stiffness[0]
    assert lost[1] == pytest.approx(-1.2 * (1.0 - math.exp(-0.5)), rel=1e-9)
    assert not np.any(lost[[0, 2, 3]])


def test_a_strut_sinks_through_the_oil_of_its_pin():
    c = 2e-5
    one = Alone("joint_clearance", c, place="left_upper", variant="oil_journal")
    one.move(0, 1.3, rest_s=0.0)
    stopped_s, tau = one.t_s, one.effect.sinks_s
    assert 12.0 <= tau <= 30.0
    p_y = 0.2  # both sliders equally high: the platform hangs in the middle
    q = p_y + math.sqrt(1.5**2 - 1.0)
    eccentricity, step = 0.0, 1e-3
    for k in range(100001):  # Ocvirk: de/dt (1 + 2 e^2) / (1 - e^2)^(5/2) = 1 / tau
        if k in (0, 5000, 20000, 100000):
            grown = one.deviation(t_s=stopped_s + k * step, q=[[q, q]]).length_m[0]
            assert grown[0] == pytest.approx(c * eccentricity * math.sqrt(1.25) / 1.5, rel=2e-3, abs=1e-12)
            assert not np.any(grown[1:])
        half = eccentricity + 0.5 * step / tau * (1.0 - eccentricity**2) ** 2.5 / (1.0 + 2.0 * eccentricity**2)
        eccentricity += step / tau * (1.0 - half**2) ** 2.5 / (1.0 + 2.0 * half**2)
    assert eccentricity < 1.0
    assert not one.deviation().laws


def test_errors_of_single_turns_add_up_along_a_screw():
    turn_m, spread = (HIGH_M - LOW_M) / 138.0, []
    for seed in range(60):
        one = Alone("screw_cumulative_error", 1e-5, variant="pitch_walk", seed=seed)
        at = LOW_M + turn_m * np.arange(139)
        off = one.deviation(t_s=np.zeros(139), q=along(at)).travel_m[:, 0]
        assert np.abs(off).max() == pytest.approx(1e-5)
        assert np.polyfit(at - MIDDLE_M, off, 1) == pytest.approx([0.0, 0.0], abs=1e-12)
        steps = np.diff(off)
        spread.append([np.mean((off[lag:] - off[:-lag]) ** 2) / np.mean(steps**2) for lag in (4, 16)])
    assert np.mean(spread, axis=0) == pytest.approx([4.0, 16.0], rel=0.25)  # the variance goes with the turns


def test_creeping_balls_do_not_come_back_with_the_place():
    one = Alone("screw_periodic_error", 1e-5, variant="slipping_balls", period_m=0.01)
    seen = []
    for _ in range(7):
        seen.append(one.travel_m())
        one.move(0, HOME_M + 0.5)
        one.move(0, HOME_M)
    # Back where it was after 1 m; after 6 m the balls are round once.
    assert seen[6] == pytest.approx(seen[0], abs=1e-12)
    turns = 0.7e-5 * np.exp(2j * np.pi * np.arange(6) / 6.0)
    mean = np.mean(seen[:6])
    part = (np.array(seen[:6]) - mean) @ turns.conjugate() / 3.0 / 0.7e-5
    assert abs(part) == pytest.approx(0.7e-5, rel=1e-6)
    assert np.array(seen[:6]) == pytest.approx(mean + (part * turns / 0.7e-5).real, abs=1e-12)
    assert mean == pytest.approx(0.7e-5 * math.sin(2.0 * math.pi * HOME_M / 0.01 + one.effect.phase), abs=1e-12)


def test_a_count_of_whole_periods_leaves_a_sawtooth_that_is_late_on_either_side():
    one = Alone("encoder_interpolation", 1e-5, variant="coarse_count", pitch_m=1e-3)
    at = HOME_M + np.linspace(0.0, 0.01, 20001)
    seen = {}
    for to_m in (1.3, 1.0):
        one.move(0, to_m)
        seen[to_m] = one.deviation(t_s=np.full(20001, one.t_s), q=along(at)).travel_m[:, 0]
    up, down = seen[1.3], seen[1.0]
    assert up.mean() == pytest.approx(0.0, abs=2e-8)
    assert up.std() == pytest.approx(1e-5 / math.sqrt(3.0), rel=1e-3)
    harmonics = np.abs(np.fft.rfft(up[:-1]))[[10, 20, 30]] / 10000.0
    assert harmonics == pytest.approx(2e-5 / math.pi / np.array([1.0, 2.0, 3.0]), rel=1e-2)
    drops = [at[np.flatnonzero(np.diff(part) < -1e-5)] for part in (up, down)]
    assert (drops[0][0] - drops[1]) % 1e-3 == pytest.approx(0.24e-3, abs=2e-6)


@pytest.mark.parametrize("name", ["guide_straightness", "guide_angular"])
def test_a_carriage_lies_on_either_side_of_a_worn_gib(name):
    one = Alone(name, 1e-5, variant="gib_play")
    worn_m = MIDDLE_M + one.effect.joint * HALF_M
    sides = []
    for to_m in (HOME_M, 1.3, 1.0):
        one.move(0, to_m)
        d = one.deviation(t_s=[one.t_s] * 3, q=along([worn_m, worn_m + 0.4 * HALF_M, worn_m - 3.0 * HALF_M]))
        sides.append((d.sideways_m if name == "guide_straightness" else d.yaw_rad)[:, 0])
        assert not np.any(d.travel_m)
    assert sides[0] == pytest.approx(np.zeros(3))  # it has not moved yet
    assert sides[1] == pytest.approx(1e-5 * np.array([1.0, 0.3 + 0.7 / math.e, 0.3]))
    assert sides[2] == pytest.approx(-sides[1])


def test_sand_under_a_foot_is_packed_by_what_shakes_it():
    one = Alone("foundation_settling", 1e-4, variant="shaken_sand", onset_s=100.0, tilt_per_m=0.3)
    to_and_fro(one, times=4, speed=0.5)
    assert one.t_s < 100.0
    assert not np.any(one.deviation().travel_m)
    one.t_s = 200.0
    to_and_fro(one, 0, times=8, speed=0.5)
    to_and_fro(one, 1, times=8, speed=0.25)
    shaken = 8 * 0.25 + 8 * 0.0625
    d = one.deviation()
    assert d.travel_m[0] == pytest.approx([-1e-4 * math.log(1.0 + shaken / 4.0) / math.log(11.0), 0.0])
    assert d.yaw_rad[0, 0] == pytest.approx(-0.3 * d.travel_m[0, 0])
    one.t_s += 5000.0
    assert one.travel_m() == d.travel_m[0, 0]  # time alone packs nothing
