"""Who decides when to calibrate: the project's rules, and rivals that do without them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.year_study.life import SETTINGS, Life
from benchmarks.year_study.truths import TOLERANCE_M, WEEKS, MachineYear
from benchmarks.year_study.workshop import LOOKS, Workshop
from calibration.intervals.charts import Chart, Cusum, Ewma, Shewhart
from calibration.intervals.decision import decide
from calibration.intervals.health import health_test
from calibration.intervals.rules import Verdict, judge_all

Decider = Callable[[Life], str]  # calibrates if it decides to; why, or nothing


def sequential_check(life: Life) -> None:
    """A check that stops when it can decide, into the history."""
    residual, known_m, mean_c = life.read_check()
    last = len(LOOKS) - 1
    planned = life.check_fact(last, life.shop.look(last, residual, known_m), known_m, mean_c)
    test = health_test(life.history, SETTINGS, planned)
    for look in range(len(LOOKS)):
        found = life.shop.look(look, residual, known_m)
        if test.answer(look, found.change, found.change_u) != "go on":
            break
    fact = life.check_fact(look, found, known_m, mean_c)
    life.history = life.history.with_check(fact)
    life.hours += fact.duration_s / 3600.0


def ours(life: Life) -> str:
    """Check, all rules, the least measurement that they ask for."""
    sequential_check(life)
    verdict: Verdict = judge_all(life.history, SETTINGS, life.now_s)
    life.scores.setdefault("poses", []).append(life.history.checks[-1].poses)
    if verdict.measurement is None:
        return ""
    life.scores.setdefault("due", []).append([r.rule for r in verdict.results if r.state != "fit"])
    note(life)
    life.calibrate(verdict.measurement.extent)
    return verdict.results[0].rule


def note(life: Life) -> None:
    """Whether a decision to calibrate was a false alarm: no event since the last full one, error in tolerance."""
    false = not life.eventful and life.true_error_m() <= TOLERANCE_M
    life.scores["false_alarms"] = life.scores.get("false_alarms", 0) + int(false)
    life.scores.setdefault("false", []).append(false)


def _event(life: Life) -> bool:
    return bool(life.history.events_since_calibration())


def calendar(interval_weeks: float) -> Callable[[], Decider]:
    """A full calibration every so many weeks, and after an event that devices notice."""

    def make() -> Decider:
        due = [interval_weeks]

        def decide_now(life: Life) -> str:
            late = life.week + 0.5 >= due[0]
            if not late and not _event(life):
                return ""
            if late:
                due[0] += interval_weeks
            note(life)
            life.calibrate("full")
            return "calendar"

        return decide_now

    return make


def staircase(start_weeks: float, seed: int) -> Callable[[], Decider]:
    """ILAC-G24 method 1: the interval grows when the machine was found in tolerance, and shrinks when it was not.

    The year begins somewhere within the first interval.
    """

    def make() -> Decider:
        begun = float(np.random.default_rng([18, seed]).uniform(0.0, start_weeks))
        state = {"interval": start_weeks, "due": start_weeks - begun}

        def decide_now(life: Life) -> str:
            late = life.week + 0.5 >= state["due"]
            if not late and not _event(life):
                return ""
            note(life)
            life.calibrate("full")
            last = life.history.last_calibration
            assert last is not None
            assert last.as_found is not None
            if late:
                state["interval"] *= 1.25 if last.as_found.position_m <= TOLERANCE_M else 0.6
            state["due"] = life.week + state["interval"]
            return "staircase"

        return decide_now

    return make


@dataclass(frozen=True)
class ChartRule:
    """A weekly check with all poses, one chart a watched change, its limit common to all; events, and the tolerance."""

    chart: Chart

    def __call__(self) -> Decider:
        """A new one, for another life."""
        rows: list[np.ndarray] = []
        of: list[str] = [""]

        def decide_now(life: Life) -> str:
            residual, known_m, mean_c = life.read_check()
            last = len(LOOKS) - 1
            found = life.shop.look(last, residual, known_m)
            fact = life.check_fact(last, found, known_m, mean_c)
            life.history = life.history.with_check(fact)
            life.hours += fact.duration_s / 3600.0
            if fact.calibration != of[0]:
                rows.clear()
                of[0] = fact.calibration
            rows.append(fact.standardised())
            values = np.array(rows)
            alarm = any(bool(self.chart.run(column).alarms[-1]) for column in values.T)
            out = decide(fact.error, TOLERANCE_M).verdict == "does not conform"
            if not (alarm or out or _event(life)):
                return ""
            note(life)
            life.calibrate("full")
            return "chart"

        return decide_now


CHARTS: dict[str, Callable[[float], Chart]] = {
    "Shewhart": Shewhart,
    "EWMA": lambda limit: Ewma(0.2, limit),
    "CUSUM": lambda limit: Cusum(0.5, limit),
}


def run_year(shop: Workshop, year: MachineYear, make: Callable[[], Decider] | None, noise: int) -> dict[str, Any]:
    """A year under a policy (None: ours); everything that is scored."""
    life = Life(shop, year, noise)
    act = ours if make is None else make()
    out_weeks, checked = 0.0, 0
    for week in range(1, WEEKS + 1):
        struck = [h.week for h in year.happenings if h.kind != "ramp" and week - 1 < h.week <= week]
        life.go_to(float(week))
        if life.true_error_m() > TOLERANCE_M:
            out_weeks += week - struck[0] if struck else 1.0
        checked += not life.eventful
        act(life)
    return {
        "seed": year.seed,
        "eventless": year.eventless,
        "hours": life.hours,
        "out_weeks": out_weeks,
        "quiet_weeks": checked,
        "false_alarms": life.scores.get("false_alarms", 0),
        "due": life.scores.get("due", []),
        "false": life.scores.get("false", []),
        "poses": life.scores.get("poses", []),
        "calibrations": life.calibrations - 1,
        "activations": life.activations,
    }
