"""What is expected of the next check: each watched change as a random walk with an effect of temperature.

A Kalman filter over all checks of one machine. State of each watched change: its level since the calibration in force
and its temperature coefficient. A calibration takes the level back to zero, within its own uncertainty, and leaves the
coefficient as it is known; another instrument makes the level uncertain, so that it never looks like a change of the
machine.
"""

from __future__ import annotations

from collections import deque
from copy import copy
from dataclasses import dataclass
from operator import is_

import numpy as np

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.intervals.facts import CalibrationFact, CheckFact, MachineHistory
from calibration.intervals.kalman import Filters

WEEK_S = 7.0 * 86400.0


@dataclass(frozen=True)
class DriftSettings:
    """How a machine drifts without any event, in standard uncertainties of a check with `full_poses` poses.

    walk_per_sqrt_week: random walk; per_k: standard deviation of the temperature coefficients, 1/K;
    instrument: standard deviation of a level's shift when the instrument is another one.
    """

    walk_per_sqrt_week: float = 0.2
    per_k: float = 0.15
    instrument: float = 5.0
    full_poses: int = 12

    def __post_init__(self) -> None:
        if min(self.walk_per_sqrt_week, self.per_k, self.instrument) < 0.0 or self.full_poses < 1:
            raise InputError("drift: settings must not be below zero, and a check has at least one pose")


@dataclass(frozen=True)
class Expectation:
    """Mean (w,) and variance (w,) of the changes that a check would find, before its own uncertainty."""

    mean: Array
    variance: Array

    def standardised(self, change: Array, change_u: Array) -> Array:
        """Found changes (w,) less the expected ones, in standard deviations of the difference."""
        return np.asarray((change - self.mean) / np.sqrt(change_u**2 + self.variance))


@dataclass(frozen=True)
class DriftTrack:
    """The filter after the last check.

    innovations (n, w): standardised, one row a check of `checks`; judged (n,): whether a row can tell a change of the
    machine (not the first one of another instrument). state (w, 2) and covariance (w, 2, 2): level and temperature
    coefficient of each, in multiples of unit (w,).
    """

    checks: tuple[CheckFact, ...]
    innovations: Array
    judged: tuple[bool, ...]
    state: Array
    covariance: Array
    unit: Array
    settings: DriftSettings

    def level(self) -> tuple[Array, Array]:
        """Changes (w,) since the calibration at its temperature, and their standard uncertainty."""
        return self.state[:, 0] * self.unit, np.sqrt(self.covariance[:, 0, 0]) * self.unit

    def per_k(self) -> tuple[Array, Array]:
        """Temperature coefficients (w,) of the changes, and their standard uncertainty."""
        return self.state[:, 1] * self.unit, np.sqrt(self.covariance[:, 1, 1]) * self.unit


def followed_checks(history: MachineHistory) -> tuple[CheckFact, ...]:
    """Checks that watch what the last one watches: older ones with other names begin another history."""
    if not history.checks:
        return ()
    names = history.checks[-1].watched
    first = max((i + 1 for i, c in enumerate(history.checks) if c.watched != names), default=0)
    return history.checks[first:]


def follow(history: MachineHistory, settings: DriftSettings) -> DriftTrack | None:
    """The filter over all checks of a history; None if there is none yet."""
    checks = followed_checks(history)
    if not checks:
        return None
    run = _followed(history, checks, settings)
    filters = run.filters
    return DriftTrack(
        checks, np.array(run.innovations), tuple(run.judged), filters.mean, filters.covariance, run.unit, settings
    )


def expect(
    history: MachineHistory,
    settings: DriftSettings,
    like: CheckFact,
) -> Expectation:
    """What a check `like` this one (its time, temperature, calibration, instrument) is expected to find.

    Only its watched names, reference_u and change_u with its poses count of what it found itself. Checks stored at or
    after it are left out.
    """
    before = [c for c in history.checks if c.t_utc_s < like.t_utc_s and c.id != like.id]
    first = max((i + 1 for i, c in enumerate(before) if c.watched != like.watched), default=0)
    checks = before[first:]
    run = _followed(history, tuple(checks), settings) if checks else _Run(like, settings)
    run.go_to(history, like)
    return run.expectation(like)


