"""Trapezoidal motion profiles and the servo's lag behind them, in closed form.

Any consistent unit of length; the drives use increments. Not modelled: jerk limits, ripple, overshoot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

LAG_TIME_S = 0.010
LAG_SHARE = 0.05  # what velocity feed-forward leaves of the lag


@dataclass(frozen=True)
class Phase:
    """Constant acceleration from `start_s` after the profile's begin; `lag` is the loop's lag there."""

    start_s: float
    duration_s: float
    x: float
    v: float
    a: float
    lag: float


@dataclass(frozen=True)
class Profile:
    """A motion that begins at time 0 and rests at `target` from `duration_s` on."""

    phases: tuple[Phase, ...]
    target: float
    duration_s: float
    final_lag: float

    def at(self, t_s: float) -> tuple[float, float, float]:
        """Commanded position, velocity and acceleration."""
        if t_s >= self.duration_s:
            return self.target, 0.0, 0.0
        phase = self._phase(t_s)
        dt = max(t_s, 0.0) - phase.start_s
        return phase.x + dt * (phase.v + 0.5 * phase.a * dt), phase.v + phase.a * dt, phase.a

    def lag(self, t_s: float) -> float:
        """Command minus where the servo is; gone some 0.1 s after the end."""
        if t_s >= self.duration_s:
            return self.final_lag * _decay(t_s - self.duration_s)
        phase = self._phase(t_s)
        return _lag_after(phase.v, phase.a, phase.lag, max(t_s, 0.0) - phase.start_s)

    def _phase(self, t_s: float) -> Phase:
        for phase in self.phases:
            if t_s < phase.start_s + phase.duration_s:
                return phase
        return self.phases[-1]


def rest(x: float, lag: float = 0.0) -> Profile:
    """Standing still, with what is left of the lag of the motion before."""
    return Profile((), x, 0.0, lag)


def move(
    x: float, v: float, target: float, *, speed: float, acceleration: float, deceleration: float, lag: float = 0.0
) -> Profile:
    """The quickest trapezoid from position x and velocity v to rest at `target`.

    Where the target cannot be reached without turning, it brakes first and turns.
    """
    builder = _Builder(x, v, lag)
    stop = x + v * abs(v) / (2.0 * deceleration)
    if v != 0.0 and (target - stop) * v < 0.0:
        builder.add(abs(v) / deceleration, -math.copysign(deceleration, v))
        builder.v = 0.0
    sign = math.copysign(1.0, target - builder.x) if builder.v == 0.0 else math.copysign(1.0, builder.v)
    if abs(builder.v) > speed:
        builder.add((abs(builder.v) - speed) / deceleration, -sign * deceleration)
        builder.v = sign * speed
    distance, slow = abs(target - builder.x), abs(builder.v)
    total = 2.0 * acceleration * deceleration * distance + deceleration * slow**2
    peak = max(slow, min(speed, math.sqrt(total / (acceleration + deceleration))))
    covered = (peak**2 - slow**2) / (2.0 * acceleration) + peak**2 / (2.0 * deceleration)
    builder.add((peak - slow) / acceleration, sign * acceleration)
    builder.v = sign * peak
    if peak > 0.0:
        builder.add(max(0.0, distance - covered) / peak, 0.0)
    builder.add(peak / deceleration, -sign * deceleration)
    return builder.done(target)


def brake(x: float, v: float, *, deceleration: float, lag: float = 0.0) -> Profile:
    """Come to rest as quickly as `deceleration` allows."""
    builder = _Builder(x, v, lag)
    builder.add(abs(v) / deceleration, -math.copysign(deceleration, v))
    return builder.done(x + v * abs(v) / (2.0 * deceleration))


class _Builder:
    """Strings phases together."""

    def __init__(self, x: float, v: float, lag: float) -> None:
        self.x, self.v, self.lag, self.t_s = x, v, lag, 0.0
        self.phases: list[Phase] = []

    def add(self, duration_s: float, a: float) -> None:
        if duration_s <= 0.0:
            return
        self.phases.append(Phase(self.t_s, duration_s, self.x, self.v, a, self.lag))
        self.lag = _lag_after(self.v, a, self.lag, duration_s)
        self.x += duration_s * (self.v + 0.5 * a * duration_s)
        self.v += a * duration_s
        self.t_s += duration_s

    def done(self, target: float) -> Profile:
        return Profile(tuple(self.phases), target, self.t_s, self.lag)


def _lag_after(v: float, a: float, lag: float, dt_s: float) -> float:
    """Lag of a first-order loop, e' = LAG_SHARE v - e / LAG_TIME_S, after dt_s of constant acceleration."""

    def forced(t_s: float) -> float:
        return LAG_SHARE * LAG_TIME_S * (v + a * t_s - a * LAG_TIME_S)

    return forced(dt_s) + (lag - forced(0.0)) * _decay(dt_s)


def _decay(dt_s: float) -> float:
    return math.exp(-dt_s / LAG_TIME_S)
