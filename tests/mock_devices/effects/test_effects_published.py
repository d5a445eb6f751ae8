"""Forms do what the publications that they are named after say, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)


def law_of(name, size, variant):
    """Force and stiffness of the first strut at elongations, for 1e8 N/m."""
    law = Alone(name, size, variant=variant).deviation().laws[0][0]
    return lambda e: law(np.asarray(e, dtype=float), np.full(len(e), 1.0e8))


def test_a_bar_that_is_warmed_at_one_end_begins_with_the_root_of_time():
    one = Alone("link_thermal_growth", 1.0, variant="conduction", tau_s=1500.0)
    grown = one.deviation(t_s=[60.0, 240.0, 1e5], q=np.full((3, 2), HOME_M)).length_m[:, 0] / (11.5e-6 * 1.5)
    # Carslaw and Jaeger: 2 sqrt(Fo / pi) while it is short, with tau = 4 l^2 / (pi^2 a), so Fo = 4 t / (pi^2 tau).
    assert grown[0] == pytest.approx(2.0 * math.sqrt(4.0 * 60.0 / (math.pi**3 * 1500.0)), rel=0.03)
    assert grown[1] / grown[0] == pytest.approx(2.0, rel=0.03)
    assert grown[2] == pytest.approx(1.0, abs=1e-9)


def test_a_column_warm_at_its_foot_grows_no_more_beyond_some_lengths_of_a_fin():
    one = Alone("column_thermal_growth", 1.0, variant="fin", tau_s=300.0)
    d = one.deviation(t_s=[1e5] * 2, q=along([0.7, 1.2])).travel_m[:, 0] / 11.5e-6
    heights = np.array([0.7, 1.2]) + 0.125 + 1.2
    assert d == pytest.approx(0.5 * (1.0 - np.exp(-heights / 0.5)), rel=1e-6)
    assert d[1] - d[0] < 0.01


def test_nested_plays_remember_a_reversal_of_their_own():
    one = Alone("backlash", 1e-5, variant="nested_plays")
    one.move(0, 0.8)
    one.move(0, 1.1)  # wider than every play: all are on one side
    assert one.travel_m() == pytest.approx(-0.5e-5)
    one.move(0, 1.09)  # back by 10 mm: 0.5 and 4 mm each way cross over, 16 by 10 of 32, 64 by 10 of 128
    crossed = 0.4 + 0.3 + 0.2 * (-1.0 + 10.0 / 16.0) + 0.1 * (-1.0 + 10.0 / 64.0)
    assert one.travel_m() == pytest.approx(0.5e-5 * crossed)
    one.move(0, 1.1)  # the minor loop closes
    assert one.travel_m() == pytest.approx(-0.5e-5)


def test_rolling_friction_has_a_part_of_speed_and_a_part_of_load():
    forces = {}
    for speed, payload_kg in ((0.5, 0.0), (0.0625, 0.0), (0.5, 400.0)):
        one = Alone("friction_windup", 1e-8, variant="palmgren", friction_n=100.0)
        one.move(0, 1.3, speed=speed)
        forces[speed, payload_kg] = float(one.deviation(payload_kg=payload_kg).force_n[0, 0])
    assert forces[0.5, 0.0] == pytest.approx(100.0)
    assert forces[0.0625, 0.0] == pytest.approx(100.0 * (0.6 / 4.0 + 0.4))  # an eighth to the power 2/3
    assert forces[0.5, 400.0] == pytest.approx(160.0)


def test_a_screw_between_two_bearings_is_softest_in_the_middle():
    one = Alone("column_compliance", 1e-8, variant="held_at_both_ends")
    at = [LOW_M, LOW_M + 0.5 * HALF_M, MIDDLE_M, HIGH_M]
    soft = one.deviation(t_s=[0.0] * 4, q=along(at)).carriage_compliance[:, 0, 0]
    assert soft == pytest.approx([0.0, 0.75e-8, 1e-8, 0.0], abs=1e-20)


def test_hertz_joints_give_way_with_the_power_two_thirds():
    law = law_of("link_stiffness", math.log(3.0), "hertz")
    secant = 1000.0 * 3.0 / 1e8  # e^-size of the strut's stiffness up to 1000 N
    force, slope = law([secant, -secant, 0.0])
    assert force == pytest.approx([1000.0, -1000.0, 0.0], abs=1e-6)
    assert slope[2] < slope[0] < 1e8
    whole_m = np.array([3e-4, 9e-4])
    forces = law(whole_m)[0]
    contact_m = whole_m - forces / 1e8
    power = math.log(contact_m[1] / contact_m[0]) / math.log(forces[1] / forces[0])
    assert power == pytest.approx(2.0 / 3.0, abs=0.02)
    e = np.linspace(-5e-5, 5e-5, 41)
    numeric = (law(e + 1e-10)[0] - law(e - 1e-10)[0]) / 2e-10
    assert law(e)[1] == pytest.approx(numeric, rel=1e-3)


def test_a_contact_grows_with_the_power_three_halves_once_the_play_is_used_up():
    law = law_of("joint_clearance", 2e-5, "contact_force")
    slack = 1e-3 * 1e8
    e = np.array([1e-5, 2.25e-5, 2.9e-5, -2.9e-5, 4e-5])
    force, slope = law(e)
    beyond = force - slack * e
    assert beyond[0] == 0.0
    assert beyond[2] / beyond[1] == pytest.approx(3.6**1.5)
    assert beyond[3] == -beyond[2]
    assert slope[4] == pytest.approx(1e8 + slack)
    numeric = (law(e + 1e-10)[0] - law(e - 1e-10)[0]) / 2e-10
    assert slope == pytest.approx(numeric, rel=1e-3)


def test_balls_go_round_at_less_than_half_the_speed_of_the_screw():
    one = Alone("screw_periodic_error", 1e-5, variant="ball_orbit", period_m=0.01)
    q = 0.5 + 1e-4 * np.arange(10000)
    y = one.deviation(t_s=np.zeros(len(q)), q=along(q)).travel_m[:, 0]
    power = np.abs(np.fft.rfft(y * np.hanning(len(q))))
    per_m = np.fft.rfftfreq(len(q), 1e-4)
    first = per_m[power.argmax()]
    power[np.abs(per_m - first) < 5.0] = 0.0
    assert first == pytest.approx(100.0, abs=1.0)
    assert per_m[power.argmax()] == pytest.approx(100.0 * 0.5 * (1.0 - 0.16 * math.sqrt(0.5)), abs=1.0)


def test_an_ellipse_of_signals_errs_as_its_arc_tangent_says():
    one = Alone("encoder_interpolation", 1e-6, variant="ellipse", pitch_m=1e-3)
    q0 = -one.effect.phase * 1e-3 / (2.0 * math.pi) + 1.1
    q0 -= (q0 + one.effect.phase * 1e-3 / (2.0 * math.pi)) % 1e-3
    quarter, half = 0.25e-3, 0.5e-3
    y = one.deviation(t_s=[0.0] * 3, q=along([q0, q0 + quarter, q0 + half])).travel_m[:, 0] * math.hypot(0.25, 0.15)
    at_zero = math.atan2(1.3 * (math.sin(0.2) - 0.15), 1.25)
    at_quarter = math.atan2(1.3 * (math.cos(0.2) - 0.15), 0.25) - 0.5 * math.pi
    at_half = math.atan2(1.3 * (-math.sin(0.2) - 0.15), -0.75) + math.pi  # below the axis: -pi + error
    assert y / 1e-6 == pytest.approx([at_zero, at_quarter, at_half], abs=1e-6)


@pytest.mark.parametrize("name", ["guide_straightness", "guide_angular"])
def test_a_rail_off_its_bolt_dips_as_a_beam_on_an_elastic_foundation(name):
    one = Alone(name, 1e-5, variant="loose_bolt_of_rail")
    at = MIDDLE_M + one.effect.joint * HALF_M
    lengths = np.array([0.0, 0.25, 0.75, 1.5]) * math.pi  # Hetenyi's lambda x
    d = one.deviation(t_s=[0.0] * 4, q=along(at + lengths / 12.0))
    if name == "guide_straightness":
        expected = 2.0 * np.exp(-lengths) * (np.cos(lengths) + np.sin(lengths))
        assert expected[2] == pytest.approx(0.0, abs=1e-15)  # where the rail first lifts off its line
        assert d.sideways_m[:, 0] == pytest.approx(1e-5 * expected, abs=1e-14)
    else:
        assert d.yaw_rad[0, 0] == pytest.approx(0.0, abs=1e-12)
        assert abs(d.yaw_rad[1, 0]) == pytest.approx(2e-5)  # steepest at a quarter of pi
        assert d.yaw_rad[3, 0] * d.yaw_rad[1, 0] < 0.0


def test_clay_consolidates_as_terzaghi_says():
    one = Alone("foundation_settling", 1e-5, variant="consolidation", onset_s=100.0, tau_s=1000.0)
    # Half of it at a time factor of 0.197, nine tenths at 0.848; the slowest term is exp(-pi^2 T / 4).
    times = [50.0, *(100.0 + 1000.0 * math.pi**2 / 4.0 * factor for factor in (0.197, 0.848))]
    sunk = -one.deviation(t_s=times, q=np.full((3, 2), HOME_M)).travel_m[:, 0]
    assert sunk == pytest.approx([0.0, 0.5e-5, 0.9e-5], rel=0.01)


def test_a_beam_bends_under_one_axis_by_where_the_other_stands():
    one = Alone("axis_coupling", 1e-5, variant="shared_beam")
    at = [[MIDDLE_M, MIDDLE_M], [MIDDLE_M, HIGH_M], [HIGH_M, MIDDLE_M], [LOW_M, HIGH_M]]
    d = -one.deviation(t_s=[0.0] * 4, q=at).travel_m[:, 0] / 0.5e-5
    assert d[0] == pytest.approx(1.0)
    assert d[1] == pytest.approx(d[2])  # Maxwell: each bends the beam under the other alike
    x, b = 0.5, 0.05
    assert d[1] == pytest.approx(8.0 * b * x * (1.0 - b**2 - x**2))
    assert 0.0 < d[3] < d[1]


def test_a_stretched_relaxation_is_fast_at_first_and_late_at_the_end():
    one = Alone("servo_settling", 1e-5, variant="stretched", tau_s=4.0)
    one.move(0, 1.3, speed=0.5, rest_s=1.0)
    first = one.travel_m()
    one.t_s += 35.0
    assert first == pytest.approx(-1e-5 * math.exp(-0.5))
    assert one.travel_m() == pytest.approx(-1e-5 * math.exp(-3.0))
