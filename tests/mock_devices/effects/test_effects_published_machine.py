"""Further forms of machine and drives against their publications: closed forms, equations solved here step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA, ALPHA_SCREW = 11.5e-6, 10.5e-6


def law_of(name, size, variant, stiffness=1.0e8):
    """The effect and force and stiffness of the first strut at elongations."""
    one = Alone(name, size, variant=variant)
    law = one.deviation().laws[0][0]
    return one, lambda e: law(np.asarray(e, dtype=float), np.full(len(e), stiffness))


def is_derivative(law, e):
    numeric = (law(e + 1e-10)[0] - law(e - 1e-10)[0]) / 2e-10
    return law(e)[1] == pytest.approx(numeric, rel=1e-3)


def test_still_air_takes_heat_with_the_power_five_quarters():
    one = Alone("link_thermal_growth", 2.0, variant="still_air", tau_s=1000.0)
    t = np.array([0.0, 500.0, 2000.0, 8000.0])
    warmth = [1.0]
    for _ in range(8000):  # d(theta)/dt = -theta^1.25 / tau, by the midpoint rule in steps of a second
        half = warmth[-1] - 0.5 * warmth[-1] ** 1.25 / 1000.0
        warmth.append(warmth[-1] - half**1.25 / 1000.0)
    grown = one.deviation(t_s=t, q=np.full((4, 2), HOME_M)).length_m[:, 0]
    expected = ALPHA * 1.5 * 2.0 * np.array([warmth[int(x)] for x in t])
    assert grown == pytest.approx(expected, rel=1e-5)


def test_a_column_that_soaks_heat_up_bends_first_and_has_grown_in_the_end():
    one = Alone("column_thermal_growth", 1.0, variant="soaking", tau_s=1000.0)
    cells, tau_s = 200, 1000.0
    theta = np.zeros(cells)
    spread = 4.0 / (math.pi**2 * tau_s) * cells**2  # a / dx^2 for a plate of thickness one, tau = 4 / (pi^2 a)
    step, found = 0.4 / spread, {}
    wanted = [50.0, 300.0, 1500.0]
    for k in range(int(1600.0 / step)):
        with_faces = np.concatenate([theta[:1], theta, [2.0 - theta[-1]]])  # insulated face, warm face
        theta = theta + 0.4 * (with_faces[2:] - 2.0 * theta + with_faces[:-2])
        for t in wanted:
            if t not in found and (k + 1) * step >= t:
                where = (np.arange(cells) + 0.5) / cells - 0.5
                found[t] = (float(theta.mean()), 12.0 * float(np.mean(theta * where)))
    d = one.deviation(t_s=wanted, q=np.full((3, 2), 1.1))
    height = 1.1 + 0.125 + 1.2
    mean, slope = np.array([found[t] for t in wanted]).T
    assert d.travel_m[:, 0] == pytest.approx(ALPHA * mean * height, rel=0.01)
    assert d.yaw_rad[:, 0] == pytest.approx(ALPHA * slope / 0.4 * height, rel=0.01)
    assert d.sideways_m[:, 0] == pytest.approx(0.5 * d.yaw_rad[:, 0] * height)
    assert slope[1] > 2.0 * slope[2]
    late = one.deviation(t_s=[0.0, 1e5], q=np.full((2, 2), 1.1))
    assert late.yaw_rad[:, 0] == pytest.approx([0.0, 0.0], abs=1e-15)
    assert late.travel_m[1, 0] == pytest.approx(ALPHA * height)


def test_a_bearing_warms_the_screw_as_a_fin_by_the_friction_of_its_speed():
    grown = {}
    for speed in (0.5, 0.0625):
        one = Alone("screw_thermal_growth", 1.0, variant="fixed_bearing", tau_s=6000.0)
        one.move(0, 0.6, speed=speed)
        one.move(0, 1.6, speed=speed)
        grown[speed] = one.deviation(t_s=[one.t_s] * 2, q=along([HIGH_M, LOW_M + 0.2])).travel_m[:, 0]
    x = np.linspace(0.0, 1.0, 20001)
    profile = np.cosh((HIGH_M - LOW_M) * (1.0 - x) / 0.35) / math.cosh((HIGH_M - LOW_M) / 0.35)
    whole = float(np.mean(profile)) * (HIGH_M - LOW_M)
    part = float(np.mean(profile[x < 0.2 / (HIGH_M - LOW_M)])) * 0.2
    warm = 0.5 + np.abs(np.array([HIGH_M, LOW_M + 0.2]) - 0.6)  # ways of both states: 0.5 m and then on from 0.6 m
    assert grown[0.5][0] / grown[0.5][1] == pytest.approx(warm[0] / warm[1] * whole / part, rel=0.01)
    assert grown[0.5][0] == pytest.approx(ALPHA_SCREW * warm[0] / (0.01 * 6000.0) * whole, rel=0.01)
    assert grown[0.0625] / grown[0.5] == pytest.approx([0.25, 0.25], rel=0.01)  # an eighth to the power 2/3


def test_play_of_bouc_and_wen_follows_their_equation():
    one = Alone("backlash", 1e-5, variant="bouc_wen")
    assert 1e-3 <= one.effect.rise_m <= 1e-2
    way, z = one.effect.rise_m * np.array([0.7, -1.1, 0.3, -2.5, 0.05]), 0.0
    for x in way:
        one.move(0, one.q[0] + x)
        steps = 20000
        for _ in range(steps):  # dz = dx - beta |dx| z - gamma dx |z|, both 1/2
            dx = x / one.effect.rise_m / steps
            z += dx - 0.5 * abs(dx) * z - 0.5 * dx * abs(z)
        assert one.travel_m() == pytest.approx(-0.5e-5 * z, abs=2e-9)
    one.move(0, 1.5)
    assert one.travel_m() == pytest.approx(-0.5e-5, rel=1e-6)


def test_flanks_rub_by_their_load_and_more_upwards():
    own_n, friction_n = 150.0 * 9.80665 / 2.0, 200.0
    found = {}
    for target, payload_kg in ((1.3, 0.0), (1.3, 300.0), (0.9, 0.0)):
        one = Alone("friction_windup", 1e-8, variant="flanks", friction_n=friction_n)
        one.move(0, target)
        d = one.deviation(payload_kg=payload_kg)
        found[target, payload_kg] = float(d.force_n[0, 0])
        load_n = own_n + 0.5 * payload_kg * 9.80665
        assert d.travel_m[0, 0] == pytest.approx(-1e-8 * (load_n + found[target, payload_kg]))
    assert found[1.3, 0.0] == pytest.approx(friction_n)
    assert found[1.3, 300.0] == pytest.approx(3.0 * friction_n)  # 450 kg over 150 kg
    # With mu = tan(friction angle) the torque up is W r (tan(lead) + mu) / (1 - mu tan(lead)), down with -mu.
    lead = math.tan(math.radians(5.0))
    up = 1.0 + friction_n / own_n
    mu = lead * (up - 1.0) / (1.0 + up * lead**2)
    assert (lead + mu) / (1.0 - mu * lead) == pytest.approx(lead * up)
    down = (lead - mu) / (1.0 + mu * lead) / lead
    assert found[0.9, 0.0] == pytest.approx(-own_n * (1.0 - down))
    assert abs(found[0.9, 0.0]) < friction_n


def test_a_column_under_a_beam_gives_way_as_a_beam_with_fixed_ends():
    one = Alone("column_compliance", 1e-8, variant="portal")
    at = np.array([LOW_M, 0.8, MIDDLE_M, HIGH_M])
    soft = one.deviation(t_s=[0.0] * 4, q=along(at)).carriage_compliance[:, 0]
    a, length = at - LOW_M + 0.3, HIGH_M - LOW_M + 0.6
    deflection = a**3 * (length - a) ** 3 / (3.0 * length**3)  # Roark: W a^3 b^3 / (3 E I l^3) under the load
    middle = length**3 / 192.0
    assert soft[:, 1] == pytest.approx(1e-8 * deflection / middle)
    assert not np.any(soft[:, [0, 2]])


def test_a_bolted_joint_gives_way_once_its_preload_is_gone():
    one, law = law_of("link_stiffness", math.log(4.0), "joint_separates")
    preload_m = one.effect.preload_n / 1.0e8
    assert 1e-5 <= preload_m <= 6e-5
    e = preload_m + np.array([-1e-3, -2e-5, 2e-5, 1e-3])
    force, slope = law(e)
    assert force[:2] == pytest.approx(1e8 * e[:2], rel=1e-3, abs=1.0)
    assert force[2:] == pytest.approx(one.effect.preload_n + 0.25e8 * (e[2:] - preload_m), rel=1e-3)
    assert slope == pytest.approx([1e8, 1e8, 0.25e8, 0.25e8], rel=1e-3)
    assert is_derivative(law, np.linspace(-5e-5, 1e-4, 41))


def test_balls_share_a_force_by_how_far_each_is_pressed():
    play_m, k = 2e-5, 1.0e8
    _, law = law_of("joint_clearance", play_m, "ball_bearing")
    shift = np.array([1e-5, 2.2e-5, 2.5e-5, 8e-5])
    each = k / (1.5 * math.sqrt(1e-5))  # N/m^1.5: as stiff as the strut when pressed by 10 um
    carried = np.zeros(4)
    for i, x in enumerate(shift):
        for angle in np.radians(np.arange(0, 360, 30)):
            pressed = x * math.cos(angle) - play_m
            carried[i] += each * max(pressed, 0.0) ** 1.5 * math.cos(angle)
    whole = shift + carried / k  # bearing and strut in series
    force, _ = law(np.concatenate([whole, -whole]))
    beyond = force - 1e-3 * k * np.concatenate([whole, -whole])
    assert beyond == pytest.approx(np.concatenate([carried, -carried]), rel=1e-6, abs=1e-6)
    assert carried[0] == 0.0
    assert carried[1] == pytest.approx(each * 2e-6**1.5)  # one ball alone
    assert is_derivative(law, np.linspace(-2e-4, 2e-4, 80))


def test_a_glued_scale_is_held_in_the_middle_and_gives_way_at_its_ends():
    one = Alone("screw_cumulative_error", 1e-5, variant="glued_scale")
    x = np.linspace(-1.0, 1.0, 4001)
    y = one.deviation(t_s=np.zeros(4001), q=along(MIDDLE_M + HALF_M * x)).travel_m[:, 0] / 1e-5
    assert y[[0, -1]] == pytest.approx([-1.0, 1.0])
    assert np.polyfit(x, y, 1) == pytest.approx([0.0, 0.0], abs=2e-3)
    second = np.diff(y, 2)  # u'' = 25 (u - straight line): adhesive of Volkersen's beta l = 5
    straight = (y[1:-1] - second / (25.0 * 0.0005**2)) / x[1:-1].clip(1e-9)
    assert np.ptp(straight[x[1:-1] > 0.3]) < 0.01


def test_a_bowed_screw_errs_by_the_slope_of_its_line():
    one = Alone("screw_periodic_error", 1e-5, variant="bowed_screw", period_m=0.01)
    q = LOW_M + 0.01 * np.arange(139)  # whole turns
    y = one.deviation(t_s=np.zeros(139), q=along(q)).travel_m[:, 0]
    turn = math.sin(2.0 * math.pi * LOW_M / 0.01 + one.effect.phase)
    share = (q - LOW_M) / (HIGH_M - LOW_M)
    slope = (np.sin(np.pi * (share + 1e-6)) - np.sin(np.pi * (share - 1e-6))) / (2e-6 * np.pi)
    assert y == pytest.approx(1e-5 * turn * slope, abs=1e-12)


def test_harmonics_of_signals_err_at_the_orders_beside_them():
    one = Alone("encoder_interpolation", 1e-6, variant="harmonics", pitch_m=1e-3)
    q = 0.5 + 1e-3 * np.arange(256) / 256.0
    y = one.deviation(t_s=np.zeros(256), q=along(q)).travel_m[:, 0] / 1e-6
    orders = np.abs(np.fft.rfft(y)) / 128.0
    # cos 2x in both, 45 degrees apart, errs by h2 / sqrt(2) at orders 1 and 3; cos 3x by h3 at order 4.
    assert orders[[1, 3, 4]] == pytest.approx([1.0, 1.0, 0.1 / (0.2 / math.sqrt(2.0))], rel=0.12)
    assert max(orders[2], orders[5]) < 0.3
    zero = 1.0 - (one.effect.phase / (2.0 * math.pi)) % 1.0
    at = along(0.5 + 1e-3 * (zero + np.array([0.0, 0.25])))
    exact = one.deviation(t_s=np.zeros(2), q=at).travel_m[:, 0] * 0.2 / math.sqrt(2.0) / 1e-6
    assert exact == pytest.approx([math.atan2(-0.2, 1.3), math.atan2(1.3, -0.2) - 0.5 * math.pi])


@pytest.mark.parametrize("name", ["guide_straightness", "guide_angular"])
def test_a_rail_is_as_rough_as_a_random_surface_under_two_blocks(name):
    spectra, q = [], np.linspace(LOW_M, HIGH_M, 512, endpoint=False)
    for seed in range(60):
        one = Alone(name, 1e-5, variant="random_surface", seed=seed)
        d = one.deviation(t_s=np.zeros(512), q=along(q))
        y = (d.yaw_rad if name == "guide_angular" else d.sideways_m)[:, 0]
        assert np.std(y) == pytest.approx(0.7e-5, rel=0.02)
        spectra.append(np.abs(np.fft.rfft(y * np.hanning(512))) ** 2)
    k = np.arange(257)
    block = np.pi * k / (HIGH_M - LOW_M) * 0.2  # half of the blocks' distance times the wave number
    seen = np.sin(block) ** 2 if name == "guide_angular" else np.cos(block) ** 2
    power, usable = np.mean(spectra, axis=0), (k >= 3) & (k <= 16) & (seen > 0.4)
    falls = np.polyfit(np.log(k[usable]), np.log(power[usable] / seen[usable]), 1)[0]
    assert falls == pytest.approx(-2.0, abs=0.35)


def test_concrete_creeps_as_branson_says():
    one = Alone("foundation_settling", 1e-5, variant="concrete", onset_s=100.0, tau_s=1000.0)
    t = [50.0, 100.0 + 1.0, 1100.0, 100.0 + 32000.0]
    sunk = -one.deviation(t_s=t, q=np.full((4, 2), HOME_M)).travel_m[:, 0] / 1e-5
    # t^0.6 / (d + t^0.6): nothing before, a half at tau, 8 of 9 at 32 tau; 1000^0.6 = 63.1
    assert sunk == pytest.approx([0.0, 1.0 / (1.0 + 63.0957), 0.5, 8.0 / 9.0], rel=1e-4)
