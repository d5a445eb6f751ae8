"""Eighth former final forms of station, air and reflectors against publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.mock_devices.effects_bench import Alone, drawn, sight_of

SPOTS = np.array([[[0.2, 3.0, 0.1], [-0.5, 2.8, 0.4]]])


def changed(one, t_s, points=SPOTS, **kinds):
    """What one effect changes of both angles and the range (3, smrs)."""
    seen = sight_of(points)
    before = [x.copy() for x in (seen.hz_rad, seen.v_rad, seen.distance_m)]
    one.effect.apply_to_sight(one.motion_states(t_s, **kinds), seen)
    return np.array([now - then for now, then in zip((seen.hz_rad, seen.v_rad, seen.distance_m), before, strict=True)])[
        :, 0
    ]


def bent_beam(load, at, cells=400):
    """Deflection of a simply supported beam at one place under a force at another, by differences of cell to cell."""
    inner = cells - 1
    second = (np.eye(inner, k=1) + np.eye(inner, k=-1) - 2.0 * np.eye(inner)) * cells**2
    force = np.zeros(inner)
    lower = min(int(load * cells), cells - 1)
    for node, part in ((lower, 1.0 - (load * cells - lower)), (lower + 1, load * cells - lower)):
        if 1 <= node <= inner:
            force[node - 1] += part * cells
    line = np.linalg.solve(second, np.linalg.solve(second, force))
    return float(np.interp(at * cells, np.arange(cells + 1), np.concatenate([[0.0], line, [0.0]])))


def test_a_truck_that_crosses_the_floor_lets_the_station_dip_once():
    truck_s = drawn("tracker_drift", "crossing_truck", "truck_s", low=600.0, high=1500.0)
    crosses_s = drawn("tracker_drift", "crossing_truck", "crosses_s", low=900.0, high=2400.0)
    stands = drawn("tracker_drift", "crossing_truck", "stands", low=0.3, high=0.7)
    one = Alone("tracker_drift", 1e-4, variant="crossing_truck", start_s=60.0)
    weights, most = one.effect.weights, bent_beam(stands, stands)
    for at in (0.05, 0.25, stands, 0.6, 0.9):
        dip = bent_beam(at, stands) / most
        turn, shift = (1e-4 / math.sqrt(2.0) * dip * weights[part] for part in (slice(0, 3), slice(3, 6)))
        moved = SPOTS + np.cross(turn / 3.2, SPOTS) + shift
        hz, _, distance = changed(one, 60.0 + truck_s + at * crosses_s)
        expected_hz = np.arctan2(moved[..., 0], moved[..., 1]) - np.arctan2(SPOTS[..., 0], SPOTS[..., 1])
        expected_m = np.linalg.norm(moved, axis=-1) - np.linalg.norm(SPOTS, axis=-1)
        assert hz == pytest.approx(expected_hz[0], rel=1e-2, abs=2e-9)
        assert distance == pytest.approx(expected_m[0], rel=1e-2, abs=2e-9)
    for after_s in (0.0, truck_s - 1.0, truck_s + crosses_s + 1.0, 9000.0):
        assert changed(one, 60.0 + after_s) == pytest.approx(np.zeros((3, 2)), abs=1e-18)


def test_air_that_payloads_have_warmed_bends_light_by_their_mass():
    aside_rad = drawn("refraction", "warm_workpiece", "aside_rad", low=-0.9, high=0.9)
    one = Alone("refraction", 10.0, variant="warm_workpiece")
    range_m = np.linalg.norm(SPOTS[0], axis=1)
    level = np.hypot(SPOTS[0, :, 0], SPOTS[0, :, 1]) / range_m
    for payload_kg in (0.0, 100.0, 400.0):
        hz, v, distance = changed(one, 500.0, payload_kg=payload_kg)
        # A curve of constant curvature leaves by half of that times the way; the light leans towards the cooler side.
        leaves = 0.5 * 0.93e-6 * 10.0 * payload_kg / 400.0 * range_m
        assert hz == pytest.approx(leaves * math.sin(aside_rad), abs=1e-15)
        assert v == pytest.approx(-leaves * math.cos(aside_rad) * level, abs=1e-15)
        assert not np.any(distance)
        assert np.array_equal(changed(one, 5000.0, payload_kg=payload_kg), [hz, v, distance])


def test_a_cup_slides_as_its_vacuum_leaks_and_then_falls():
    lets_go_s = drawn("smr_reseat", "leaking_cup", "lets_go_s", low=300.0, high=1500.0)
    one = Alone("smr_reseat", 3e-5, place="P2", variant="leaking_cup", onset_s=100.0, start_s=60.0)
    assert not np.any(one.deviation(t_s=159.0).smr_m)
    vacuum, now_s, step, seen = 1.0, 0.0, 0.1, []
    for share in (0.1, 0.3, 0.6, 0.99):
        while now_s < share * lets_go_s - 0.5 * step:
            vacuum, now_s = vacuum - step * vacuum / (0.5 * lets_go_s), now_s + step
        moved = one.deviation(t_s=160.0 + share * lets_go_s).smr_m[0]
        assert not np.any(np.delete(moved, 1, axis=0))
        assert np.linalg.norm(moved[1]) == pytest.approx(3e-5 * 0.3 * (1.0 - vacuum), rel=2e-3)
        seen.append(moved[1])
    for after_s in (lets_go_s + 0.1, 9000.0):
        moved = one.deviation(t_s=160.0 + after_s).smr_m[0, 1]
        assert np.linalg.norm(moved) == pytest.approx(3e-5)
        assert moved / np.linalg.norm(moved) == pytest.approx(seen[0] / np.linalg.norm(seen[0]))
