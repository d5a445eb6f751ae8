"""Effects outside the catalogue in machine and station: what their descriptions say, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects.base import StationSight
from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M, HALF_M = 0.5 * (LOW_M + HIGH_M), 0.5 * (HIGH_M - LOW_M)
TARGETS = np.array([[0.3, 3.1, 0.2], [-0.8, 3.0, -1.2], [0.0, 2.9, 0.6]])
NAMES = [smr.name for smr in FILE.smrs]


def sight_at(points_m):
    distance = np.linalg.norm(points_m, axis=-1)
    hz = np.arctan2(points_m[..., 0], points_m[..., 1])
    return StationSight(points_m.copy(), hz, np.arccos(points_m[..., 2] / distance), distance)


def seen_at(sight):
    """Where the station believes the points to be."""
    level = sight.distance_m * np.sin(sight.v_rad)
    up = sight.distance_m * np.cos(sight.v_rad)
    return np.stack([level * np.sin(sight.hz_rad), level * np.cos(sight.hz_rad), up], axis=-1)


def test_heads_around_a_circle_leave_the_orders_of_their_number():
    one = Alone("circle_error", 1e-5)
    n = 720
    angle = 2.0 * np.pi * np.arange(n) / n
    seen = StationSight(np.zeros((n, 1, 3)), angle[:, None].copy(), angle[:, None].copy(), np.ones((n, 1)))
    one.effect.apply_to_sight(one.motion_states(np.zeros(n), q=np.full((n, 2), HOME_M)), seen)
    for error in (seen.hz_rad[:, 0] - angle, seen.v_rad[:, 0] - angle):
        orders = np.abs(np.fft.rfft(error)) / (n / 2)
        assert orders[[4, 8, 12, 16]] == pytest.approx([0.25e-5] * 4)
        orders[[4, 8, 12, 16]] = 0.0
        assert orders.max() < 1e-12
    assert np.all(seen.distance_m == 1.0)


def test_a_lobed_ball_lengthens_its_strut_five_times_a_turn():
    one = Alone("lobed_joint", 1e-5, place=FILE.struts[2].name)
    turn = np.array([0.0, 2.0 * np.pi / 15.0, np.pi / 5.0])[:, None] * 0.5  # within what the strut can swing
    swing = np.concatenate([turn[:, 0], -turn[1:, 0]])
    d = one.deviation(t_s=np.zeros(5), q=along(MIDDLE_M + 1.5 * np.sin(swing), drive=1))
    assert d.length_m[:, 2] == pytest.approx(1e-5 * np.cos(5.0 * swing + one.effect.phase))
    assert not np.any(d.length_m[:, [0, 1, 3]])
    # From one lobe to the valley beside it is a tenth of a turn.
    q = MIDDLE_M + 1.5 * np.sin(np.array([-0.1, np.pi / 5.0 - 0.1]))
    there = one.deviation(t_s=np.zeros(2), q=along(q, drive=1)).length_m[:, 2]
    assert there[1] == pytest.approx(-there[0])


def test_a_lining_wears_with_the_way_and_the_pressure():
    one = Alone("guide_wear", 1e-5)
    assert not np.any(one.deviation().sideways_m)
    for k in range(10):
        one.move(0, HOME_M + (0.5 if k % 2 == 0 else 0.0))
    one.move(1, 0.5)  # the other drive's way wears nothing here
    d = one.deviation(t_s=[one.t_s] * 2, q=along([HOME_M, HIGH_M])).sideways_m[:, 0]
    pressed = np.exp(-2.0 * (np.array([HOME_M, HIGH_M]) - MIDDLE_M) ** 2 / HALF_M**2)
    ways = np.array([5.0, 4.5 + HIGH_M - HOME_M - 0.5])  # the last leg came down by half a metre
    assert d == pytest.approx(-1e-5 * ways / 100.0 * pressed)
    assert pressed[1] == pytest.approx(math.exp(-2.0))


def test_a_gas_spring_keeps_pressure_times_a_power_of_its_volume():
    one = Alone("gas_spring", 1000.0)
    at = np.array([LOW_M, MIDDLE_M, HIGH_M])
    (point, force), *others = one.deviation(t_s=np.zeros(3), q=np.stack([at, at], axis=1)).loads
    assert not others
    assert not np.any(point)
    assert not np.any(force.real)
    lifts = force.imag
    middle = 1000.0 / 0.8**1.3  # of the extended spring's volume four fifths are left
    assert lifts + middle == pytest.approx([1000.0 / 0.6**1.3, middle, 1000.0])
    assert lifts[0] > 0.0 > lifts[2]  # pressed together it lifts more
    mixed = one.deviation(q=[[LOW_M, HIGH_M]]).loads[0][1]
    assert mixed[0] == pytest.approx(0.0, abs=1e-9)


def test_a_pane_shifts_what_is_seen_askew():
    one = Alone("cover_glass", 2e-3, place="P2")
    points = np.tile([0.1, 3.0, 0.1], (3, len(NAMES), 1))
    points[:, NAMES.index("P2")] = TARGETS
    sight = sight_at(points)
    before = seen_at(sight)
    one.effect.apply_to_sight(one.motion_states([0.0] * 3, q=np.full((3, 2), HOME_M)), sight)
    moved = seen_at(sight) - before
    assert np.delete(moved, NAMES.index("P2"), axis=1) == pytest.approx(0.0, abs=1e-12)
    for k, target in enumerate(TARGETS):  # the ray by Snell: in along the line, through the pane, out in parallel
        line = target / np.linalg.norm(target)
        across = np.array([line[0], 0.0, line[2]])
        side = across / np.linalg.norm(across)
        inside = math.asin(np.linalg.norm(across) / 1.515)
        through = 2e-3 * (np.array([0.0, 1.0, 0.0]) + math.tan(inside) * side)
        without = 2e-3 / line[1] * line
        parallel = through - without  # of the ray behind the pane against the one without it
        parallel -= line * (line @ parallel)
        # The reflector is met by a ray that began further off by that shift, so that it seems to lie the other way.
        assert moved[k, NAMES.index("P2")] == pytest.approx(-parallel, abs=2e-8)


def test_a_block_leans_by_the_moment_of_what_stands_on_it():
    one = Alone("leaning_block", 1e-5)
    q = np.array([[1.1, 1.1], [1.55, 1.1], [1.1, 1.55]])
    turned = {}
    for payload_kg in (0.0, 150.0):
        sight = sight_at(np.repeat(TARGETS[None], 3, axis=0))
        before = seen_at(sight)
        one.effect.apply_to_sight(one.motion_states([0.0] * 3, q=q, payload_kg=payload_kg), sight)
        turned[payload_kg] = seen_at(sight) - before
    # Half way to the edge; twice the weight, twice the moment. About the second axis (e, h) goes on by (a h, -a e).
    angle = 0.5e-5
    expected = angle * np.stack([TARGETS[:, 2], np.zeros(3), -TARGETS[:, 0]], axis=1)
    assert turned[0.0][0] == pytest.approx(np.zeros((3, 3)), abs=1e-14)
    assert turned[0.0][1] == pytest.approx(expected, abs=1e-10)
    assert turned[0.0][2] == pytest.approx(-expected, abs=1e-10)
    assert turned[150.0][1] == pytest.approx(2.0 * expected, abs=1e-10)


def test_a_spindle_that_runs_now_and_then_warms_the_platform():
    one = Alone("spindle_heat", 10.0)
    switched = [0.0, *one.effect.moments_s]
    assert len(switched) > 6
    warm, step, track = 0.0, 0.5, []
    for k in range(12000):
        track.append(warm)
        running = int(np.searchsorted(switched, (k + 0.5) * step)) % 2 == 1
        warm += step / 1200.0 * (float(running) - warm)
    t = np.array([0.0, 300.0, 1000.0, 2500.0, 5900.0])
    d = one.deviation(t_s=t, q=np.full((5, 2), HOME_M))
    strain = 11.5e-6 * 10.0 * np.array([track[int(2 * x)] for x in t])
    assert d.platform_joint_m[:, 2] == pytest.approx(strain * complex(0.2, 0.125), abs=1e-8)
    p1 = NAMES.index("P1")
    assert d.smr_m[:, p1] == pytest.approx(np.outer(strain, [-0.2, -0.12, 0.1]), abs=1e-8)
    assert not np.any(d.smr_m[:, [NAMES.index("SL"), NAMES.index("N1")]])
    assert len(np.flatnonzero(np.diff(np.sign(np.diff(track))))) >= 4  # warms and cools


def test_an_axis_drops_once_its_brake_is_closed_from_whichever_side_it_came():
    one = Alone("brake_drop", 1e-5)
    for target in (HOME_M + 0.1, HOME_M):
        one.move(0, target, rest_s=0.0)
        dropped = [one.travel_m(t_s=one.t_s + dwell) for dwell in (0.0, 5.9, 8.5, 11.0, 40.0)]
        assert dropped == pytest.approx([0.0, 0.0, -0.5e-5, -1e-5, -1e-5], abs=1e-12)
        one.t_s += 40.0
    assert not np.any(one.deviation(t_s=[one.t_s], q=along([HOME_M])).travel_m[:, 1])
