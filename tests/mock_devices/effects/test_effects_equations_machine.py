"""Forms of machine and drives against their publications: closed forms, equations solved here step by step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
ALPHA, ALPHA_SCREW = 11.5e-6, 10.5e-6


def is_derivative(law, e, k):
    numeric = (law(e + 1e-10, k)[0] - law(e - 1e-10, k)[0]) / 2e-10
    return law(e, k)[1] == pytest.approx(numeric, rel=1e-3)


def test_a_strut_in_air_that_cycles_lags_behind_it():
    one = Alone("link_thermal_growth", 2.0, variant="cycling_air", tau_s=800.0)
    period_s = one.effect.period_s
    assert 1200.0 <= period_s <= 3600.0
    strut, warmth = 0.0, [0.0]
    for k in range(40000):  # tau dT/dt = air - T, by the midpoint rule in steps of half a second
        air = math.sin(2.0 * math.pi * (0.5 * k + 0.25) / period_s)
        strut += 0.5 / 800.0 * (air - strut) / (1.0 + 0.25 / 800.0)
        warmth.append(strut)
    largest = max(warmth[30000:])  # in the steady state, when the beginning is forgotten
    t = np.array([0.0, 300.0, 1500.0, 6000.0, 19000.0])
    grown = one.deviation(t_s=t, q=np.full((5, 2), HOME_M)).length_m[:, 0]
    expected = np.array([warmth[int(2 * x)] for x in t]) / largest
    assert grown == pytest.approx(ALPHA * 1.5 * 2.0 * expected, rel=2e-3, abs=1e-8)


def test_heat_of_a_motor_comes_down_its_column():
    one = Alone("column_thermal_growth", 3.0, variant="motor_above", tau_s=1000.0)
    length, cells = HIGH_M + 0.125 + 1.2 + 0.2, 700
    width, theta = length / cells, np.zeros(cells)
    diffusivity = 0.5**2 / 4.0 / 1000.0  # 2 sqrt(a t) is half a metre after tau
    step = 0.45 * width**2 / diffusivity
    for _ in range(round(1500.0 / step)):  # from the foot, which is insulated, to the head, which is kept at one
        ends = np.concatenate([theta[:1], theta, [2.0 - theta[-1]]])
        theta = theta + 0.45 * (ends[2:] - 2.0 * theta + ends[:-2])
    at = np.array([LOW_M, 1.1, 1.5, HIGH_M])
    grown = one.deviation(t_s=np.full(4, 1500.0), q=along(at)).travel_m[:, 0]
    whole = np.concatenate([[0.0], np.cumsum(theta) * width])
    expected = np.interp(at + 0.125 + 1.2, np.arange(cells + 1) * width, whole)
    assert grown == pytest.approx(3.0 * ALPHA * expected, rel=0.01, abs=1e-9)
    assert grown[0] < 0.05 * grown[3]  # it has not come down there yet
    assert one.travel_m(t_s=0.0) == pytest.approx(0.0, abs=1e-12)


def test_a_screw_is_warm_where_its_nut_ran():
    tau = 2000.0
    one = Alone("screw_thermal_growth", 1.0, variant="where_it_ran", tau_s=tau)
    stays = [(HOME_M, 1.4), (1.4, 1.2), (1.2, 1.6)]
    left = []
    for start, end in stays:
        one.move(0, end, speed=0.1, rest_s=100.0)
        left.append((one.t_s - 100.0 - 0.5 * abs(end - start) / 0.1, min(start, end), max(start, end)))
    one.move(1, 0.6)  # the other screw
    now_s = one.t_s
    x = np.linspace(LOW_M, HIGH_M, 40001)
    warm = np.zeros_like(x)
    for middle_s, low, high in left:
        once = (HIGH_M - LOW_M) / (0.01 * tau)
        warm[(x >= low) & (x <= high)] += once * math.exp(-(now_s - middle_s) / tau)
    whole = ALPHA_SCREW * float(np.sum(warm[x <= 1.6])) * (x[1] - x[0])
    assert one.travel_m() == pytest.approx(whole, rel=0.02)
    one.t_s += tau
    assert one.travel_m() == pytest.approx(whole * math.exp(-1.0), rel=0.02)
    one.move(0, 1.1, speed=0.5, rest_s=0.0)  # below all that is warm but what this way has just left
    assert one.travel_m() == pytest.approx(0.0, abs=0.02 * whole)


def test_oil_between_flanks_is_pressed_out_as_stefan_says():
    own_kg, tau = 150.0, 4.0
    one = Alone("backlash", 1e-5, variant="squeeze_film", tau_s=tau)
    one.move(0, 1.3, rest_s=0.0)
    arrived_s = one.t_s
    for payload_kg in (0.0, 300.0):
        height, step = 1.0, 1e-3
        for k in range(12000):  # dh/dt = -(load) h^3 / (2 tau)
            if k in (0, 2000, 11999):
                found = one.travel_m(t_s=arrived_s + k * step, payload_kg=payload_kg)
                assert found == pytest.approx(-0.5e-5 * height, rel=1e-3)
            half = height - 0.5 * step * (1.0 + payload_kg / own_kg) * height**3 / (2.0 * tau)
            height -= step * (1.0 + payload_kg / own_kg) * half**3 / (2.0 * tau)
    one.move(0, 1.1, rest_s=0.0)
    assert one.travel_m() == pytest.approx(0.5e-5)


def test_friction_of_a_grease_falls_as_it_warms():
    one = Alone("friction_windup", 1e-8, variant="warming_grease", friction_n=200.0)
    one.move(0, 1.3)
    t = np.array([one.t_s, 1500.0, 1e5])
    friction = one.deviation(t_s=t, q=np.full((3, 2), 1.3)).force_n[:, 0]
    warmer_k = 25.0 * np.array([t[0] / 1500.0, 1.0 - 1.0 / math.e, 1.0])
    assert friction == pytest.approx(200.0 * 0.95123**warmer_k, rel=1e-3)  # five hundredths less viscous a kelvin
    own_n = 75.0 * 9.80665
    d = one.deviation(t_s=1e5)
    assert d.travel_m[0, 0] == pytest.approx(-1e-8 * (own_n + 200.0 * math.exp(-1.25)))


def test_a_ball_nut_gives_way_by_the_power_two_thirds_of_its_load():
    one = Alone("column_compliance", 1e-8, variant="ball_nut")
    given = []
    for payload_kg in (0.0, 150.0, 1050.0):
        soft = one.deviation(payload_kg=payload_kg).carriage_compliance[0, 0]
        assert not np.any(soft[1:])
        given.append(soft[0] * (150.0 + payload_kg))
    assert given[0] == pytest.approx(1e-8 * 150.0)
    assert np.array(given) / given[0] == pytest.approx([1.0, 2.0 ** (2.0 / 3.0), 4.0])


def test_a_fork_s_bearing_gives_way_by_the_angle_of_its_strut():
    one = Alone("link_stiffness", math.log(5.0), place="right_upper", variant="fork_bearing")
    poses = [complex(0.0, 0.0), complex(0.3, 0.2), complex(-0.25, 0.1)]
    q, angle = [], []
    for p in poses:  # both sliders above a platform that does not turn; struts of 1.5 m over 1 m to either side
        rises = [math.sqrt(1.5**2 - (1.0 + side * p.real) ** 2) for side in (1.0, -1.0)]
        q.append([p.imag + rise for rise in rises])
        angle.append(math.asin(rises[1] / 1.5))
    rest = one.deviation(t_s=[0.0] * 3, q=q).ln_stiffness
    middle = math.asin(math.sqrt(1.25) / 1.5)  # both drives in the middle of their travels
    swing = np.array(angle) - middle
    compliance = np.cos(swing) ** 2 + 5.0 * np.sin(swing) ** 2
    assert rest[:, 2] == pytest.approx(-np.log(compliance), abs=1e-12)
    assert rest[0, 2] == pytest.approx(0.0, abs=1e-12)
    assert not np.any(rest[:, [0, 1, 3]])


def test_a_spring_hides_the_play_of_its_joint_until_it_gives_way():
    for seed in (1, 2, 3, 4):
        one = Alone("joint_clearance", 2e-5, variant="spring_seated", seed=seed)
        law, k = one.deviation().laws[0][0], 1.0e8
        spring_n = one.effect.spring_n
        assert 200.0 <= abs(spring_n) <= 1500.0
        side = math.copysign(1.0, spring_n)
        stretch = side * np.array([-5e-4, 0.0, 0.4e-6, abs(spring_n) / k + 2e-5, 5e-4])
        force = law(stretch, np.full(5, k))[0]
        # Stiff to the other side and before; held by the spring within the play; stiff again 40 um later.
        held = abs(spring_n) + 1e-3 * k * 2e-5
        expected = np.array([-5e4, 0.0, 40.0, held, k * (5e-4 - 4e-5) + 1e-3 * k * 4e-5])
        assert force == pytest.approx(side * expected, rel=1e-3, abs=60.0)
        assert is_derivative(law, np.linspace(-1e-4, 1e-4, 81), np.full(81, k))


def test_a_screw_is_worn_over_the_stretch_where_a_nut_of_its_length_has_been():
    one = Alone("screw_cumulative_error", 1e-5, variant="worn_stretch")
    x = np.linspace(-1.0, 1.0, 401)
    y = one.deviation(t_s=np.zeros(401), q=along(MIDDLE_M + HALF_M * x)).travel_m[:, 0] / 1e-5
    # A nut as long as a fifth of half the travel goes to and fro; each place wears by the share of time it is within.
    worn = np.zeros_like(x)
    reach = 0.25 + 0.2 / 2.0
    for middle in one.effect.worn + np.linspace(-reach, reach, 4001):
        worn += np.abs(x - middle) <= 0.2 / 2.0
    assert y == pytest.approx(1.0 - 2.0 * worn / worn.max(), abs=0.03)
    assert abs(one.effect.worn) < 0.3


def test_a_bent_universal_joint_errs_twice_a_turn():
    one = Alone("screw_periodic_error", 1e-5, variant="universal_joint", period_m=0.01)
    q = 0.5 + 0.01 * np.arange(64) / 64.0
    y = one.deviation(t_s=np.zeros(64), q=along(q)).travel_m[:, 0]
    orders = np.abs(np.fft.rfft(y)) / 32.0
    ratio = math.tan(math.radians(15.0)) ** 2  # series: sum of tan^2n(bend / 2) / n sin(2 n turn)
    assert orders[[2, 4]] == pytest.approx([1e-5, 1e-5 * ratio / 2.0], rel=1e-6)
    assert orders[1::2].max() < 1e-15


def test_shadows_of_gratings_err_at_orders_that_four_divides():
    one = Alone("encoder_interpolation", 1e-6, variant="shadow_gratings", pitch_m=1e-3)
    q = 0.5 + 1e-3 * np.arange(512) / 512.0
    y = one.deviation(t_s=np.zeros(512), q=along(q)).travel_m[:, 0]
    orders = np.abs(np.fft.rfft(y)) / 256.0
    assert orders[4] == pytest.approx(1e-6, rel=0.03)
    assert np.abs(y).max() == pytest.approx(1e-6, rel=0.01)
    zero = 1.0 - (one.effect.phase / (2.0 * math.pi)) % 1.0
    at = along(0.5 + 1e-3 * (zero + np.array([0.0, 1.0 / 16.0, 1.0 / 8.0, 1.0 / 4.0])))
    exact = one.deviation(t_s=np.zeros(4), q=at).travel_m[:, 0]
    # Triangles at 22.5 degrees are 3/4 and 1/4: atan(1/3) for 22.5 degrees.
    expected = math.radians(math.degrees(math.atan(1.0 / 3.0)) - 22.5) / 0.0711
    assert exact == pytest.approx([0.0, 1e-6 * expected, 0.0, 0.0], abs=1e-11)
    orders[4::4] = 0.0
    assert orders.max() < 2e-9


def test_a_rail_over_uneven_supports_is_bent_least():
    one = Alone("guide_straightness", 1e-5, variant="uneven_supports")
    q = np.linspace(LOW_M, HIGH_M, 1001)
    y = one.deviation(t_s=np.zeros(1001), q=along(q)).sideways_m[:, 0]
    assert np.std(y) == pytest.approx(0.7e-5, rel=0.02)
    assert np.polyfit(q, y, 1)[0] == pytest.approx(0.0, abs=1e-7)
    # A beam that is pinned to the supports alone: the least of its bending energy, found on a grid.
    n, pins = 1001, np.arange(0, 1001, 200)
    second = np.diff(np.eye(n), 2, axis=0)
    free = np.setdiff1d(np.arange(n), pins)
    least = np.zeros(n)
    least[pins] = y[pins]
    least[free] = np.linalg.solve(
        second[:, free].T @ second[:, free], -second[:, free].T @ second[:, pins] @ least[pins]
    )
    assert y == pytest.approx(least, abs=2e-8)


def test_the_angle_of_a_rail_over_uneven_supports_is_its_slope():
    straight = Alone("guide_straightness", 1e-5, variant="uneven_supports")
    turned = Alone("guide_angular", 1e-5, variant="uneven_supports")
    turned.effect.heights, turned.effect.bends = straight.effect.heights, straight.effect.bends
    q = np.linspace(LOW_M + 0.01, HIGH_M - 0.01, 400)
    rail = straight.deviation(t_s=np.zeros(800), q=along(np.concatenate([q + 1e-6, q - 1e-6]))).sideways_m[:, 0]
    slope = (rail[:400] - rail[400:]) / 2e-6
    yaw = turned.deviation(t_s=np.zeros(400), q=along(q)).yaw_rad[:, 0]
    assert np.corrcoef(slope, yaw)[0, 1] == pytest.approx(1.0, abs=1e-6)
    alone = Alone("guide_angular", 1e-5, variant="uneven_supports")
    whole = alone.deviation(t_s=np.zeros(400), q=along(q)).yaw_rad[:, 0]
    assert np.std(whole) == pytest.approx(0.7e-5, rel=0.05)


def test_lead_creeps_with_the_cube_root_of_time_and_then_evenly():
    one = Alone("foundation_settling", 1e-5, variant="lead_pads", onset_s=100.0, tau_s=1000.0)
    t = [50.0, 100.0 + 4.0, 100.0 + 4000.0 / 8.0, 4100.0, 100.0 + 32000.0]
    sunk = -one.deviation(t_s=t, q=np.full((5, 2), HOME_M)).travel_m[:, 0] / 1e-5
    # Four fifths by the cube root, a fifth evenly: a tenth of the root after a thousandth, a half after 1/8.
    assert sunk == pytest.approx([0.0, 0.08 + 0.0002, 0.4 + 0.025, 1.0, 1.6 + 1.6])
