"""What happens to a machine in a year: drawn from a seed, the same for whoever decides about it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.year_study.workshop import Workshop

WEEKS = 52
RATES = {"step": 0.5, "ramp": 0.3, "drive replaced": 0.2, "collision": 0.1}
RESEATS = 2
SEASON_K = 6.0  # from the coldest to the warmest week
WALK = 0.2  # of the checks' statistic in its standard deviation, RMS over the watched changes, a square-root week
TOLERANCE_M = 30.0e-6


@dataclass(frozen=True)
class Happening:
    """Something at a time in weeks: changes of parameters at once, or a week for wear."""

    week: float
    kind: str
    changes: tuple[tuple[str, float], ...]
    part: str = ""


@dataclass(frozen=True)
class MachineYear:
    """A seed's year. walk (weeks, p): changes of the steppable parameters from week to week."""

    seed: int
    happenings: tuple[Happening, ...]
    reseats: tuple[float, ...]
    walk: np.ndarray
    phase: float

    def mean_c(self, week: float) -> float:
        """Temperature of the shop."""
        return 21.5 + 0.5 * SEASON_K * float(np.sin(2.0 * np.pi * (week / 52.18 + self.phase)))

    @property
    def eventless(self) -> bool:
        """Whether nothing but drift, season and reseats happens."""
        return not self.happenings


def draw_year(shop: Workshop, seed: int, rate: float = 1.0, weeks: int = WEEKS) -> MachineYear:
    """The year of a seed; rate multiplies how often things happen."""
    rng = np.random.default_rng([14, seed])
    found: list[Happening] = []
    for kind, per_year in RATES.items():
        for _ in range(rng.poisson(rate * per_year * weeks / WEEKS)):
            found.append(_happening(shop, kind, float(rng.uniform(0.0, weeks)), rng))
    reseats = tuple(sorted(rng.uniform(0.0, weeks, rng.poisson(RESEATS * weeks / WEEKS)).tolist()))
    return MachineYear(
        seed, tuple(sorted(found, key=lambda h: h.week)), reseats, draw_walk(shop, rng, weeks), float(rng.uniform())
    )


def draw_walk(shop: Workshop, rng: np.random.Generator, weeks: int) -> np.ndarray:
    """Steps (weeks, p) of the steppable parameters: independent, each in proportion to its own sigma."""
    sigma = np.array([shop.sigma[name] for name in shop.steppable])
    design = shop.check_design
    rows = [shop.watched.names.index(name) for name in shop.steppable]
    # how far the standardised statistics move when every parameter moves by its sigma
    moved = design.correlation[:, rows] * (sigma / design.change_u[rows])
    scale = WALK / float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
    return np.asarray(scale * sigma * rng.standard_normal((weeks, len(sigma))))


def _happening(shop: Workshop, kind: str, week: float, rng: np.random.Generator) -> Happening:
    if kind == "step":
        name = str(rng.choice(shop.steppable))
        return Happening(week, kind, ((name, _sign(rng) * log_uniform(rng, 1.0, 20.0) * shop.sigma[name]),), name)
    if kind == "ramp":
        name = str(rng.choice(shop.steppable))
        return Happening(week, kind, ((name, _sign(rng) * slope(shop, name, log_uniform(rng, 0.3, 3.0))),), name)
    side = str(rng.choice(["left", "right"]))
    if kind == "drive replaced":
        offset = _sign(rng) * log_uniform(rng, 5.0, 30.0) * shop.sigma[f"drive_offset.{side}"]
        scale = rng.standard_normal() * 4.0 * shop.sigma[f"drive_scale.{side}"]
        moved: list[tuple[str, float]] = [(f"base_joint.{side}_{end}.y", offset) for end in ("upper", "lower")]
        return Happening(week, kind, (*moved, (f"drive_scale.{side}", float(scale))), side)
    names = [f"axis_tilt.{side}.rz", f"base_joint.{side}_upper.x", f"base_joint.{side}_lower.x"]
    return Happening(
        week, kind, tuple((n, _sign(rng) * log_uniform(rng, 3.0, 30.0) * shop.sigma[n]) for n in names), side
    )


def slope(shop: Workshop, name: str, years: float) -> float:
    """Wear a week that alone reaches the tolerance in so many years."""
    per_change = shop.check_design.error_per_change[shop.watched.names.index(name)]
    return float(TOLERANCE_M / per_change / (years * 52.18))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A draw whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def settings() -> dict[str, Any]:
    """For the results' file."""
    return {"rates": RATES, "reseats": RESEATS, "season_k": SEASON_K, "walk": WALK, "tolerance_m": TOLERANCE_M}
