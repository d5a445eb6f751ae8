"""Control charts of standardised values (mean 0, standard deviation 1 in control): Shewhart, EWMA, CUSUM.

A chart's average run length (ARL) is the mean number of checks until it alarms, counted from its start (zero state).
Those of EWMA and CUSUM solve an integral equation of the second kind by Gauss-Legendre quadrature (Crowder 1987;
Page 1954), that of Shewhart is closed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from calibration.base.arrays import Array
from calibration.base.errors import InputError

_NODES = 81
_HIGHEST_LIMIT = 12.0


@dataclass(frozen=True)
class ChartRun:
    """A chart over values (n,): its statistic (n,), its limit at each (n,), and the first alarm's index, or None."""

    statistic: Array
    limit: Array

    @property
    def alarms(self) -> Array:
        """Whether each is beyond its limit (n,), as 0 or 1."""
        return (np.abs(self.statistic) > self.limit).astype(np.float64)

    @property
    def first_alarm(self) -> int | None:
        """Index of the first value beyond its limit."""
        beyond = np.flatnonzero(self.alarms)
        return int(beyond[0]) if beyond.size else None


@dataclass(frozen=True)
class Shewhart:
    """Alarms when a value lies further than `limit` from zero."""

    limit: float

    def __post_init__(self) -> None:
        _above_zero("Shewhart", limit=self.limit)

    def run(self, values: Array) -> ChartRun:
        """The chart over values (n,)."""
        v = _values(values)
        return ChartRun(v, np.full(v.shape, self.limit))

    def average_run_length(self, shift: float = 0.0) -> float:
        """ARL when the mean is `shift`: 1 / P(|value| > limit)."""
        return 1.0 / float(ndtr(-self.limit - shift) + ndtr(-self.limit + shift))


@dataclass(frozen=True)
class Ewma:
    """Exponentially weighted moving average, weight in (0, 1] of the newest value (Roberts 1959).

    Alarms when it lies further from zero than `limit` of its own standard deviations. steady: with the standard
    deviation of long runs from the first value on, as published run lengths have it; else with the exact one.
    """

    weight: float
    limit: float
    steady: bool = False

    def __post_init__(self) -> None:
        _above_zero("EWMA", limit=self.limit, weight=self.weight)
        if self.weight > 1.0:
            raise InputError(f"EWMA: weight {self.weight} is above 1: choose one in (0, 1]")

    def run(self, values: Array) -> ChartRun:
        """The chart over values (n,), begun at zero."""
        v = _values(values)
        statistic = np.empty_like(v)
        last = 0.0
        for i, value in enumerate(v):
            last += self.weight * (value - last)
            statistic[i] = last
        age = np.full(v.size, np.inf) if self.steady else np.arange(1.0, v.size + 1.0)
        return ChartRun(statistic, self.limit * self._sd * np.sqrt(1.0 - (1.0 - self.weight) ** (2.0 * age)))

    @property
    def _sd(self) -> float:
        return float(np.sqrt(self.weight / (2.0 - self.weight)))

    def average_run_length(self, shift: float = 0.0) -> float:
        """ARL with the steady limits when the mean is `shift` (Crowder 1987)."""
        edge = self.limit * self._sd
        if self.weight == 1.0:
            return Shewhart(self.limit).average_run_length(shift)
        node, share = np.polynomial.legendre.leggauss(_NODES)
        node, share = node * edge, share * edge
        step = (node[None, :] - (1.0 - self.weight) * node[:, None]) / self.weight - shift
        kernel = share / self.weight * _density(step)
        length = np.linalg.solve(np.eye(_NODES) - kernel, np.ones(_NODES))
        return float(1.0 + share / self.weight @ (_density(node / self.weight - shift) * length))


@dataclass(frozen=True)
class Cusum:
    """Two one-sided cumulative sums of what exceeds `reference` (Page 1954); alarms when one is above `limit`."""

    reference: float
    limit: float

    def __post_init__(self) -> None:
        _above_zero("CUSUM", limit=self.limit)
        if self.reference < 0.0:
            raise InputError(f"CUSUM: reference {self.reference} is below zero")

    def run(self, values: Array) -> ChartRun:
        """The chart over values (n,), both sums begun at zero; the statistic is the larger of them, with its sign."""
        v = _values(values)
        statistic = np.empty_like(v)
        up = down = 0.0
        for i, value in enumerate(v):
            up = max(0.0, up + value - self.reference)
            down = max(0.0, down - value - self.reference)
            statistic[i] = up if up >= down else -down
        return ChartRun(statistic, np.full(v.shape, self.limit))

    def average_run_length(self, shift: float = 0.0) -> float:
        """ARL of both sums when the mean is `shift`: their alarm rates add up (Kemp 1961)."""
        return 1.0 / (1.0 / self._one_sided(shift) + 1.0 / self._one_sided(-shift))

    def _one_sided(self, shift: float) -> float:
        """L(s) = 1 + Phi(reference - s - shift) L(0) + integral over (0, limit) of phi(x + reference - s - shift) L."""
        node, share = np.polynomial.legendre.leggauss(_NODES)
        node, share = 0.5 * self.limit * (node + 1.0), 0.5 * self.limit * share
        at = np.concatenate([[0.0], node])
        back = self.reference - shift
        kernel = np.empty((at.size, at.size))
        kernel[:, 0] = ndtr(back - at)
        kernel[:, 1:] = share * _density(node[None, :] + back - at[:, None])
        return float(np.linalg.solve(np.eye(at.size) - kernel, np.ones(at.size))[0])


Chart = Shewhart | Ewma | Cusum


def limit_for(make: Callable[[float], Chart], arl: float) -> float:
    """The limit that gives a chart the in-control average run length `arl`; make: the chart of a limit.

    Raises InputError if no limit below 12 does.
    """
    low = 1e-3

    def excess(limit: float) -> float:
        return float(np.log(make(limit).average_run_length() / arl))

    high = 0.5
    while high < _HIGHEST_LIMIT and excess(high) < 0.0:
        low, high = high, high * 1.25
    if excess(low) > 0.0 or excess(high) < 0.0:
        raise InputError(f"control chart: no limit gives an average run length of {arl:g} checks")
    return float(brentq(excess, low, high, xtol=1e-10))


def _density(x: Array) -> Array:
    return np.asarray(np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi))


def _values(values: Array) -> Array:
    v = np.asarray(values, dtype=np.float64)
    if v.ndim != 1 or not np.all(np.isfinite(v)):
        raise InputError("control chart: values must be one row of finite numbers")
    return v


def _above_zero(where: str, **values: float) -> None:
    for name, value in values.items():
        if not value > 0.0:
            raise InputError(f"{where}: {name} is {value}: it must be above zero")
