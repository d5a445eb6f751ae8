"""Several Kalman filters of the same size side by side, each with one reading at a time.

The equations of filterpy's `KalmanFilter` (the tests compare the two), for all filters at once: a history is followed
anew at each decision, for every watched change and every possible beginning of wear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array


@dataclass
class Filters:
    """Means (b, s) and covariances (b, s, s) of b filters."""

    mean: Array
    covariance: Array

    def predict(self, transition: Array, noise: Array) -> None:
        """transition (b, s, s) or (s, s); noise (b, s): variances that each state gains."""
        self.mean = np.asarray((transition @ self.mean[:, :, None])[:, :, 0])
        self.covariance = transition @ self.covariance @ np.swapaxes(transition, -1, -2)
        self.add(noise)

    def add(self, noise: Array) -> None:
        """Variances (b, s) that each state gains, nothing else having changed."""
        self.covariance = self.covariance + noise[:, :, None] * np.eye(self.mean.shape[1])

    def expected(self, by_state: Array) -> tuple[Array, Array]:
        """Mean and variance (b,) of what a reading with the row by_state (b, s) or (s,) would show without noise."""
        row = np.broadcast_to(by_state, self.mean.shape)
        shown = (self.covariance @ row[:, :, None])[:, :, 0]
        return np.sum(row * self.mean, axis=1), np.maximum(np.sum(row * shown, axis=1), 0.0)

    def update(self, by_state: Array, reading: Array, variance: Array) -> tuple[Array, Array]:
        """Take a reading (b,) of some variance (b,) in; its innovation and the innovation's variance (b,)."""
        row = np.broadcast_to(by_state, self.mean.shape)
        mean, spread = self.expected(row)
        innovation, total = reading - mean, spread + variance
        gain = (self.covariance @ row[:, :, None])[:, :, 0] / total[:, None]
        self.mean = self.mean + gain * innovation[:, None]
        # Joseph's form keeps the covariance symmetric and positive
        keep = np.eye(row.shape[1]) - gain[:, :, None] * row[:, None, :]
        noise = gain[:, :, None] * gain[:, None, :] * np.broadcast_to(variance, total.shape)[:, None, None]
        self.covariance = keep @ self.covariance @ np.swapaxes(keep, 1, 2) + noise
        return innovation, total
