"""Effects that only a final scoring uses: what their descriptions say, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import OUTSIDE, OUTSIDE_FINAL, SPECS, draw
from mock_devices.effects.base import StationSight
from tests.mock_devices.effects_bench import FILE, HOME_M, Alone, along

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


def test_a_final_scoring_draws_what_the_descriptions_say():
    assert set(OUTSIDE_FINAL) == {"cover_glass", "leaning_block", "spindle_heat", "brake_drop"}
    assert {"circle_error", "lobed_joint", "guide_wear", "gas_spring"} <= set(OUTSIDE)
    rng = np.random.default_rng(1)
    assert {draw(name, FILE, rng, final=True).variant for name in OUTSIDE_FINAL} == {"plain"}
    assert all(len(SPECS[name].variants) == 4 for name in OUTSIDE_FINAL)


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
