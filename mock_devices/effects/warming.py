"""How warm a part is: courses of warming and cooling, and a part that lags behind its sensor."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from mock_devices.effects.base import Array, Effect, MotionState

AIR = "air"  # the part that is none
CYCLES_S = (1200.0, 3600.0)  # of air that is switched
GRID_S = 30.0
_TERMS = 60


def warm_up(elapsed_s: Array, tau_s: float) -> Array:
    """Share of the final temperature after a time."""
    return np.asarray(1.0 - np.exp(-elapsed_s / tau_s))


def conducted(elapsed_s: Array, tau_s: float) -> Array:
    """Share of the final mean temperature of a bar that is warmed at one end, its sides insulated.

    H. S. Carslaw, J. C. Jaeger, "Conduction of Heat in Solids" (1959), 3.3: it begins with the root of time. tau_s is
    the time constant of the slowest term.
    """
    odd = np.arange(1.0, 2.0 * _TERMS, 2.0)
    return np.asarray(1.0 - 8.0 / np.pi**2 * (np.exp(-np.outer(elapsed_s / tau_s, odd**2)) / odd**2).sum(axis=1))


def cooled(elapsed_s: Array, tau_s: float) -> Array:
    """Share of its first warmth that a part has left in still air: it loses heat with the power 5/4 of its warmth.

    Free convection in W. H. McAdams, "Heat Transmission" (1954): a coefficient with the root of the root of the warmth.
    tau_s is the time constant of the first moment.
    """
    return np.asarray((1.0 + 0.25 * elapsed_s / tau_s) ** -4.0)


def soaked(elapsed_s: Array, tau_s: float) -> tuple[Array, Array]:
    """Mean temperature of a plate that is warmed at one face, and the slope of its profile, both over the face's.

    The other face is insulated. The plate grows by the mean and bends by the slope, 12 times the first moment, as in B.
    A. Boley, J. H. Weiner, "Theory of Thermal Stresses" (1960): the slope rises and is gone when the plate is warm
    throughout. tau_s is the time constant of the slowest term.
    """
    odd = np.arange(1.0, 2.0 * _TERMS, 2.0)
    wave = 0.5 * np.pi * odd
    sine = np.where(odd % 4.0 == 1.0, 1.0, -1.0)
    left = np.exp(-np.outer(elapsed_s / tau_s, odd**2))
    mean = 1.0 - left @ (2.0 / wave**2)
    moment = left @ (2.0 / wave * (sine / wave**2 - 0.5 / wave))
    return mean, np.where(elapsed_s > 0.0, 12.0 * moment, 0.0)


def cycled(elapsed_s: Array, tau_s: float, period_s: float) -> Array:
    """Warmth over its largest of a part in air that cycles as a sine, from the same temperature at the beginning.

    The part lags behind and swings less: the first element of ANSI B89.6.2, "Temperature and Humidity Environment for
    Dimensional Measurement" (1973). The sensor, in the machine's slow air, shows nothing of it.
    """
    rate = 2.0 * math.pi / period_s
    lag = math.atan(rate * tau_s)
    return np.asarray(np.sin(rate * elapsed_s - lag) + math.sin(lag) * np.exp(-elapsed_s / tau_s))


def ahead_of_front(distance_m: Array, deep_m: Array) -> Array:
    """Metres of whole warmth beyond a distance from the warm end of a long bar; deep_m is 2 sqrt(a t).

    The integral of the error function's complement, for an end that is kept warm: H. S. Carslaw, J. C. Jaeger,
    "Conduction of Heat in Solids" (1959), 2.4.
    """
    u = distance_m / deep_m
    left = np.array([math.erfc(x) for x in u.tolist()])
    return np.asarray(deep_m * (np.exp(-(u**2)) / math.sqrt(math.pi) - u * left))


def set_share(elapsed_s: Array, half_s: float, catalyses: float) -> Array:
    """Share of a resin that has set some time after it was mixed; what has set makes the rest set faster.

    The rate of M. R. Kamal, S. Sourour, "Kinetics and Thermal Characterization of Thermoset Cure" (1973), with both
    exponents one: (1 + catalyses a) (1 - a) over a time, which follows from half of it having set after half_s.
    """
    grows = np.expm1(np.minimum(np.log(2.0 + catalyses) / half_s * elapsed_s, 600.0))
    return np.asarray(grows / (1.0 + catalyses + grows))


def grid_from(start_s: float, state: MotionState) -> Array:
    """Times GRID_S apart, from a start to beyond the last of a state."""
    return np.arange(start_s, max(float(state.t_s.max()), start_s) + 2.0 * GRID_S, GRID_S)


def lag_behind(state: MotionState, part: str, start_s: float, tau_s: float) -> Array:
    """A part of time constant tau minus its sensor, or minus the air (n,) in kelvin: first order, equal at first."""
    grid = grid_from(start_s, state)
    sensed = state.thermal.air_series_c(grid) if part == AIR else state.thermal.part_series_c(part, grid)
    keep = math.exp(-GRID_S / tau_s)
    follow = np.empty_like(sensed)
    value = sensed[0]
    for i, now in enumerate(sensed):
        value = now + (value - now) * keep if i else now
        follow[i] = value
    return np.asarray(np.interp(state.t_s, grid, follow - sensed))


def warmed_by(state: MotionState, gives_off: Callable[[Array], Array], start_s: float, tau_s: float) -> Array:
    """Warmth (n,) by heat that has been given off up to a time after a start, which fades with a time constant."""
    grid = grid_from(start_s, state)
    keep, half = math.exp(-GRID_S / tau_s), math.exp(-0.5 * GRID_S / tau_s)
    warm, now = np.zeros_like(grid), 0.0
    for i, adds in enumerate(np.diff(gives_off(grid - start_s)).tolist()):
        now = now * keep + adds * half
        warm[i + 1] = now
    return np.asarray(np.interp(state.t_s, grid, warm))


class ByTurns:
    """Nears one and zero by turns with a time constant, each from the next of some moments on; first one, from zero."""

    def __init__(self, changes_s: Array, tau_s: float) -> None:
        self._begins_s, self._tau_s = np.concatenate([[0.0], changes_s]), tau_s
        self._before = [0.0]
        for k, lasts_s in enumerate(np.diff(self._begins_s).tolist()):
            aim = (k + 1) % 2
            self._before.append(aim + (self._before[-1] - aim) * math.exp(-lasts_s / tau_s))

    def at(self, elapsed_s: Array) -> Array:
        """Where it is after some times (n,)."""
        k = np.searchsorted(self._begins_s, elapsed_s, side="right") - 1
        aim = (k + 1) % 2
        return np.asarray(
            aim + (np.array(self._before)[k] - aim) * np.exp(-(elapsed_s - self._begins_s[k]) / self._tau_s)
        )


class Warming(Effect):
    """The temperature above the sensor, by variant."""

    sensor = "struts"

    def setup(self) -> None:
        """How long a cycle of the air is."""
        self.period_s = float(self.rng.uniform(*CYCLES_S))

    def rise_k(self, state: MotionState) -> Array:
        """The temperature above the sensor (n,)."""
        t, tau = self.elapsed_s(state), self.values["tau_s"]
        if self.variant == "lagging":
            return self.size * lag_behind(state, self.sensor, self.site.start_s, tau)
        if self.variant == "two_stages":
            return self.size * (0.6 * warm_up(t, tau) + 0.4 * warm_up(t, 5.0 * tau))
        share = warm_up(t, tau)
        if self.variant == "conduction":
            share = conducted(t, tau)
        elif self.variant == "still_air":
            share = cooled(t, tau)
        elif self.variant == "cycling_air":
            share = cycled(t, tau, self.period_s)
        elif self.variant == "pulse":  # warmed once, cooling again: a door, a lamp
            return np.asarray(self.size * (t / tau) * np.exp(1.0 - t / tau))
        return self.size * share
