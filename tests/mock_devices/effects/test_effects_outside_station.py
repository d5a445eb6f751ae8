"""Effects outside the catalogue in the station: what their descriptions say, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, sight_of

SPOTS = np.array([[-0.5, 3.0, -0.4], [0.0, 3.0, 0.0], [0.6, 2.9, 0.5]])


def read(one, exchanges=0.0, points=SPOTS):
    """What one effect changes of both angles and the range (smrs,)."""
    seen = sight_of(points[None])
    before = [x.copy() for x in (seen.hz_rad, seen.v_rad, seen.distance_m)]
    one.effect.apply_to_sight(one.motion_states(0.0, exchanges=exchanges), seen)
    return [(now - then)[0] for now, then in zip((seen.hz_rad, seen.v_rad, seen.distance_m), before, strict=True)]


def test_every_loss_of_the_beam_moves_all_ranges_alike():
    one = Alone("reference_range", 3e-5)
    offsets = []
    for exchanges in range(6):
        hz, v, off = read(one, float(exchanges))
        assert not np.any(hz)
        assert not np.any(v)
        assert off == pytest.approx(np.full(3, off[0]), abs=1e-15)
        offsets.append(float(off[0]))
    assert abs(offsets[0]) == pytest.approx(3e-5)
    assert np.abs(offsets).max() <= 3e-5 + 1e-12
    assert np.diff(np.sort(offsets)).min() > 1e-9
    assert float(read(one, 3.0)[2][0]) == pytest.approx(offsets[3])


def test_an_eccentric_circle_errs_once_a_turn_and_an_oval_one_twice():
    one = Alone("circle_eccentricity", 1e-4)
    turn = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
    level = np.stack([3.0 * np.sin(turn), 3.0 * np.cos(turn), np.zeros(64)], axis=1)
    hz, _, distance = read(one, points=level)
    whole = np.abs(np.fft.rfft(hz)) / 32.0
    assert whole[1:4] == pytest.approx([1e-4, 0.4e-4, 0.0], abs=1e-10)
    assert not np.any(distance)
    up = np.linspace(0.2, 2.9, 50)  # one direction, from the zenith down
    _, v, _ = read(one, points=np.stack([np.zeros(50), 3.0 * np.sin(up), 3.0 * np.cos(up)], axis=1))
    terms = np.stack([np.sin(up), np.cos(up), np.sin(2.0 * up), np.cos(2.0 * up)], axis=1)
    found, left, *_ = np.linalg.lstsq(terms, v, rcond=None)
    assert float(left[0]) < 1e-18
    assert [math.hypot(*found[:2]), math.hypot(*found[2:])] == pytest.approx([1e-4, 0.4e-4])


def test_a_tilted_axis_aims_beside_what_is_above_or_below_it():
    one = Alone("tilted_axis", 2e-4)
    beam = one.effect.beam
    assert 0.3 <= abs(beam) <= 0.8
    hz, v, distance = read(one)
    assert not np.any(v)
    assert not np.any(distance)
    for off, spot in zip(hz, SPOTS, strict=True):  # the beam's line, turned about the transit axis that leans by 2e-4
        level = math.hypot(spot[0], spot[1])
        whole = math.hypot(level, spot[2])
        assert off == pytest.approx(2e-4 * (spot[2] / level + beam * whole / level))
    assert hz[1] == pytest.approx(2e-4 * beam)


def test_a_stray_reflex_errs_periodically_with_the_range():
    one = Alone("cyclic_range", 2e-5)
    unit_m = one.effect.unit_m
    assert 0.03 <= unit_m <= 0.12
    ranges = 3.0 + np.linspace(0.0, 4.0 * unit_m, 400, endpoint=False)
    for ahead in (np.array([0.0, 1.0, 0.0]), np.array([0.6, 0.64, 0.48])):  # the same in every direction
        seen = sight_of((ranges[:, None] * ahead)[None])
        hz, v, distance = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
        one.effect.apply_to_sight(one.motion_states(0.0), seen)
        assert np.array_equal(seen.hz_rad, hz)
        assert np.array_equal(seen.v_rad, v)
        spectrum = np.abs(np.fft.rfft((seen.distance_m - distance)[0])) / 200.0
        assert spectrum[4] == pytest.approx(2e-5)
        assert np.delete(spectrum, 4).max() < 1e-12


def test_angles_go_in_steps_where_the_last_bits_are_stuck():
    one = Alone("stuck_bits", 3e-5)
    points = np.random.default_rng(3).uniform([-1.0, 2.5, -1.0], [1.0, 3.5, 1.0], (200, 2, 3))
    seen = sight_of(points)
    hz, v, distance = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
    one.effect.apply_to_sight(one.motion_states(np.zeros(200), q=np.full((200, 2), HOME_M)), seen)
    assert np.array_equal(seen.distance_m, distance)
    for read, true in ((seen.hz_rad, hz), (seen.v_rad, v)):
        steps = read / 3e-5 - 0.5
        assert steps == pytest.approx(np.round(steps), abs=1e-6)
        assert np.abs(read - true).max() <= 1.5e-5 + 1e-15
        assert np.std(read - true) == pytest.approx(3e-5 / math.sqrt(12.0), rel=0.1)
    still = sight_of(points)
    Alone("stuck_bits", 0.0).effect.apply_to_sight(one.motion_states(np.zeros(200), q=np.full((200, 2), HOME_M)), still)
    assert np.array_equal(still.hz_rad, hz)


def test_ranges_jump_where_the_gain_is_switched():
    one = Alone("switched_gain", 5e-5)
    (left_m, right_m), (bottom_m, top_m) = FILE.workspace_m
    switches_m = one.effect.switches_m
    assert Alone("switched_gain", 5e-5, seed=2).effect.switches_m != switches_m
    before_m = np.mean([smr.position_m[2] for smr in FILE.smrs if smr.on == "platform"])
    ahead = np.array([0.5 * (left_m + right_m), 0.5 * (bottom_m + top_m), before_m]) - STATION_M
    beside_m = math.sqrt(switches_m**2 - float(ahead @ ahead))
    assert 0.35 <= beside_m / (0.5 * math.hypot(right_m - left_m, top_m - bottom_m)) <= 0.75
    ranges = switches_m + np.array([-0.3, -1e-6, 1e-6, 0.05, 0.2, 0.6])
    seen = sight_of(np.stack([0.1 * ranges, 0.9 * ranges, math.sqrt(0.18) * ranges], axis=1)[None])
    hz, v, before = seen.hz_rad.copy(), seen.v_rad.copy(), seen.distance_m.copy()
    one.effect.apply_to_sight(one.motion_states(500.0), seen)
    step = [0.0, 0.0, 1.0, math.exp(-0.05 / 0.25), math.exp(-0.2 / 0.25), math.exp(-0.6 / 0.25)]
    assert (seen.distance_m - before)[0] == pytest.approx(5e-5 * np.array(step), rel=1e-5, abs=1e-14)
    assert np.array_equal(seen.hz_rad, hz)
    assert np.array_equal(seen.v_rad, v)
