"""Steps of Gauss-Newton where the model's curvature lets them shrink by the same factor only, one after the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.base.arrays import Array

LARGEST_SHARE = 0.5  # of the series that is summed up: beyond it convergence is not regular enough
NEAR = 1e-3  # of the way that is left, where the steps run out: in standard errors


def accelerated_step(
    metric: Array, previous: tuple[Array, Array] | None, z: Array, step: Array, largest_share: float = LARGEST_SHARE
) -> Array:
    """A Gauss-Newton step at z, accelerated in the slowest direction by the previous iterate and its step.

    Anderson's mixing with a memory of one sums the series of steps. metric (m, u): a root of the information;
    largest_share: beyond which a step stays as it is. Steps that shrink to r of the one before have the share r/(1-r).
    """
    if previous is None:
        return step
    place, before = previous
    change = metric @ (step - before)
    share = float(change @ (metric @ step)) / float(change @ change)
    return step if abs(share) > largest_share else step - share * (z - place + step - before)


def left_to_go(sizes: Sequence[float]) -> float:
    """Distance from the minimum, if steps go on shrinking as the last two did; infinite where they do not shrink, or of
    a single step. Before the first, sizes are infinite."""
    share = sizes[-1] / sizes[-2] if len(sizes) > 1 and np.isfinite(sizes[-2]) else np.inf
    return sizes[-1] * share / (1.0 - share) if share < 1.0 else np.inf
