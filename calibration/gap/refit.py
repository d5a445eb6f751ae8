"""Forms that are not linear in their parameters, fitted again from several starts.

At every point of a curve its tangent is weighed like any form, calibration taken out, and its coefficients lead to the
next point: Gauss-Newton on the evidence, with a step that is shortened where it does not help.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.effects.base import Acts, Curve, Form
from calibration.gap.evidence import Readout, Weighed, weigh
from calibration.machine import Array

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
    """The best of all curves for sizes within limits; each curve and each of its starts is as likely as any other."""
    found = [best for number, curve in enumerate(curves) if (best := _best(readout, number, curve, low, high))]
    return max(found, key=lambda one: one.log_evidence, default=None)


def _best(readout: Readout, number: int, curve: Curve, low: float, high: float) -> Refitted | None:
    known = [_Point.at(readout, number, curve, start, low, high) for start in curve.starts]
    starts = sorted((point for point in known if point is not None), key=lambda point: -point.value)
    ends = [_followed(readout, number, curve, point, low, high) for point in starts[:FOLLOWED]]
    if not ends:
        return None
    top = max(ends, key=lambda point: point.value)
    return Refitted(top.value - float(np.log(len(curve.starts))), top.weighed, top.acts)


def _followed(readout: Readout, number: int, curve: Curve, start: _Point, low: float, high: float) -> _Point:
    farthest = np.where(np.isfinite(curve.spread), curve.spread, FARTHEST)
    here, length = start, 1.0
    for _ in range(STEPS):
        there = np.clip(here.place + np.clip(length * here.step, -farthest, farthest), curve.low, curve.high)
        then = _Point.at(readout, number, curve, there, low, high)
        if then is not None and then.value > here.value + ENOUGH:
            here, length = then, min(1.0, 2.0 * length)
        else:
            length /= 3.0
            if length < SHORTEST:
                break
    return here


@dataclass(frozen=True)
class _Point:
    """A point of a curve: its log evidence with the prior of its parameters, and where its tangent leads."""

    place: Array
    value: float
    weighed: Weighed
    acts: tuple[Acts, ...]
    step: Array

    @classmethod
    def at(cls, readout: Readout, number: int, curve: Curve, place: Array, low: float, high: float) -> _Point | None:
        """None where the curve has no finite columns."""
        tangent = curve.tangent(place)
        if not all(np.all(np.isfinite(shape)) for act in tangent.acts for _, shape in act):
            return None
        form = Form(
            tuple(range(len(tangent.acts))),
            tangent.relative,
            curve=(number, tuple(place.tolist())),
        )
        weighed = weigh(readout.judge(tangent.acts), [form], low, high)[0]
        value = weighed.log_evidence - 0.5 * float(np.sum((place / curve.spread) ** 2))
        return cls(place, value, weighed, tangent.acts, tangent.step(weighed.coefficients))
