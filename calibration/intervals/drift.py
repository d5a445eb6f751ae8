"""What is expected of the next check: each watched change as a random walk with an effect of temperature.

A Kalman filter over all checks of one machine. State of each watched change: its level since the calibration in force
and its temperature coefficient. A calibration takes the level back to zero, within its own uncertainty, and leaves the
coefficient as it is known; another instrument makes the level uncertain, so that it never looks like a change of the
machine.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.intervals.facts import CheckFact, MachineHistory

WEEK_S = 7.0 * 86400.0


@dataclass(frozen=True)
class DriftSettings:
    """How a machine drifts without any event, in standard uncertainties of a check with `full_poses` poses.

    walk_per_sqrt_week: random walk; per_k: standard deviation of the temperature coefficients, 1/K;
    instrument: standard deviation of a level's shift when the instrument is another one.
    """

    walk_per_sqrt_week: float = 0.2
    per_k: float = 0.3
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
    machine (not the first one of another instrument). state (2 w,) and covariance: levels, then temperature
    coefficients, in multiples of unit (w,).
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
        w = len(self.unit)
        return self.state[:w] * self.unit, np.sqrt(np.diag(self.covariance)[:w]) * self.unit

    def per_k(self) -> tuple[Array, Array]:
        """Temperature coefficients (w,) of the changes, and their standard uncertainty."""
        w = len(self.unit)
        return self.state[w:] * self.unit, np.sqrt(np.diag(self.covariance)[w:]) * self.unit


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
    run = _Run(checks[0], settings)
    innovations, judged = [], []
    for check in checks:
        same = run.go_to(history, check)
        innovations.append(run.update(check))
        judged.append(same)
    return DriftTrack(
        checks, np.array(innovations), tuple(judged), run.kf.x.copy(), run.kf.P.copy(), run.unit, settings
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
    run = _Run(checks[0] if checks else like, settings)
    for check in checks:
        run.go_to(history, check)
        run.update(check)
    run.go_to(history, like)
    return run.expectation(like)


class _Run:
    """One pass of the filter; values in units of the first check's uncertainty with all poses."""

    def __init__(self, first: CheckFact, settings: DriftSettings) -> None:
        self.settings = settings
        self.unit = np.asarray(first.change_u) * np.sqrt(first.poses / settings.full_poses)
        w = len(first.watched)
        self.kf = KalmanFilter(dim_x=2 * w, dim_z=w)
        self.kf.x = np.zeros(2 * w)
        self.kf.P = np.diag([0.0] * w + [settings.per_k**2] * w)
        self.kf.F = np.eye(2 * w)
        self._last: CheckFact | None = None

    def go_to(self, history: MachineHistory, check: CheckFact) -> bool:
        """Predict to a check; whether its instrument is that of the check before, or of the calibration."""
        w, last = len(self.unit), self._last
        calibration = next(c for c in history.calibrations if c.id == check.calibration)
        anew = last is None or last.calibration != check.calibration
        since_s = calibration.t_utc_s if last is None or anew else last.t_utc_s
        known = calibration.instrument if last is None or anew else last.instrument
        if anew:
            self.kf.x[:w] = 0.0
            self.kf.P[:w, :] = 0.0
            self.kf.P[:, :w] = 0.0
            self.kf.P[:w, :w] = np.diag((np.asarray(check.reference_u) / self.unit) ** 2)
        variance = self.settings.walk_per_sqrt_week**2 * (check.t_utc_s - since_s) / WEEK_S
        if check.instrument != known:
            variance += self.settings.instrument**2
        self.kf.Q = np.diag([variance] * w + [0.0] * w)
        self.kf.predict()
        warmer_k = check.temperature_c - calibration.temperature_c
        self.kf.H = np.concatenate([np.eye(w), warmer_k * np.eye(w)], axis=1)
        return check.instrument == known

    def expectation(self, check: CheckFact) -> Expectation:
        mean = self.kf.H @ self.kf.x
        variance = np.einsum("wi,ij,wj->w", self.kf.H, self.kf.P, self.kf.H)
        if len(mean) != len(check.watched):
            raise InputError(f"check {check.id}: watches other changes than the machine's history")
        return Expectation(mean * self.unit, np.maximum(variance, 0.0) * self.unit**2)

    def update(self, check: CheckFact) -> Array:
        """Take a check in; its standardised innovations (w,)."""
        found, u = np.asarray(check.change), np.asarray(check.change_u)
        innovation = self.expectation(check).standardised(found, u)
        self.kf.update(found / self.unit, R=np.diag((u / self.unit) ** 2))
        self._last = check
        return innovation
