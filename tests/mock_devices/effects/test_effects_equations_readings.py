"""Forms of station, controls and stated values against their publications, at points worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Deviation, Site, StationSight
from mock_devices.effects.catalogue import make
from mock_devices.effects.walks import Flicker
from mock_devices.known_tables import KnownTable
from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, Temperatures, along

LOW_M, HIGH_M = FILE.sliders[0].travel_m
TARGETS = np.array([[0.3, 3.1, 0.2], [-0.8, 3.0, -1.2], [0.0, 2.9, 0.6]])


def test_what_relaxes_in_many_times_drifts_by_the_logarithm_of_time():
    walk = Flicker(np.random.default_rng(5), 600)
    t = 60.0 * np.arange(400)
    values = walk.at(t)
    assert values[0] == pytest.approx(np.zeros(600), abs=1e-12)
    relaxes_s = 60.0 * 4.0 ** np.arange(5)
    for lag in (2, 16, 128):  # what 1/f noise differs by after a time, whenever it begins: the same late and early
        expected = 2.0 * np.mean(1.0 - np.exp(-60.0 * lag / relaxes_s))
        assert np.mean((values[lag] - values[0]) ** 2) == pytest.approx(expected, rel=0.2)
        assert np.mean((values[lag:] - values[:-lag]) ** 2) == pytest.approx(expected, rel=0.1)
    again = Flicker(np.random.default_rng(5), 600)
    assert np.concatenate([again.at(t[k : k + 1]) for k in (390, 3)]) == pytest.approx(values[[390, 3]], abs=1e-12)


def test_a_station_that_flickers_drifts_by_its_size():
    sizes = []
    for seed in range(60):
        one = Alone("tracker_drift", 1e-5, variant="flicker", seed=seed)
        sizes.append(one.distance_off_m(TARGETS[0], 900.0 * np.arange(30)))
    about = np.std(np.array(sizes) - np.mean(sizes, axis=1)[:, None])
    assert 0.6 * 1e-5 / math.sqrt(2.0) < about < 1.1 * 1e-5 / math.sqrt(2.0)  # the slowest are not over by then


def test_cold_comes_up_from_a_floor_as_taylor_says():
    gradient = 10.0
    one = Alone("refraction", gradient, variant="cold_floor")
    eddies = one.effect.eddies
    assert 1e-4 <= eddies <= 6e-4
    distance = np.linalg.norm(TARGETS, axis=-1)
    v = np.arccos(TARGETS[:, 2] / distance)
    for t_s in (900.0, 3600.0):
        seen = StationSight(TARGETS[None].copy(), np.zeros((1, 3)), v[None].copy(), distance[None].copy())
        one.effect.apply_to_sight(one.motion_states(t_s), seen)
        cold_k = gradient * 1.5  # over the station's height of 1.5 m
        share = (np.arange(400) + 0.5) / 400.0
        for k in range(3):

            def air_k(height, t_s=t_s, cold_k=cold_k):
                return -cold_k * np.array([math.erfc(h / math.sqrt(4.0 * eddies * t_s)) for h in height])

            over_floor = 1.5 + share * TARGETS[k, 2]
            slope = (air_k(over_floor + 1e-5) - air_k(over_floor - 1e-5)) / 2e-5
            expected = -distance[k] * np.mean((1.0 - share) * 0.93e-6 * slope * math.sin(v[k]))
            assert seen.v_rad[0, k] - v[k] == pytest.approx(expected, rel=1e-2, abs=1e-9)
    early = StationSight(TARGETS[None].copy(), np.zeros((1, 3)), v[None].copy(), distance[None].copy())
    one.effect.apply_to_sight(one.motion_states(0.0), early)
    assert early.v_rad[0] == pytest.approx(v, abs=1e-12)


def test_a_reflector_upon_a_chip_jumps_between_two_places():
    one = Alone("smr_reseat", 1e-5, variant="chip_in_seat", onset_s=1000.0)
    t = np.arange(0.0, 150000.0, 20.0)
    shift = one.deviation(t_s=t, q=np.full((len(t), 2), HOME_M)).smr_m[:, 0, :2]
    beside = np.linalg.norm(shift, axis=1) / 1e-5
    assert not np.any(beside[t < 1000.0])
    assert beside[t >= 1000.0][0] == pytest.approx(1.0)
    assert set(np.round(beside, 12)) == {0.0, 1.0}
    sides = 2.0 * beside[t >= 1000.0] - 1.0
    for lag in (10, 25):  # Rice: correlation exp(-2 rate lag)
        assert np.mean(sides[lag:] * sides[:-lag]) == pytest.approx(math.exp(-2.0 * 20.0 * lag / 900.0), abs=0.15)


def test_an_axis_gets_a_part_of_the_other_one_s_following_error():
    one = Alone("axis_coupling", 1e-4, variant="cross_coupled")
    one.move(0, 1.4)
    assert one.travel_m() == 0.0  # its own
    one.move(1, 1.4, speed=0.25, rest_s=0.0)
    stopped_s = one.t_s
    for wait_s in (0.0, 3.0, 12.0):
        assert one.travel_m(t_s=stopped_s + wait_s) == pytest.approx(1e-4 * 0.125 * math.exp(-wait_s / 6.0))
    one.move(1, 1.0, speed=0.5, rest_s=6.0)
    assert one.travel_m() == pytest.approx(-1e-4 * 0.25 / math.e)
    assert one.travel_m(drive=1) == 0.0


def test_messages_wait_by_times_spread_as_an_exponential():
    one = Alone("latency", 1e-3, variant="queued", start_s=50.0)
    t = 50.0 + np.sort(np.random.default_rng(1).uniform(0.0, 5000.0, 20000))
    waits = np.asarray(one.effect.early_s(one.motion_states(t, q=np.full((20000, 2), HOME_M))))
    assert waits.max() == pytest.approx(math.log(10.0) * 1e-3, rel=0.01)
    for times in (0.5, 1.0, 2.0):  # share that waits longer, among the nine tenths that wait less than ln 10
        assert np.mean(waits > times * 1e-3) == pytest.approx((math.exp(-times) - 0.1) / 0.9, abs=0.01)
    assert abs(np.corrcoef(waits[1:], waits[:-1])[0, 1]) < 0.1


def test_dry_friction_shortens_swings_and_holds_the_slider_beside_its_target():
    one = Alone("servo_settling", 1e-5, variant="dry_friction", tau_s=2.0)
    one.move(0, 1.3, speed=0.5, rest_s=0.0)
    start_s, step = one.t_s, 1e-4
    place, speed, track = 1.0, 0.0, []
    rate = (math.pi / 2.0) ** 2
    for _ in range(150000):  # x'' = -rate (x + 0.15 sign(x')), at rest where the spring is weaker than friction
        track.append(place)
        side = math.copysign(1.0, speed) if speed else -math.copysign(1.0, place)
        before = speed
        if speed == 0.0 and abs(place) <= 0.15:
            continue
        speed -= step * rate * (place + 0.15 * side)
        if before * speed < 0.0:
            speed = 0.0
        place += step * speed
    for wait_s in (0.0, 1.0, 2.0, 3.3, 4.0, 5.0, 9.0, 14.0):
        assert one.travel_m(t_s=start_s + wait_s) == pytest.approx(-1e-5 * track[round(wait_s / step)], abs=1e-8)
    assert one.travel_m(t_s=start_s + 14.0) == pytest.approx(0.1e-5)


def test_nickel_steel_grows_with_the_square_of_the_temperature_too():
    one = Alone("expansion_coefficient", 1e-6, variant="nickel_steel")
    lengths = []
    for warmer_k in (-2.0, 1.0, 5.0):
        state = one.motion_states()
        state.parts_c["struts"] = np.full(1, 20.0 + warmer_k)
        d = Deviation.none(1, FILE)
        one.effect.act(state, d)
        lengths.append(d.length_m[0] / 1.5e-6)
        assert not np.any(d.travel_m)
    # a t + b t^2 with b = a / 5 K
    assert np.array(lengths) == pytest.approx(np.outer([-2.0 + 0.8, 1.2, 10.0], np.ones(4)))


def test_shot_trickles_evenly_into_the_other_chamber():
    one = Alone("payload", 40.0, variant="hourglass")
    through_s = one.effect.empty_s
    t = np.array([0.0, 0.25, 0.5, 1.0, 1.7]) * through_s
    d = one.deviation(t_s=t, q=np.full((5, 2), HOME_M), payload_kg=200.0)
    assert np.abs(d.payload_shift_m) == pytest.approx(0.05 * np.array([0.0, 0.25, 0.5, 1.0, 1.0]))
    assert not np.any(d.payload_mass_kg)
    assert not np.any(d.force_n)
    assert not np.any(one.deviation(t_s=through_s, payload_kg=0.0).payload_shift_m)


def test_a_table_for_a_warm_machine_is_weighted_by_its_warmth():
    nodes, rows = (0.4, 1.2), ((1e-5,), (3e-5,))
    tables = tuple(KnownTable(1, drive, nodes, rows) for drive in ("left", "right"))
    one = Alone("tables_left_on", 0.5, variant="by_temperature")
    site = Site(FILE, STATION_M, 0.0, tables)
    one.effect = make(EffectChoice("tables_left_on", 0.5, variant="by_temperature"), site, 1)
    state = one.motion_states(t_s=[0.0] * 3, q=along([0.8] * 3))
    state.parts_c["columns"] = np.array([20.0, 21.0, 24.0])
    d = Deviation.none(3, FILE)
    one.effect.act(state, d)
    assert d.travel_m[:, 0] == pytest.approx(0.5 * 2e-5 * np.array([0.0, 0.5, 2.0]))


def test_a_belt_lets_its_zero_sink_with_the_way_made_up_and_down():
    one = Alone("drive_scale", 1e-4, variant="belt_creep", temperatures=Temperatures(lambda t: 20.0 + t))
    assert one.travel_m() == 0.0
    for k in range(20):
        one.move(0, HOME_M + (0.4 if k % 2 == 0 else 0.0))
        one.move(1, HOME_M + 0.01 * k)
    assert one.travel_m() == pytest.approx(-1e-4 * 20 * 0.4 / 100.0)
    assert one.travel_m(drive=1) == 0.0
    one.move(0, HOME_M - 0.3)
    assert one.travel_m() == pytest.approx(-1e-4 * 8.3 / 100.0)