_MEMORY: deque[_Run] = deque(maxlen=4)


def _followed(history: MachineHistory, checks: tuple[CheckFact, ...], settings: DriftSettings) -> _Run:
    """The filter after some checks, at least one; it goes on from a pass over the first of them, if one is remembered.

    Facts never change, so that whether one is remembered changes nothing but the time it takes.
    """
    known = [run for run in tuple(_MEMORY) if run.begins(history, checks, settings)]
    run = max(known, key=lambda r: len(r.seen)).copy() if known else _Run(checks[0], settings)
    for check in checks[len(run.seen) :]:
        run.judged.append(run.go_to(history, check))
        run.innovations.append(run.update(check))
    run.calibrations = history.calibrations
    if not any(len(one.seen) == len(run.seen) for one in known):
        _MEMORY.append(run.copy())
    return run


class _Run:
    """One pass of the filter; values in units of the first check's uncertainty with all poses."""

    def __init__(self, first: CheckFact, settings: DriftSettings) -> None:
        self.settings = settings
        self.unit = np.asarray(first.change_u) * np.sqrt(first.poses / settings.full_poses)
        w = len(first.watched)
        self.filters = Filters(np.zeros((w, 2)), np.tile(np.diag([0.0, settings.per_k**2]), (w, 1, 1)))
        self._row = np.array([1.0, 0.0])
        self._last: CheckFact | None = None
        self.seen: tuple[CheckFact, ...] = ()
        self.calibrations: tuple[CalibrationFact, ...] = ()
        self.innovations: list[Array] = []
        self.judged: list[bool] = []

    def copy(self) -> _Run:
        """One that goes its own way from here."""
        other = copy(self)
        other.filters = Filters(self.filters.mean.copy(), self.filters.covariance.copy())
        other.innovations, other.judged = list(self.innovations), list(self.judged)
        return other

    def begins(self, history: MachineHistory, checks: tuple[CheckFact, ...], settings: DriftSettings) -> bool:
        """Whether this was a pass over the first of these very checks, with these very calibrations."""
        return (
            0 < len(self.seen) <= len(checks)
            and len(self.calibrations) <= len(history.calibrations)
            and all(map(is_, self.seen, checks))
            and all(map(is_, self.calibrations, history.calibrations))
            and settings == self.settings
        )

    def go_to(self, history: MachineHistory, check: CheckFact) -> bool:
        """Predict to a check; whether its instrument is that of the check before, or of the calibration."""
        last = self._last
        calibration = next(c for c in history.calibrations if c.id == check.calibration)
        anew = last is None or last.calibration != check.calibration
        since_s = calibration.t_utc_s if last is None or anew else last.t_utc_s
        known = calibration.instrument if last is None or anew else last.instrument
        if anew:
            self.filters.mean[:, 0] = 0.0
            self.filters.covariance[:, 0, :] = 0.0
            self.filters.covariance[:, :, 0] = 0.0
            self.filters.covariance[:, 0, 0] = (np.asarray(check.reference_u) / self.unit) ** 2
        variance = self.settings.walk_per_sqrt_week**2 * (check.t_utc_s - since_s) / WEEK_S
        if check.instrument != known:
            variance += self.settings.instrument**2
        self.filters.add(np.tile([variance, 0.0], (len(self.unit), 1)))
        self._row = np.array([1.0, check.temperature_c - calibration.temperature_c])
        return check.instrument == known

    def expectation(self, check: CheckFact) -> Expectation:
        """What a check would find, after `go_to`."""
        if len(self.unit) != len(check.watched):
            raise InputError(f"check {check.id}: watches other changes than the machine's history")
        mean, variance = self.filters.expected(self._row)
        return Expectation(mean * self.unit, variance * self.unit**2)

    def update(self, check: CheckFact) -> Array:
        """Take a check in; its standardised innovations (w,)."""
        found, u = np.asarray(check.change) / self.unit, np.asarray(check.change_u) / self.unit
        innovation, variance = self.filters.update(self._row, found, u**2)
        self._last = check
        self.seen = (*self.seen, check)
        return np.asarray(innovation / np.sqrt(variance))
