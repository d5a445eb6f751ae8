"""What a strut does that is not a linear spring, inside a structure that is one.

A strut with an elongation g(T) beyond that of its nominal stiffness yields to the tension T, and what holds it lets the
tension fall by r for each metre: T = T0 - r g(T), with the tension T0 that a linear strut would carry (Thevenin's
equivalent of the structure at the strut; exact as long as the rest is linear). T0 itself is known badly: it holds the
preload, which follows from misfits of all struts that readings hardly show, so those are parameters too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calibration.base.arrays import Array
from calibration.effects.api import Curve, Setting, Tangent

# Elongation in m beyond the linear spring's and its derivative, at tensions (n,); it grows with the tension from zero.
Law = Callable[[Array], tuple[Array, Array]]

MISFIT = 3.0  # standard deviation of a misfit, in tolerances of a strut's length: it sums up those of a loop
SHARE = 0.4  # of every parameter's column, relative to the size
ITERATIONS = 40
LEAST_SHARE = 0.5  # that is counted on when the first parameter is to make up for a size that does not fit
STEP = 0.02  # of a parameter of a law, for its derivative
LEAST_RESTRAINT = 1e-3  # over the strut's stiffness: with less the strut is as good as free


@dataclass(frozen=True)
class Held:
    """A strut in its structure: tension_n (n,) of a linear one, restraint_n_per_m (n,) of what holds it, misfit (n, j):
    change of the tension in N per metre of each misfit. The first misfit is the strut's own length."""

    channel: str
    stiffness_n_per_m: float
    tension_n: Array
    restraint_n_per_m: Array
    misfit: Array

    @classmethod
    def of(cls, s: Setting, strut: int) -> Held:
        """A strut of a setting. Misfits: lengths of all struts, and its own along the drives and with the payload."""
        answer = s.answer_n_per_m[:, strut]
        own = answer[:, strut]
        order = [strut, *(i for i in range(answer.shape[1]) if i != strut)]
        along = [own * s.along(drive) for drive in range(len(s.machine.drive_names))]
        return cls(
            f"length.{s.machine.strut_names[strut]}",
            float(s.machine.nominal.stiffness_n_per_m[strut]),
            s.tension_n[:, strut],
            np.maximum(-own, 0.0),
            np.column_stack([answer[:, order], *along, own * s.load]),
        )

    @property
    def typical_n(self) -> float:
        """RMS of its tension."""
        return max(float(np.sqrt(np.mean(self.tension_n**2))), 1.0)

    def shifts_m(self, middles: Sequence[float]) -> list[float]:
        """Misfits of its own to start from: none, and what puts its mean tension at so many standard deviations."""
        restraint = float(np.mean(self.restraint_n_per_m))
        if restraint <= LEAST_RESTRAINT * self.stiffness_n_per_m:
            return [0.0]
        spread, mean = float(np.std(self.tension_n)), float(np.mean(self.tension_n))
        return [0.0, *((mean - middle * spread) / restraint for middle in middles)]

    def taken_up(self, law: Law, misfit_m: Array) -> tuple[Array, Array, Array]:
        """Its tension T (n,), g'(T) (n,) and 1 / (1 + r g'(T)): Newton's steps, halving where they do not converge."""
        free = self.tension_n + self.misfit @ misfit_m
        low, high, tension = np.minimum(free, 0.0), np.maximum(free, 0.0), 0.5 * free
        last = high - low
        for _ in range(ITERATIONS):
            growth, slope = law(tension)
            over = tension + self.restraint_n_per_m * growth - free
            low, high = np.where(over < 0.0, tension, low), np.where(over >= 0.0, tension, high)
            newton = tension - over / (1.0 + self.restraint_n_per_m * slope)
            good = (newton >= low) & (newton <= high) & (np.abs(newton - tension) <= 0.5 * last)
            then = np.where(good, newton, 0.5 * (low + high))
            last, tension = np.abs(then - tension), then
        slope = law(tension)[1]
        return tension, slope, 1.0 / (1.0 + self.restraint_n_per_m * slope)


