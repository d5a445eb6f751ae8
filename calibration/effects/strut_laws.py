"""Nonlinear elongation of one strut within an otherwise linear elastic structure.

A strut elongates under the tension T by g(T) beyond its nominal stiffness, and the surrounding structure lets the
tension fall by r per metre: T = T0 - r g(T), where T0 is the tension of a linear strut (Thevenin's equivalent of the
structure at the strut; exact as long as everything else is linear). T0 itself is poorly known: it contains the preload,
which follows from misfits of all struts that the readings barely determine, so these misfits are parameters too.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calibration.base.arrays import Array
from calibration.effects.api import Curve, EffectInputs, Tangents

# From tensions (..., v) in N: elongation in m beyond the linear spring's, and its derivative; it rises from zero at
# zero.
ElongationLaw = Callable[[Array], tuple[Array, Array]]

MISFIT_TOLERANCES = 3.0  # standard deviation of a misfit, in tolerances of a strut's length: a loop sums up several
COLUMN_SHARE = 0.4  # standard deviation of every parameter's column, relative to the size
ITERATIONS = 40
SOLVED = 1e-9  # last step of a tension, over the typical one
DERIVATIVE_STEP = 0.02  # of a parameter, for the numerical derivative of a law
MOST_TENSION = 2.0  # over the typical one, up to which a compliance changes
MOST_WIDTHS = 1e4  # of a tension, beyond which a play is closed
LEAST_RATE = 1e-6  # of a compliance's change
LEAST_RESTRAINT = 1e-3  # over the strut's stiffness; with less the strut counts as unrestrained


@dataclass(frozen=True)
class RestrainedStrut:
    """A strut within the structure that restrains it, at each of the stands (v) where it differs.

    rows (v,): a reading of each stand; group (n,): the stand of each reading. tension_n (v,): as a linear strut;
    restraint_n_per_m (v,): tension lost per metre of elongation; misfit (v, j): change of the tension in N per metre of
    each misfit, the first of which is the strut's own length.
    """

    channel: str
    stiffness_n_per_m: float
    rows: NDArray[np.intp]
    group: NDArray[np.intp]
    tension_n: Array
    restraint_n_per_m: Array
    misfit: Array

    @classmethod
    def from_inputs(cls, inputs: EffectInputs, strut: int) -> RestrainedStrut:
        """A strut by its index. Misfits: lengths of all struts; its own in proportion to each drive and the payload."""
        response = inputs.tension_response_n_per_m[:, strut]
        differs = np.column_stack([inputs.tension_n[:, strut], response, inputs.context.drives, inputs.payload_ratio])
        _, rows, group = np.unique(differs, axis=0, return_index=True, return_inverse=True)
        response = response[rows]
        own = response[:, strut]
        order = [strut, *(i for i in range(response.shape[1]) if i != strut)]
        along_drives = [own * inputs.normalised_travel(drive)[rows] for drive in range(len(inputs.machine.drive_names))]
        return cls(
            f"length.{inputs.machine.strut_names[strut]}",
            float(inputs.machine.nominal.stiffness_n_per_m[strut]),
            rows,
            group.reshape(-1),  # numpy 2.0 returned another shape
            inputs.tension_n[rows, strut],
            np.maximum(-own, 0.0),
            np.column_stack([response[:, order], *along_drives, own * inputs.payload_ratio[rows]]),
        )

    @cached_property
    def typical_n(self) -> float:
        """RMS of its tension."""
        return max(float(np.sqrt(np.mean(self.tension_n**2))), 1.0)

    def starting_misfits_m(self, middles: Sequence[float]) -> list[float]:
        """Starts for its own misfit: zero, and those that put the mean tension at given standard deviations."""
        restraint = float(np.mean(self.restraint_n_per_m))
        if restraint <= LEAST_RESTRAINT * self.stiffness_n_per_m:
            return [0.0]
        spread, mean = float(np.std(self.tension_n)), float(np.mean(self.tension_n))
        return [0.0, *((mean - middle * spread) / restraint for middle in middles)]

    def solve_tension(self, law: ElongationLaw, misfit_m: Array) -> tuple[Array, Array, Array]:
        """Tension T (..., v), g'(T) and 1 / (1 + r g'(T)) for misfits (..., j), by Newton's method safeguarded with
        bisection."""
        free = self.tension_n + misfit_m @ self.misfit.T
        low, high, tension = np.minimum(free, 0.0), np.maximum(free, 0.0), 0.5 * free
        last_step = high - low
        tolerance_n = SOLVED * self.typical_n
        for _ in range(ITERATIONS):
            growth, slope = law(tension)
            imbalance = tension + self.restraint_n_per_m * growth - free
            low, high = np.where(imbalance < 0.0, tension, low), np.where(imbalance >= 0.0, tension, high)
            newton = tension - imbalance / (1.0 + self.restraint_n_per_m * slope)
            step = np.abs(newton - tension)
            solved = step <= tolerance_n  # then rounding alone may lead out of the limits
            accept = solved | ((newton >= low) & (newton <= high) & (step <= 0.5 * last_step))
            next_tension = np.where(accept, newton, 0.5 * (low + high))
            last_step, tension = np.abs(next_tension - tension), next_tension
            if np.all(solved):
                break
        slope = law(tension)[1]
        return tension, slope, 1.0 / (1.0 + self.restraint_n_per_m * slope)


def misfit_m(inputs: EffectInputs) -> float:
    """Standard deviation of a strut's misfit."""
    return MISFIT_TOLERANCES * inputs.machine.file.tolerances.strut_length_m


