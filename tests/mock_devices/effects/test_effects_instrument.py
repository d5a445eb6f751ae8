"""What the station sees: bent light against ray tracing, drift as a random walk, reflectors, latency."""

from __future__ import annotations

import numpy as np
import pytest

from mock_devices.effects import EffectChoice
from mock_devices.effects.base import Site, StationSight
from mock_devices.effects.catalogue import make
from mock_devices.effects.instrument import move_station
from mock_devices.effects.walks import RandomWalk
from mock_devices.recordings.maker import points
from tests.mock_devices.effects_bench import FILE, HOME_M, STATION_M, Alone, Temperatures, bench

TARGETS = np.array([[0.3, 3.1, 0.2], [-0.8, 3.0, -1.2], [0.0, 2.9, 0.6]])


def sight_of(points_m):
    distance = np.linalg.norm(points_m, axis=-1)
    return StationSight(
        points_m.copy(),
        np.arctan2(points_m[..., 0], points_m[..., 1]),
        np.arccos(points_m[..., 2] / distance),
        distance,
    )


def test_bent_light_arrives_under_the_angle_that_ray_tracing_gives():
    gradient = 6.0
    one = Alone("refraction", gradient)
    s = sight_of(TARGETS[None])
    before = s.v_rad.copy()
    one.effect.apply_to_sight(one.motion_states(), s)
    for k, target in enumerate(TARGETS):
        level, height = np.hypot(target[0], target[1]), target[2]
        low, high = np.arctan2(height, level) - 1e-3, np.arctan2(height, level) + 1e-3
        for _ in range(45):  # shoot at the target until the ray meets it
            slope = 0.5 * (low + high)
            low, high = (slope, high) if _ray_height(slope, level, gradient) < height else (low, slope)
        expected = 0.5 * np.pi - 0.5 * (low + high)
        assert s.v_rad[0, k] - before[0, k] == pytest.approx(expected - before[0, k], rel=0.02, abs=1e-10)
    assert np.all(s.v_rad < before)  # warm above: everything seems higher


def test_ranges_with_a_wrong_index_are_scaled_and_follow_the_weather():
    swing = Temperatures(lambda t: 20.0 + 2.0 * t / 3600.0)
    moments = np.array([0.0, 1800.0, 3600.0])
    per_k = -0.93e-6 * 10.0
    expected_k = {"index_offset": [1.0] * 3, "index_fixed": [0.0, 1.0, 2.0], "index_late": [0.0, 1.0, 2.0 / 3.0]}
    for variant, kelvin in expected_k.items():
        one = Alone("refraction", 10.0, variant=variant, temperatures=swing)
        s = sight_of(np.repeat(TARGETS[None], 3, axis=0))
        before, angles = s.distance_m.copy(), s.v_rad.copy()
        one.effect.apply_to_sight(one.motion_states(moments, q=np.full((3, 2), HOME_M)), s)
        for k in range(3):
            assert s.distance_m[:, k] / before[:, k] - 1.0 == pytest.approx(per_k * np.array(kelvin), abs=1e-12)
        assert np.array_equal(s.v_rad, angles)  # light that is late is not bent


def test_light_over_a_floor_is_bent_by_the_power_law_of_the_profile():
    air_k, gradient = 2.0, 6.0
    one = Alone("refraction", gradient, variant="power_law", temperatures=Temperatures(lambda t: np.full_like(t, 20.0)))
    state = one.motion_states()
    state.parts_c["base"] = np.full(1, 20.0 - air_k)
    s = sight_of(TARGETS[None])
    before = s.v_rad.copy()
    one.effect.apply_to_sight(state, s)
    share = (np.arange(4000) + 0.5) / 4000.0
    for k, (east, north, up) in enumerate(TARGETS):
        distance = np.sqrt(east**2 + north**2 + up**2)
        over_floor = (1.5 + share * up) / 1.5  # the station stands 1.5 m over the floor
        curvature = 0.93e-6 * air_k * gradient * over_floor ** (-4.0 / 3.0) * np.hypot(east, north) / distance
        expected = -distance * np.mean((1.0 - share) * curvature)
        assert s.v_rad[0, k] - before[0, k] == pytest.approx(expected, rel=0.05)


def _ray_height(elevation, level, gradient, steps=400):
    """Height at which a ray arrives: d(n cos e)/ds = 0 in layers, n = 1.00027 - 0.93e-6 gradient h."""
    h, dx = 0.0, level / steps
    invariant = (1.00027) * np.cos(elevation)
    sign = 1.0
    angle = elevation
    for _ in range(steps):
        middle = h + 0.5 * dx * np.tan(angle)
        n = 1.00027 - 0.93e-6 * gradient * middle
        cosine = min(invariant / n, 1.0)
        sign = np.sign(angle) or sign
        angle = sign * np.arccos(cosine)
        h += dx * np.tan(angle)
    return h


def test_drift_is_a_random_walk_however_it_is_asked():
    ends, halves = [], []
    for seed in range(400):
        walk = RandomWalk(np.random.default_rng(seed), 2)
        ends.append(walk.at(np.array([3600.0]))[0])
        halves.append(walk.at(np.array([900.0]))[0])
    assert np.std(ends) == pytest.approx(1.0, rel=0.1)
    assert np.std(halves) == pytest.approx(0.5, rel=0.1)
    assert np.std(np.array(ends) - halves) == pytest.approx(np.sqrt(0.75), rel=0.1)
    one, other = (RandomWalk(np.random.default_rng(5), 3) for _ in range(2))
    times = np.array([30.0, 40000.0, 777.0])
    there = np.array([other.at(np.array([t]))[0] for t in times[[1, 2, 0]]])
    assert one.at(times)[[1, 2, 0]] == pytest.approx(there, abs=1e-12)


