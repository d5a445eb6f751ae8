"""Whether numbers are by chance: not more alike between neighbours than numbers are that were drawn in any order."""

from __future__ import annotations

import numpy as np

from calibration.base.arrays import Array

MOST_ALIKE = 4.0  # standard deviations of the correlation of neighbours, were they drawn by chance


def are_by_chance(values: Array, along: Array) -> bool:
    """Whether values (k,) do not follow from any of some coordinates, along (k, c), such as time.

    By the correlation of each with the next one along a coordinate, of which by chance the standard deviation is
    1 / sqrt(k).
    """
    scatter = values - values.mean()
    most = MOST_ALIKE * float(scatter @ scatter) / np.sqrt(len(scatter))
    in_order = (scatter[np.argsort(x, kind="stable")] for x in along.T)
    return all(float(one[1:] @ one[:-1]) <= most for one in in_order)
