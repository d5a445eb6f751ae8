"""What is always there, of declared levels: drift, reseating, reversal, temperatures off their sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.emergent.campaign import Disturbances
from benchmarks.emergent.machines import EXPANSION_PER_K
from benchmarks.emergent.strut_model import SLIDERS, STRUTS

Array = NDArray[np.float64]

HOUR_S, LEVER_M = 3600.0, 3.0


@dataclass(frozen=True)
class Levels:
    """Standard deviations, as `[nuisance]` of a recording declares them."""

    drift_m: float
    reseat_m: float
    reversal_m: float
    temperature_k: float


PROFILES = {
    "quiet": Levels(8e-7, 5e-7, 4e-7, 0.01),
    "standard": Levels(1.8e-6, 1e-6, 1e-6, 0.02),
    "drifty": Levels(4e-6, 1e-6, 1e-6, 0.02),
    "restless": Levels(1.8e-6, 2.5e-6, 2e-6, 0.04),
}


def on_machine(levels: Levels, t_s: Array, sides: Array, drives_m: Array, rng: np.random.Generator) -> Disturbances:
    """Reversal of each drive, and slow waves of temperature; by readings at times (r,), sides and drives (r, 2)."""
    count = SLIDERS + STRUTS
    periods, phases = rng.uniform(1500.0, 9000.0, count), rng.uniform(0.0, 2.0 * np.pi, count)
    waves = levels.temperature_k * np.sqrt(2.0) * np.sin(2.0 * np.pi * t_s[:, None] / periods + phases)
    halves = levels.reversal_m * rng.standard_normal(SLIDERS)
    travel = -halves * sides + EXPANSION_PER_K * drives_m * waves[:, :SLIDERS]
    return Disturbances(travel, EXPANSION_PER_K * waves[:, SLIDERS:])


def reseated_m(
    levels: Levels, exchanges: NDArray[np.intp], reflectors: NDArray[np.intp], rng: np.random.Generator
) -> Array:
    """Shifts (r, 3) of the platform's reflectors, drawn anew with each payload exchange."""
    shifts = levels.reseat_m * rng.standard_normal((int(exchanges.max()) + 1, 3, 3))
    shifts[0], shifts[..., 2] = 0.0, 0.0
    on = reflectors < 3
    return np.where(on[:, None], shifts[exchanges, np.where(on, reflectors, 0)], 0.0)


def drift(levels: Levels, t_s: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Turns (r, 3) in rad and shifts (r, 3) of the station's frame: walks, half of the variance each at LEVER_M."""
    steps = np.sqrt(np.diff(t_s, prepend=t_s[0]) / HOUR_S)[:, None] * rng.standard_normal((len(t_s), 6))
    walk = levels.drift_m / np.sqrt(2.0) * np.cumsum(steps, axis=0)
    return walk[:, :3] / LEVER_M, walk[:, 3:]
