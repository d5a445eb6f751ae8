"""Where the machine stands at each reading."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Conditions:
    """What holds at r readings of s struts and d drives whatever departs.

    Poses are those that were commanded; strut_strain is the growth of the struts that no sensor shows.
    """

    drives_m: Array  # (r, d), as the drives read them
    positions_m: Array  # (r, 3)
    rotations: Array  # (r, 3, 3)
    payload_kg: Array  # (r,)
    payload_centre_m: Array  # (r, 3)
    part_c: Mapping[str, Array]  # (r,), by group
    expansion_per_k: Mapping[str, float]  # true ones, by group
    strut_strain: Array  # (r, s)


@dataclass(frozen=True)
class Equilibrium:
    """Poses and forces at r readings; a tension is positive, directions of struts are from base to platform."""

    positions_m: Array  # (r, 3)
    rotations: Array  # (r, 3, 3)
    tension_n: Array  # (r, s)
    directions: Array  # (r, s, 3)
    carriage_force_n: Array  # (r, d, 3), of the struts on each carriage
    carriage_moment_nm: Array  # (r, d, 3), about the middle of its joints
    travel_m: Array  # (r, d), true
    axes: Array  # (d, 3), true
    centres_m: Array  # (r, d, 3), middle of a carriage's joints at zero travel
    growth: Mapping[str, Array]  # (r,), factor of lengths by group
