"""Further forms of station, controls and stated values against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Site
from mock_devices.effects.catalogue import make
from mock_devices.known_tables import KnownTable
from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, Temperatures, along, sight_of

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)


def test_a_floor_comes_back_after_every_passer_by():
    target, squares = np.array([0.2, 3.0, 0.1]), []
    for seed in range(150):
        one = Alone("tracker_drift", 1e-5, variant="passers_by", seed=seed)
        off = one.distance_off_m(target, np.concatenate([[0.0], 4000.0 + 2000.0 * np.arange(20)]))
        assert off[0] == 0.0
        squares.append(np.mean(off[1:] ** 2))
    # Campbell: rate times the integral of the square of a shot. Distances see the shift alone, half of the variance.
    assert math.sqrt(np.mean(squares)) == pytest.approx(1e-5 / math.sqrt(2.0), rel=0.1)
    one = Alone("tracker_drift", 1e-5, variant="passers_by", seed=3)
    passed = one.effect.passed_s
    k = int(np.argmax(np.diff(passed[:60]))) + 1  # nobody comes for longest
    t = np.array([passed[k - 1] + 1e-6, passed[k] - 1e-6, passed[k] + 1e-6])
    left = one.distance_off_m(target, t)
    assert left[1] == pytest.approx(left[0] * math.exp(-(t[1] - t[0]) / 600.0), rel=1e-3)
    assert abs(left[2] - left[1]) > 1e-7


def test_a_warm_jet_bends_lines_away_from_its_middle():
    gradient = 20.0
    one = Alone("refraction", gradient, variant="warm_jet")
    middle = one.effect.jet_m
    assert -0.25 <= middle <= 0.05
    crossing = middle + np.array([-0.4, -0.15 / math.sqrt(2.0), 0.0, 0.15 / math.sqrt(2.0), 0.4])
    points = np.stack([np.zeros(5), np.full(5, 3.0), 2.0 * crossing], axis=1)[None]
    seen = sight_of(points)
    level = seen.v_rad.copy()
    one.effect.apply_to_sight(one.motion_states(0.0), seen)
    bent = (seen.v_rad - level)[0] / np.sin(level[0])

    def air_k(height):  # a bell whose steepest slope is the gradient
        return gradient * 0.15 * math.sqrt(math.e / 2.0) * np.exp(-(((height - middle) / 0.15) ** 2))

    slope = (air_k(crossing + 1e-6) - air_k(crossing - 1e-6)) / 2e-6
    # Bent by dn/dT dT/dh over 0.6 m half way, which moves the far end by half of its distance.
    assert bent == pytest.approx(-0.93e-6 * slope * 0.6 * 0.5, rel=1e-4, abs=1e-12)
    assert bent[1] == pytest.approx(-0.93e-6 * gradient * 0.3)
    assert bent[3] == pytest.approx(-bent[1])
    assert seen.distance_m == pytest.approx(np.linalg.norm(points, axis=-1))


def test_a_ball_that_turns_in_its_seat_carries_its_corner_round():
    one = Alone("smr_reseat", 1e-5, place="P3", variant="turning_ball", onset_s=50.0)

    def shift():
        return one.deviation().smr_m[0, 2, :2]

    one.move(0, HOME_M + 0.4)
    assert not np.any(shift())
    one.t_s = 60.0
    places = []
    for k in range(200):  # 0.4 m each, by both drives: once round in all
        one.move(k % 2, HOME_M + (0.4 if one.q[k % 2] < HOME_M + 0.2 else 0.0))
        places.append(shift())
    places = np.array(places)
    assert places[-1] == pytest.approx(np.zeros(2), abs=1e-15)
    assert np.linalg.norm(places[99]) == pytest.approx(1e-5)  # across the circle
    centre = 0.5 * places[99]
    assert np.linalg.norm(places - centre, axis=1) == pytest.approx(np.full(200, 0.5e-5))
    before = shift()
    one.t_s += 5000.0
    assert np.array_equal(shift(), before)  # time alone turns nothing


def test_signals_of_the_other_axis_err_by_the_sine_of_the_difference():
    one = Alone("axis_coupling", 4e-4, variant="crosstalk")
    rng = np.random.default_rng(1)
    q = rng.uniform(LOW_M, HIGH_M, (200, 2))
    off = one.deviation(t_s=np.zeros(200), q=q).travel_m
    small = 1e-4  # of the own signal, which the error in radians is then
    own, other = 2.0 * np.pi * q[:, 0] / 0.02, 2.0 * np.pi * q[:, 1] / 0.02 + one.effect.phase
    both = np.exp(1j * own) + small * np.exp(1j * other)
    error = np.angle(both * np.exp(-1j * own)) / small
    assert off[:, 0] == pytest.approx(1e-4 * error, abs=1e-7)
    assert not np.any(off[:, 1])
    both_on = one.deviation(t_s=[0.0] * 3, q=[[0.5, 0.9], [0.7123, 1.1123], [0.5, 0.905]]).travel_m[:, 0]
    assert both_on[1] == pytest.approx(both_on[0])
    assert both_on[2] != pytest.approx(both_on[0], rel=1e-3)


def test_a_clock_that_ages_is_off_by_the_integral_of_its_rate():
    one = Alone("latency", 2e-4, variant="clock_ageing", start_s=700.0)
    t = 700.0 + np.array([0.0, 1800.0, 3600.0, 7200.0])
    early = np.asarray(one.effect.early_s(one.motion_states(t, q=np.full((4, 2), HOME_M))))
    seconds = np.arange(0.0, 7200.0, 1.0) + 0.5
    rate = seconds * 2.0 * 2e-4 / 3600.0**2  # grows evenly from nothing
    expected = [float(np.sum(rate[seconds < s])) for s in t - 700.0]
    assert early == pytest.approx(expected, rel=1e-6, abs=1e-15)
    assert early[2] == pytest.approx(2e-4)


def test_a_belt_remembers_all_its_ways_together():
    tau = 2.0
    one = Alone("servo_settling", 1e-5, variant="after_effect", tau_s=tau)
    kernel = []
    for to_m in (1.5, 1.0, 1.01):
        way, begun_s = to_m - one.q[0], one.t_s
        one.move(0, to_m, speed=0.5, rest_s=1.0)
        kernel.append((way, 0.5 * (begun_s + one.t_s - 1.0)))
    one.move(1, 1.4)

    def behind(t_s):
        return 1e-5 * sum(
            way / 0.5 * 0.5 * (math.exp(-(t_s - s) / tau) + math.exp(-(t_s - s) / (6.0 * tau))) for way, s in kernel
        )

    for wait_s in (0.0, 3.0, 20.0):
        assert one.travel_m(t_s=one.t_s + wait_s) == pytest.approx(-behind(one.t_s + wait_s), rel=1e-9)
    assert one.travel_m() > 0.0  # the last way went up, but the one before it is not forgotten
    assert one.travel_m(drive=1) == 0.0


def test_struts_that_grow_late_follow_a_change_since_the_begin():
    one = Alone(
        "expansion_coefficient",
        2e-6,
        variant="late_growth",
        temperatures=Temperatures(lambda t: np.where(t < 600.0, 23.0, 24.5)),
    )
    t = np.array([0.0, 500.0, 600.0 + 2400.0, 30000.0])
    grown = one.deviation(t_s=t, q=np.full((4, 2), HOME_M)).length_m
    expected = 2e-6 * 1.5 * 1.5 * np.array([0.0, 0.0, 1.0 - 1.0 / math.e, 1.0])
    assert grown == pytest.approx(np.outer(expected, np.ones(4)), rel=0.01, abs=1e-12)


def test_liquid_swings_after_a_motion_sideways_and_grows_calm():
    one = Alone("payload", 40.0, variant="sloshing")
    one.move(1, HOME_M + 0.2, speed=0.5, rest_s=0.0)
    one.t_s -= 0.4
    one.move(0, HOME_M - 0.2, speed=0.5, rest_s=0.0)  # at once with the other: to the right at full speed
    stopped_s = one.t_s
    t = stopped_s + np.linspace(0.0, 45.0, 4501)
    d = one.deviation(t_s=t, q=np.full((4501, 2), HOME_M), payload_kg=200.0)
    off = d.payload_shift_m.real
    assert off[0] == pytest.approx(40.0 * 0.5 / 400.0)
    assert not np.any(d.payload_shift_m.imag)
    assert not np.any(d.payload_mass_kg)
    turns = t[np.flatnonzero(np.diff(np.sign(off)))] - stopped_s
    assert np.diff(turns) == pytest.approx(2.25, abs=0.02)
    assert off[450] == pytest.approx(off[0] * math.exp(-4.5 / 15.0))
    assert not np.any(one.deviation(t_s=stopped_s).payload_shift_m)  # nothing is on the platform
    up = Alone("payload", 40.0, variant="sloshing")
    up.move(0, HOME_M + 0.2, rest_s=0.0)
    up.t_s -= 0.4
    up.move(1, HOME_M + 0.2, rest_s=0.0)
    assert up.deviation(payload_kg=200.0).payload_shift_m[0] == pytest.approx(0.0, abs=1e-15)


def test_a_table_is_weighted_by_where_the_other_axis_stands():
    nodes, rows = (0.4, 1.2), ((1e-5,), (3e-5,))
    tables = tuple(KnownTable(1, drive, nodes, rows) for drive in ("left", "right"))
    one = Alone("tables_left_on", 0.5, variant="multiplied")
    one.effect = make(EffectChoice("tables_left_on", 0.5, variant="multiplied"), Site(FILE, STATION_M, 0.0, tables), 1)
    q = [[0.8, LOW_M], [0.8, MIDDLE_M], [0.8, HIGH_M], [1.2, HIGH_M]]
    off = one.deviation(t_s=[0.0] * 4, q=q).travel_m
    assert off[:, 0] == pytest.approx(0.5 * np.array([0.0, 2e-5, 4e-5, 6e-5]), abs=1e-15)
    assert off[0, 1] == pytest.approx(0.5 * 1e-5 * (1.0 + (0.8 - MIDDLE_M) / HALF_M))


def test_a_stepping_motor_loses_steps_where_it_lifts_fast():
    one = Alone("drive_scale", 4e-5, variant="lost_steps")
    for to_m, speed, lost in ((1.3, 0.5, 1), (1.0, 0.5, 1), (1.2, 0.25, 1), (1.21, 0.4, 2), (0.9, 0.1, 2)):
        one.move(0, to_m, speed=speed)
        assert one.travel_m() == pytest.approx(-1e-6 * lost)
    one.move(1, 1.5, speed=0.5)
    assert one.travel_m() == pytest.approx(-2e-6)
    assert one.travel_m(drive=1) == 0.0
    at_ends = one.deviation(t_s=[one.t_s] * 2, q=along([LOW_M, HIGH_M])).travel_m[:, 0]
    assert at_ends[0] == pytest.approx(-2e-6)  # the whole zero, not the scale