def test_a_station_that_moves_sees_what_geometry_says():
    s = sight_of(TARGETS[None])
    turn, shift = np.array([[2e-5, -1e-5, 3e-5]]), np.array([[4e-5, 1e-5, -2e-5]])
    move_station(s, turn, shift)
    moved = TARGETS + np.cross(turn[0], TARGETS) + shift[0]
    expected = sight_of(moved)
    assert s.hz_rad[0] == pytest.approx(expected.hz_rad, abs=3e-9)
    assert s.v_rad[0] == pytest.approx(expected.v_rad, abs=3e-9)
    assert s.distance_m[0] == pytest.approx(expected.distance_m, abs=3e-9)


def test_drift_has_its_size_after_one_hour():
    sizes = []
    for seed in range(60):
        choice = EffectChoice("tracker_drift", 4e-5, seed=seed)
        effect = make(choice, Site(FILE, STATION_M), 1)
        one = Alone("tracker_drift", 4e-5)
        s = sight_of(np.array([[[0.0, 3.2, 0.0]]]))
        effect.apply_to_sight(one.motion_states(t_s=3600.0), s)
        sizes += [s.hz_rad[0, 0] * 3.2, (0.5 * np.pi - s.v_rad[0, 0]) * 3.2]
    assert np.sqrt(np.mean(np.square(sizes))) == pytest.approx(4e-5 / np.sqrt(2.0), rel=0.25)


def test_only_the_reseated_reflector_moves_and_only_after_its_time():
    one = Alone("smr_reseat", 2e-5, place="P2", onset_s=1000.0)
    d = one.deviation(t_s=[10.0, 999.0, 1001.0, 9000.0])
    moved = np.linalg.norm(d.smr_m, axis=2)
    assert moved[:, 1] == pytest.approx([0.0, 0.0, 2e-5, 2e-5])
    assert not np.any(np.delete(moved, 1, axis=1))
    exchanged = Alone("smr_reseat", 2e-5, variant="each_exchange")
    places = [tuple(exchanged.deviation(t_s=1.0, exchanges=float(k)).smr_m[0, 0]) for k in range(4)]
    assert places[0] == (0.0, 0.0, 0.0)
    assert len(set(places)) == 4


def test_latency_shows_the_way_made_meanwhile():
    flying = bench(visits=6, fly_share=1.0)
    site = Site(flying.nominal, STATION_M, flying.start_s)
    latency_s = 5e-4

    def seen(*choices):
        return flying.points_m([make(choice, site, 1) for choice in choices]) @ flying.view.rotation

    on_slider = np.array([smr.on == "left" for smr in flying.nominal.smrs])[flying.timeline.smr]
    moved = (seen(EffectChoice("latency", latency_s)) - seen())[on_slider]
    assert moved[:, 1] == pytest.approx(flying.timeline.velocity_m_per_s[on_slider, 0] * latency_s, abs=2e-8)
    standing = bench(visits=6)
    site = Site(standing.nominal, STATION_M, standing.start_s)
    late = standing.points_m([make(EffectChoice("latency", latency_s), site, 1)])
    assert np.array_equal(late, standing.points_m([]))


def test_a_filter_in_the_tracking_still_lags_after_the_stop():
    one = Alone("latency", 0.8, variant="filtering")
    one.move(1, HOME_M + 0.2, speed=0.25)
    arrived = one.history.legs(1)[-1].end_s
    for t in (0.5, 2.0):
        assert one.travel_m(drive=1, t_s=arrived + t) == pytest.approx(-0.25 * 0.8 * np.exp(-t / 0.8))


def test_air_that_warms_moves_a_station_that_follows_it():
    warming = Temperatures(lambda t: 20.0 + t / 3600.0)
    one = Alone("tracker_drift", 4e-5, variant="with_air", temperatures=warming)
    changes = []
    for t in (1800.0, 3600.0):
        s = sight_of(TARGETS[None])
        before = points(s.hz_rad[0], s.v_rad[0], s.distance_m[0])
        one.effect.apply_to_sight(one.motion_states(t_s=t), s)
        changes.append(np.linalg.norm(points(s.hz_rad[0], s.v_rad[0], s.distance_m[0]) - before))
    assert changes[1] == pytest.approx(2.0 * changes[0], rel=1e-3)


def test_ordinary_drift_has_the_declared_deviation_after_an_hour():
    """Across the line of sight at the station's distance; along it there is the shift alone, half of the variance."""
    size, distance_m, seeds = 5e-6, 3.2, 300
    across, along = [], []
    for seed in range(seeds):
        one = Alone("ordinary_drift", size, seed=seed)
        s = sight_of(np.array([[[0.0, distance_m, 0.0]]]))
        hz, v, d = s.hz_rad.item(), s.v_rad.item(), s.distance_m.item()
        one.effect.apply_to_sight(one.motion_states(3600.0), s)
        across += [distance_m * (s.hz_rad.item() - hz), distance_m * (s.v_rad.item() - v)]
        along.append(s.distance_m.item() - d)
    for values, variance in ((across, size**2), (along, 0.5 * size**2)):
        bound = 4.0 * np.sqrt(2.0 / len(values))
        assert np.mean(np.square(values)) == pytest.approx(variance, rel=bound)
