"""Any smooth function of a coordinate, as columns with a prior."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from calibration.base.arrays import Array

SMOOTH_TERMS = 12
SMOOTHNESS = 2.0  # power with which the deviations of cosines fall


def smooth_function(x: Array) -> Callable[[Array], Array]:
    """Any smooth function of a coordinate within the range of x (n,), constant beyond: columns (m, k), total RMS 1."""
    low, span = float(x.min()), max(float(np.ptp(x)), 1e-300)
    order = np.arange(1, SMOOTH_TERMS + 1)
    deviations = order**-SMOOTHNESS
    deviations *= np.sqrt(2.0 / np.sum(deviations**2))

    def columns(of: Array) -> Array:
        place = np.clip((of - low) / span, 0.0, 1.0)
        return np.asarray(np.cos(np.pi * np.outer(place, order)) * deviations)

    return columns
