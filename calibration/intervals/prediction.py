"""When a machine will leave its tolerance: random walk, trend and season, followed by a Kalman filter.

The watched change that has moved most is followed alone over the checks of the calibration in force. Wear may have
begun at any time: one filter for each possible beginning, weighted by its likelihood (a static multiple-model filter,
Bar-Shalom et al. 2001), and one without wear. Their mixture gives the probability that the tolerance is left by a date.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from filterpy.kalman import KalmanFilter
from scipy.special import ndtr

from calibration.base.arrays import Array
from calibration.base.errors import InputError
from calibration.intervals.drift import WEEK_S, DriftSettings, follow
from calibration.intervals.facts import CalibrationFact, CheckFact, MachineHistory

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
    allowed = _allowed(calibration, checks[-1], watched, tolerance_m, 0.0)
    components = _components(checks, calibration, watched, allowed, drift, settings)
    ahead_weeks = np.linspace(0.0, settings.horizon_s, 731) / WEEK_S
    warmer_k = forecast_temperature(history, now_utc_s + ahead_weeks * WEEK_S) - calibration.temperature_c
    ahead = _allowed(calibration, checks[-1], watched, tolerance_m, _known_per_k(checks, calibration) * warmer_k)
    walk = (drift.walk_per_sqrt_week * _unit(checks[0], watched, drift)) ** 2
    age_weeks = (now_utc_s - checks[-1].t_utc_s) / WEEK_S
    mixture = _probability_left(components, ahead_weeks + age_weeks, warmer_k, ahead, walk)
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


def _allowed(
    calibration: CalibrationFact, check: CheckFact, watched: int, tolerance_m: float, known_m: Array | float
) -> Array:
    """How far a change may go until the error reaches the tolerance (n,).

    What the calibration left and what is known of temperature (n,) are taken off as squares: different fields over the
    workspace. A quarter of the tolerance is always left.
    """
    per_change = check.error_per_change[watched]
    if per_change <= 0.0:
        raise InputError(f"prediction: {check.watched[watched]} has no effect on the tool: watch others")
    left_m = calibration.as_left.position_m if calibration.as_left else 0.0
    square = tolerance_m**2 - left_m**2 - np.square(known_m)
    return np.asarray(np.sqrt(np.maximum(square, (0.25 * tolerance_m) ** 2)) / per_change)


def _known_per_k(checks: tuple[CheckFact, ...], calibration: CalibrationFact) -> float:
    """Known error a kelvin away from the calibration's temperature: least squares through zero."""
    warmer = np.array([c.temperature_c - calibration.temperature_c for c in checks])
    known = np.array([c.known_error_m for c in checks])
    return float(np.abs(warmer) @ known / max(float(warmer @ warmer), 1e-6))


def _unit(check: CheckFact, watched: int, drift: DriftSettings) -> float:
    return check.change_u[watched] * math.sqrt(check.poses / drift.full_poses)


def _components(
    checks: tuple[CheckFact, ...],
    calibration: CalibrationFact,
    watched: int,
    allowed: Array,
    drift: DriftSettings,
    settings: PredictionSettings,
) -> list[_Component]:
    """One filter without wear and one for each beginning of it, all over the same checks."""
    start = [calibration.t_utc_s, *(c.t_utc_s for c in checks[:-2])]
    chosen = sorted({start[int(i)] for i in np.linspace(0, len(start) - 1, min(settings.beginnings, len(start)))})
    found = [_filter(checks, calibration, watched, None, 0.0, drift)]
    found[0] = _weighted(found[0], 1.0 - settings.trend)
    slope = float(allowed) / settings.fastest_weeks
    for begin_utc_s in chosen:
        one = _filter(checks, calibration, watched, begin_utc_s, slope, drift)
        found.append(_weighted(one, settings.trend / len(chosen)))
    return found


def _weighted(component: _Component, prior: float) -> _Component:
    return _Component(component.log_weight + math.log(prior), component.mean, component.covariance, component.wears)


def _filter(
    checks: tuple[CheckFact, ...],
    calibration: CalibrationFact,
    watched: int,
    begin_utc_s: float | None,
    slope: float,
    drift: DriftSettings,
) -> _Component:
    """Kalman filter of level, temperature coefficient and slope; begin: when wear began, None for never."""
    unit = _unit(checks[0], watched, drift)
    kf = KalmanFilter(dim_x=3, dim_z=1)
    kf.x = np.zeros(3)
    kf.P = np.diag([checks[0].reference_u[watched] ** 2, (drift.per_k * unit) ** 2, slope**2])
    last_s, log_weight = calibration.t_utc_s, 0.0
    for check in checks:
        weeks = (check.t_utc_s - last_s) / WEEK_S
        worn = 0.0 if begin_utc_s is None else max(0.0, check.t_utc_s - max(begin_utc_s, last_s)) / WEEK_S
        kf.F = np.array([[1.0, 0.0, worn], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        kf.Q = np.diag([(drift.walk_per_sqrt_week * unit) ** 2 * weeks, 0.0, 0.0])
        kf.predict()
        kf.H = np.array([[1.0, check.temperature_c - calibration.temperature_c, 0.0]])
        kf.update(np.array([check.change[watched]]), R=check.change_u[watched] ** 2)
        variance, miss = float(kf.S[0, 0]), float(kf.y[0])
        log_weight -= 0.5 * (miss**2 / variance + math.log(variance))
        last_s = check.t_utc_s
    return _Component(log_weight, kf.x.copy(), kf.P.copy(), begin_utc_s is not None)


def _probability_left(
    components: list[_Component], weeks: Array, warmer_k: Array, allowed: Array, walk: float
) -> _Mixture:
    """All hypotheses together, so many weeks (n,) after the last check."""
    log_weight = np.array([c.log_weight for c in components])
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    total, level = np.zeros_like(weeks), 0.0
    for share, part in zip(weight, components, strict=True):
        h = np.stack([np.ones_like(weeks), warmer_k, weeks if part.wears else np.zeros_like(weeks)], axis=1)
        mean = h @ part.mean
        sd = np.sqrt(np.einsum("ni,ij,nj->n", h, part.covariance, h) + walk * weeks)
        beyond = ndtr((mean - allowed) / sd) + ndtr((-mean - allowed) / sd)
        # a random walk that is beyond at the end has an equal chance of having been so and come back (reflection)
        by_then = np.minimum(np.maximum.accumulate(beyond) * (1.0 if part.wears else 2.0), 1.0)
        total += share * by_then
        level += float(share * part.mean[0])
    return _Mixture(total, float(weight[[c.wears for c in components]].sum()), abs(level) / float(allowed[0]))


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
