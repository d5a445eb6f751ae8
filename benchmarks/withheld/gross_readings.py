"""Gross readings: a few of a recording's readings, of any reflector, off in any direction by 0.1 to 10 mm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

SMALLEST_M, LARGEST_M = 1.0e-4, 1.0e-2

Column = NDArray[Any]


def with_gross_readings(columns: Mapping[str, Column], count: int, rng: np.random.Generator) -> dict[str, Column]:
    """The columns with `count` readings off; sizes are spread evenly in the logarithm."""
    rows = rng.choice(len(columns["x_m"]), count, replace=False)
    direction = rng.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    sizes_m = np.exp(rng.uniform(np.log(SMALLEST_M), np.log(LARGEST_M), (count, 1)))
    return moved_readings(columns, rows, sizes_m * direction)


def moved_readings(
    columns: Mapping[str, Column], rows: NDArray[np.intp], by_m: NDArray[np.float64]
) -> dict[str, Column]:
    """The columns with readings, rows (k,), off by so much (k, 3)."""
    moved = np.stack([columns[name] for name in ("x_m", "y_m", "z_m")], axis=1)[rows] + by_m
    distance = np.linalg.norm(moved, axis=1)
    now = {
        "x_m": moved[:, 0], "y_m": moved[:, 1], "z_m": moved[:, 2],
        "hz_rad": np.arctan2(moved[:, 0], moved[:, 1]) % (2.0 * np.pi),
        "v_rad": np.arccos(moved[:, 2] / distance),
        "slope_distance_m": distance,
    }  # fmt: skip
    out = dict(columns)
    for name, values in now.items():
        out[name] = out[name].copy()
        out[name][rows] = values
    return out
