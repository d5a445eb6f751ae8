"""Rules that say when calibration is due: pure functions of stored facts and a time, each with its reason in words."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calibration.base.errors import InputError
from calibration.intervals.decision import decide
from calibration.intervals.extent import Measurement, what_to_measure
from calibration.intervals.facts import CheckFact, MachineHistory
from calibration.intervals.health import health_test
from calibration.intervals.prediction import DuePrediction, predict_due
from calibration.intervals.sequential import BoundedLooks
from calibration.intervals.settings import IntervalSettings
from calibration.intervals.validity import comparable, require_clock, require_tolerance

State = Literal["fit", "due", "out of tolerance"]
STATES: tuple[State, ...] = ("fit", "due", "out of tolerance")
EXIT_STATUS = {"fit": 0, "due": 10, "out of tolerance": 1}


@dataclass(frozen=True)
class RuleResult:
    """What one rule says, and why."""

    rule: str
    state: State
    reason: str


@dataclass(frozen=True)
class Verdict:
    """What all rules say together: the worst of them, what to measure then, and the prediction.

    due_utc_s: the earliest date known on which calibration falls due by a rule or leaves its tolerance, None if there
    is none in sight.
    """

    state: State
    results: tuple[RuleResult, ...]
    measurement: Measurement | None
    prediction: DuePrediction | None
    due_utc_s: float | None
    remarks: tuple[str, ...]

    @property
    def exit_status(self) -> int:
        """Of `pkm-rig health`: 0 fit, 10 due, 1 out of tolerance."""
        return EXIT_STATUS[self.state]

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons of the rules that do not say fit."""
        return tuple(f"{r.rule}: {r.reason}" for r in self.results if r.state != "fit")


Rule = Callable[[MachineHistory, IntervalSettings, float], RuleResult]


def calendar(history: MachineHistory, settings: IntervalSettings, now_utc_s: float) -> RuleResult:
    """Due when the longest interval since the last full calibration is over, or none was ever made."""
    last = next((c for c in reversed(history.calibrations) if c.extent == "full"), None)
    if last is None:
        return RuleResult("calendar", "due", "no full calibration yet")
    days, most = (now_utc_s - last.t_utc_s) / 86400.0, settings.calendar_s / 86400.0
    words = f"{days:.0f} days since calibration {last.id}, {most:.0f} allowed"
    return RuleResult("calendar", "due" if days >= most else "fit", words)


def operating_hours(history: MachineHistory, settings: IntervalSettings, now_utc_s: float) -> RuleResult:
    """Due when the machine has run longer than allowed since the last full calibration."""
    last = next((c for c in reversed(history.calibrations) if c.extent == "full"), None)
    if last is None:
        return RuleResult("operating hours", "due", "no full calibration yet")
    newest = history.calibrations[-1]
    checked = [c.operating_h for c in history.checks if c.t_utc_s >= newest.t_utc_s]
    hours = checked[-1] if checked else newest.operating_h
    run = hours - last.operating_h
    if run < 0.0:
        raise InputError(f"operating hours: {hours:.1f} h now, {last.operating_h:.1f} h at calibration {last.id}")
    limit = f"{settings.operating_h:.0f} allowed" if math.isfinite(settings.operating_h) else "no limit is stated"
    words = f"{run:.0f} h since calibration {last.id}, {limit}"
    return RuleResult("operating hours", "due" if run >= settings.operating_h else "fit", words)


def temperature(history: MachineHistory, settings: IntervalSettings, now_utc_s: float) -> RuleResult:
    """Due when the machine is further from the temperature of its tables than allowed, at the last check."""
    last, checks = history.last_calibration, history.checks_since_calibration()
    if last is None or not checks:
        return RuleResult("temperature", "fit", "no check since the last calibration")
    away_k = checks[-1].temperature_c - last.temperature_c
    words = f"{away_k:+.1f} K from calibration {last.id}, {settings.temperature_k:.1f} K allowed"
    return RuleResult("temperature", "due" if abs(away_k) >= settings.temperature_k else "fit", words)


def event(history: MachineHistory, settings: IntervalSettings, now_utc_s: float) -> RuleResult:
    """Due when something has happened to the machine since the last calibration."""
    found = history.happened_since_calibration()
    if not found:
        return RuleResult("event", "fit", "nothing has happened")
    words = ", ".join(f"{e.kind} {e.part}".strip() for e in found)
    return RuleResult("event", "due", words)


