"""When a machine will leave its tolerance: random walk, trend and season, followed by a Kalman filter.

The watched change that has moved most is followed alone over the checks of the calibration in force. Wear may have
begun at any time: one filter for each possible beginning, weighted by its likelihood (a static multiple-model filter,
Bar-Shalom et al. 2001), and one without wear. Their mixture gives the probability that the tolerance is left by a date.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.intervals.drift import WEEK_S, DriftSettings, follow
from calibration.intervals.facts import CalibrationFact, CheckFact, MachineHistory
from calibration.intervals.kalman import Filters

YEAR_S = 365.25 * 86400.0


@dataclass(frozen=True)
class PredictionSettings:
    """How far and how surely is predicted.

    horizon_s: nothing is said beyond; coverage of the interval; act_by: probability that the tolerance is left before
    the "act by" date. trend: prior probability of wear; fastest_weeks: a trend that uses the tolerance within so many
    weeks is one standard deviation of the prior. beginnings: how many of them are tried.
    """

    horizon_s: float = 3.0 * YEAR_S
    coverage: float = 0.95
    act_by: float = 0.01
    trend: float = 0.3
    fastest_weeks: float = 40.0
    beginnings: int = 12

    def __post_init__(self) -> None:
        shares = (self.coverage, self.act_by, self.trend)
        if not all(0.0 < p < 1.0 for p in shares) or min(self.horizon_s, self.fastest_weeks) <= 0.0:
            raise InputError("prediction: probabilities lie between 0 and 1, horizon and weeks are above zero")


@dataclass(frozen=True)
class DuePrediction:
    """When the tolerance is left: median, interval and "act by" date; None beyond the horizon.

    change: the watched change that leads there; used: its share of the tolerance today; trend: probability of wear.
    """

    due_utc_s: float | None
    early_utc_s: float | None
    late_utc_s: float | None
    act_by_utc_s: float | None
    change: str
    used: float
    trend: float
    reason: str


@dataclass(frozen=True)
class _Mixture:
    """Probability (n,) that the tolerance has been left by some times; probability of wear; share used today."""

    left: Array
    wear: float
    used: float


@dataclass(frozen=True)
class _Component:
    """One hypothesis: its log weight; mean (3,), covariance (3, 3) of level, temperature coefficient, slope a week."""

    log_weight: float
    mean: Array
    covariance: Array
    wears: bool


def predict_due(
    history: MachineHistory,
    now_utc_s: float,
    drift: DriftSettings,
    settings: PredictionSettings | None = None,
) -> DuePrediction | None:
    """The prediction at a time, from checks up to it; None while there is no check of the calibration in force."""
    settings = settings or PredictionSettings()
    calibration = history.last_calibration
    checks = tuple(c for c in history.checks_since_calibration() if c.t_utc_s <= now_utc_s)
    track = follow(history, drift)
    if calibration is None or not checks or track is None or track.checks[-1].id != checks[-1].id:
        return None
    checks = tuple(c for c in checks if c.watched == checks[-1].watched and c.instrument == checks[-1].instrument)
    level, level_u = track.level()
    watched = int(np.argmax(np.abs(level) / level_u))
    tolerance_m = history.machine.tolerance_m(now_utc_s)
    limits = _Limits.of(checks, calibration, watched, tolerance_m)
    components = _components(checks, calibration, watched, limits.without_season, drift, settings)
    ahead_weeks = np.linspace(0.0, settings.horizon_s, 731) / WEEK_S
    warmer_k = forecast_temperature(history, now_utc_s + ahead_weeks * WEEK_S) - calibration.temperature_c
    since_last = ahead_weeks + (now_utc_s - checks[-1].t_utc_s) / WEEK_S
    since_calibration = ahead_weeks + (now_utc_s - calibration.t_utc_s) / WEEK_S
    ahead = _Ahead(since_last, since_calibration, warmer_k)
    walk = (drift.walk_per_sqrt_week * _unit(checks[0], watched, drift)) ** 2
    mixture = _probability_left(components, ahead, limits, walk, drift.walk_per_sqrt_week)
    return _dated(checks[-1].watched[watched], now_utc_s, ahead_weeks * WEEK_S, mixture, settings)


def forecast_temperature(history: MachineHistory, t_utc_s: Array) -> Array:
    """Temperatures (n,) expected at times.

    A yearly sine through those of checks and calibrations, once they span half a year, else the last one.
    """
    rows = sorted(
        [(c.t_utc_s, c.temperature_c) for c in history.calibrations]
        + [(c.t_utc_s, c.temperature_c) for c in history.checks]
    )
    if not rows:
        raise InputError("prediction: no temperature has been recorded yet")
    times, values = np.array(rows).T
    if times[-1] - times[0] < 0.5 * YEAR_S or len(rows) < 10:
        return np.full(t_utc_s.shape, values[-1])
    angle = 2.0 * np.pi * times / YEAR_S
    design = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    mean, cosine, sine = np.linalg.lstsq(design, values, rcond=None)[0]
    ahead = 2.0 * np.pi * t_utc_s / YEAR_S
    return np.asarray(mean + cosine * np.cos(ahead) + sine * np.sin(ahead))


@dataclass(frozen=True)
class _Ahead:
    """Times (n,): weeks since the last check, since the calibration, kelvin above the calibration."""

    since_last_weeks: Array
    since_calibration_weeks: Array
    warmer_k: Array


@dataclass(frozen=True)
class _Limits:
    """How far the change may go until the error over the workspace reaches the tolerance.

    The error is a sum of fields over the workspace: what the change does, what is known of the temperature (per kelvin
    and its correlation with the change's), and what the calibration left and other changes add, whose correlation with
    it is unknown (standard deviation 1/sqrt 3).
    """

    tolerance_m: float
    per_change: float
    left_m: float
    per_k_m: float
    alignment: float
    walk_m: float

    @classmethod
    def of(
        cls, checks: tuple[CheckFact, ...], calibration: CalibrationFact, watched: int, tolerance_m: float
    ) -> _Limits:
        """From the checks of a calibration."""
        last = checks[-1]
        per_change = last.error_per_change[watched]
        if per_change <= 0.0:
            raise InputError(f"prediction: {last.watched[watched]} has no effect on the tool: watch others")
        warmer = np.array([c.temperature_c - calibration.temperature_c for c in checks])
        known = np.array([c.known_error_m for c in checks])
        aligned = [c.known_alignment[watched] if c.known_alignment else 0.0 for c in checks]
        weight = max(float(np.abs(warmer) @ known), 1e-12)
        return cls(
            tolerance_m=tolerance_m,
            per_change=per_change,
            left_m=calibration.as_left.position_m if calibration.as_left else 0.0,
            per_k_m=float(np.abs(warmer) @ known / max(float(warmer @ warmer), 1e-6)),
            alignment=float((warmer * known) @ np.array(aligned) / weight),
            walk_m=float(np.median(np.asarray(last.error_per_change) * np.asarray(last.change_u))),
        )

    @property
    def without_season(self) -> float:
        """At the calibration's temperature."""
        square = max(self.tolerance_m**2 - self.left_m**2, (0.25 * self.tolerance_m) ** 2)
        return math.sqrt(square) / self.per_change

    def at(self, warmer_k: Array, sign: float) -> Array:
        """At other temperatures (n,), for a change of a sign: the positive solution of |change + known| = tolerance."""
        known = self.per_k_m * warmer_k
        along = sign * self.alignment * known
        square = self.tolerance_m**2 - self.left_m**2 - known**2 + along**2
        return np.asarray((np.sqrt(np.maximum(square, (0.25 * self.tolerance_m) ** 2)) - along) / self.per_change)

    def sd(self, weeks: Array, walk_per_sqrt_week: float) -> Array:
        """Standard deviation (n,) of the limit: of what else there is, so many weeks after the calibration."""
        other = self.left_m**2 + (walk_per_sqrt_week * self.walk_m) ** 2 * weeks
        return np.asarray(np.sqrt(other / 3.0) / self.per_change)


def _unit(check: CheckFact, watched: int, drift: DriftSettings) -> float:
    return check.change_u[watched] * math.sqrt(check.poses / drift.full_poses)


def _components(
    checks: tuple[CheckFact, ...],
    calibration: CalibrationFact,
    watched: int,
    allowed: float,
    drift: DriftSettings,
    settings: PredictionSettings,
) -> list[_Component]:
    """One filter without wear and one for each beginning of it, all over the same checks."""
    start = [calibration.t_utc_s, *(c.t_utc_s for c in checks[:-2])]
    chosen = sorted({start[int(i)] for i in np.linspace(0, len(start) - 1, min(settings.beginnings, len(start)))})
    begin = np.array([math.inf, *chosen])
    slope = np.where(np.isfinite(begin), allowed / settings.fastest_weeks, 0.0)
    unit = _unit(checks[0], watched, drift)
    filters = Filters(np.zeros((len(begin), 3)), np.zeros((len(begin), 3, 3)))
    filters.covariance[:, 0, 0] = checks[0].reference_u[watched] ** 2
    filters.covariance[:, 1, 1] = (drift.per_k * unit) ** 2
    filters.covariance[:, 2, 2] = slope**2
    prior = np.array([1.0 - settings.trend, *[settings.trend / len(chosen)] * len(chosen)])
    log_weight, last_s = np.log(prior), calibration.t_utc_s
    for check in checks:
        transition = np.tile(np.eye(3), (len(begin), 1, 1))
        transition[:, 0, 2] = np.maximum(0.0, check.t_utc_s - np.maximum(begin, last_s)) / WEEK_S
        walked = (drift.walk_per_sqrt_week * unit) ** 2 * (check.t_utc_s - last_s) / WEEK_S
        filters.predict(transition, np.tile([walked, 0.0, 0.0], (len(begin), 1)))
        row = np.array([1.0, check.temperature_c - calibration.temperature_c, 0.0])
        miss, variance = filters.update(
            row, np.asarray(check.change[watched]), np.asarray(check.change_u[watched] ** 2)
        )
        log_weight = log_weight - 0.5 * (miss**2 / variance + np.log(variance))
        last_s = check.t_utc_s
    return [
        _Component(float(w), mean, covariance, bool(np.isfinite(b)))
        for w, mean, covariance, b in zip(log_weight, filters.mean, filters.covariance, begin, strict=True)
    ]


def _probability_left(
    components: list[_Component], ahead: _Ahead, limits: _Limits, walk: float, walk_per_sqrt_week: float
) -> _Mixture:
    """All hypotheses together. walk: variance of the random walk a week."""
    log_weight = np.array([c.log_weight for c in components])
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    weeks = ahead.since_last_weeks
    high, low = limits.at(ahead.warmer_k, 1.0), limits.at(ahead.warmer_k, -1.0)
    of_limit = limits.sd(ahead.since_calibration_weeks, walk_per_sqrt_week) ** 2
    total, level = np.zeros_like(weeks), 0.0
    for share, part in zip(weight, components, strict=True):
        h = np.stack([np.ones_like(weeks), ahead.warmer_k, weeks if part.wears else np.zeros_like(weeks)], axis=1)
        mean = h @ part.mean
        sd = np.sqrt(np.einsum("ni,ij,nj->n", h, part.covariance, h) + walk * weeks + of_limit)
        beyond = ndtr((mean - high) / sd) + ndtr((-mean - low) / sd)
        # a random walk that is beyond at the end has an equal chance of having been so and come back (reflection)
        by_then = np.minimum(np.maximum.accumulate(beyond) * (1.0 if part.wears else 2.0), 1.0)
        total += share * by_then
        level += float(share * part.mean[0])
    wear = float(weight[[c.wears for c in components]].sum())
    return _Mixture(total, wear, abs(level) / limits.without_season)


def _dated(
    change: str, now_utc_s: float, ahead_s: Array, mixture: _Mixture, settings: PredictionSettings
) -> DuePrediction:
    left, wear, used = mixture.left, mixture.wear, mixture.used

    def date(probability: float) -> float | None:
        reached = np.flatnonzero(left >= probability)
        if not reached.size:
            return None
        i = int(reached[0])
        if i == 0:
            return now_utc_s
        part = (probability - left[i - 1]) / (left[i] - left[i - 1])
        return now_utc_s + float(ahead_s[i - 1] + part * (ahead_s[i] - ahead_s[i - 1]))

    tail = 0.5 * (1.0 - settings.coverage)
    due, act_by = date(0.5), date(settings.act_by)
    words = f"{change} has used {100.0 * used:.0f} % of the tolerance, wear is {100.0 * wear:.0f} % probable"
    if due is not None:
        words += f"; out of tolerance in {(due - now_utc_s) / 86400.0:.0f} days"
    return DuePrediction(due, date(tail), date(1.0 - tail), act_by, change, used, wear, words)
