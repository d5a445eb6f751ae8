"""Forms that are not linear in their parameters, fitted again from several starts.

At every point of a curve its tangent is weighed like any form, calibration taken out, and its coefficients lead to the
next point: Gauss-Newton on the evidence, with a step that is shortened where it does not help.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.evidence import Readout, Weighed, weigh
from calibration.effects.api import Acts, Curve, Form, Tangent

FOLLOWED = 4  # starts that are worth following
STEPS = 8
SHORTEST = 0.05
FARTHEST = 0.7  # in one step, of parameters without a spread of their own
ENOUGH = 0.1  # of log evidence: a step that gains less is the last


@dataclass(frozen=True)
class Refitted:
    """The best point of a curve: its log evidence, its form there with coefficients, its columns."""

    log_evidence: float
    best: Weighed
    acts: tuple[Acts, ...]


def refit(readout: Readout, curves: Sequence[Curve], low: float, high: float) -> Refitted | None:
    """The best of all curves for sizes within limits; a curve is as likely as any other."""
    found = [best for number, curve in enumerate(curves) if (best := _best(readout, number, curve, low, high))]
    return max(found, key=lambda one: one.log_evidence, default=None)


def _best(readout: Readout, number: int, curve: Curve, low: float, high: float) -> Refitted | None:
    known = [_Point.at(readout, number, curve, start, low, high) for start in curve.starts]
    starts = sorted((point for point in known if point is not None), key=lambda point: -point.value)
    ends = [_followed(readout, number, curve, point, low, high) for point in starts[:FOLLOWED]]
    ends = [end for end in ends if end.size > 0.0]  # else the readings ask for the contrary of the effect
    if not ends:
        return None
    top = max(ends, key=lambda point: point.value)
    cost, covariance = _over_the_range(readout, curve, top)
    return Refitted(top.value - cost, replace(top.weighed, covariance=covariance), top.tangent.acts)


def _followed(readout: Readout, number: int, curve: Curve, start: _Point, low: float, high: float) -> _Point:
    farthest = np.where(np.isfinite(curve.spread), curve.spread, FARTHEST)
    here, length = start, 1.0
    for _ in range(STEPS):
        step = here.tangent.step(here.weighed.coefficients)
        there = np.clip(here.place + np.clip(length * step, -farthest, farthest), curve.low, curve.high)
        then = _Point.at(readout, number, curve, there, low, high)
        if then is not None and then.value > here.value + ENOUGH:
            here, length = then, min(1.0, 2.0 * length)
        else:
            length /= 3.0
            if length < SHORTEST:
                break
    return here


def _over_the_range(readout: Readout, curve: Curve, point: _Point) -> tuple[float, Array]:
    """What it costs in log evidence that parameters were free over their whole range, not near the point alone; and the
    covariance of the coefficients (k, k) that goes with it.

    Laplace's approximation: the tangent's information with the priors of the parameters in place of `relative`.
    """
    information = readout.judge(point.tangent.acts).information
    spread = np.where(np.isfinite(curve.spread), curve.spread, (curve.high - curve.low) / np.sqrt(12.0))
    near = np.array(point.tangent.relative)
    wide = np.array([1.0, *np.maximum(spread / point.tangent.units, near[1:])])
    wide[1] = near[1]  # the first parameter goes with the size, which has its own prior

    def posterior(relative: Array) -> tuple[Array, Array]:
        d = point.weighed.size * relative
        return d, np.eye(len(d)) + d[:, None] * information * d

    (_, tight), (d, loose) = posterior(near), posterior(wide)
    cost = 0.5 * float(np.linalg.slogdet(loose)[1] - np.linalg.slogdet(tight)[1])
    return cost, d[:, None] * np.linalg.inv(loose) * d


@dataclass(frozen=True)
class _Point:
    """A point of a curve, its tangent there as a form, and its log evidence with the prior of its parameters."""

    place: Array
    tangent: Tangent
    weighed: Weighed
    value: float

    @property
    def size(self) -> float:
        """The size that the readings ask for."""
        return float(np.dot(self.tangent.size, self.weighed.coefficients[: len(self.tangent.size)]))

    @classmethod
    def at(cls, readout: Readout, number: int, curve: Curve, place: Array, low: float, high: float) -> _Point | None:
        """None where the curve has no finite columns."""
        tangent = curve.tangent(place)
        if not all(np.all(np.isfinite(shape)) for act in tangent.acts for _, shape in act):
            return None
        columns = tuple(range(len(tangent.acts)))
        form = Form(columns, tangent.relative, curve=(number, tuple(place.tolist())), size=tangent.size)
        weighed = weigh(readout.judge(tangent.acts), [form], low, high)[0]
        return cls(place, tangent, weighed, weighed.log_evidence - 0.5 * float(np.sum((place / curve.spread) ** 2)))
