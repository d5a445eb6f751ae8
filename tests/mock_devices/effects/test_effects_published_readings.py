"""Further forms of station, controls and stated values against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Deviation, Site, StationSight
from mock_devices.effects.catalogue import make
from mock_devices.effects.walks import HeldWalk
from mock_devices.known_tables import KnownTable
from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, Temperatures, along

LOW_M, HIGH_M = FILE.sliders[0].travel_m
MIDDLE_M = 0.5 * (LOW_M + HIGH_M)
TARGETS = np.array([[0.3, 3.1, 0.2], [-0.8, 3.0, -1.2], [0.0, 2.9, 0.6]])


def test_a_walk_that_is_held_back_forgets_in_its_time_constant():
    walk = HeldWalk(np.random.default_rng(5), 400)
    t = 60.0 * np.arange(120)
    values = walk.at(t)
    assert not np.any(values[0])
    # Uhlenbeck and Ornstein: variance 1 - exp(-2 t / T), correlation exp(-dt / T).
    assert np.var(values, axis=1)[[5, 15, 60]] == pytest.approx(1.0 - np.exp(-2.0 * t[[5, 15, 60]] / 900.0), abs=0.12)
    late = values[60:]
    ratio = np.sum(late[15:] * late[:-15]) / np.sum(late[:-15] ** 2)
    assert ratio == pytest.approx(math.exp(-1.0), abs=0.03)
    again = HeldWalk(np.random.default_rng(5), 400)
    assert np.array_equal(np.concatenate([again.at(t[k : k + 1]) for k in (3, 90)]), values[[3, 90]])


def test_a_station_that_is_held_back_drifts_by_its_size_and_no_further():
    sizes = []
    for seed in range(40):
        one = Alone("tracker_drift", 1e-5, variant="held_back", seed=seed)
        sizes.append(one.distance_off_m(TARGETS[0], 3600.0 + 900.0 * np.arange(40)))
    assert np.std(sizes) == pytest.approx(1e-5 / math.sqrt(2.0), rel=0.1)  # a shift has half of the variance


def test_light_is_bent_in_the_layer_between_cool_and_warm_air():
    gradient = 10.0
    one = Alone("refraction", gradient, variant="two_layers")
    distance = np.linalg.norm(TARGETS, axis=-1)
    v = np.arccos(TARGETS[:, 2] / distance)
    seen = StationSight(TARGETS[None].copy(), np.zeros((1, 3)), v[None].copy(), distance[None].copy())
    one.effect.apply_to_sight(one.motion_states(), seen)
    share = (np.arange(4000) + 0.5) / 4000.0
    for k in range(3):
        height = share * TARGETS[k, 2]
        warm_k = gradient * 0.2 * np.tanh((height + 1e-6 - 0.25) / 0.2)  # the profile, with that slope in its middle
        cool_k = gradient * 0.2 * np.tanh((height - 1e-6 - 0.25) / 0.2)
        curvature = 0.93e-6 * (warm_k - cool_k) / 2e-6 * math.sin(v[k])
        expected = -distance[k] * np.mean((1.0 - share) * curvature)
        assert seen.v_rad[0, k] - v[k] == pytest.approx(expected, rel=1e-3)
    assert abs(seen.v_rad[0, 1] - v[1]) < 0.2 * abs(seen.v_rad[0, 2] - v[2])  # below the layer light goes straight


def test_tape_gives_at_once_and_creeps_with_a_power_of_time():
    one = Alone("smr_reseat", 1e-5, variant="adhesive_tape", onset_s=100.0)
    t = [99.0, 100.0, 100.0 + 3600.0 / 16.0, 3700.0, 100.0 + 16 * 3600.0]
    d = one.deviation(t_s=t, q=np.full((5, 2), HOME_M))
    gone = np.linalg.norm(d.smr_m[:, 0, :2], axis=1) / 1e-5
    assert gone == pytest.approx([0.0, 0.2, 0.2 + 0.8 / 2.0, 1.0, 0.2 + 0.8 * 2.0])
    assert not np.any(d.smr_m[:, 1:])


def test_a_bed_on_soft_ground_dips_under_the_other_axis():
    one = Alone("axis_coupling", 1e-5, variant="elastic_bed")
    away = np.array([0.0, 0.25, 0.75, 1.0]) * math.pi / 3.0  # Hetenyi: zero at 3/4 pi, lowest lift at pi
    own = MIDDLE_M - 0.6
    d = one.deviation(t_s=[0.0] * 4, q=np.stack([np.full(4, own), own + away], axis=1)).travel_m
    expected = [1.0, math.exp(-0.25 * math.pi) * math.sqrt(2.0), 0.0, -math.exp(-math.pi)]
    assert d[:, 0] == pytest.approx(-0.25e-5 * np.array(expected), abs=1e-14)
    other = one.deviation(q=[[own + 0.25, own]]).travel_m[0, 0]
    assert other == pytest.approx(one.deviation(q=[[own, own + 0.25]]).travel_m[0, 0])
    assert not np.any(d[:, 1])


def test_clocks_run_apart_until_the_next_message():
    one = Alone("latency", 1e-3, variant="clock_skew", start_s=50.0)
    t = 50.0 + np.array([0.0, 512.0, 1023.0, 1025.0, 1024.0 * 3.25])
    early = one.effect.early_s(one.motion_states(t, q=np.full((5, 2), HOME_M)))
    assert early == pytest.approx(1e-3 * np.array([0.0, 0.5, 1023.0 / 1024.0, 1.0 / 1024.0, 0.25]))


def test_a_loop_with_damping_one_comes_to_rest():
    one = Alone("servo_settling", 1e-5, variant="critically_damped", tau_s=4.0)
    one.move(0, 1.3, speed=0.25, rest_s=0.0)
    start_s = one.t_s
    t, step = np.arange(0.0, 20.0, 1e-3), 1e-3
    place, speed, track = 1.0, 0.0, []
    for _ in t:  # x'' + 2 x' / tau + x / tau^2 = 0
        track.append(place)
        speed += step * (-2.0 * speed / 4.0 - place / 16.0)
        place += step * speed
    for wait_s in (0.0, 1.0, 4.0, 15.0):
        expected = -0.5e-5 * track[round(wait_s / step)]
        assert one.travel_m(t_s=start_s + wait_s) == pytest.approx(expected, rel=2e-3)


def test_a_frame_of_fibres_grows_across_them_alone():
    one = Alone("expansion_coefficient", 1e-5, variant="fibres")
    state = one.motion_states(q=[[0.8, 1.4]])
    state.parts_c["base"], state.parts_c["columns"] = np.full(1, 23.0), np.full(1, 22.0)
    d = Deviation.none(1, FILE)
    one.effect.act(state, d)
    across = one.effect.across
    tensor = 1e-5 * np.outer([across.real, across.imag], [across.real, across.imag])
    for a, (side, q) in enumerate(((-1.2, 0.8), (1.2, 1.4))):
        grown = 3.0 * tensor @ np.array([side, 0.0])  # from the origin to the middle of the joints
        along_axis = 2.0 * tensor[1, 1] * q  # the column, along its axis
        assert d.sideways_m[0, a] == pytest.approx(-grown[0])
        assert d.travel_m[0, a] == pytest.approx(grown[1] + along_axis)
    upper = 3.0 * tensor @ np.array([0.0, 0.125])
    assert d.base_joint_m[0, 0] == pytest.approx(complex(*upper))


def test_a_leaking_block_runs_empty_as_torricelli_says():
    one = Alone("payload", 40.0, variant="draining")
    empty_s = one.effect.empty_s
    height, step = 1.0, empty_s / 20000.0
    for _ in range(10000):  # dh/dt goes with the root of h; empty after empty_s
        height -= step * 2.0 / empty_s * math.sqrt(height)
    t = [0.0, 0.5 * empty_s, 0.9 * empty_s, 1.5 * empty_s]
    d = one.deviation(t_s=t, q=np.full((4, 2), HOME_M), payload_kg=200.0)
    assert d.payload_mass_kg == pytest.approx([40.0, 40.0 * height, 0.4, 0.0], rel=1e-3)
    assert d.force_n[:, 0] == pytest.approx(0.5 * 9.80665 * d.payload_mass_kg)
    assert not np.any(one.deviation(payload_kg=0.0).payload_mass_kg)


def test_a_table_without_interpolation_is_held_from_node_to_node():
    nodes = (0.4, 0.7, 1.0, 1.3)
    rows = tuple((1e-5 * i,) for i in range(1, 5))
    tables = tuple(KnownTable(1, drive, nodes, rows) for drive in ("left", "right"))
    one = Alone("tables_left_on", 1.0, variant="pulses")
    one.effect = make(EffectChoice("tables_left_on", 1.0, variant="pulses"), Site(FILE, STATION_M, 0.0, tables), 1)
    at = [0.35, 0.4, 0.69, 0.7, 1.29, 1.6]
    d = one.deviation(t_s=[0.0] * 6, q=along(at))
    assert d.travel_m[:, 0] == pytest.approx(1e-5 * np.array([1.0, 1.0, 1.0, 2.0, 3.0, 4.0]))


def test_a_table_of_two_axes_is_held_over_both():
    nodes = (0.4, 0.7, 1.0, 1.3)
    rows = tuple(tuple(1e-5 * (i + 10 * j) for j in range(4)) for i in range(4))
    tables = tuple(KnownTable(1, d, nodes, rows, p, nodes) for d, p in (("left", "right"), ("right", "left")))
    one = Alone("tables_left_on", 1.0, variant="pulses")
    one.effect = make(EffectChoice("tables_left_on", 1.0, variant="pulses"), Site(FILE, STATION_M, 0.0, tables), 1)
    assert one.deviation(q=[[0.9, 1.2]]).travel_m[0] == pytest.approx([1e-5 * 21.0, 1e-5 * 12.0])


def test_the_scale_of_an_interferometer_follows_the_air():
    swing = Temperatures(lambda t: 20.0 + 2.0 * t / 3600.0)
    swing.pressure_series_hpa = lambda t: 1000.0 + np.asarray(t) / 3600.0
    one = Alone("drive_scale", 1e-5, variant="wavelength", temperatures=swing)
    d = one.deviation(t_s=[0.0, 3600.0, 3600.0, 3600.0], q=along([HIGH_M, HIGH_M, MIDDLE_M, LOW_M])).travel_m[:, 0]
    kelvin = 2.0 - 0.27 / 0.93  # 2 K warmer; one hPa more has the effect of being colder
    assert d == pytest.approx(1e-5 * kelvin * np.array([0.0, 1.0, 0.5, 0.0]), abs=1e-13)