@dataclass(frozen=True)
class LawParameter:
    """A parameter of a law: limits, and prior standard deviation about zero (infinite if only the limits are known)."""

    low: float
    high: float
    spread: float = np.inf


def curve_of_law(
    strut: RestrainedStrut,
    law: Callable[[Array], ElongationLaw],
    parameters: Sequence[LawParameter],
    *,
    starts: Sequence[Sequence[float]],
    middles: Sequence[float],
    size: Callable[[Array], Array],
    misfit_unit_m: Callable[[Array], Array | float],
    misfit_m: float,
    form: str,
) -> Curve:
    """The curve of an elongation law at a strut.

    law: from its parameters (k, ..., 1), of which the first alone sets how much the strut elongates; starts: values of
    them to start from; middles: mean tensions to start from, in standard deviations. size: of the effect (..., 1), from
    the parameters. misfit_unit_m: unit in which misfits count; misfit_m: their standard
    deviation. form: name.
    """
    n, misfits = len(parameters), strut.misfit.shape[1]

    def tangents(points: Array) -> Tangents:
        at = points.T[:n, :, None]
        tension, slope, restraint_factor = strut.solve_tension(law(at), points[:, n:])
        growth, by_parameter = _growth_and_derivatives(law, at, tension)
        by_parameter *= restraint_factor
        size_here, unit_m = size(at), np.broadcast_to(misfit_unit_m(at), (len(points), 1))
        by_misfit = (slope * restraint_factor * unit_m)[:, None] * strut.misfit.T
        columns = np.concatenate([growth[:, None], by_parameter.transpose(1, 0, 2), by_misfit], axis=1)
        # Relative growth of the elongation with the first parameter.
        share = np.sum(growth * by_parameter[0], axis=1) / np.maximum(np.sum(growth**2, axis=1), 1e-300)

        units = np.concatenate([np.ones((len(points), n)), np.repeat(unit_m, misfits, axis=1)], axis=1)
        relative = (1.0,) + (COLUMN_SHARE,) * (n + misfits)
        sizes = np.column_stack([np.ones(len(points)), share])
        return Tangents(strut.channel, columns / size_here[:, None], relative, units, sizes, size_here[:, 0])

    low = np.array([*(p.low for p in parameters), *[-5.0 * misfit_m] * misfits])
    high = np.array([*(p.high for p in parameters), *[5.0 * misfit_m] * misfits])
    others = np.zeros(misfits - 1)
    all_starts = np.array([[*start, own, *others] for start in starts for own in strut.starting_misfits_m(middles)])
    spread = np.array([*(p.spread for p in parameters), *[misfit_m] * misfits])
    return Curve(
        np.unique(np.clip(all_starts, low, high), axis=0), low, high, spread, lambda point: tangents(point[None])[0],
        form, strut.group, tangents,
    )  # fmt: skip


def _growth_and_derivatives(law: Callable[[Array], ElongationLaw], at: Array, tension_n: Array) -> tuple[Array, Array]:
    """Elongation (m, v) of a law with parameters (k, m, 1), and its derivatives (k, m, v) by these."""
    steps = DERIVATIVE_STEP * np.eye(len(at), len(at) + 1, 1)[:, :, None, None]
    growth = law(at[:, None] + steps)(tension_n)[0]
    return growth[0], (growth[1:] - growth[0]) / DERIVATIVE_STEP


def saturating_law(clearance_m: Array | float, width_n: Array | float, power: Array | float) -> ElongationLaw:
    """Play to each side that closes along any curve: s / (1 + |s|^p)^(1/p), of s the tension over a width."""

    def law(tension: Array) -> tuple[Array, Array]:
        s = np.minimum(np.abs(tension / width_n), MOST_WIDTHS)
        open_share = 1.0 / (1.0 + s**power)
        return np.sign(tension) * clearance_m * s * open_share ** (1.0 / power), (
            clearance_m / width_n * open_share ** (1.0 + 1.0 / power)
        )

    return law


def series_spring(compliance_m_per_n: Array | float) -> ElongationLaw:
    """A linear spring in series."""

    def law(tension: Array) -> tuple[Array, Array]:
        return compliance_m_per_n * tension, compliance_m_per_n + 0.0 * tension

    return law


def smooth_spring(
    compliance_m_per_n: Array | float, tension_n: float, tilt: Array | float, bend: Array | float
) -> ElongationLaw:
    """A spring whose compliance is c exp(a s + b |s|), a function of s, the tension over `tension_n`, up to a limit."""

    def law(tension: Array) -> tuple[Array, Array]:
        s = tension / tension_n
        rate = np.where(s > 0.0, bend + tilt, bend - tilt)
        rate = np.where(np.abs(rate) < LEAST_RATE, LEAST_RATE, rate)  # the limit of no change
        size = np.minimum(np.abs(s), MOST_TENSION)
        compliance = compliance_m_per_n * np.exp(rate * size)
        grown = (compliance - compliance_m_per_n) / rate + compliance * (np.abs(s) - size)
        return np.sign(s) * tension_n * grown, compliance

    return law
