"""Coordinates with covariance, and the interim test against a tracker that only has geometry."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import calibration
from drivers.station.coordinates import StatedAccuracy, coordinates
from drivers.station.interim_test import InterimLimits, KnownDistance, interim_test, two_face_error
from drivers.station.laser_tracker import LaserTracker
from drivers.station.polar import MeanReading, PolarReading, cartesian_to_polar, polar_to_cartesian
from mock_devices.plant.plant import Plant
from mock_devices.settings import InstrumentProfile, MockSettings
from mock_devices.station.mock_station import MockStation
from mock_devices.station.station_server import PtyStationServer
from pkm_rig.rig.clock import VirtualClock
from tests.mock_devices.standing import StandingPlant

MACHINE = Path(calibration.__file__).parent / "machine" / "data" / "planar4.toml"


def _reading(hz: float, v: float, d: float, face: int = 1) -> PolarReading:
    return PolarReading(
        hz_rad=hz,
        v_rad=v,
        slope_distance_m=d,
        face=face,
        prism_constant_m=0.0,
        ppm=0.0,
        t_rig_s=0.0,
        t_host_s=0.0,
        u_t_s=0.0,
    )


def test_covariance_is_what_many_readings_scatter_by() -> None:
    stated = StatedAccuracy(angle_sd_rad=1e-4, range_sd_m=1e-3, range_ppm=0.0)
    hz, v, d = 0.7, 1.1, 3.0
    draws = np.random.default_rng(1).standard_normal((3, 40_000))
    points = np.array(
        [
            polar_to_cartesian(hz + 1e-4 * a / math.sin(v), v + 1e-4 * b, d + 1e-3 * c)
            for a, b, c in draws.T
        ]
    )  # fmt: skip
    read_coordinates = coordinates(_reading(hz, v, d), stated)
    np.testing.assert_allclose(read_coordinates.covariance_m2, np.cov(points.T), atol=3e-8)
    mean = MeanReading(
        hz_rad=hz,
        v_rad=v,
        slope_distance_m=d,
        s_hz_rad=0.0,
        s_v_rad=0.0,
        s_distance_m=0.0,
        n=4,
        t_rig_s=0.0,
    )
    np.testing.assert_allclose(coordinates(mean, stated).covariance_m2 * 4.0, read_coordinates.covariance_m2)


def test_unless_stated_a_range_has_a_tenth_of_a_millimetre_and_a_millionth() -> None:
    """The data sheet's 0.1 mm and 1 ppm, at 200 m along north."""
    covariance_m2 = coordinates(_reading(0.0, math.pi / 2, 200.0), StatedAccuracy()).covariance_m2
    assert math.sqrt(covariance_m2[1, 1]) == pytest.approx(math.hypot(1e-4, 2e-4))


def test_two_face_errors_have_the_sign_of_their_cause() -> None:
    side, index, v = 8e-6, -5e-6, 1.2
    one = _reading(0.3 + side / math.sin(v), v + index, 3.0)
    two = _reading(0.3 + math.pi - side / math.sin(v), 2.0 * math.pi - v + index, 3.0, face=2)
    error = two_face_error("N1", [one, two])
    assert (error.across_rad, error.up_rad) == pytest.approx((side, index), rel=1e-5)
    with pytest.raises(ValueError, match="no readings"):
        two_face_error("N1", [one])


@pytest.mark.parametrize(("index_rad", "passed"), [(1e-6, True), (40e-6, False)])
def test_the_mock_station_passes_unless_its_index_is_off(index_rad: float, passed: bool) -> None:
    clock = VirtualClock()
    profile = InstrumentProfile(vertical_index_rad=index_rad)
    plant = StandingPlant(Plant(MACHINE, MockSettings(seed=3, instrument=profile), clock)).plant
    server = PtyStationServer(MockStation(plant))
    tracker = LaserTracker(server.url, clock)
    places_m = {}
    for sighting in plant.sightings(0.0):
        if sighting.name in ("N1", "N2"):
            polar = sighting.polar
            places_m[sighting.name] = polar_to_cartesian(polar.hz_rad, polar.v_rad, polar.distance_m)
    length_m = math.dist(places_m["N1"], places_m["N2"])
    try:
        with clock.activity():
            tracker.connect()
            known = [KnownDistance(("N1", "N2"), length_m, 2e-6)]
            test_result = interim_test(tracker, places_m, known, StatedAccuracy(), InterimLimits())
            with pytest.raises(ValueError, match="unknown nest"):
                interim_test(tracker, places_m, [KnownDistance(("N1", "N9"), 1.0, 0.0)], StatedAccuracy())
    finally:
        tracker.close()
        server.close()
        clock.close()
    assert test_result.passed is passed
    assert len(test_result.two_face) == 2
    assert abs(test_result.distances[0].error_m) < 0.5e-3
    assert test_result.distances[0].expanded_u_m > 1e-6
    assert all("two-face" in failure for failure in test_result.failures)
    assert cartesian_to_polar(*places_m["N1"])[2] > 1.0
