"""What is said of the causes that were found: size, places, probability, and what could be taken for them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from calibration.base.arrays import Array
from calibration.diagnosis.evidence import Readout
from calibration.diagnosis.linear_model import Baseline
from calibration.diagnosis.result import FoundEffect, Quantity
from calibration.diagnosis.search import Cause, Explanation, taken
from calibration.diagnosis.verdict import presence

EQUIVALENT_SIGMA = 0.3
TOLD_APART, TOLD_APART_SHARE = 10.0, 0.05  # of log evidence, by which the data do tell an effect from the first
COMPARED = 6  # effects that come next in the ranking are held against the first


def equivalents(found: Explanation, readout: Readout, verdict: str) -> tuple[tuple[str, ...], float]:
    """Effects that the readings do not exclude and whose prediction, calibration fitted again, is that of the first to
    0.3 sigma; the largest difference."""
    first = next((c for c in found.causes if c.effect.name == verdict), None)
    if first is None:
        return (), 0.0
    signal = np.einsum("nwk,k->nw", readout.columns(first.acts), first.best.coefficients)
    names, most = [], 0.0
    alone = next(c.log_evidence for c in found.ranking if c.effect.name == verdict)
    open_still = alone - TOLD_APART - TOLD_APART_SHARE * alone
    rivals = [c for c in found.ranking if c.effect.name != verdict and c.log_evidence > open_still]
    for other in rivals[:COMPARED]:
        left = taken(readout, other).apply(signal[:, :, None])[:, :, 0]
        apart = platform_rms(readout.baseline, left)
        if apart < EQUIVALENT_SIGMA:
            names.append(other.effect.name)
            most = max(most, apart)
    return tuple(names), most


def platform_rms(baseline: Baseline, whitened: Array) -> float:
    """RMS in sigma over the moving coordinates of the platform's readings."""
    moves = int(np.sum(baseline.machine.dof < 3))
    rows = baseline.on_platform
    return float(np.sqrt(np.sum(whitened[rows] ** 2) / (moves * max(int(rows.sum()), 1))))


def found_effect(cause: Cause, ranking: Mapping[str, float], readout: Readout, *, main: bool) -> FoundEffect:
    """A cause as it is told; `main`: it is the verdict."""
    best, effect = cause.best, cause.effect
    value, u = _size(cause)
    signal = np.einsum("nwk,k->nw", readout.columns(cause.acts), best.coefficients)
    known = {p.name: p for p in effect.others}
    others = tuple(
        Quantity(name, at, _u_of_parameter(name, at), known[name].unit)
        for name, at in best.form.parameters.items()
        if name in known
    )
    return FoundEffect(
        effect=effect.name,
        place=cause.place,
        size=Quantity(effect.size.name, value, u, effect.size.unit),
        probability=ranking[effect.name] if main else presence(cause, ranking),
        place_probability=cause.places[cause.place],
        raw_sigma=platform_rms(readout.baseline, signal),
        visible_sigma=platform_rms(readout.baseline, readout.apply(signal[:, :, None])[:, :, 0]),
        others=others,
    )


def _size(cause: Cause) -> tuple[float, float]:
    """Size of a cause in its best form and its standard uncertainty, by what its effect says of several columns."""
    best = cause.best
    if best.form.size:
        weights = np.array(best.form.size + (0.0,) * (len(best.coefficients) - len(best.form.size)))
        return float(weights @ best.coefficients), float(np.sqrt(weights @ best.covariance @ weights))
    main = [i for i, relative in enumerate(best.form.relative) if relative >= 1.0]
    some, covariance = best.coefficients[main], best.covariance[np.ix_(main, main)]
    if len(main) == 1:
        return float(some[0]), float(np.sqrt(covariance[0, 0]))
    norm = float(np.linalg.norm(some))
    u = float(np.sqrt(some @ covariance @ some)) / max(norm, 1e-300)
    if cause.effect.measured == "norm":
        return norm, u
    if cause.effect.measured == "sum":
        return float(np.sum(some)), float(np.sqrt(np.sum(covariance)))
    done: dict[str, Array] = {}
    for i, coefficient in zip(main, some, strict=True):
        channel, shape = cause.acts[i][0]
        done[channel] = done.get(channel, 0.0) + coefficient * shape
    each = [np.ptp(x) if cause.effect.measured == "range" else np.sqrt(np.mean(x**2)) for x in done.values()]
    value = float(np.linalg.norm(each))
    return value, u * value / max(norm, 1e-300)


def _u_of_parameter(name: str, at: float) -> float:
    """Forms are tried at steps: half a step is what is not told apart."""
    return 0.002 * at if name == "period_m" else 0.3 * at if name == "tau_s" else 120.0
