"""Single questions: is a step found at the next check, and when is a worn machine due?"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.year_study.life import SETTINGS, START_S, Life
from benchmarks.year_study.policies import sequential_check
from benchmarks.year_study.truths import (
    TOLERANCE_M,
    WALK,
    Happening,
    MachineYear,
    draw_walk,
    draw_year,
    log_uniform,
    slope,
)
from benchmarks.year_study.workshop import Workshop
from calibration.intervals.drift import WEEK_S
from calibration.intervals.prediction import predict_due
from calibration.intervals.rules import judge_all

SIZES = (1.0, 2.0, 3.0, 4.0, 5.0, 5.5, 6.0, 7.0, 8.0)
QUIET_WEEKS = (10, 40)
LEAST_CHECKS = 20
RAMP_WEEKS = 200


def run_step(shop: Workshop, seed: int) -> dict[str, Any]:
    """One machine, quiet for some weeks; then the same check with a step of each size in one parameter.

    Each size is a life of its own: the same truth and noise until the step.
    """
    rng = np.random.default_rng([16, seed])
    name = str(rng.choice(shop.steppable))
    sign, quiet = float(rng.choice([-1.0, 1.0])), int(rng.integers(*QUIET_WEEKS))
    year = replace(draw_year(shop, seed, 0.0), happenings=())
    life = Life(shop, year, 0)
    for week in range(1, quiet + 1):
        life.go_to(float(week))
        sequential_check(life)
    life.go_to(quiet + 1.0)
    history, state = life.history, life.rng.bit_generator.state
    found = []
    for size in (0.0, *SIZES):
        life.history, life.rng.bit_generator.state = history, state
        by = sign * size * shop.sigma[name]
        life.plant.move(name, by)
        sequential_check(life)
        verdict = judge_all(life.history, SETTINGS, life.now_s)
        found.append(verdict.state != "fit")
        life.plant.move(name, -by)
    return {"seed": seed, "name": name, "quiet": quiet, "found": found}


def run_ramp(shop: Workshop, seed: int) -> dict[str, Any]:
    """One machine that wears and is only watched: the date predicted when half the tolerance is used, and the true one.

    Half the tolerance is used when the error that is not the temperature's is half the tolerance; the date is
    that at which the whole error leaves it. At least 20 checks come before; wear begins after 12 to 30 weeks.
    """
    rng = np.random.default_rng([17, seed])
    name, years = str(rng.choice(shop.steppable)), log_uniform(rng, 0.3, 3.0)
    begins = float(rng.uniform(12.0, 30.0))
    sign = float(rng.choice([-1.0, 1.0]))
    quiet = draw_year(shop, seed, 0.0, RAMP_WEEKS)
    wear = Happening(begins, "ramp", ((name, sign * slope(shop, name, years)),), name)
    year = MachineYear(seed, (wear,), quiet.reseats, draw_walk(shop, rng, RAMP_WEEKS), quiet.phase)
    life = Life(shop, year, 0)
    out: dict[str, Any] = {"seed": seed, "name": name, "life_weeks": years * 52.18, "begins": begins}
    per_change = shop.check_design.error_per_change[shop.watched.names.index(name)]
    for week in range(1, RAMP_WEEKS + 1):
        life.go_to(float(week))
        worn_m = abs(wear.changes[0][1]) * max(0.0, week - begins) * per_change
        if "predicted" not in out:
            sequential_check(life)
            if worn_m >= 0.5 * TOLERANCE_M and len(life.history.checks) >= LEAST_CHECKS:
                out["predicted"] = week
                out |= _dates(life)
        if life.true_error_m() > TOLERANCE_M:
            out["left"] = float(week)
            break
    return out


def _dates(life: Life) -> dict[str, float | None]:
    found = predict_due(life.history, life.now_s, SETTINGS.drift, SETTINGS.prediction)
    assert found is not None
    dates = {
        "due": found.due_utc_s, "early": found.early_utc_s, "late": found.late_utc_s, "act_by": found.act_by_utc_s
    }  # fmt: skip
    return {k: None if t is None else (t - START_S) / WEEK_S for k, t in dates.items()} | {"wear": found.trend}


def settings() -> dict[str, Any]:
    """For the results' file."""
    return {"sizes": SIZES, "quiet_weeks": QUIET_WEEKS, "walk": WALK}
