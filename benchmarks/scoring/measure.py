"""A row of a table: a figure with its interval, and whether its goal is met or even shown.

A goal is met by the figure itself. It is shown where the 95 % interval also excludes a figure that is 0.05 (five
points) worse than the goal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.withheld.statistics import Z95, wilson

Array = NDArray[np.float64]

WORSE = 0.05
BOOTSTRAPS, BOOTSTRAP_SEED = 1000, 5
FEW = 10  # values, whose mean shows nothing
SHOWN, MET, SHORT = "shown", "met", "short"


@dataclass(frozen=True)
class Measure:
    """One row: value with its 95 % interval over n cases; ok and shown are None where there is no goal or no case."""

    name: str
    goal: str
    value: float | None
    low: float
    high: float
    n: int
    ok: bool | None
    shown: bool | None = None

    def data(self) -> dict[str, Any]:
        """For results.json."""
        return asdict(self)


def status(measure_data: dict[str, Any]) -> str:
    """What is printed of a goal: `shown`, `met`, `short`, or nothing where there is none."""
    if measure_data["ok"] is None:
        return ""
    return (SHOWN if measure_data.get("shown") else MET) if measure_data["ok"] else SHORT


def held_to(name: str, found: tuple[float | None, float, float, int], goal: str, least: float, most: float) -> Measure:
    """A measure (value, low, high, n) that shall lie from least to most."""
    value, low, high, n = found
    ok = None if value is None else least <= value <= most
    shown = None if ok is None else ok and low > least - WORSE and high < most + WORSE
    return Measure(name, goal, value, low, high, n, ok, shown)


def plain(name: str, found: tuple[float | None, float, float, int]) -> Measure:
    """A measure without a goal."""
    return Measure(name, "", *found, ok=None)


def share(name: str, hits: Sequence[bool], goal: float | None = None, *, at_most: bool = False) -> Measure:
    """A proportion with Wilson's interval."""
    found = _proportion(hits)
    if goal is None:
        return plain(name, found)
    text = f"{'at most' if at_most else 'at least'} {100 * goal:g} %"
    return held_to(name, found, text, -np.inf if at_most else goal, goal if at_most else np.inf)


def share_between(name: str, hits: Sequence[bool], least: float, most: float) -> Measure:
    """A proportion that shall be neither too small nor too large, as that of intervals that cover."""
    return held_to(name, _proportion(hits), f"{100 * least:g} to {100 * most:g} %", least, most)


def mean(name: str, values: Sequence[float], most: float | None = None) -> Measure:
    """A mean with the interval of its standard error."""
    found: tuple[float | None, float, float, int] = (None, 0.0, 0.0, 0)
    if values:
        middle = float(np.mean(values))
        spread = Z95 * float(np.std(values)) / float(np.sqrt(len(values)))
        found = middle, middle - spread, middle + spread, len(values)
    if most is None:
        return plain(name, found)
    measure = held_to(name, found, f"at most {most:g}", -np.inf, most)
    return replace(measure, shown=False) if 0 < len(values) < FEW else measure  # their spread says little


def median(name: str, x: Array, less: Array, most: float | None = None) -> Measure:
    """Median of x (n,) less that of others (n,) of the same cases, with a bootstrap interval."""
    found: tuple[float | None, float, float, int] = (None, 0.0, 0.0, 0)
    if x.size:
        drawn = np.random.default_rng(BOOTSTRAP_SEED).integers(0, x.size, (BOOTSTRAPS, x.size))
        spread = np.median(x[drawn], axis=1) - np.median(less[drawn], axis=1)
        low, high = (float(end) for end in np.quantile(spread, [0.025, 0.975]))
        found = float(np.median(x) - np.median(less)), low, high, int(x.size)
    return plain(name, found) if most is None else held_to(name, found, f"at most {most:g}", -np.inf, most)


def quantiles(name: str, values: Sequence[float], most: float | None = None) -> Measure:
    """The median, in the place of the interval the 5 and 95 % quantiles."""
    goal = "" if most is None else f"at most {most:g} s"
    if not values:
        return Measure(name, goal, None, 0.0, 0.0, 0, None)
    low, middle, high = (float(x) for x in np.quantile(values, [0.05, 0.5, 0.95]))
    ok = None if most is None else middle <= most
    return Measure(name, goal, middle, low, high, len(values), ok)


def worst(name: Callable[[str], str], by_group: dict[str, list[bool]], goal: float) -> list[Measure]:
    """The group with the smallest share of hits; nothing without a group."""
    if not by_group:
        return []
    group = min(by_group, key=lambda one: (sum(by_group[one]) / len(by_group[one]), one))
    return [share(name(group), by_group[group], goal)]


def _proportion(hits: Sequence[bool]) -> tuple[float | None, float, float, int]:
    k, n = int(sum(hits)), len(hits)
    return (k / n if n else None, *wilson(k, n), n)
