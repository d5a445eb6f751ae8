"""Trapezoidal motion profiles, in closed form, with the following error along them.

Any consistent unit of length; the drives use increments. Not modelled: jerk limits, ripple, overshoot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mock_devices.drives.following_error import decay, following_error_after


@dataclass(frozen=True)
class Phase:
    """Constant acceleration from `start_s` after the start of the profile; `following_error` is that at `start_s`."""

    start_s: float
    duration_s: float
    x: float
    v: float
    a: float
    following_error: float


@dataclass(frozen=True)
class Profile:
    """A motion that starts at time 0 and is at rest at `target` from `duration_s` on."""

    phases: tuple[Phase, ...]
    target: float
    duration_s: float
    final_following_error: float

    def at(self, t_s: float) -> tuple[float, float, float]:
        """Commanded position, velocity and acceleration."""
        if t_s >= self.duration_s:
            return self.target, 0.0, 0.0
        phase = self._phase(t_s)
        dt = max(t_s, 0.0) - phase.start_s
        return phase.x + dt * (phase.v + 0.5 * phase.a * dt), phase.v + phase.a * dt, phase.a

    def following_error(self, t_s: float) -> float:
        """Commanded minus actual position; it has decayed some 0.1 s after the end."""
        if t_s >= self.duration_s:
            return self.final_following_error * decay(t_s - self.duration_s)
        phase = self._phase(t_s)
        return following_error_after(phase.v, phase.a, phase.following_error, max(t_s, 0.0) - phase.start_s)

    def _phase(self, t_s: float) -> Phase:
        for phase in self.phases:
            if t_s < phase.start_s + phase.duration_s:
                return phase
        return self.phases[-1]


def standstill(x: float, following_error: float = 0.0) -> Profile:
    """Standstill, with the remaining following error of the previous motion."""
    return Profile((), x, 0.0, following_error)


def move(
    x: float,
    v: float,
    target: float,
    *,
    speed: float,
    acceleration: float,
    deceleration: float,
    following_error: float = 0.0,
) -> Profile:
    """The quickest trapezoid from position x and velocity v to rest at `target`.

    If the target cannot be reached without reversing, it decelerates to rest first.
    """
    builder = _Builder(x, v, following_error)
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
    return builder.build(target)


def decelerate_to_rest(x: float, v: float, *, deceleration: float, following_error: float = 0.0) -> Profile:
    """Come to rest with the given deceleration."""
    builder = _Builder(x, v, following_error)
    builder.add(abs(v) / deceleration, -math.copysign(deceleration, v))
    return builder.build(x + v * abs(v) / (2.0 * deceleration))


class _Builder:
    """Appends phases one to another."""

    def __init__(self, x: float, v: float, following_error: float) -> None:
        self.x, self.v, self.following_error, self.t_s = x, v, following_error, 0.0
        self.phases: list[Phase] = []

    def add(self, duration_s: float, a: float) -> None:
        if duration_s <= 0.0:
            return
        self.phases.append(Phase(self.t_s, duration_s, self.x, self.v, a, self.following_error))
        self.following_error = following_error_after(self.v, a, self.following_error, duration_s)
        self.x += duration_s * (self.v + 0.5 * a * duration_s)
        self.v += a * duration_s
        self.t_s += duration_s

    def build(self, target: float) -> Profile:
        return Profile(tuple(self.phases), target, self.t_s, self.following_error)
