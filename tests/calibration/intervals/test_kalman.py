"""Filters side by side against filterpy's, one by one."""

from __future__ import annotations

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from calibration.intervals.kalman import Filters


def test_filters_side_by_side_are_filterpy_s_one_by_one():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((4, 3, 3))
    mean, covariance = rng.standard_normal((4, 3)), root @ np.swapaxes(root, 1, 2)
    several = Filters(mean.copy(), covariance.copy())
    single = []
    for b in range(4):
        kf = KalmanFilter(dim_x=3, dim_z=1)
        kf.x, kf.P = mean[b].copy(), covariance[b].copy()
        single.append(kf)
    for _ in range(30):
        transition = np.eye(3) + 0.1 * rng.standard_normal((4, 3, 3))
        noise, row = rng.uniform(0.0, 0.2, (4, 3)), rng.standard_normal((4, 3))
        reading, variance = rng.standard_normal(4), rng.uniform(0.1, 1.0, 4)
        several.predict(transition, noise)
        innovation, total = several.update(row, reading, variance)
        for b, kf in enumerate(single):
            kf.predict(F=transition[b], Q=np.diag(noise[b]))
            kf.update(reading[b : b + 1], R=variance[b], H=row[b : b + 1])
            assert innovation[b] == pytest.approx(float(kf.y[0]))
            assert total[b] == pytest.approx(float(kf.S[0, 0]))
            assert several.mean[b] == pytest.approx(kf.x)
            assert several.covariance[b] == pytest.approx(kf.P)
