"""The lives that a study simulates, in the order in which they are worth having."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from benchmarks.year_study.lost_reference import run_lost
from benchmarks.year_study.policies import CHARTS, ChartRule, Decider, calendar, run_year, staircase
from benchmarks.year_study.special import run_ramp, run_step
from benchmarks.year_study.truths import WEEKS, draw_year
from benchmarks.year_study.workshop import workshop

DEVELOPMENT = 900_000  # seeds from here on are for setting things; no figure of a study comes from them
MONTHLY = "calendar, monthly"
LIMITS = {"Shewhart": 4.35, "EWMA": 5.9, "CUSUM": 24.0, "ILAC staircase": 71.0}  # the last in weeks; `rival_limits`
RIVALS = (MONTHLY, *LIMITS)
OTHER_RATES = {"rates halved": 0.5, "rates doubled": 2.0}

Task = tuple[str, int]


def tasks(years: int, rivals: int, others: int, steps: int, ramps: int, lost: int) -> list[Task]:
    """Kind and number of each life: what the goals need first, in blocks, so that a stopped study has some of all."""
    most = {"ours": years, "step": steps, "ramp": ramps, "lost": lost}
    most |= dict.fromkeys(RIVALS, rivals) | dict.fromkeys(OTHER_RATES, others)
    blocks: list[tuple[str, int, int]] = []
    for part in range(8):  # 200 years of ours, with as much of the rest as it is worth
        for kind, size in (
            ("ours", 25),
            ("step", 25),
            ("ramp", 25),
            ("lost", 25),
            *((k, 25) for k in RIVALS),
            *((k, 10) for k in OTHER_RATES),
        ):
            blocks.append((kind, size * part, size * (part + 1)))
    blocks += [(k, 80, others) for k in OTHER_RATES] + [
        ("step", 200, steps),
        ("ramp", 200, ramps),
        ("lost", 200, lost),
        ("ours", 200, years),
    ]
    return [(kind, i) for kind, begin, end in blocks for i in range(begin, min(end, most[kind]))]


def decider(name: str, seed: int, limit: float | None = None) -> Callable[[], Decider]:
    """A rival's maker of policies; limit: another one than that which was set."""
    if name == MONTHLY:
        return calendar(WEEKS / 12.0)
    limit = LIMITS[name] if limit is None else limit
    return staircase(limit, seed) if name == "ILAC staircase" else ChartRule(CHARTS[name](limit))


def run_task(kind: str, number: int, offset: int) -> dict[str, Any]:
    """One life; a number is the same year, machine and noise for whoever decides about it."""
    shop, seed = workshop(), offset + number
    if kind == "step":
        row = run_step(shop, 300_000 + seed)
    elif kind == "ramp":
        row = run_ramp(shop, 400_000 + seed)
    elif kind == "lost":
        row = run_lost(shop, 600_000 + seed)
    elif kind in OTHER_RATES:
        row = run_year(shop, draw_year(shop, 500_000 + seed, OTHER_RATES[kind]), None, 0)
    else:
        row = run_year(shop, draw_year(shop, seed), None if kind == "ours" else decider(kind, seed), 0)
    return {"kind": kind, "number": number, "limit": LIMITS.get(kind), **row}
