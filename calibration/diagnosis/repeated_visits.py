"""How far readings scatter over visits of one target under the same conditions: the noise floor of a recording."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array

LEAST_REPEATED = 3  # visits of one target under the same conditions


def scatter_over_visits(position_m: Array, conditions: Array, visit: NDArray[np.intp]) -> float | None:
    """RMS scatter, per coordinate, of the means of visits under equal conditions (r, k); None if no conditions are
    those of LEAST_REPEATED visits. position_m (r, c), visit (r,): of each reading, several at a visit being one."""
    _, first, of_visit = np.unique(np.column_stack([conditions, visit]), axis=0, return_index=True, return_inverse=True)
    position_m = _means(position_m, of_visit.ravel())
    group = np.unique(conditions[first], axis=0, return_inverse=True)[1].ravel()
    visits = np.bincount(group)
    repeated = visits[group] >= LEAST_REPEATED
    if not np.any(repeated):
        return None
    square = float(np.sum((position_m - _means(position_m, group)[group])[repeated] ** 2))
    degrees_of_freedom = int(np.sum(visits[visits >= LEAST_REPEATED] - 1)) * position_m.shape[1]
    return float(np.sqrt(square / degrees_of_freedom))


def _means(values: Array, group: NDArray[np.intp]) -> Array:
    """Means (g, c) of the values (r, c) of each group (r,)."""
    return np.stack([np.bincount(group, x) for x in values.T], axis=1) / np.bincount(group)[:, None]
