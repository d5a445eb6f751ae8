"""The power curve: share of steps found at the next check, beside what the normal distribution says of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from scipy.special import ndtr

from benchmarks.withheld.statistics import wilson
from benchmarks.year_study.life import SETTINGS
from benchmarks.year_study.measures import power
from benchmarks.year_study.workshop import LOOKS, workshop
from calibration.intervals.sequential import bounds

mpl.use("Agg")


def steady_variance() -> float:
    """Variance that the expectation of a check adds after many checks, in that of a check with all poses."""
    q = SETTINGS.drift.walk_per_sqrt_week**2
    return 0.5 * (q + np.sqrt(q * q + 4.0 * q))


def theoretical(size: np.ndarray) -> np.ndarray:
    """Power of one normal difference against the last look's limit: no early stop, one watched change."""
    added = steady_variance()
    looks = bounds(SETTINGS.check, np.sqrt(LOOKS[-1] / np.array(LOOKS, dtype=float) + added), workshop().independent)
    shift, limit = size / np.sqrt(1.0 + added), float(looks.upper[-1])
    return np.asarray(ndtr(shift - limit) + ndtr(-shift - limit))


def draw(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Found shares with Wilson's intervals, and the theoretical curve."""
    figure = Figure(figsize=(7.0, 4.4), layout="constrained")
    axes = figure.add_subplot()
    size, share = power(rows)
    low, high = np.array([wilson(round(s * len(rows)), len(rows)) for s in share]).T
    smooth = np.linspace(0.0, 8.0, 161)
    axes.plot(smooth, 100.0 * theoretical(smooth), color="#0072B2", label="theory: one change, all poses")
    axes.errorbar(
        size, 100.0 * share, 100.0 * np.array([share - low, high - share]), fmt="o", color="#D55E00", capsize=3,
        label=f"found by the study, {len(rows)} machines, 95 % intervals",
    )  # fmt: skip
    axes.axhline(95.0, color="0.6", linewidth=0.8, linestyle=":")
    axes.set_xlabel("step of one parameter / standard deviations of a check")
    axes.set_ylabel("found at the next check / %")
    axes.set_xlim(-0.2, 8.2)
    axes.set_ylim(-2.0, 102.0)
    axes.grid(visible=True, alpha=0.3)
    axes.legend(loc="lower right")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
