from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.instruments import station_geometry
from calibration.instruments.smr_positions import SmrPositions

STATED = station_geometry.StationAccuracy(2.4e-6, 1.0e-4, 1.0e-4, 1.0e-6)


def test_axes_are_those_of_geocom():
    hz, v = np.array([0.0, np.pi / 2, 0.0]), np.array([np.pi / 2, np.pi / 2, 0.0])
    np.testing.assert_allclose(
        station_geometry.polar_to_points(hz, v, np.full(3, 2.0)), [[0, 2, 0], [2, 0, 0], [0, 0, 2]], atol=1e-15
    )


@given(st.floats(-5, 5), st.floats(0.5, 5), st.floats(-3, 3))
def test_angles_invert_points(e, n, h):
    point = np.array([[e, n, h]])
    np.testing.assert_allclose(
        station_geometry.polar_to_points(*station_geometry.points_to_polar(point)), point, atol=1e-12
    )


def test_covariance_agrees_with_the_scatter_of_noisy_readings():
    rng = np.random.default_rng(11)
    hz, v, d = 0.3, 1.9, 3.4
    n = 40_000
    cloud = station_geometry.polar_to_points(
        rng.normal(hz, STATED.angle_sd_rad, n),
        rng.normal(v, STATED.angle_sd_rad, n),
        rng.normal(d, STATED.range_sd_m, n),
    )
    stated = station_geometry.point_covariances(np.array([hz]), np.array([v]), np.array([d]), STATED)[0]
    covariance = np.cov(cloud.T)
    # Whitened, the sample covariance is the identity within some 1 / sqrt(n).
    white = np.linalg.inv(np.linalg.cholesky(stated))
    np.testing.assert_allclose(white @ covariance @ white.T, np.eye(3), atol=0.05)


def test_a_certified_length_ties_the_range_constant():
    nests = np.array([[-0.8, 3.1, -1.4], [0.8, 3.1, -1.4]])
    constant = 7e-5
    rng = np.random.default_rng(2)
    items = []
    for _ in range(300):
        hz, v, d = (np.tile(x, 40) for x in station_geometry.points_to_polar(nests))
        cov = station_geometry.point_covariances(hz, v, d, STATED)
        d = d + constant + rng.normal(0.0, STATED.range_sd_m, d.size)
        hz = hz + rng.normal(0.0, STATED.angle_sd_rad, d.size)
        point = station_geometry.polar_to_points(hz, v, d)
        length = station_geometry.CertifiedLength(("N1", "N2"), 1.6, 2e-6)
        items.append(station_geometry.range_constant(point[0::2], point[1::2], cov[0::2], cov[1::2], length, 1e-4))
    estimates, u = np.array(items).T
    shrunk = constant * (1.0 - (u[0] / 1e-4) ** 2)
    assert np.mean(estimates) == pytest.approx(shrunk, abs=4e-6)
    assert np.std(estimates) == pytest.approx(u[0], rel=0.2)


@pytest.mark.parametrize("certificate_u_m", [2e-6, 2e-5])
def test_no_number_of_readings_ties_the_range_constant_better_than_the_certificate(certificate_u_m):
    """Readings without noise: what is left is the certificate's uncertainty, over the distance's derivative."""
    nests = np.array([[-0.8, 3.1, -1.4], [0.8, 3.1, -1.4]])
    sight = nests / np.linalg.norm(nests, axis=1)[:, None]

    def apart(constant_m):
        first, second = nests + constant_m * sight
        return np.linalg.norm(second - first)

    slope = (apart(1e-3) - apart(-1e-3)) / 2e-3
    many = np.tile(np.eye(3) * 1e-18, (50, 1, 1))
    first, second = (np.tile(point, (50, 1)) for point in nests + 7e-5 * sight)
    length = station_geometry.CertifiedLength(("N1", "N2"), float(apart(0.0)), certificate_u_m)
    estimate, u = station_geometry.range_constant(first, second, many, many, length, 1e-4)
    by_certificate = certificate_u_m / slope
    assert u == pytest.approx(1.0 / np.hypot(1.0 / by_certificate, 1.0 / 1e-4), rel=1e-3)
    assert estimate == pytest.approx(7e-5 * (u / by_certificate) ** 2, rel=1e-3)


def test_whitened_noise_that_is_added_is_what_the_readings_are_off_by(synthetic):
    """Residuals that are put back, as in repetitions of a fit, are the same numbers; the first is along the sight."""
    rig = synthetic(6)
    readings = SmrPositions(rig.see(rig.visits(rig.workspace(6), np.zeros(6))), rig.station)
    poses = rig.model.predict(rig.truth[: len(rig.model)], readings.observations.visits)
    own = rig.truth[rig.layout.instrument_slices[0]]
    white = np.random.default_rng(6).standard_normal((len(readings), 3))
    before, after = (
        each.compare(poses, each.observations.visit[:, None], own).residual
        for each in (readings, readings.with_noise(white))
    )
    np.testing.assert_allclose(before - after, white, atol=1e-3)  # the line of sight turns with the noise
    sight = readings.observations.position_m
    along = np.einsum("rij,rj->ri", readings.whiten, sight / np.linalg.norm(sight, axis=1)[:, None])
    assert np.all(along[:, 0] > 100.0 * np.abs(along[:, 1:]).max(axis=1))
