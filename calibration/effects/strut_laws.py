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

from calibration.effects.base import Curve, Setting, Tangent
from calibration.machine import Array

# Elongation in m beyond the linear spring's and its derivative, at tensions (n,); it grows with the tension from zero.
Law = Callable[[Array], tuple[Array, Array]]

MISFIT_M = 3.0e-4  # standard deviation of a strut's misfit
SHARE = 0.4  # of every parameter's column, relative to the size
ITERATIONS = 30
STEP = 0.02  # of a parameter of a law, for its derivative


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
        if restraint <= 1e-3 * self.stiffness_n_per_m:
            return [0.0]
        spread, mean = float(np.std(self.tension_n)), float(np.mean(self.tension_n))
        return [0.0, *((mean - middle * spread) / restraint for middle in middles)]

    def taken_up(self, law: Law, misfit_m: Array) -> tuple[Array, Array, Array]:
        """Its tension T (n,), its growth g(T) (n,) and 1 / (1 + r g'(T)). NaN where no tension was found."""
        free = self.tension_n + self.misfit @ misfit_m
        low, high, tension = np.minimum(free, 0.0), np.maximum(free, 0.0), 0.5 * free
        for _ in range(ITERATIONS):
            growth, slope = law(tension)
            over = tension + self.restraint_n_per_m * growth - free
            low, high = np.where(over < 0.0, tension, low), np.where(over >= 0.0, tension, high)
            newton = tension - over / (1.0 + self.restraint_n_per_m * slope)
            tension = np.where((newton > low) & (newton < high), newton, 0.5 * (low + high))
        growth, slope = law(tension)
        off = np.abs(tension + self.restraint_n_per_m * growth - free) > 1e-3 * (np.abs(free) + 1.0)
        return tension, np.where(off, np.nan, growth), 1.0 / (1.0 + self.restraint_n_per_m * slope)


def curve(
    held: Held,
    law: Callable[[Array], Law],
    starts: Sequence[Sequence[float]],
    limits: Sequence[tuple[float, float, float]],
    size: Callable[[Array, Array], float],
    misfit_unit_m: Callable[[Array], float],
    middles: Sequence[float],
    *,
    amplitude: bool,
) -> Curve:
    """The curve of a law at a strut.

    law: of its own parameters; starts: of those; limits: low, high and standard deviation of each. size: of the effect,
    from parameters and growth (n,). misfit_unit_m: of misfits that count. middles: mean tensions to start from, in
    standard deviations. amplitude: whether the first parameter is the logarithm of the size.
    """
    own, misfits = len(limits), held.misfit.shape[1]

    def tangent(at: Array) -> Tangent:
        parameters, misfit_m = at[:own], at[own:]
        tension, growth, kept = held.taken_up(law(parameters), misfit_m)
        big, unit = size(parameters, growth), misfit_unit_m(parameters)
        by = []
        for i in range(own):
            moved = parameters.copy()
            moved[i] += STEP
            by.append((law(moved)(tension)[0] - growth) / STEP * kept)
        columns = [growth, *by]
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(held.restraint_n_per_m > 0.0, (1.0 - kept) / held.restraint_n_per_m, 0.0)
        columns += list((slope[:, None] * held.misfit * unit).T)

        def step(coefficients: Array) -> Array:
            main = max(float(coefficients[0]), 0.2 * big)
            out = coefficients[1:] / main
            out[own:] *= unit
            if amplitude:
                out[0] += np.log(main / big)
            return np.asarray(out)

        acts = tuple(((held.channel, column / big),) for column in columns)
        return Tangent(acts, (1.0,) + (SHARE,) * (own + misfits), step)

    shifts = held.shifts_m(middles)
    rest = np.zeros(misfits - 1)
    return Curve(
        starts=np.array([[*start, shift, *rest] for start in starts for shift in shifts]),
        low=np.array([*(low for low, _, _ in limits), *[-5.0 * MISFIT_M] * misfits]),
        high=np.array([*(high for _, high, _ in limits), *[5.0 * MISFIT_M] * misfits]),
        spread=np.array([*(spread for *_, spread in limits), *[MISFIT_M] * misfits]),
        tangent=tangent,
    )


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
