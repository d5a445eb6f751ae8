from __future__ import annotations

import numpy as np
from scipy.stats import chi2

from calibration.recording.header import AccuracyEntry
from calibration.reduction.drift_filter import estimate_drift

STATED = AccuracyEntry(angle_sd_rad=2.4e-6, range_sd_m=1e-4, range_constant_u_m=1e-4, range_scale_u=1e-6)
NESTS = np.array([[-0.8, 3.1, -1.4], [0.8, 3.1, -1.4]])


def walk(seed, checks=40, noise_m=5e-6):
    """Nest readings of a station whose frame drifts as the filter believes it does; returns the truth too."""
    rng = np.random.default_rng(seed)
    t = np.arange(checks) * 180.0
    strength = np.array([STATED.drift_m_per_sqrt_h] * 3 + [STATED.drift_of_level_rad_per_sqrt_h] * 2)
    strength = np.append(strength, STATED.drift_rad_per_sqrt_h)
    steps = rng.normal(0.0, 1.0, (checks, 6)) * strength * np.sqrt(180.0 / 3600.0)
    steps[0] = 0.0
    state = np.cumsum(steps, axis=0)
    moved = NESTS[None] + state[:, None, :3] + np.cross(state[:, None, 3:], NESTS[None])
    position = (moved + rng.normal(0.0, noise_m, moved.shape)).reshape(-1, 3)
    covariance = np.tile(np.eye(3) * noise_m**2, (2 * checks, 1, 1))
    return t, np.repeat(t, 2), np.tile([0, 1], checks), position, covariance, state


def test_drift_is_followed_within_its_covariance():
    squares, count = 0.0, 0
    for seed in range(20):
        t, times, nest, position, covariance, state = walk(seed)
        drift = estimate_drift(times, nest, position, covariance, STATED, t + 1e-3)
        points = np.tile([0.1, 3.1, 0.0], (len(t), 1))
        wanted = state[:, :3] + np.cross(state[:, 3:], points)
        cleaned, added = drift.remove(points + wanted, np.zeros((len(t), 3, 3)))
        error = cleaned - points
        for k in (len(t) // 2, len(t) - 1):
            squares += float(error[k] @ np.linalg.solve(added[k], error[k]))
            count += 3
    low, high = chi2.ppf([1e-3, 1 - 1e-3], count) / count
    assert low < squares / count < high


def test_later_nest_readings_do_not_move_the_frame_of_earlier_ones():
    t, times, nest, position, covariance, _ = walk(5)
    half = len(times) // 2
    early = t[: half // 4]
    whole = estimate_drift(times, nest, position, covariance, STATED, early)
    part = estimate_drift(times[:half], nest[:half], position[:half], covariance[:half], STATED, early)
    assert np.abs(whole.state - part.state)[:, :3].max() < 3e-6