def check_limit(history: MachineHistory, settings: IntervalSettings, now_utc_s: float) -> RuleResult:
    """Due when the last check found a change beyond its limit, or cannot be shown to conform; out if it does not."""
    checks = history.checks_since_calibration()
    if not checks:
        return RuleResult("check", "fit", "no check since the last calibration")
    last = checks[-1]
    decision = decide(last.error, history.machine.tolerance_m(now_utc_s), settings.probability)
    if decision.verdict == "does not conform":
        return RuleResult("check", "out of tolerance", decision.reason)
    if decision.verdict == "undecided":
        return RuleResult("check", "due", decision.reason)
    test = health_test(history, settings, last)
    size = test.standardised(np.asarray(last.change), np.asarray(last.change_u))
    worst = int(np.argmax(np.abs(size)))
    limit = _limit(test.looks, settings, last)
    mark = " (provisional)" if test.scale.provisional else ""
    off = f"{last.watched[worst]} off by {size[worst]:+.1f} standard deviations, limit {limit:.1f}{mark}"
    words = f"{off}; {decision.reason}"
    same_instrument = _same_instrument(history, last)
    beyond = abs(size[worst]) > limit and same_instrument
    return RuleResult("check", "due" if beyond else "fit", words)


def predicted(history: MachineHistory, settings: IntervalSettings, now_utc_s: float) -> RuleResult:
    """Due when the tolerance would be left before the next slot: the "act by" date is nearer than that."""
    return _predicted(predict_due(history, now_utc_s, settings.drift, settings.prediction), settings, now_utc_s)


def _predicted(found: DuePrediction | None, settings: IntervalSettings, now_utc_s: float) -> RuleResult:
    if found is None:
        return RuleResult("prediction", "fit", "no check since the last calibration")
    before_slot = found.act_by_utc_s is not None and found.act_by_utc_s < now_utc_s + settings.slot_s
    return RuleResult("prediction", "due" if before_slot else "fit", found.reason)


RULES: tuple[Rule, ...] = (calendar, operating_hours, temperature, event, check_limit)


def judge_all(history: MachineHistory, settings: IntervalSettings, now_utc_s: float) -> Verdict:
    """All rules together at a time, on what can be compared with today's machine.

    The worst state counts. Raises InputError if the clock was set back or the tolerance is below 2 U.
    """
    require_clock(history, now_utc_s)
    kept, remarks = comparable(history)
    require_tolerance(kept, now_utc_s)
    prediction = predict_due(kept, now_utc_s, settings.drift, settings.prediction)
    results = (
        *(rule(kept, settings, now_utc_s) for rule in RULES),
        _predicted(prediction, settings, now_utc_s),
    )
    state = max((r.state for r in results), key=STATES.index)
    due = tuple(r.rule for r in results if r.state != "fit")
    measurement = what_to_measure(due, kept.events_since_calibration()) if due else None
    return Verdict(state, results, measurement, prediction, _due(kept, settings, prediction, due, now_utc_s), remarks)


def is_postponed(history: MachineHistory, now_utc_s: float) -> bool:
    """Whether somebody's postponement holds; never beyond its end, nor over an event or check made after it."""
    for one in history.postponements:
        newer = [e for e in history.events if e.t_utc_s > one.t_utc_s]
        if one.t_utc_s <= now_utc_s < one.until_utc_s and not newer:
            return True
    return False


def _due(
    history: MachineHistory,
    settings: IntervalSettings,
    prediction: DuePrediction | None,
    due: tuple[str, ...],
    now_utc_s: float,
) -> float | None:
    if due:
        return now_utc_s
    full = [c.t_utc_s + settings.calendar_s for c in history.calibrations if c.extent == "full"][-1:]
    dates = [*full, *([prediction.due_utc_s] if prediction and prediction.due_utc_s is not None else [])]
    finite = [d for d in dates if np.isfinite(d)]
    return min(finite, default=None)


def _limit(looks: BoundedLooks, settings: IntervalSettings, check: CheckFact) -> float:
    """The upper limit of the look that ended a check: the last one with no more poses."""
    reached = [i for i, n in enumerate(settings.check.looks) if n <= check.poses]
    return float(looks.upper[reached[-1] if reached else 0])


def _same_instrument(history: MachineHistory, check: CheckFact) -> bool:
    """Whether the check before, or the calibration, was made with the same instrument."""
    before = [c for c in history.checks_since_calibration() if c.t_utc_s < check.t_utc_s]
    last = history.last_calibration
    known = before[-1].instrument if before else (last.instrument if last else check.instrument)
    return check.instrument == known
