"""Normal distributions of all readings written out, without the engine's shortcuts, and an effect to test with."""

from __future__ import annotations

import numpy as np

from calibration.effects.api import BasisSets, Effect, EffectInputs, EffectParameter

LOW, HIGH = 1e-6, 3e-4


def flat(columns):
    return columns.reshape(-1, columns.shape[2])


def dense(linear, *more):
    """Covariance of all whitened readings."""
    a = np.concatenate([flat(linear.columns), *more], axis=1)
    return np.eye(len(a)) + a @ a.T


def log_density(y, covariance):
    _, log_determinant = np.linalg.slogdet(covariance)
    return -0.5 * (y @ np.linalg.solve(covariance, y) + log_determinant + len(y) * np.log(2.0 * np.pi))


def explicit(linear, likelihood, contributions):
    """Columns (3 n, k) without `MarginalLikelihood.columns`."""
    out = np.zeros((3 * len(linear.rows), len(contributions)))
    for k, contribution in enumerate(contributions):
        for channel, shape in contribution:
            moved = likelihood.channels.shift_m(channel) @ linear.frame.rotation.T
            out[:, k] += (linear.whiten @ moved[:, :, None])[:, :, 0].ravel() * np.repeat(shape, 3)
    return out


def with_forms_at(*places: int) -> Effect:
    """An effect of the drives that has a basis set at some of them only."""

    def forms(inputs: EffectInputs, place: int) -> BasisSets:
        out = BasisSets()
        if place in places:
            out.add_set(out.add((f"travel.{inputs.drive(place)}", inputs.context.direction[:, place])))
        return out

    return Effect("one_sided", "drive", EffectParameter("width_m", LOW, HIGH, "m", ""), "", (), forms)