def misfit_m(s: Setting) -> float:
    """Standard deviation of a strut's misfit."""
    return MISFIT * s.machine.file.tolerances.strut_length_m


@dataclass(frozen=True)
class Range:
    """A parameter of a law: limits, and its standard deviation about zero (infinite if limits are all there is)."""

    low: float
    high: float
    spread: float = np.inf


def curve(
    held: Held,
    law: Callable[[Array], Law],
    parameters: Sequence[Range],
    starts: Sequence[Sequence[float]],
    middles: Sequence[float],
    size: Callable[[Array, Array], float],
    misfit_unit_m: Callable[[Array], float],
    misfit_m: float,
) -> Curve:
    """The curve of a law at a strut.

    law: of its own parameters, the first of which alone says how much it grows; starts: of those. middles: mean
    tensions to start from, in standard deviations. size: of the effect, from parameters and growth (n,).
    misfit_unit_m: of misfits that count; misfit_m: their standard deviation.
    """
    own, misfits = len(parameters), held.misfit.shape[1]

    def tangent(at: Array) -> Tangent:
        here = at[:own]
        tension, slope, kept = held.taken_up(law(here), at[own:])
        growth = law(here)(tension)[0]
        by = [(law(here + STEP * np.eye(own)[i])(tension)[0] - growth) / STEP * kept for i in range(own)]
        big, unit = size(here, growth), misfit_unit_m(here)
        columns = [growth, *by, *((slope * kept)[:, None] * held.misfit * unit).T]
        # By how much of itself it grows with the first parameter.
        share = float(growth @ by[0]) / max(float(growth @ growth), 1e-300)

        def step(coefficients: Array) -> Array:
            main = max(float(coefficients[0]), 0.2 * big)
            out = coefficients[1:] / main
            out[own:] *= unit
            out[0] += np.log(main / big) / (np.sign(share) * max(abs(share), LEAST_SHARE))
            return np.asarray(out)

        units = (1.0,) * own + (unit,) * misfits
        acts = tuple(((held.channel, column / big),) for column in columns)
        return Tangent(acts, (1.0,) + (SHARE,) * len(units), units, (1.0, share), step)

    low = np.array([*(p.low for p in parameters), *[-5.0 * misfit_m] * misfits])
    high = np.array([*(p.high for p in parameters), *[5.0 * misfit_m] * misfits])
    rest = np.zeros(misfits - 1)
    all_starts = np.array([[*start, shift, *rest] for start in starts for shift in held.shifts_m(middles)])
    spread = np.array([*(p.spread for p in parameters), *[misfit_m] * misfits])
    return Curve(np.unique(np.clip(all_starts, low, high), axis=0), low, high, spread, tangent)


def play(clearance_m: Array | float, width_n: float) -> Law:
    """Play to each side, taken up over a width of tension."""

    def law(tension: Array) -> tuple[Array, Array]:
        hypotenuse = np.hypot(tension, width_n)
        return clearance_m * tension / hypotenuse, clearance_m * width_n**2 / hypotenuse**3

    return law


def softer(compliance_m_per_n: Array | float) -> Law:
    """A spring in line."""

    def law(tension: Array) -> tuple[Array, Array]:
        return compliance_m_per_n * tension, compliance_m_per_n + 0.0 * tension

    return law


def slipping(compliance_m_per_n: float, tension_n: float, power: float) -> Law:
    """Gives way more and more above a tension."""

    def law(tension: Array) -> tuple[Array, Array]:
        grown = compliance_m_per_n * np.minimum(np.abs(tension / tension_n), 1e3) ** power
        return grown * tension, (power + 1.0) * grown

    return law


def one_way(compliance_m_per_n: float, side: float, width_n: float) -> Law:
    """A spring in line for tension (side 1) or compression (side -1) alone."""

    def law(tension: Array) -> tuple[Array, Array]:
        hypotenuse = np.hypot(tension, width_n)
        half = 0.5 * compliance_m_per_n
        return half * (tension + side * (hypotenuse - width_n)), half * (1.0 + side * tension / hypotenuse)

    return law
