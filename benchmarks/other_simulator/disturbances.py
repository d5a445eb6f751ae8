"""What is always there: drift of the station, reseating, reversal, temperatures off their sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.other_simulator.courses import walking, wandering
from benchmarks.other_simulator.departures import Departures
from benchmarks.other_simulator.machine import ON_FLOOR, Machine
from benchmarks.other_simulator.rows import Rows

Array = NDArray[np.float64]

ORDINARY = {"drift_m": 3e-6, "reseat_m": 2e-6, "reversal_m": 1e-6, "temperature_k": 0.02}
FACTORS, FREQUENCY = {"small": 0.5, "ordinary": 1.0, "large": 2.0}, [0.25, 0.5, 0.25]
LEVER_M = 3.0
PART_TAU_S = 3600
OUTLIERS, OUTLIER_M = 0.002, (1e-4, 1e-3)  # share of the readings, size


@dataclass(frozen=True)
class Levels:
    """Levels of a campaign; nuisance: by the names of a recording's section, which states them if `declared`."""

    name: str
    nuisance: dict[str, float]
    declared: bool
    outliers: bool

    @property
    def label(self) -> str:
        """What the table of truths calls them."""
        return self.name + ("" if self.declared else "_undeclared") + ("+outliers" if self.outliers else "")

    def stated_drift(self) -> dict[str, float]:
        """Drift by the names of `[station.accuracy]`."""
        drift_m = self.nuisance["drift_m"]
        values = {
            "drift_rad_per_sqrt_h": max(drift_m / LEVER_M, 1e-6),
            "drift_of_level_rad_per_sqrt_h": max(drift_m / 6, 5e-7),
            "drift_m_per_sqrt_h": max(drift_m, 1e-6),
        }
        return {name: float(f"{value:.2g}") for name, value in values.items()}


@dataclass(frozen=True)
class Drift:
    """Walks of the station's frame at r readings: shifts (r, 3) in m and turns (r, 3) in rad."""

    shifts_m: Array
    turns_rad: Array

    def of(self, seen_m: Array) -> Array:
        """Sights (r, 3) in the frame that has drifted."""
        return seen_m - self.shifts_m - np.cross(self.turns_rad, seen_m)


def draw_levels(rng: np.random.Generator) -> Levels:
    """Levels about ordinary ones, of half or double them; a fifth undeclared, a fifth with outliers."""
    name = str(rng.choice(list(FACTORS), p=FREQUENCY))
    nuisance = {
        key: float(f"{ordinary * FACTORS[name] * np.exp(rng.normal() * 0.25):.2g}")
        for key, ordinary in ORDINARY.items()
    }
    return Levels(name, nuisance, declared=rng.random() >= 0.2, outliers=rng.random() < 0.2)


def draw_drift(levels: Levels, t_s: Array, rng: np.random.Generator) -> Drift:
    """Drift at times (r,)."""
    drift_m = levels.nuisance["drift_m"]
    return Drift(walking(t_s, rng) * drift_m * 0.5, walking(t_s, rng) * np.array([0.3, 0.3, 0.5]) * drift_m / LEVER_M)


def draw_on_machine(
    levels: Levels, machine: Machine, rows: Rows, expansion_per_k: dict[str, float], rng: np.random.Generator
) -> tuple[Departures, Array]:
    """Reversal, temperatures and reseating; and the strain (r, s) of the struts that their sensor does not show."""
    out = Departures.none(machine, len(rows))
    temperature_k = levels.nuisance["temperature_k"]
    for drive in range(len(machine.drives)):
        out.drives_m[:, drive] -= rows.side[:, drive] * rng.normal() * levels.nuisance["reversal_m"]
        warmth = wandering(rows.t_s, PART_TAU_S, rng)
        out.drives_m[:, drive] += expansion_per_k["drives"] * temperature_k * warmth * rows.drives_m[:, drive]
    strains = [expansion_per_k["struts"] * temperature_k * wandering(rows.t_s, PART_TAU_S, rng) for _ in machine.struts]
    block = np.searchsorted(rows.reseats_s, rows.t_s, "right")
    for smr, carrier in enumerate(machine.carriers):
        seating = rows.nest_check if carrier == ON_FLOOR else block
        shifts = rng.normal(size=(seating.max() + 1, 3)) * levels.nuisance["reseat_m"]
        read = rows.smr == smr
        out.points_m[read] += shifts[seating[read]]
    return out, np.stack(strains, 1)


def with_outliers(seen_m: Array, rng: np.random.Generator) -> Array:
    """Readings (r, 3) with some of them off by a random vector."""
    out, count = seen_m.copy(), len(seen_m)
    hit = rng.choice(count, max(1, round(OUTLIERS * count)), replace=False)
    direction = rng.normal(size=(len(hit), 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    out[hit] += direction * np.exp(rng.uniform(np.log(OUTLIER_M[0]), np.log(OUTLIER_M[1]), len(hit)))[:, None]
    return out
